//! `host-gen modes`, `gains` and `zeros`, which need no search.

use host_gen::analysis::gains::GainAnalysis;
use host_gen::analysis::modes::ModeAnalysis;
use host_gen::analysis::warnings::warnings;
use host_gen::analysis::zeros::ZeroAnalysis;
use host_gen::machine::Structure;

use crate::arguments::Common;
use crate::failure::{Failure, in_loop, in_study};
use crate::print;
use crate::search::study;

pub fn modes(Common { model, format }: &Common) -> Result<(), Failure> {
    if let Some(passive) = Structure::load_passive(model)? {
        return print::warned(*format, &ModeAnalysis::passive(&passive)?, &[]);
    }
    let study = study(model)?;
    print::warned(*format, &ModeAnalysis::new(&study), &warnings(&study))
}

pub fn gains(Common { model, format }: &Common) -> Result<(), Failure> {
    let study = study(model)?;
    let gains = GainAnalysis::new(&study).map_err(in_loop(model))?;
    print::warned(*format, &gains, &warnings(&study))
}

pub fn zeros(Common { model, format }: &Common) -> Result<(), Failure> {
    let study = study(model)?;
    let zeros = ZeroAnalysis::new(study.machine()).map_err(in_study(model))?;
    print::warned(*format, &zeros, &warnings(&study))
}
