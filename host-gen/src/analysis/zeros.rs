//! The transmission zeros for each kind of feedback, and the closed-loop poles nearest to
//! them.

use serde::Serialize;

use crate::closed_loop::{Pole, ideal_poles};
use crate::design::study::Growth;
use crate::design::{Study, StudyError};
use crate::machine::Machine;
use crate::numeric::NumericError;

/// Result of `host-gen zeros`: transmission zeros for each kind of feedback.
#[derive(Debug, Serialize)]
pub struct ZeroAnalysis {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) kinds: Vec<ZerosOfKind>,
}

#[derive(Debug, Serialize)]
pub(crate) struct ZerosOfKind {
    pub(crate) feedback: &'static str,
    pub(crate) zeros: Vec<Zero>,
    /// Whether a zero is unstable: then the machine is unstable with the sensor outputs
    /// held at zero.
    pub(crate) unstable: bool,
    /// Whether gravity makes it so.
    pub(crate) by_weight: bool,
    /// Whether springs of negative stiffness make it unstable.
    pub(crate) by_springs: bool,
}

#[derive(Debug, Serialize)]
pub(crate) struct Zero {
    #[serde(flatten)]
    pub(crate) at: Pole,
    /// Natural frequency of the nearest pole of the ideal loop, Hz.
    pub(crate) nearest_closed_loop_hz: Option<f64>,
}

impl ZeroAnalysis {
    /// The zeros for each kind of feedback that the machine has sensors for.
    ///
    /// # Errors
    /// [`StudyError`] if the machine gives no valid model or an eigenvalue iteration does
    /// not converge.
    pub fn new(machine: &Machine) -> Result<Self, StudyError> {
        let studies = Study::of_each_kind(machine)?;
        let kinds = studies.iter().map(ZerosOfKind::new);
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            kinds: kinds.collect::<Result<_, _>>()?,
        })
    }
}

impl ZerosOfKind {
    fn new(study: &Study) -> Result<Self, NumericError> {
        let plant = &study.plant().plant.state_space;
        let feedback = study.design_model().feedback;
        let zeros = study.zeros()?;
        let poles = ideal_poles(plant, study.gains())?;
        let growth = study.growth(&zeros)?;
        Ok(Self {
            feedback: feedback.name(),
            zeros: zeros
                .into_iter()
                // One of each conjugate pair.
                .filter(|s| s.im >= 0.0)
                .map(|s| Zero {
                    nearest_closed_loop_hz: poles
                        .iter()
                        .min_by(|a, b| (*a - s).norm().total_cmp(&(*b - s).norm()))
                        .map(|pole| Pole::from(*pole).hz),
                    at: s.into(),
                })
                .collect(),
            unstable: growth.is_some(),
            by_weight: growth == Some(Growth::Weight),
            by_springs: growth == Some(Growth::Springs),
        })
    }
}
