//! Poles without control, with the ideal law, and of the sampled loop.

use nalgebra::Complex;
use serde::Serialize;
use shared::table::ValidTable;

use crate::closed_loop::{Pole, SampledLoop, ideal_poles, stable};
use crate::design::Study;
use crate::numeric::NumericError;

/// Result of `host-gen poles`: poles without control, with the ideal law, and of the
/// sampled loop.
#[derive(Debug, Serialize)]
pub struct PoleAnalysis {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) feedback: &'static str,
    pub(crate) open: Vec<Pole>,
    pub(crate) ideal: Vec<Pole>,
    pub(crate) sampled: Vec<Pole>,
    pub(crate) stable: bool,
}

impl PoleAnalysis {
    /// The poles of `study`; the sampled loop is the one with `table`.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn new(study: &Study, table: &ValidTable) -> Result<Self, NumericError> {
        let plant = &study.plant().plant;
        let closed = SampledLoop::new(study.plant(), table);
        let ideal = ideal_poles(&plant.state_space, study.gains())?;
        let sampled = closed.poles()?;
        // One of each conjugate pair. Poles faster than half the sample rate come from
        // the delay, not from the machine.
        let fastest = core::f64::consts::PI / study.plant().period;
        let list = |poles: &[Complex<f64>]| {
            poles
                .iter()
                .filter(|s| s.im >= 0.0 && s.norm() < fastest)
                .map(|s| Pole::from(*s))
                .collect()
        };
        Ok(Self {
            machine: study.machine().name.clone(),
            model_sha256: study.machine().digest.to_string(),
            feedback: study.design_model().feedback.name(),
            open: list(&plant.poles.iter().map(|p| p.lambda).collect::<Vec<_>>()),
            ideal: list(&ideal),
            stable: stable(&sampled),
            sampled: list(&sampled),
        })
    }
}
