//! `host-gen campaign`.

use clap::Args;
use host_gen::analysis::warnings::warnings;
use host_gen::report::campaign::CampaignSummary;
use host_gen::simulate::faults::{Defect, campaign as run};

use crate::arguments::Common;
use crate::failure::Failure;
use crate::print;
use crate::search::{Bar, Searcher, study};

#[derive(Args)]
pub struct CampaignArguments {
    #[command(flatten)]
    common: Common,
    /// Simulate every pair of faults at once; this takes some minutes.
    #[arg(long)]
    pairs: bool,
}

pub fn campaign(arguments: &CampaignArguments, searcher: &Searcher) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let study = study(model)?;
    let design = searcher.design(model, &study)?;
    let single = Defect::all();
    let mut cases: Vec<Vec<Defect>> = single.iter().map(|defect| vec![*defect]).collect();
    if arguments.pairs {
        let pairs = |(i, a): (usize, &Defect)| {
            let others = single[i + 1..].iter();
            others.map(|b| vec![*a, *b]).collect::<Vec<_>>()
        };
        cases = single.iter().enumerate().flat_map(pairs).collect();
    }
    let outcomes = run(&study, &design.table, &cases, &Bar::of(cases.len()));
    let campaign = CampaignSummary::new(&study, outcomes);
    print::warned(*format, &campaign, &warnings(&study))?;
    if campaign.is_safe() {
        Ok(())
    } else {
        Err(Failure::Unsafe)
    }
}
