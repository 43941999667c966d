//! `host-gen design` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::TITLE;
use super::bound::{BANDS, write_room};
use super::loops::write_design;
use super::shapes::write_shapes;
use crate::analysis::actuators::Actuators;
use crate::analysis::controller::DesignAnalysis;
use crate::analysis::delay::DelayBudget;
use crate::analysis::rounding::Rounding;
use crate::design::Shaping;

impl Display for DesignAnalysis {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Design of {}, {} feedback{TITLE:#}",
            self.machine, self.feedback
        )?;
        write_design(f, &self.shaped)?;
        if let Some(room) = &self.room {
            write_room(f, BANDS, room)?;
        }
        if let Some(room) = &self.rms_room {
            write_room(f, "The rms", room)?;
        }
        self.floor.write_together(f)?;
        let micro = |s: f64| 1e6 * s;
        let DelayBudget {
            latch,
            hold,
            amplifier,
            sensor,
            whole,
            in_hold,
            middle,
        } = &self.delay;
        writeln!(
            f,
            "{TITLE}Delay, µs:{TITLE:#} sample to latch {:.1}, hold {:.1}, amplifier {:.1}, sensor {:.1}; total {:.1}",
            micro(*latch),
            micro(*hold),
            micro(*amplifier),
            micro(*sensor),
            micro(*whole)
        )?;
        write!(
            f,
            "  a sample lies at {in_hold:.2} of the hold of the force that it measures"
        )?;
        if (in_hold - 0.5).abs() < 0.005 {
            writeln!(f)?;
        } else {
            writeln!(
                f,
                ", in its middle with {:.1} µs from sample to latch",
                micro(*middle)
            )?;
        }
        write_actuators(f, &self.actuators)?;
        writeln!(
            f,
            "{TITLE}How each mode follows the floor motion in its own shape{TITLE:#}"
        )?;
        write!(
            f,
            "                    corner  highest            attenuation, dB"
        )?;
        for hz in self.isolation_at_hz {
            write!(f, " {hz:>5} Hz")?;
        }
        writeln!(f)?;
        for mode in &self.modes {
            writeln!(f, "  {:.2} Hz", mode.hz)?;
            let rows = [
                ("open", Some(&mode.open)),
                ("ideal", mode.ideal.as_ref()),
                ("sampled", Some(&mode.sampled)),
            ];
            for (name, isolation) in rows {
                let Some(i) = isolation else {
                    writeln!(f, "    {name:<10} unstable")?;
                    continue;
                };
                write!(
                    f,
                    "    {name:<10} {:>8.2} Hz {:>6.1} dB at {:>5.2} Hz        ",
                    i.corner_hz, i.peak_db, i.peak_hz
                )?;
                for db in i.db {
                    write!(f, " {db:>8.1}")?;
                }
                writeln!(f)?;
            }
        }
        writeln!(
            f,
            "{TITLE}Disk margins{TITLE:#}          α     gain    phase"
        )?;
        let margins = self.margins.modes.iter().enumerate();
        let all = margins
            .map(|(k, margin)| (format!("mode {}", k + 1), margin))
            .chain([("all modes at once".to_owned(), &self.margins.together)]);
        for (name, margin) in all {
            writeln!(
                f,
                "  {name:<16} {:>5.2}   ×{:>5.2}   ±{:>4.1}°",
                margin.disk, margin.gain, margin.phase_deg
            )?;
        }
        let bode = &self.margins.bode;
        writeln!(
            f,
            "{TITLE}Bode's integral, mean of the modes, delay of {} sample{}:{TITLE:#} {:.0} Hz of attenuation, {:.0} Hz of amplification;",
            bode.delay_samples,
            if bode.delay_samples == 1 { "" } else { "s" },
            bode.attenuation_hz,
            bode.amplification_hz
        )?;
        writeln!(
            f,
            "  amplification by the bound wherever the loop amplifies would be {:.0} Hz: {:.0} % of that is used",
            bode.limit_hz,
            100.0 * bode.amplification_hz / bode.limit_hz
        )?;
        write!(f, "Single precision relative to sensor noise, dB:")?;
        for Rounding {
            hz, over_noise_db, ..
        } in &self.rounding
        {
            write!(f, " {over_noise_db:.0} at {hz:.0} Hz")?;
        }
        if self.rounding.iter().any(|found| found.over_noise_db > 0.0) {
            write!(
                f,
                "\n  Warning: the errors of single precision exceed the sensors' noise: the board's loop is not the one that is computed here."
            )?;
        }
        write!(f, "\nCodes of the DAC relative to sensor noise, dB:")?;
        for Rounding {
            hz,
            codes_over_noise_db,
            ..
        } in &self.rounding
        {
            write!(f, " {codes_over_noise_db:.0} at {hz:.0} Hz")?;
        }
        writeln!(f)?;
        if !self.chart.is_empty() {
            write!(f, "Other boards, roughly   delay    in hold")?;
            for band in &self.shaped.bands {
                write!(f, " {:>14}", band.name)?;
            }
            writeln!(f)?;
        }
        for cell in &self.chart {
            write!(
                f,
                "  {:>8.0} Hz     {:>6.1} µs {:>10.2}  ",
                cell.sample_rate,
                micro(cell.whole_delay),
                cell.in_hold
            )?;
            for db in &cell.sampled_db {
                write!(f, " {db:>11.1} dB")?;
            }
            if cell.sampled_db.is_empty() {
                write!(f, " unreachable")?;
            }
            writeln!(f)?;
        }
        if let Shaping::Modes { shapes } = &self.shaped.shaping {
            write_shapes(f, &shapes[..])?;
        }
        Ok(())
    }
}

fn write_actuators(f: &mut Formatter<'_>, actuators: &Actuators) -> fmt::Result {
    let Actuators {
        gain,
        limit,
        stroke,
        full_force_hz,
        hysteresis,
        warning,
    } = actuators;
    // Four digits.
    let decimals = (3.0 - gain.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    write!(
        f,
        "{TITLE}Actuators:{TITLE:#} {gain:.decimals$} N/V at the DAC, at most ±{limit:.0} N"
    )?;
    if let Some(stroke) = stroke {
        write!(f, " or ±{:.2} µm of free expansion", 1e6 * stroke)?;
    }
    if let Some(hz) = full_force_hz {
        write!(f, "; the amplifier's current allows that up to {hz:.1} Hz")?;
    }
    writeln!(f)?;
    if hysteresis.is_empty() {
        return Ok(());
    }
    writeln!(
        f,
        "  hysteresis, by its describing function   gain     lag   peak sensitivity"
    )?;
    for at in hysteresis {
        writeln!(
            f,
            "    sine of {:>9.2} N                  {:>6.3}  {:>5.2}°  {:>6.2}",
            at.force, at.gain, at.lag_deg, at.peak_sensitivity
        )?;
    }
    if let Some(warning) = warning {
        writeln!(f, "  Warning: {warning}.")?;
    }
    Ok(())
}
