//! The transmission zeros of each kind of feedback, beside the poles they attract.

use serde::Serialize;

use super::digest;
use crate::closed_loop::{Pole, ideal_poles};
use crate::design::{Study, StudyError};
use crate::machine::Machine;
use crate::numeric::NumericError;
use crate::plant::zeros::{grow, transmission_zeros};

/// `host-gen zeros`.
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
    /// A zero that grows: the machine with its sensors held is unstable.
    pub(crate) unstable: bool,
}

#[derive(Debug, Serialize)]
pub(crate) struct Zero {
    #[serde(flatten)]
    pub(crate) at: Pole,
    /// The nearest pole of the ideal loop, Hz.
    pub(crate) nearest_closed_loop_hz: Option<f64>,
}

impl ZeroAnalysis {
    /// Of all kinds of feedback a machine has sensors for.
    ///
    /// # Errors
    /// As [`Study::new`], and where an eigenvalue iteration does not converge.
    pub fn new(machine: &Machine) -> Result<Self, StudyError> {
        let studies = Study::of_each_kind(machine)?;
        let kinds = studies.iter().map(ZerosOfKind::new);
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: digest(machine),
            kinds: kinds.collect::<Result<_, _>>()?,
        })
    }
}

impl ZerosOfKind {
    fn new(study: &Study) -> Result<Self, NumericError> {
        let plant = &study.plant().plant.state_space;
        let feedback = study.design_model().feedback;
        let zeros = transmission_zeros(plant, feedback)?;
        let poles = ideal_poles(plant, study.gains())?;
        let unstable = grow(&zeros);
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
            unstable,
        })
    }
}
