//! All stages up to the plant, in one go.

use crate::design::{Design, Gains};
use crate::machine::{Machine, MachineError};
use crate::multibody::Multibody;
use crate::plant::{Plant, SampledPlant};
use crate::shaping::{Effort, Shaped, ShapingError, choose};
use shared::table::ValidTable;

/// Why a study, or what is done with its loop, comes to nothing.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The machine.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// The loop.
    #[error(transparent)]
    Loop(#[from] ShapingError),
}

/// A machine with its model, its design for the target, and its plant.
#[derive(Clone, Debug)]
pub struct Study {
    /// The machine.
    pub machine: Machine,
    /// M, K and the coordinates.
    pub model: Multibody,
    /// The rigid design model.
    pub design: Design,
    /// The ideal gains for the machine's target.
    pub gains: Gains,
    /// The flexible plant as the board samples it.
    pub plant: SampledPlant,
}

impl Study {
    /// Runs the stages.
    pub fn new(machine: Machine) -> Result<Self, MachineError> {
        let model = Multibody::new(&machine)?;
        let design = Design::new(&machine, &model, machine.target.feedback)?;
        let gains = design.gains(&machine.target);
        let plant = SampledPlant::new(Plant::new(&machine, &model, &design)?, &machine.board);
        Ok(Self {
            machine,
            model,
            design,
            gains,
            plant,
        })
    }

    /// The table with the shaping that the sampled loop bears.
    pub fn table(&self) -> Result<(ValidTable, Shaped), ShapingError> {
        self.table_with(Effort::Full, &|| {})
    }

    /// The same; `progress` is called after every trial.
    pub fn table_with(
        &self,
        effort: Effort,
        progress: &dyn Fn(),
    ) -> Result<(ValidTable, Shaped), ShapingError> {
        choose(&self.machine, &self.design, &self.plant, effort, progress)
    }
}
