//! `host-gen simulate`.

use std::path::PathBuf;

use clap::Args;
use host_gen::analysis::warnings::warnings;
use host_gen::design::{Design, Study};
use host_gen::floor::Record;
use host_gen::machine::Simulation;
use host_gen::report::summary::SimulateSummary;
use host_gen::simulate::run::{Comparison, Moment, compare, evaluated, histories, reports};

use crate::arguments::{Common, positive};
use crate::failure::Failure;
use crate::files::write_whole;
use crate::floor::Recorded;
use crate::print::{self, seconds};
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
    /// CSV file for the histories over time, with units: the performance outputs, open and closed, and
    /// the leg forces with the loop closed.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
}

/// Most samples in a CSV file, some hundred bytes each.
const LONGEST: usize = 5_000_000;

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
    let samples = evaluated(&settings, &study.machine().board);
    if arguments.csv.is_some() && samples > LONGEST {
        return Err(Failure::Setting {
            option: "--duration",
            must: format!("be lower: a CSV file has at most {LONGEST} samples, not {samples}"),
        });
    }
    let design = searcher.design(model, &study)?;
    if let Some(path) = &arguments.csv {
        let record = record.as_ref().map(|(record, _)| record);
        write_whole(path, &csv(&study, &settings, &design, record))?;
    }
    let simulation = simulation(&study, &settings, &design, record);
    print::warned(
        arguments.common.format,
        &SimulateSummary::new(&study, design, simulation),
        &warnings(&study),
    )
}

/// The histories as CSV.
fn csv(study: &Study, settings: &Simulation, design: &Design, record: Option<&Record>) -> Vec<u8> {
    let machine = study.machine();
    let performance = machine.performance_names();
    let outputs = |side: &str| {
        let named = |name: &String| format!("{name} {side} [m/s^2]");
        performance.iter().map(named).collect::<Vec<_>>()
    };
    let legs = machine.actuators.iter();
    let legs = legs.map(|&beam| format!("force {} [N]", machine.beams[beam].name));
    let mut head = vec!["time [s]".to_owned()];
    head.extend(outputs("open"));
    head.extend(outputs("closed"));
    head.extend(legs);
    let mut table = csv::Writer::from_writer(Vec::new());
    let wrote = table.write_record(&head).and_then(|()| {
        let each = |moment: Moment<'_>| {
            let Moment {
                time,
                open,
                closed,
                forces,
            } = moment;
            let numbers = open.iter().chain(closed.iter()).chain(&forces);
            let numbers = numbers.map(|x| format!("{x:.6e}"));
            table.write_record([seconds(time)].into_iter().chain(numbers))
        };
        let (plant, board) = (study.plant(), &machine.board);
        histories(plant, board, settings, &design.table, record, each)
    });
    wrote.expect("rows in memory of one length are written");
    table
        .into_inner()
        .expect("memory takes all that is written")
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
