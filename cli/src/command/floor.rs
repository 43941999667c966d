//! `host-gen floor`.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use host_gen::analysis::floors::FloorAnalysis;
use host_gen::analysis::warnings::warnings;
use host_gen::closed_loop::budget::both_budgets;
use host_gen::floor::Criterion;
use host_gen::floor::{Floor, STRONGEST, Spectrum};

use crate::arguments::{Common, band, between, criterion};
use crate::failure::{Failure, in_loop};
use crate::print;
use crate::search::{Searcher, study};

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
#[group(multiple = false)]
struct FloorChoice {
    /// Floor at the limit of this vibration criterion.
    #[arg(long, value_parser = criterion())]
    criterion: Option<Criterion>,
    /// White acceleration along each of x, y and z, m/s²/√Hz.
    #[arg(long)]
    white: Option<f64>,
    /// Text file with a floor spectrum, that of the acceleration along each of x, y and z. Each
    /// line has a frequency, Hz, ascending, and an acceleration density, m/s²/√Hz; # starts a
    /// comment.
    #[arg(long)]
    spectrum: Option<PathBuf>,
}

pub fn floor(arguments: &FloorArguments, searcher: &Searcher) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let band = band(arguments.from, arguments.to)?;
    let [from, to] = band;
    let study = study(model)?;
    let (floor, name) = match &arguments.floor {
        FloorChoice {
            criterion: Some(criterion),
            ..
        } => (Floor::Criterion(*criterion), criterion.name().to_owned()),
        FloorChoice {
            spectrum: Some(path),
            ..
        } => {
            let name = path.display().to_string();
            (Floor::Table(read(path, &name)?), name)
        }
        FloorChoice {
            white: Some(density),
            ..
        } => {
            between("white", *density, [0.0, STRONGEST], " m/s²/√Hz")?;
            let floor = Floor::White(*density);
            let name = floor.name();
            (floor, name)
        }
        _ => {
            let floor = study.machine().spectrum.clone();
            let floor = floor.ok_or_else(|| Failure::NoFloor(model.clone()))?;
            let name = floor.name();
            (floor, name)
        }
    };
    let nyquist = 0.5 * study.machine().board.sample_rate;
    between("to", to, [from, nyquist], " Hz, half the sample rate")?;
    let [low, high] = floor.range();
    if high <= from || to <= low {
        return Err(Failure::Unseen {
            path: name,
            low,
            high,
            from,
            to,
        });
    }
    let design = searcher.design(model, &study)?;
    let (board, exposure) = (&study.machine().board, study.machine().exposure);
    let budgets = both_budgets(study.plant(), board, &design.table, &floor, band, exposure);
    let [open, closed] = budgets.map_err(in_loop(model))?;
    print::warned(
        *format,
        &FloorAnalysis::new(&study, name, open, closed),
        &warnings(&study),
    )
}

/// Reads the spectrum in a file called `name`.
fn read(path: &Path, name: &str) -> Result<Spectrum, Failure> {
    let text = fs::read_to_string(path).map_err(|error| Failure::Io {
        path: name.to_owned(),
        what: "read",
        error,
    })?;
    text.parse().map_err(|error| Failure::Spectrum {
        path: name.to_owned(),
        error,
    })
}
