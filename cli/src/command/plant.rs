//! `host-gen plant`.

use std::fs;
use std::path::PathBuf;

use clap::Args;
use host_gen::analysis::plant_matrices::PlantMatrices;
use host_gen::analysis::warnings::warnings;
use host_gen::design::Study;
use host_gen::plant::export::{Generalised, matrix_market, plain_text};

use crate::arguments::Common;
use crate::failure::Failure;
use crate::files::write_whole;
use crate::print;
use crate::search::study;

#[derive(Args)]
pub struct PlantArguments {
    #[command(flatten)]
    common: Common,
    /// Folder for A, B, C and D, for each kind of feedback: as Matrix Market files (.mtx), and
    /// as plain text (.txt) for Octave, MATLAB and Julia.
    #[arg(long)]
    matrix_market: Option<PathBuf>,
}

pub fn plant(arguments: &PlantArguments) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let study = study(model)?;
    let machine = study.machine();
    let report = PlantMatrices::new(machine)?;
    if let Some(folder) = &arguments.matrix_market {
        fs::create_dir_all(folder).map_err(|error| Failure::Io {
            path: folder.display().to_string(),
            what: "created",
            error,
        })?;
        for study in Study::of_each_kind(machine)? {
            let Generalised { a, b, c, d } = Generalised::new(&study.plant().plant);
            let kind = study.design_model().feedback.name();
            for (name, matrix) in [("A", a), ("B", b), ("C", c), ("D", d)] {
                let path = |ending| folder.join(format!("{kind}-{name}.{ending}"));
                write_whole(&path("mtx"), matrix_market(&matrix).as_bytes())?;
                write_whole(&path("txt"), plain_text(&matrix).as_bytes())?;
            }
        }
    }
    print::warned(*format, &report, &warnings(&study))
}
