//! `host-gen bound`.

use host_gen::analysis::bound::BoundAnalysis;
use host_gen::analysis::warnings::warnings;
use host_gen::design::DesignError;

use crate::arguments::Common;
use crate::failure::{Failure, in_loop};
use crate::print;
use crate::search::{Bar, Searcher, study};

pub fn bound(common: &Common, searcher: &Searcher) -> Result<(), Failure> {
    let study = study(&common.model)?;
    let design = match searcher.full(&Bar::search()).design(&study) {
        Ok(design) => Some(design),
        // Whether any controller can reach it is the question then.
        Err(DesignError::Unreachable { .. }) => None,
        Err(error) => return Err(in_loop(&common.model)(error)),
    };
    let bound = BoundAnalysis::new(&study, design.as_ref()).map_err(in_loop(&common.model))?;
    print::warned(common.format, &bound, &warnings(&study))
}
