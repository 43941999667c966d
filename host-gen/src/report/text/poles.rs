//! `host-gen poles` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::TITLE;
use crate::analysis::poles::PoleAnalysis;

impl Display for PoleAnalysis {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Poles of {}, {} feedback{TITLE:#}",
            self.machine, self.feedback
        )?;
        let length = self
            .open
            .len()
            .max(self.ideal.len())
            .max(self.sampled.len());
        writeln!(
            f,
            "        open: Hz  damping      ideal: Hz  damping    sampled: Hz  damping"
        )?;
        for i in 0..length {
            for list in [&self.open, &self.ideal, &self.sampled] {
                match list.get(i) {
                    Some(pole) => write!(f, "    {:>12.4} {:>8.4}", pole.hz, pole.damping)?,
                    None => write!(f, "{:25}", "")?,
                }
            }
            writeln!(f)?;
        }
        writeln!(
            f,
            "  The sampled loop is {}.",
            if self.stable { "stable" } else { "unstable" }
        )
    }
}
