//! `host-gen plant`.

use std::fs;
use std::path::PathBuf;

use clap::Args;
use host_gen::analysis::mat_file::{MatFileError, mat_file};
use host_gen::analysis::plant_matrices::PlantMatrices;
use host_gen::analysis::warnings::warnings;
use host_gen::design::Study;
use host_gen::plant::export::{Generalised, matrix_market, plain_text};

use crate::arguments::Common;
use crate::failure::{Failure, in_loop};
use crate::files::write_whole;
use crate::print;
use crate::search::{Searcher, study};

#[derive(Args)]
pub struct PlantArguments {
    #[command(flatten)]
    common: Common,
    /// File for MATLAB, Octave and SciPy (.mat) with plant, sampled plant, gains, controller, poles and
    /// frequency responses, see docs/json.md. The controller is searched for.
    #[arg(long, value_name = "FILE")]
    mat: Option<PathBuf>,
    /// Folder for A, B, C and D, for each kind of feedback: as Matrix Market files (.mtx), and
    /// as plain text (.txt) for Octave, MATLAB and Julia; and names and units of the signals (.csv).
    #[arg(long, value_name = "FOLDER")]
    matrix_market: Option<PathBuf>,
}

pub fn plant(arguments: &PlantArguments, searcher: &Searcher) -> Result<(), Failure> {
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
        let write = |name: String, text: &str| write_whole(&folder.join(name), text.as_bytes());
        for study in Study::of_each_kind(machine)? {
            let Generalised { a, b, c, d } = Generalised::new(&study.plant().plant);
            let kind = study.design_model().feedback.name();
            for (name, matrix) in [("A", a), ("B", b), ("C", c), ("D", d)] {
                write(format!("{kind}-{name}.mtx"), &matrix_market(&matrix))?;
                write(format!("{kind}-{name}.txt"), &plain_text(&matrix))?;
            }
        }
        for (kind, signals) in report.signals() {
            write(format!("{kind}-signals.csv"), &signals)?;
        }
    }
    if let Some(path) = &arguments.mat {
        let design = searcher.design(model, &study)?;
        let bytes = mat_file(&study, design).map_err(|error| match error {
            MatFileError::Numeric(error) => in_loop(model)(error),
            MatFileError::TooLarge(error) => Failure::Mat {
                path: path.display().to_string(),
                error,
            },
        })?;
        write_whole(path, &bytes)?;
    }
    print::warned(*format, &report, &warnings(&study))
}
