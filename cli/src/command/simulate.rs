//! `host-gen simulate`.

use clap::Args;
use host_gen::analysis::warnings::warnings;
use host_gen::design::{Design, Study};
use host_gen::floor::Record;
use host_gen::machine::Simulation;
use host_gen::report::summary::SimulateSummary;
use host_gen::simulate::run::{Comparison, compare, reports};

use crate::arguments::{Common, positive};
use crate::failure::Failure;
use crate::floor::Recorded;
use crate::print;
use crate::search::{Bar, Searcher, study};

#[derive(Args)]
pub struct SimulateArguments {
    #[command(flatten)]
    common: Common,
    /// Simulated time after settling, s [default: from the file].
    #[arg(long)]
    duration: Option<f64>,
    /// Seed of the random numbers [default: from the file].
    #[arg(long)]
    seed: Option<u64>,
    /// Floor acceleration, rms along each of x, y and z, m/s² [default: from the file].
    #[arg(long, conflicts_with = "record")]
    floor_rms: Option<f64>,
    #[command(flatten)]
    recorded: Recorded,
}

pub fn simulate(arguments: &SimulateArguments, searcher: &Searcher) -> Result<(), Failure> {
    let model = &arguments.common.model;
    let study = study(model)?;
    // The search uses the settings of the file.
    let mut settings = study.machine().simulation;
    if let Some(duration) = arguments.duration {
        settings.duration = positive("duration", duration, "simulation.duration")?;
    }
    if let Some(floor_rms) = arguments.floor_rms {
        settings.floor_rms = positive("floor-rms", floor_rms, "simulation.floor_rms")?;
    }
    if let Some(seed) = arguments.seed {
        settings.seed = seed;
    }
    let record = arguments.recorded.read(Ok)?;
    let design = searcher.design(model, &study)?;
    let simulation = simulation(&study, &settings, &design, record);
    print::warned(
        arguments.common.format,
        &SimulateSummary::new(&study, design, simulation),
        &warnings(&study),
    )
}

/// Simulates the open and the closed loop on the same floor: that of `settings`, or a record with
/// its name.
pub fn simulation(
    study: &Study,
    settings: &Simulation,
    design: &Design,
    record: Option<(Record, String)>,
) -> Comparison {
    let machine = study.machine();
    compare(
        study.plant(),
        &machine.board,
        settings,
        &design.table,
        machine.performance_names(),
        record.as_ref().map(|(record, name)| (record, name.clone())),
        &Bar::of(reports(settings, &machine.board)),
    )
}
