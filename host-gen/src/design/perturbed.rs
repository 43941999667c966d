//! A controller on randomly perturbed machines.

use rayon::prelude::*;
use shared::table::ValidTable;

use super::outcome::PerturbedSet;
use super::study::Study;
use crate::closed_loop::{SLOWEST, SampledLoop, stable};
use crate::control::LinearLaw;
use crate::machine::{DESIGN_SAMPLES, Machine, Target};
use crate::numeric::NumericError;

/// The perturbed machines on which a design of `machine` must hold; none for one that makes no
/// model.
pub(super) fn drawn(machine: &Machine) -> Vec<Option<Study>> {
    let samples = DESIGN_SAMPLES.min(machine.robustness.samples);
    let studies = (0..samples).into_par_iter();
    studies.map(|i| Study::new(machine.drawn(i)).ok()).collect()
}

/// `table`, made for `study`, on the perturbed machines of `drawn`. One that makes no model counts
/// as one on which the loop is not stable.
pub(super) fn perturbed(
    study: &Study,
    drawn: &[Option<Study>],
    target: &Target,
    table: &ValidTable,
) -> Result<PerturbedSet, NumericError> {
    let modal = &study.design_model().modal;
    let law = LinearLaw::new(table);
    let low = SLOWEST * target.frequency;
    let peaks = drawn
        .par_iter()
        .map(|study| {
            let Some(study) = study else {
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
        samples: drawn.len(),
        stable: stable.clone().count(),
        peak_sensitivity: stable.fold(0.0, |a, b| a.max(*b)),
    })
}
