//! The ideal gains with the design model that they come from, and the ideal loop's
//! poles.

use serde::Serialize;

use super::{Rows, rows};
use crate::closed_loop::{Pole, ideal_poles};
use crate::design::Study;
use crate::machine::FeedbackKind;
use crate::numeric::NumericError;
use crate::plant::{Plant, StateSpace};

/// Result of `host-gen gains`: the ideal gains, the design model, and the poles of the
/// ideal loop.
#[derive(Debug, Serialize)]
pub struct GainAnalysis {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) feedback: &'static str,
    pub(crate) frequency_hz: f64,
    pub(crate) damping: f64,
    pub(crate) sensors: Vec<String>,
    pub(crate) actuators: Vec<String>,
    /// How the design model was reduced, in words.
    pub(crate) reduction: &'static str,
    pub(crate) rigid_modes_hz: [f64; 6],
    pub(crate) mass: Rows,
    pub(crate) stiffness: Rows,
    pub(crate) rheonomic: Rows,
    pub(crate) sensing: Rows,
    pub(crate) modal: Rows,
    pub(crate) proportional: Rows,
    pub(crate) integral: Rows,
    pub(crate) ideal_poles_rigid: Vec<Pole>,
    pub(crate) ideal_poles_flexible: Vec<Pole>,
}

impl GainAnalysis {
    /// The gains of `study`.
    ///
    /// # Errors
    /// [`NumericError`] if the ideal loop is ill-posed or an eigenvalue iteration does
    /// not converge.
    pub fn new(study: &Study) -> Result<Self, NumericError> {
        let machine = study.machine();
        let design = study.design_model();
        let poles = |plant: &StateSpace| -> Result<Vec<Pole>, NumericError> {
            let poles = ideal_poles(plant, study.gains())?;
            Ok(poles.into_iter().map(Pole::from).collect())
        };
        let beam = |i: &usize| machine.beams[*i].name.clone();
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            feedback: design.feedback.name(),
            frequency_hz: machine.target.frequency,
            damping: machine.target.damping,
            // With both kinds of feedback, the gains are those of acceleration feedback.
            sensors: machine.sensor_names(match design.feedback {
                FeedbackKind::Both => FeedbackKind::Acceleration,
                one => one,
            }),
            actuators: machine.actuators.iter().map(beam).collect(),
            reduction: design.suspension.reduction.words(),
            rigid_modes_hz: design.hertz(),
            mass: rows(&design.suspension.mass),
            stiffness: rows(&design.suspension.stiffness),
            rheonomic: rows(&design.suspension.rheonomic),
            sensing: rows(&design.sensing),
            modal: rows(&design.modal),
            proportional: rows(&study.gains().proportional),
            integral: rows(&study.gains().integral),
            ideal_poles_rigid: poles(&Plant::of_design_model(design))?,
            ideal_poles_flexible: poles(&study.plant().plant.state_space)?,
        })
    }
}
