//! The generalised plant of each kind of feedback, with the names of its signals.

use std::fmt::Write as _;

use serde::Serialize;

use super::signals::{Signals, of_plant, states};
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
    input_identifiers: Vec<String>,
    input_units: Vec<&'static str>,
    pub(crate) kinds: Vec<PlantOfKind>,
}

#[derive(Debug, Serialize)]
pub(crate) struct PlantOfKind {
    pub(crate) feedback: &'static str,
    pub(crate) outputs: Vec<String>,
    output_identifiers: Vec<String>,
    output_units: Vec<&'static str>,
    states: Vec<String>,
    state_units: Vec<&'static str>,
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
        let mut inputs = Signals::default();
        let mut kinds = Vec::new();
        for study in Study::of_each_kind(machine)? {
            let g = Generalised::new(&study.plant().plant);
            let feedback = study.design_model().feedback;
            let [own, outputs] = of_plant(machine, feedback);
            // Those of the inputs come first, so they are the same for all kinds.
            inputs = own;
            let states = states(g.a.nrows() / 2);
            kinds.push(PlantOfKind {
                feedback: feedback.name(),
                outputs: outputs.names,
                output_identifiers: outputs.identifiers,
                output_units: outputs.units,
                states: states.names,
                state_units: states.units,
                a: rows(&g.a),
                b: rows(&g.b),
                c: rows(&g.c),
                d: rows(&g.d),
            });
        }
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            inputs: inputs.names,
            input_identifiers: inputs.identifiers,
            input_units: inputs.units,
            kinds,
        })
    }

    /// The signals of each kind of feedback as CSV, with the kind's name: a line for each column of B
    /// and D and then for each row of C and D, with `identifier`, a name that MATLAB, Octave and
    /// python-control accept, `name` as in the machine file, and `unit`.
    pub fn signals(&self) -> impl Iterator<Item = (&'static str, String)> {
        self.kinds.iter().map(|kind| {
            let inputs = self.input_identifiers.iter().zip(&self.inputs);
            let inputs = inputs
                .zip(&self.input_units)
                .map(|signal| ("input", signal));
            let outputs = kind.output_identifiers.iter().zip(&kind.outputs);
            let outputs = outputs
                .zip(&kind.output_units)
                .map(|signal| ("output", signal));
            let mut text = "kind,identifier,name,unit\n".to_owned();
            for (end, ((identifier, name), unit)) in inputs.chain(outputs) {
                let name = name.replace('"', "\"\"");
                // Writing to a String cannot fail.
                writeln!(text, "{end},{identifier},\"{name}\",{unit}").unwrap_or_default();
            }
            (kind.feedback, text)
        })
    }
}
