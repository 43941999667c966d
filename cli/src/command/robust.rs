//! `host-gen robust`.

use clap::Args;
use host_gen::analysis::robustness::{RobustnessAnalysis, monte_carlo};
use host_gen::analysis::warnings::warnings;

use crate::arguments::{Common, count};
use crate::failure::{Failure, in_study};
use crate::print;
use crate::search::{Bar, Searcher, study};

#[derive(Args)]
pub struct RobustArguments {
    #[command(flatten)]
    common: Common,
    /// Number of perturbed machines, 1 to 1000000 [default: from the file].
    #[arg(long, value_parser = count(1, 1_000_000))]
    samples: Option<usize>,
    /// Seed of the random numbers [default: from the file].
    #[arg(long)]
    seed: Option<u64>,
}

pub fn robust(arguments: &RobustArguments, searcher: &Searcher) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let study = study(model)?;
    // The search uses the settings of the file.
    let mut settings = study.machine().robustness.clone();
    if let Some(samples) = arguments.samples {
        settings.samples = samples;
    }
    if let Some(seed) = arguments.seed {
        settings.seed = seed;
    }
    let design = searcher.design(model, &study)?;
    let bar = Bar::of(settings.samples);
    let spread = monte_carlo(&study, &settings, &design.table, &design.bands, &bar);
    let spread = spread.map_err(in_study(model))?;
    print::warned(
        *format,
        &RobustnessAnalysis::new(study.machine(), &settings, spread),
        &warnings(&study),
    )
}
