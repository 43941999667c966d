//! `host-gen compare`.

use clap::Args;
use host_gen::analysis::compare::MachineComparison;
use host_gen::analysis::warnings::warnings;
use host_gen::design::DesignedStudy;
use host_gen::machine::Machine;

use crate::arguments::{Format, Several};
use crate::failure::{Failure, in_study};
use crate::print;
use crate::search::{Bar, Searcher};

#[derive(Args)]
pub struct CompareArguments {
    #[command(flatten)]
    several: Several,
    /// Output format: text, or JSON as in docs/json.md.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
}

pub fn compare(arguments: &CompareArguments, searcher: &Searcher) -> Result<(), Failure> {
    let mut machines = arguments.several.load()?;
    if arguments.several.by_feedback {
        machines = machines.iter().flat_map(Machine::by_feedback).collect();
    }
    let studies = DesignedStudy::all(machines, &searcher.full(&Bar::search()))?;
    let comparison = MachineComparison::new(&studies);
    let comparison = comparison.map_err(in_study(&arguments.several.models[0]))?;
    let mut all = Vec::new();
    for DesignedStudy { study, .. } in &studies {
        for warning in warnings(study) {
            let warning = format!("{}: {warning}", study.machine().name);
            if !all.contains(&warning) {
                all.push(warning);
            }
        }
    }
    print::warned(arguments.format, &comparison, &all)
}
