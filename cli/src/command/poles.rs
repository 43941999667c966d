//! `host-gen poles`.

use host_gen::analysis::poles::PoleAnalysis;
use host_gen::analysis::warnings::warnings;

use crate::arguments::Common;
use crate::failure::{Failure, in_loop};
use crate::print;
use crate::search::{Searcher, study};

pub fn poles(common: &Common, searcher: &Searcher) -> Result<(), Failure> {
    let study = study(&common.model)?;
    let design = searcher.design(&common.model, &study)?;
    let poles = PoleAnalysis::new(&study, &design.table).map_err(in_loop(&common.model))?;
    print::warned(common.format, &poles, &warnings(&study))
}
