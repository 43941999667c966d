//! The generalised plant of each kind of feedback, with the names of its signals.

use serde::Serialize;

use super::{Rows, rows};
use crate::design::Study;
use crate::machine::{Machine, MachineError};
use crate::plant::export::Generalised;

/// Result of `host-gen plant`: the generalised plant as matrices, with the names of its
/// signals.
#[derive(Debug, Serialize)]
pub struct PlantMatrices {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) inputs: Vec<String>,
    pub(crate) kinds: Vec<PlantOfKind>,
}

#[derive(Debug, Serialize)]
pub(crate) struct PlantOfKind {
    pub(crate) feedback: &'static str,
    pub(crate) outputs: Vec<String>,
    pub(crate) a: Rows,
    pub(crate) b: Rows,
    pub(crate) c: Rows,
    pub(crate) d: Rows,
}

impl PlantMatrices {
    /// The plant for each kind of feedback that the machine has sensors for.
    ///
    /// # Errors
    /// [`MachineError`] with the entry at fault if the machine gives no valid model.
    pub fn new(machine: &Machine) -> Result<Self, MachineError> {
        let beam = |i: &usize| machine.beams[*i].name.clone();
        let kinds = Study::of_each_kind(machine)?
            .iter()
            .map(|study| {
                let g = Generalised::new(&study.plant().plant);
                let mut outputs = machine.performance_names();
                outputs.extend(machine.sensor_names(study.design_model().feedback));
                PlantOfKind {
                    feedback: study.design_model().feedback.name(),
                    outputs,
                    a: rows(&g.a),
                    b: rows(&g.b),
                    c: rows(&g.c),
                    d: rows(&g.d),
                }
            })
            .collect();
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            inputs: machine
                .floor
                .iter()
                .map(|input| input.name.clone())
                .chain(machine.actuators.iter().map(beam))
                .collect(),
            kinds,
        })
    }
}
