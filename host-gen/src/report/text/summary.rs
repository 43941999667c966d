//! `host-gen generate` and `host-gen simulate` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::{TITLE, WARNING};
use super::gains::write_gains;
use super::loops::{write_design, write_simulation};
use crate::report::summary::{GenerateSummary, SimulateSummary};

impl Display for SimulateSummary {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{TITLE}Loop of {}{TITLE:#}", self.machine)?;
        write_design(f, &self.shaped)?;
        write_simulation(f, &self.simulation)
    }
}

impl Display for GenerateSummary {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.modes)?;
        write_gains(&self.gains, f)?;
        writeln!(f)?;
        write_design(f, &self.shaped)?;
        writeln!(f)?;
        write_simulation(f, &self.simulation)?;
        if !self.not_published.is_empty() {
            writeln!(
                f,
                "\n{TITLE}Not published, but reconstructed or assumed{TITLE:#}"
            )?;
        }
        for statement in &self.not_published {
            writeln!(
                f,
                "  {:<14} {}\n{:17}{}",
                statement.kind,
                statement.entries.join(", "),
                "",
                statement.from
            )?;
        }
        for warning in &self.warnings {
            writeln!(f, "\n{WARNING}Warning:{WARNING:#} {warning}")?;
        }
        writeln!(f, "\nTable written to {}", self.table)
    }
}
