//! `host-gen fit` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::{TITLE, WARNING, cells, write_table, write_words};
use crate::identify::{Estimate, Identification};

impl Display for Identification {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Changes of the file's values, and half their intervals of 95 %{TITLE:#}"
        )?;
        let rows = self.estimates.iter().filter(|estimate| estimate.determined);
        let rows = rows.map(change_cells);
        let head = cells(["", "change", "±", ""]);
        write_table(f, 2, 1, std::iter::once(head).chain(rows))?;
        let left = self
            .estimates
            .iter()
            .filter(|estimate| !estimate.determined);
        let left: Vec<_> = left.map(|estimate| format!("{};", estimate.name)).collect();
        if !left.is_empty() {
            write_words(f, 2, "The measurement says little about:", &left)?;
        }
        for group in &self.alike {
            let names: Vec<_> = group.iter().map(|name| format!("{name};")).collect();
            write_words(f, 2, "Known only together:", &names)?;
        }
        writeln!(
            f,
            "  The errors that are left are {:.2} times those expected from the noise.",
            self.relative_misfit
        )?;
        writeln!(f, "{TITLE}Difference from the measured plant, %{TITLE:#}")?;
        let head = cells(["Hz", "before", "fitted", "noise"]);
        let rows = self.lines.iter().map(|line| {
            let percent = |x: f64| format!("{:.2}", 100.0 * x);
            vec![
                format!("{:.2}", line.hz),
                percent(line.before),
                percent(line.error),
                percent(line.expected),
            ]
        });
        write_table(f, 2, 0, std::iter::once(head).chain(rows))?;
        for estimate in self.estimates.iter().filter(|estimate| estimate.far) {
            writeln!(
                f,
                "{WARNING}warning:{WARNING:#} {} is {:.1} standard deviations from the file's value: either the file is wrong there, or something else that is not uncertain in it; see [uncertainty]",
                estimate.name,
                estimate.deviations.abs()
            )?;
        }
        for resonance in &self.strange {
            writeln!(
                f,
                "{WARNING}warning:{WARNING:#} the machine has a resonance at {:.2} Hz with a damping of {:.2} % that the model has not: something that moves is missing in the file",
                resonance.hz,
                100.0 * resonance.damping
            )?;
        }
        if !self.unexplained.is_empty() {
            writeln!(
                f,
                "{WARNING}warning:{WARNING:#} the model does not explain the measurement at {}: a sensor may be at another place, or something is missing in the file",
                hertz(&self.unexplained)
            )?;
        }
        Ok(())
    }
}

/// A fitted quantity in a row of a table: name, change, half its interval, unit.
pub fn change_cells(estimate: &Estimate) -> Vec<String> {
    let (factor, unit) = estimate.scale.shown();
    vec![
        estimate.name.clone(),
        format!("{:+.3}", factor * estimate.change),
        format!("{:.3}", factor * estimate.interval),
        unit.to_owned(),
    ]
}

/// Frequencies as text.
fn hertz(all: &[f64]) -> String {
    let all: Vec<_> = all.iter().map(|hz| format!("{hz:.2}")).collect();
    format!("{} Hz", all.join(", "))
}
