//! `host-gen plant` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::{TITLE, write_words};
use crate::analysis::plant_matrices::PlantMatrices;

impl Display for PlantMatrices {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Generalised plant of {} (Fig. 4){TITLE:#}",
            self.machine
        )?;
        write_words(f, 2, "inputs:", &self.inputs)?;
        for kind in &self.kinds {
            let states = kind.a.len();
            let heading = format!("{} feedback: {states} states, outputs", kind.feedback);
            write_words(f, 2, &heading, &kind.outputs)?;
        }
        writeln!(
            f,
            "  The matrices: --format json, --mat FILE or --matrix-market FOLDER."
        )
    }
}
