//! `host-gen floor` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::{TITLE, WARNING, cells, write_table};
use crate::analysis::floors::{FloorAnalysis, SourceShares};

/// An rms in the unit in which it is shown: where that is not the unit of the result, the numbers are
/// neither large nor small, and need no power of ten.
fn shown(rms: &SourceShares) -> String {
    let x = rms.shown_rms;
    if rms.shown_unit == rms.unit || !(1e-3..1e6).contains(&x) {
        return format!("{x:.2e}");
    }
    let decimals = (2.0 - x.log10().floor()).max(0.0) as usize;
    format!("{x:.decimals$}")
}

impl FloorAnalysis {
    /// Writes the rms values of both sides.
    fn write_rms(&self, f: &mut Formatter<'_>, sides: [&[SourceShares]; 2]) -> fmt::Result {
        let mut head = cells(["rms", "unit", "open", "closed"]);
        head.extend(self.sources.map(|source| format!("from {source}")));
        let [open, closed] = sides;
        let rows = open.iter().zip(closed).map(|(open, closed)| {
            let mut row = cells([&closed.name, closed.shown_unit]);
            row.extend([open, closed].map(shown));
            row.extend(closed.shares.map(|share| format!("{:.1} %", 100.0 * share)));
            row
        });
        write_table(f, 2, 2, [head].into_iter().chain(rows))?;
        writeln!(
            f,
            "  The shares are those of the power with the loop closed."
        )
    }

    /// Writes what is measured of all performance outputs together.
    pub(super) fn write_together(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Performance on the floor {}, {} to {} Hz, all outputs together{TITLE:#}",
            self.floor, self.low_hz, self.high_hz
        )?;
        self.write_rms(f, [&self.open.together, &self.closed.together])
    }
}

impl Display for FloorAnalysis {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}{} on the floor {}, {} to {} Hz, {} feedback{TITLE:#}",
            self.machine, self.floor, self.low_hz, self.high_hz, self.feedback
        )?;
        self.write_rms(f, [&self.open.rms, &self.closed.rms])?;
        if !self.closed.thirds.is_empty() {
            writeln!(
                f,
                "  Frame velocity in one-third octaves, worst of x, y, z, µm/s\n        Hz       open     closed   main source, closed"
            )?;
        }
        for (open, closed) in self.open.thirds.iter().zip(&self.closed.thirds) {
            writeln!(
                f,
                "    {:>6.1} {:>10.4} {:>10.4}   {}",
                closed.hz,
                1e6 * open.velocity,
                1e6 * closed.velocity,
                closed.dominant
            )?;
        }
        if !self.judged.is_empty() {
            writeln!(
                f,
                "  The frame meets {} without control and {} with control.",
                self.meets(&self.open),
                self.meets(&self.closed)
            )?;
        }
        writeln!(
            f,
            "  With control a leg needs up to {:.1} N rms; three sigma are {:.0} N, the limit is {:.0} N.",
            self.legs.rms, self.legs.three_sigma, self.legs.limit
        )?;
        for warning in &self.warnings {
            writeln!(f, "  {WARNING}Warning:{WARNING:#} {warning}.")?;
        }
        Ok(())
    }
}
