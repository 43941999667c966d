//! Designs and simulations in text.

use std::fmt::{self, Formatter};

use super::aligned::{TITLE, WARNING, cells, write_table};
use crate::control::shape::Filter;
use crate::design::{Design, Shaping};
use crate::simulate::run::Comparison;

pub(super) fn write_design(f: &mut Formatter<'_>, r: &Design) -> fmt::Result {
    writeln!(f, "{TITLE}Shaping on the sampled, delayed loop{TITLE:#}")?;
    match &r.shaping {
        Shaping::Common { corner_hz } => {
            writeln!(f, "  all channels: low-pass {corner_hz} Hz")?;
        }
        Shaping::Modes { shapes } => {
            let split = shapes.iter().any(|shape| shape.split_hz.is_some());
            writeln!(
                f,
                "  mode     zeros, Hz  damping     poles, Hz  damping{}",
                if split { "   split, Hz" } else { "" }
            )?;
            for (i, shape) in shapes.iter().enumerate() {
                for (j, Filter { zeros, poles }) in shape.sections.iter().enumerate() {
                    let mode = if j == 0 {
                        (i + 1).to_string()
                    } else {
                        String::new()
                    };
                    write!(
                        f,
                        "  {mode:>4} {:>13.2} {:>8.3} {:>13.2} {:>8.3}",
                        zeros.hz, zeros.damping, poles.hz, poles.damping
                    )?;
                    if let (0, Some(hz)) = (j, shape.split_hz) {
                        write!(f, " {hz:>11.1}")?;
                    }
                    writeln!(f)?;
                }
            }
        }
    }
    writeln!(
        f,
        "  AC coupling {:.4} Hz (second order), leak {:.4} Hz",
        r.ac_coupling_hz, r.leak_hz
    )?;
    writeln!(
        f,
        "  stable; peak sensitivity {:.3} at {:.4} Hz (at the legs {:.3}, at the sensors {:.3}); slowest pole {:.3} 1/s",
        r.peak_sensitivity.value,
        r.peak_sensitivity.at,
        r.peak_sensitivity.at_legs,
        r.peak_sensitivity.at_sensors,
        r.slowest_decay
    )?;
    if let Some(used) = r.roll_off {
        writeln!(
            f,
            "  at high frequency, σ_max(T) reaches {:.3} of the limit of control.roll_off, at {:.0} Hz",
            used.part, used.at
        )?;
    }
    if !r.soft_start {
        writeln!(
            f,
            "  {WARNING}Warning:{WARNING:#} the loop is not stable at every gain of the soft start."
        )?;
    }
    if let Some(drawn) = r.drawn {
        writeln!(
            f,
            "  on randomly perturbed machines: stable on {} of {}, peak sensitivity up to {:.3}",
            drawn.stable, drawn.samples, drawn.peak_sensitivity
        )?;
    }
    writeln!(
        f,
        "  isolates from {:.2} Hz (ideal loop: from {:.2} Hz)",
        r.isolation_from_hz, r.isolation_from_ideal_hz
    )?;
    if let Some(below) = r.below {
        writeln!(
            f,
            "  below {} Hz, the loop raises σ_max(G11) by at most {:.1} dB, at {:.2} Hz",
            below.high_hz, below.db, below.hz
        )?;
    }
    let bands = r.bands.iter().map(|band| {
        let mut row = vec![
            band.name.clone(),
            format!("{} to {} Hz", band.low_hz, band.high_hz),
        ];
        let cost = band.sampled_db - band.ideal_db;
        row.extend([
            level(band.open_db, "undamped"),
            level(band.ideal_db, "unstable"),
            level(band.sampled_db, "undamped"),
            level(cost, "-"),
        ]);
        row
    });
    if r.bands.is_empty() {
        return Ok(());
    }
    writeln!(f, "  Highest peak of σ_max(G11), dB")?;
    let head = cells(["", "", "open", "ideal", "sampled", "sampled minus ideal"]);
    write_table(f, 4, 2, [head].into_iter().chain(bands))
}

/// A level, dB, or why it is none.
fn level(db: f64, otherwise: &str) -> String {
    if db.is_finite() {
        format!("{db:.1}")
    } else {
        otherwise.to_owned()
    }
}

pub(super) fn write_simulation(f: &mut Formatter<'_>, s: &Comparison) -> fmt::Result {
    let [low, high] = s.floor_band_hz;
    let floor = match &s.record {
        Some(name) => name.clone(),
        None => format!(
            "of {:.1e} m/s² rms along each axis, {low} to {high} Hz",
            s.floor_rms
        ),
    };
    writeln!(
        f,
        "{TITLE}Software in the loop: {} s on a floor {floor}, seed {}{TITLE:#}",
        s.duration_s, s.seed
    )?;
    let head = cells([
        "m/s²",
        "rms open",
        "rms closed",
        "peak open",
        "peak closed",
        "rms, dB",
    ]);
    let rows = s.outputs.iter().enumerate().map(|(i, name)| {
        let [open, closed] = [&s.open, &s.closed];
        let mut row = vec![name.clone()];
        let values = [open.rms[i], closed.rms[i], open.peak[i], closed.peak[i]];
        row.extend(values.map(|x| format!("{x:.3e}")));
        row.push(format!(
            "{:.1}",
            20.0 * (closed.rms[i] / open.rms[i]).log10()
        ));
        row
    });
    write_table(f, 2, 1, [head].into_iter().chain(rows))?;
    writeln!(
        f,
        "  largest leg force {:.1} N; clamp active in {}, sensor at a rail in {} of {} steps",
        s.closed.force_peak, s.closed.clamped_steps, s.closed.railed_steps, s.closed.steps
    )?;
    if s.closed.clamped_steps > 0 {
        writeln!(
            f,
            "  {WARNING}Warning:{WARNING:#} the legs reached their force limits, so the loop did not always act as designed."
        )?;
    }
    Ok(())
}
