//! `host-gen floor`.

use clap::Args;
use host_gen::analysis::floors::FloorAnalysis;
use host_gen::analysis::warnings::warnings;
use host_gen::closed_loop::budget::both_budgets;
use host_gen::floor::NamedFloor;

use crate::arguments::{Common, band, between};
use crate::failure::{Failure, in_loop};
use crate::floor::FloorChoice;
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

pub fn floor(arguments: &FloorArguments, searcher: &Searcher) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let band = band(arguments.from, arguments.to)?;
    let [from, to] = band;
    let study = study(model)?;
    let own = || study.machine().spectrum.clone().map(NamedFloor::from);
    let floor = arguments.floor.floor()?.or_else(own);
    let NamedFloor { floor, name } = floor.ok_or_else(|| Failure::NoFloor(model.clone()))?;
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
