//! One shaping verified on the sampled loop, and the reasons why a target is missed.

use nalgebra::Complex;
use shared::table::{TableError, ValidTable};

use super::outcome::{DesignError, PerturbedSet, Shaping};
use super::study::Study;
use crate::closed_loop::{LoopGrid, PeakSensitivity, SampledLoop, stable};
use crate::control::{Gains, LinearLaw, table};
use crate::machine::Target;
use crate::numeric::NumericError;

/// A shaping whose loop is stable within the bound.
pub(super) struct Trial {
    pub(super) shaping: Shaping,
    pub(super) drawn: Option<PerturbedSet>,
    pub(super) table: ValidTable,
    pub(super) poles: Vec<Complex<f64>>,
}

impl Trial {
    /// The loop of a shaping, if it is stable within the bound, and its peak
    /// sensitivity.
    pub(super) fn new(
        study: &Study,
        target: &Target,
        shaping: &Shaping,
        loops: &LoopGrid,
    ) -> Result<(Option<Self>, PeakSensitivity), Miss> {
        let (machine, plant) = (study.machine(), study.plant());
        let model = study.design_model();
        let table = match shaping {
            Shaping::Common { corner_hz } => {
                let gains = Gains::new(model, target);
                table::direct(machine, plant, target, &gains, *corner_hz)?
            }
            Shaping::Modes { shapes } => table::modal(machine, plant, model, target, shapes)?,
        };
        let closed_loop = SampledLoop::new(plant, &table);
        let poles = closed_loop.poles()?;
        let peak = loops.peak(plant, &closed_loop.law);
        let holds = stable(&poles)
            && peak.bounded() <= target.max_sensitivity
            && rolls_off(target, loops, &closed_loop.law);
        let trial = holds.then(|| Self {
            shaping: shaping.clone(),
            drawn: None,
            table,
            poles,
        });
        Ok((trial, peak))
    }
}

/// Whether a loop keeps the target's limit at high frequency, if there is one.
pub(super) fn rolls_off(target: &Target, loops: &LoopGrid, law: &LinearLaw) -> bool {
    let kept = |limit| loops.roll_off(law, &limit).part <= 1.0;
    target.roll_off.is_none_or(kept)
}

/// Why a target is not reached.
pub(super) enum Miss {
    Error(DesignError),
    /// No shaping is stable with the requested sensitivity.
    Unstable,
    /// The best loop isolates only from `sampled` Hz, the ideal one from `ideal` Hz.
    Late {
        ideal: f64,
        sampled: f64,
    },
}

impl From<TableError> for Miss {
    fn from(error: TableError) -> Self {
        Self::Error(error.into())
    }
}

impl From<NumericError> for Miss {
    fn from(error: NumericError) -> Self {
        Self::Error(error.into())
    }
}

/// Ratio of successive frequencies of a scan.
pub(super) const SCAN: f64 = 1.25;

/// 1.3 for 1.3000000000000003.
pub(super) fn nearest_decimal(x: f64) -> f64 {
    format!("{x:.6e}").parse().unwrap_or(x)
}
