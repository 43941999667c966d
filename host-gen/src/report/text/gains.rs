//! `host-gen gains` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::{TITLE, write_table};
use crate::analysis::Rows;
use crate::analysis::gains::GainAnalysis;
use crate::closed_loop::Pole;

fn write_rows(f: &mut Formatter<'_>, title: &str, rows: &Rows) -> fmt::Result {
    writeln!(f, "{title}")?;
    // Entries that are zero by symmetry differ from zero by rounding.
    let largest = rows.iter().flatten().fold(0.0, |m: f64, x| m.max(x.abs()));
    for row in rows {
        for x in row {
            let x = if x.abs() < 1e-12 * largest { 0.0 } else { *x };
            write!(f, "{x:>13.4e}")?;
        }
        writeln!(f)?;
    }
    Ok(())
}

/// The gains alone.
pub(super) fn write_gains(all: &GainAnalysis, f: &mut Formatter<'_>) -> fmt::Result {
    let (p, i) = if all.feedback == "force" {
        ("K_P, Eq. (22)", "K_I, 1/s, Eq. (22)")
    } else {
        ("K_a, N/(m/s²), Eq. (19)", "K_v, N/(m/s), Eq. (20)")
    };
    writeln!(
        f,
        "{TITLE}Gains for {} feedback, {} Hz, damping {}{TITLE:#}",
        all.feedback, all.frequency_hz, all.damping
    )?;
    for (title, gains) in [(p, &all.proportional), (i, &all.integral)] {
        let head = [title.to_owned()].into_iter().chain(all.sensors.clone());
        let rows = all.actuators.iter().zip(gains).map(|(leg, row)| {
            let gains = row.iter().map(|x| format!("{x:.4e}"));
            [leg.clone()].into_iter().chain(gains).collect()
        });
        write_table(f, 2, 1, [head.collect()].into_iter().chain(rows))?;
    }
    Ok(())
}

fn write_poles(f: &mut Formatter<'_>, title: &str, poles: &[Pole]) -> fmt::Result {
    writeln!(f, "{title}")?;
    // One of each conjugate pair.
    for pole in poles.iter().filter(|pole| pole.im >= 0.0) {
        writeln!(f, "  {:>10.4} Hz  damping {:>8.4}", pole.hz, pole.damping)?;
    }
    Ok(())
}

impl Display for GainAnalysis {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Design model of {}: {}{TITLE:#}",
            self.machine, self.reduction
        )?;
        write_rows(f, "  M_d, kg, Eq. (13)", &self.mass)?;
        write_rows(f, "  K_d, N/m, Eq. (13)", &self.stiffness)?;
        write_rows(f, "  T_c, Eq. (15)", &self.sensing)?;
        write_rows(f, "  S, 1/√kg, Eq. (17)", &self.modal)?;
        write_gains(self, f)?;
        write_poles(
            f,
            "  Ideal loop on the design model:",
            &self.ideal_poles_rigid,
        )?;
        write_poles(
            f,
            "  Ideal loop on the flexible machine:",
            &self.ideal_poles_flexible,
        )
    }
}
