//! `host-gen plant` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::TITLE;
use crate::analysis::plant_matrices::PlantMatrices;

impl Display for PlantMatrices {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Generalised plant of {} (Fig. 4){TITLE:#}",
            self.machine
        )?;
        writeln!(f, "  inputs: {}", self.inputs.join(" "))?;
        for kind in &self.kinds {
            writeln!(
                f,
                "  {} feedback: {} states, outputs {}",
                kind.feedback,
                kind.a.len(),
                kind.outputs.join(" ")
            )?;
        }
        writeln!(
            f,
            "  The matrices: --format json, or --matrix-market FOLDER."
        )
    }
}
