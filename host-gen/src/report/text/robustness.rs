//! `host-gen robust` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::{TITLE, write_words};
use crate::analysis::robustness::{RobustnessAnalysis, Spread};

impl Display for RobustnessAnalysis {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let r = &self.result;
        writeln!(
            f,
            "{TITLE}The controller of {} on {} randomly perturbed machines{TITLE:#}",
            self.machine, r.samples
        )?;
        let varied = format!(
            "mass ±{:.0} %, centre of gravity ±{:.0} mm; legs ±{:.0} %; damping ±{:.0} %; sensors ±{} %, ±{}°; actuators ±{} %; delay ±{} µs; seed {}",
            100.0 * self.mass,
            1e3 * self.cog,
            100.0 * self.leg_stiffness,
            100.0 * self.damping,
            short(100.0 * self.sensor_gain),
            short(self.misalignment),
            short(100.0 * self.actuator_gain),
            short(1e6 * self.delay),
            self.seed
        );
        let varied = format!("{} {varied}", self.payload.join(", "));
        let words: Vec<String> = varied.split_whitespace().map(str::to_owned).collect();
        write_words(f, 2, "payload", &words)?;
        writeln!(f, "  stable on {} of {}", r.stable, r.samples)?;
        writeln!(f, "{:34}   lowest    nominal    highest", "")?;
        let line = |f: &mut Formatter<'_>, title: &str, s: &Spread| {
            writeln!(
                f,
                "  {title:<30} {:>10.3} {:>10.3} {:>10.3}",
                s.min, s.nominal, s.max
            )
        };
        line(f, "peak sensitivity", &r.peak_sensitivity)?;
        line(f, "isolates from, Hz", &r.isolation_from_hz)?;
        line(f, "lowest damping of any pole", &r.lowest_damping)?;
        for band in &r.bands {
            line(
                f,
                &format!("σ_max(G11), {}, dB", band.name),
                &band.sampled_db,
            )?;
        }
        for (title, list) in [("mode, open", &r.open), ("pole, ideal", &r.ideal)] {
            for (i, moving) in list.iter().enumerate() {
                line(f, &format!("{title} {}, Hz", i + 1), &moving.hz)?;
            }
        }
        for (i, moving) in r.ideal.iter().enumerate() {
            line(
                f,
                &format!("pole, ideal {}, damping", i + 1),
                &moving.damping,
            )?;
        }
        Ok(())
    }
}

/// A number with at most three decimals, without those that are zero.
fn short(x: f64) -> f64 {
    (1e3 * x).round() / 1e3
}
