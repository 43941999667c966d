//! `host-gen modes`, `gains` and `zeros`, which need no search.

use host_gen::analysis::gains::GainAnalysis;
use host_gen::analysis::modes::ModeAnalysis;
use host_gen::analysis::zeros::ZeroAnalysis;
use host_gen::machine::Machine;

use crate::arguments::Common;
use crate::failure::{Failure, in_loop, in_study};
use crate::print;
use crate::search::study;

pub fn modes(common: &Common) -> Result<(), Failure> {
    print::result(common.format, &ModeAnalysis::new(&study(&common.model)?))
}

pub fn gains(common: &Common) -> Result<(), Failure> {
    let gains = GainAnalysis::new(&study(&common.model)?);
    print::result(common.format, &gains.map_err(in_loop(&common.model))?)
}

pub fn zeros(common: &Common) -> Result<(), Failure> {
    let zeros = ZeroAnalysis::new(&Machine::load(&common.model)?);
    print::result(common.format, &zeros.map_err(in_study(&common.model))?)
}
