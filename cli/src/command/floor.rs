//! `host-gen floor`.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use host_gen::analysis::criterion::Criterion;
use host_gen::analysis::floors::FloorAnalysis;
use host_gen::analysis::vibration::{Floor, SpectrumError, both_budgets};

use crate::arguments::{Common, band, criterion, within};
use crate::failure::{Failure, in_loop};
use crate::print;
use crate::search::{Searcher, study, warnings};

#[derive(Args)]
pub struct FloorArguments {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    floor: FloorChoice,
    /// Lowest frequency, Hz.
    #[arg(long, default_value_t = 0.5)]
    from: f64,
    /// Highest frequency, Hz.
    #[arg(long, default_value_t = 300.0)]
    to: f64,
}

#[derive(Args)]
#[group(required = true, multiple = false)]
struct FloorChoice {
    /// Floor at the limit of this vibration criterion.
    #[arg(long, value_parser = criterion())]
    criterion: Option<Criterion>,
    /// White acceleration of each floor input, m/s²/√Hz.
    #[arg(long)]
    white: Option<f64>,
    /// Text file with a floor spectrum. Each line has a frequency, Hz, ascending, and an
    /// acceleration density, m/s²/√Hz; # starts a comment.
    #[arg(long)]
    spectrum: Option<PathBuf>,
}

pub fn floor(arguments: &FloorArguments, searcher: &Searcher) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let band = band(arguments.from, arguments.to)?;
    let (floor, name) = match &arguments.floor {
        FloorChoice {
            criterion: Some(criterion),
            ..
        } => (Floor::Criterion(*criterion), criterion.name().to_owned()),
        FloorChoice {
            spectrum: Some(path),
            ..
        } => (read(path)?, path.display().to_string()),
        FloorChoice { white, .. } => {
            let density = white.unwrap_or(f64::NAN);
            if !(density.is_finite() && density >= 0.0) {
                return Err(Failure::Option("white"));
            }
            within("white", density, "board.accelerometer.noise_density")?;
            (
                Floor::White(density),
                format!("white, {density:e} m/s²/√Hz"),
            )
        }
    };
    let study = study(model)?;
    let design = searcher.design(model, &study)?;
    let board = &study.machine().board;
    let budgets = both_budgets(study.plant(), board, &design.table, &floor, band);
    let [open, closed] = budgets.map_err(in_loop(model))?;
    print::warned(
        *format,
        &FloorAnalysis::new(&study, name, band, open, closed),
        &warnings(model, &study)?,
    )
}

/// Reads the spectrum in a file.
fn read(path: &Path) -> Result<Floor, Failure> {
    let text = fs::read_to_string(path).map_err(|error| Failure::Io {
        path: path.display().to_string(),
        what: "read",
        error,
    })?;
    text.parse()
        .map_err(|error: SpectrumError| Failure::Spectrum {
            path: path.display().to_string(),
            line: error.line,
        })
}
