//! What `host-gen generate` and `host-gen simulate` have to say.

use serde::Serialize;

use crate::analysis::digest;
use crate::analysis::gains::GainAnalysis;
use crate::analysis::modes::ModeAnalysis;
use crate::analysis::warnings::{Statement, warnings};
use crate::design::{Design, Study};
use crate::machine::Certainty;
use crate::numeric::NumericError;
use crate::simulate::run::Comparison;

/// `host-gen simulate`.
#[derive(Debug, Serialize)]
pub struct SimulateSummary {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) shaped: Design,
    pub(crate) simulation: Comparison,
}

impl SimulateSummary {
    /// Of a study's loop.
    pub fn new(study: &Study, shaped: Design, simulation: Comparison) -> Self {
        Self {
            machine: study.machine().name.clone(),
            model_sha256: digest(study.machine()),
            shaped,
            simulation,
        }
    }
}

/// `host-gen generate`.
#[derive(Debug, Serialize)]
pub struct GenerateSummary {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) modes: ModeAnalysis,
    pub(crate) gains: GainAnalysis,
    pub(crate) shaped: Design,
    pub(crate) table: String,
    pub(crate) simulation: Comparison,
    pub(crate) not_published: Vec<Statement>,
    pub(crate) warnings: Vec<String>,
}

impl GenerateSummary {
    /// Of a study whose table was written to `table`.
    ///
    /// # Errors
    /// Where an eigenvalue iteration does not converge.
    pub fn new(
        study: &Study,
        shaped: Design,
        table: String,
        simulation: Comparison,
    ) -> Result<Self, NumericError> {
        let machine = study.machine();
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: digest(machine),
            modes: ModeAnalysis::new(study),
            gains: GainAnalysis::new(study)?,
            shaped,
            table,
            simulation,
            warnings: warnings(study)?,
            not_published: machine
                .provenance
                .iter()
                .filter(|p| p.kind != Certainty::Published)
                .map(Statement::new)
                .collect(),
        })
    }
}
