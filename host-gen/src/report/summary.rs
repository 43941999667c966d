//! The results of `host-gen generate` and `host-gen simulate`.

use serde::Serialize;

use crate::analysis::gains::GainAnalysis;
use crate::analysis::modes::ModeAnalysis;
use crate::analysis::warnings::{Statement, warnings};
use crate::design::{Design, Study};
use crate::machine::Certainty;
use crate::numeric::NumericError;
use crate::simulate::run::Comparison;

/// Result of `host-gen simulate`: the design and the simulation of open and closed loop.
#[derive(Debug, Serialize)]
pub struct SimulateSummary {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) shaped: Design,
    pub(crate) simulation: Comparison,
}

impl SimulateSummary {
    /// The design `shaped` of `study`, and its `simulation`.
    pub fn new(study: &Study, shaped: Design, simulation: Comparison) -> Self {
        Self {
            machine: study.machine().name.clone(),
            model_sha256: study.machine().digest.to_string(),
            shaped,
            simulation,
        }
    }
}

/// Result of `host-gen generate`: modes, gains, design, simulation, and the numbers that
/// are not published.
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
    /// Summary for `study` with its design `shaped`, whose table was written to the file
    /// `table`.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn new(
        study: &Study,
        shaped: Design,
        table: String,
        simulation: Comparison,
    ) -> Result<Self, NumericError> {
        let machine = study.machine();
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            modes: ModeAnalysis::new(study),
            gains: GainAnalysis::new(study)?,
            shaped,
            table,
            simulation,
            warnings: warnings(study),
            not_published: machine
                .provenance
                .iter()
                .filter(|p| p.kind != Certainty::Published)
                .map(Statement::new)
                .collect(),
        })
    }
}
