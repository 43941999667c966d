//! `host-gen compliance`.

use std::path::PathBuf;

use clap::Args;
use host_gen::analysis::warnings::warnings;
use host_gen::machine::Machine;
use host_gen::simulate::compliance::{ComplianceAnalysis, ComplianceError, Pushing, Tolerance};
use host_gen::simulate::profile::Profile;

use crate::arguments::{Common, positive};
use crate::failure::{Failure, in_loop};
use crate::floor::parsed;
use crate::print;
use crate::search::{Searcher, study};

#[derive(Args)]
pub struct ComplianceArguments {
    #[command(flatten)]
    common: Common,
    /// Loads over time, as comma-separated values. The first line names the columns: `time [s]`, and
    /// loads of the file with their units, `stage [N]`. Simulated with the step of the firmware.
    #[arg(long, conflicts_with = "step")]
    profile: Option<PathBuf>,
    /// A step of one load of the file, N or N m, as `NAME=SIZE`.
    #[arg(long, value_parser = step)]
    step: Option<(String, f64)>,
    /// Simulated time, s.
    #[arg(long, default_value_t = 5.0)]
    duration: f64,
    /// Within what of its value at rest a displacement is settled, m or rad [default: 2 % of its
    /// largest without control].
    #[arg(long)]
    settled: Option<f64>,
}

fn step(text: &str) -> Result<(String, f64), String> {
    let found = text
        .split_once('=')
        .and_then(|(name, size)| Some((name.to_owned(), size.parse::<f64>().ok()?)));
    found
        .filter(|(_, size)| size.is_finite())
        .ok_or_else(|| "write NAME=SIZE, such as stage=10".to_owned())
}

/// When a step comes, s.
const STEP_AT: f64 = 0.1;

pub fn compliance(arguments: &ComplianceArguments, searcher: &Searcher) -> Result<(), Failure> {
    let model = &arguments.common.model;
    let study = study(model)?;
    let machine = study.machine();
    let duration = positive("duration", arguments.duration, "simulation.duration")?;
    let tolerance = match arguments.settled {
        Some(size) if !(size > 0.0 && size.is_finite()) => {
            return Err(Failure::Setting {
                option: "--settled",
                must: "be above 0 m or rad".to_owned(),
            });
        }
        Some(size) => Tolerance::Absolute(size),
        None => Tolerance::Part(0.02),
    };
    let given = match (&arguments.profile, &arguments.step) {
        (Some(path), _) => {
            let profile = parsed(path, |text| Profile::read(text, &machine.loads))?;
            Some((profile, path.display().to_string()))
        }
        (None, Some((name, size))) => {
            let index = load(machine, name)?;
            let unit = machine.loads[index].unit();
            let words = format!("a step of {name} of {size} {unit} at {STEP_AT} s");
            Some((Profile::step(index, *size, STEP_AT), words))
        }
        (None, None) => None,
    };
    let pushing = given.as_ref().map(|(profile, name)| Pushing {
        profile,
        name: name.clone(),
        duration,
        tolerance,
    });
    if let Some(pushing) = &pushing
        && pushing.profile.last_change() >= duration
    {
        let last = pushing.profile.last_change();
        return Err(Failure::Setting {
            option: "--duration",
            must: format!("be above {last} s, where the loads change last"),
        });
    }
    let design = searcher.design(model, &study)?;
    let found = ComplianceAnalysis::new(&study, &design, pushing).map_err(|error| match error {
        ComplianceError::Machine(error) => Failure::Machine(error),
        ComplianceError::Numeric(error) => in_loop(model)(error),
    })?;
    print::warned(arguments.common.format, &found, &warnings(&study))
}

/// The index of a load by its name.
fn load(machine: &Machine, name: &str) -> Result<usize, Failure> {
    let found = machine.loads.iter().position(|load| load.at.name == name);
    found.ok_or_else(|| {
        let known = machine.loads.iter().map(|load| load.at.name.as_str());
        let known = known.collect::<Vec<_>>().join(", ");
        Failure::Setting {
            option: "--step",
            must: if known.is_empty() {
                "name a load of the file, which has none: add [loads.NAME]".to_owned()
            } else {
                format!("name a load of the file: {known}")
            },
        }
    })
}
