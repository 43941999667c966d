//! A machine with everything that follows from its file alone: model, design
//! model, ideal gains, sampled plant.

use crate::control::Gains;
use crate::machine::{FeedbackKind, Machine, MachineError};
use crate::model::design_model::DesignModel;
use crate::model::multibody::Multibody;
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
}
