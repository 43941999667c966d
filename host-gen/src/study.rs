//! All stages up to the plant, in one go.

use crate::design::{Design, Gains};
use crate::machine::{Machine, MachineError};
use crate::multibody::Multibody;
use crate::plant::{Plant, SampledPlant};
use crate::shaping::{Effort, Shaped, ShapingError, choose};
use rayon::prelude::*;
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

/// A study and the loop that is closed on it.
#[derive(Clone, Debug)]
pub struct Looped {
    /// The study.
    pub study: Study,
    /// Its table and shaping, or why there is none.
    pub sampled: Result<(ValidTable, Shaped), String>,
}

impl Looped {
    /// Searches for the table; `progress` is called after every trial.
    pub fn new(study: Study, progress: &dyn Fn()) -> Self {
        let table = study.table_with(Effort::Full, progress);
        Self {
            sampled: table.map_err(|error| error.to_string()),
            study,
        }
    }

    /// A machine once with each kind of feedback that it has sensors for and with
    /// both at once, as [`Machine::by_feedback`].
    ///
    /// # Errors
    /// As [`Study::new`].
    pub fn by_feedback(
        machine: &Machine,
        progress: &(dyn Fn() + Sync),
    ) -> Result<Vec<Self>, MachineError> {
        Self::all(machine.by_feedback(), progress)
    }

    /// Of machines, one beside the other.
    ///
    /// # Errors
    /// As [`Study::new`].
    pub fn all(
        machines: Vec<Machine>,
        progress: &(dyn Fn() + Sync),
    ) -> Result<Vec<Self>, MachineError> {
        machines
            .into_par_iter()
            .map(|machine| Ok(Self::new(Study::new(machine)?, progress)))
            .collect()
    }
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
