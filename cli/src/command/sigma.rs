//! `host-gen sigma`.

use clap::Args;
use host_gen::analysis::sigma::{Frequencies, SigmaAnalysis};
use host_gen::analysis::warnings::warnings;
use host_gen::design::DesignedStudy;

use crate::arguments::{Common, band, count, positive};
use crate::failure::{Failure, in_loop};
use crate::print;
use crate::search::{Bar, Searcher, study};

#[derive(Args)]
pub struct SigmaArguments {
    #[command(flatten)]
    common: Common,
    /// Lowest frequency, Hz.
    #[arg(long, default_value_t = Frequencies::BAND[0])]
    from: f64,
    /// Highest frequency, Hz.
    #[arg(long, default_value_t = Frequencies::BAND[1])]
    to: f64,
    /// Number of frequencies, evenly spaced in the logarithm, 2 to 100000; more are added
    /// around peaks.
    #[arg(long, default_value_t = Frequencies::COUNT, value_parser = count(2, 100_000))]
    points: usize,
    /// Only these frequencies, Hz, separated by commas.
    #[arg(long, value_delimiter = ',', conflicts_with_all = ["from", "to", "points"])]
    at: Vec<f64>,
    /// Design and show the sampled law for each kind of feedback, not only for that of the file.
    #[arg(long)]
    by_feedback: bool,
}

pub fn sigma(arguments: &SigmaArguments, searcher: &Searcher) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let frequencies = if arguments.at.is_empty() {
        let [low, high] = band(arguments.from, arguments.to)?;
        let count = arguments.points;
        Frequencies::Adaptive { low, high, count }
    } else {
        for &hz in &arguments.at {
            positive("at", hz, "performance.bands.*")?;
        }
        Frequencies::At(arguments.at.clone())
    };
    let study = study(model)?;
    let machine = study.machine();
    let bar = Bar::search();
    let search = searcher.full(&bar);
    let studies = if arguments.by_feedback {
        DesignedStudy::by_feedback(machine, &search)?
    } else {
        DesignedStudy::own_feedback(machine, Some(&search))?
    };
    drop(bar);
    let sigma = SigmaAnalysis::new(machine, &studies, frequencies).map_err(in_loop(model))?;
    print::warned(*format, &sigma, &warnings(&study))
}
