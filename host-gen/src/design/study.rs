//! A machine with everything that follows from its file alone: model, design
//! model, ideal gains, sampled plant.

use nalgebra::{Complex, Vector3};

use crate::control::Gains;
use crate::machine::{FeedbackKind, Machine, MachineError};
use crate::model::design_model::DesignModel;
use crate::model::multibody::Multibody;
use crate::numeric::NumericError;
use crate::plant::zeros::{grow, transmission_zeros};
use crate::plant::{Plant, SampledPlant};

/// A machine with its model, its design model, its ideal gains and its plant.
///
/// The parts are private, so that they always belong to the same machine.
#[derive(Clone, Debug)]
pub struct Study {
    machine: Machine,
    model: Multibody,
    design_model: DesignModel,
    gains: Gains,
    plant: SampledPlant,
}

/// Why a transmission zero of a machine is unstable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Growth {
    /// The machine's weight: without gravity, no zero is unstable.
    Weight,
    /// Springs of negative stiffness: without gravity and these, no zero is unstable.
    Springs,
    /// Where the sensors are: without gravity and negative stiffness, a zero is unstable, too.
    Placement,
}

impl Study {
    /// Models `machine`, and samples it with the timing of its board.
    ///
    /// # Errors
    /// [`MachineError`] with the entry at fault if bodies, legs, sensors or floor inputs
    /// give no valid model.
    pub fn new(machine: Machine) -> Result<Self, MachineError> {
        let model = Multibody::new(&machine)?;
        let design_model = DesignModel::new(&machine, &model, machine.target.feedback)?;
        let gains = Gains::new(&design_model, &machine.target);
        let plant = Plant::new(&machine, &model, &design_model)?;
        let plant = SampledPlant::new(plant, &machine.board);
        Ok(Self {
            machine,
            model,
            design_model,
            gains,
            plant,
        })
    }

    /// The sampled plant on a floor at rest, moved by the loads of the machine, as
    /// [`Plant::loaded`].
    ///
    /// # Errors
    /// As [`Study::new`].
    pub fn loaded_plant(&self) -> Result<SampledPlant, MachineError> {
        let plant = Plant::loaded(&self.machine, &self.model, &self.design_model)?;
        Ok(SampledPlant::new(plant, &self.machine.board))
    }

    /// One study with acceleration feedback and one with force feedback, as far as the
    /// machine has the sensors.
    ///
    /// # Errors
    /// [`MachineError`] with the entry at fault, as [`Study::new`].
    pub fn of_each_kind(machine: &Machine) -> Result<Vec<Self>, MachineError> {
        let kinds = [FeedbackKind::Acceleration, FeedbackKind::Force];
        let machines = kinds.map(|feedback| machine.with_feedback(feedback));
        machines.into_iter().flatten().map(Self::new).collect()
    }

    /// The machine as its file describes it.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// M, K and the coordinates of the flexible machine.
    pub fn model(&self) -> &Multibody {
        &self.model
    }

    /// The design model: all bodies as one rigid body on six legs. The gains are computed
    /// from it.
    pub fn design_model(&self) -> &DesignModel {
        &self.design_model
    }

    /// The ideal gains for the machine's target.
    pub fn gains(&self) -> &Gains {
        &self.gains
    }

    /// The flexible plant as the board samples it.
    pub fn plant(&self) -> &SampledPlant {
        &self.plant
    }

    /// Rate of growth of the fastest mode that gravity makes unstable, over 2π, Hz; `None` if
    /// the machine stands.
    pub fn falls(&self) -> Option<f64> {
        let lowest = self.model.modes().hertz()[0];
        (lowest < 0.0).then_some(-lowest)
    }

    /// Why one of the machine's transmission `zeros`, rad/s, is unstable, if one is.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn growth(&self, zeros: &[Complex<f64>]) -> Result<Option<Growth>, NumericError> {
        if !grow(zeros) {
            return Ok(None);
        }
        let stands = |machine: &Machine| match Self::new(machine.clone()) {
            Ok(study) => Ok(!grow(&study.zeros()?)),
            Err(_) => Ok(false),
        };
        let mut other = self.machine.clone();
        other.gravity = Vector3::zeros();
        if stands(&other)? {
            return Ok(Some(Growth::Weight));
        }
        if !other
            .springs
            .iter()
            .any(|spring| spring.stiffness.min() < 0.0)
        {
            return Ok(Some(Growth::Placement));
        }
        for spring in &mut other.springs {
            spring.stiffness.apply(|k| *k = k.max(0.0));
        }
        Ok(Some(match stands(&other)? {
            true => Growth::Springs,
            false => Growth::Placement,
        }))
    }

    /// The transmission zeros from leg forces to the sensors that are fed back, rad/s, as
    /// [`transmission_zeros`]. With both kinds of sensors, the zeros of either kind.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn zeros(&self) -> Result<Vec<Complex<f64>>, NumericError> {
        let feedback = self.design_model.feedback;
        transmission_zeros(&self.plant.plant.state_space, feedback)
    }
}
