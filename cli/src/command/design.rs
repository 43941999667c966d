//! `host-gen design`.

use clap::Args;
use host_gen::analysis::controller::DesignAnalysis;
use host_gen::analysis::warnings::warnings;

use crate::arguments::Common;
use crate::failure::{Failure, in_loop, in_study};
use crate::print;
use crate::search::{Bar, Searcher, study};

#[derive(Args)]
pub struct DesignArguments {
    #[command(flatten)]
    common: Common,
    /// Also design for twice the sample rate, and with samples in the middle of a hold; this takes
    /// half a minute more.
    #[arg(long)]
    chart: bool,
}

pub fn design(arguments: &DesignArguments, searcher: &Searcher) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let study = study(model)?;
    let design = searcher.design(model, &study)?;
    let mut analysis = DesignAnalysis::new(&study, design).map_err(in_loop(model))?;
    if arguments.chart {
        let charted = analysis.with_other_boards(&study, searcher.cache(), &Bar::search());
        analysis = charted.map_err(in_study(model))?;
    }
    print::warned(*format, &analysis, &warnings(&study))
}
