//! A controller on randomly perturbed machines.

use rayon::prelude::*;
use shared::table::ValidTable;

use super::outcome::PerturbedSet;
use super::study::Study;
use crate::closed_loop::{SLOWEST, SampledLoop, stable};
use crate::control::LinearLaw;
use crate::machine::{DESIGN_SAMPLES, Target};
use crate::numeric::NumericError;

/// `table`, made for `study`, on randomly perturbed machines. One that makes no model counts as one
/// on which the loop is not stable.
pub(super) fn perturbed(
    study: &Study,
    target: &Target,
    table: &ValidTable,
) -> Result<PerturbedSet, NumericError> {
    let machine = study.machine();
    let modal = &study.design_model().modal;
    let law = LinearLaw::new(table);
    let samples = DESIGN_SAMPLES.min(machine.robustness.samples);
    let low = SLOWEST * target.frequency;
    let peaks = (0..samples)
        .into_par_iter()
        .map(|i| {
            let Ok(study) = Study::new(machine.drawn(i)) else {
                return Ok(None);
            };
            let closed = SampledLoop {
                plant: study.plant(),
                law,
            };
            let poles = closed.poles()?;
            Ok(stable(&poles).then(|| closed.peak_sensitivity(modal, low, &poles).bounded()))
        })
        .collect::<Result<Vec<_>, NumericError>>()?;
    let stable = peaks.iter().flatten();
    Ok(PerturbedSet {
        samples,
        stable: stable.clone().count(),
        peak_sensitivity: stable.fold(0.0, |a, b| a.max(*b)),
    })
}
