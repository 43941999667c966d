//! Warnings about a machine, and the sources of its numbers.

use serde::Serialize;

use crate::design::Study;
use crate::machine::{Certainty, FeedbackKind, Provenance};
use crate::model::gravity::buckling_load;
use crate::numeric::NumericError;
use crate::plant::zeros::{grow, transmission_zeros};

/// The source of some of a machine's numbers.
#[derive(Debug, Serialize)]
pub(crate) struct Statement {
    pub(crate) kind: &'static str,
    pub(crate) entries: Vec<String>,
    pub(crate) from: String,
}

impl Statement {
    /// From an entry in the machine's file.
    pub(crate) fn new(provenance: &Provenance) -> Self {
        Self {
            kind: match provenance.kind {
                Certainty::Published => "published",
                Certainty::Reconstructed => "reconstructed",
                Certainty::Assumed => "assumed",
            },
            entries: provenance.entries.clone(),
            from: provenance.from.clone(),
        }
    }
}

/// Effects of gravity: legs that buckle, and instability. Empty if there are none.
///
/// # Errors
/// [`NumericError`] if an eigenvalue iteration does not converge.
pub(crate) fn warnings(study: &Study) -> Result<Vec<String>, NumericError> {
    let mut warnings = Vec::new();
    let loads = study.model().statics.axial.iter();
    for (beam, load) in study.machine().beams.iter().zip(loads) {
        let limit = buckling_load(beam);
        if -load > limit {
            warnings.push(format!(
                "{} buckles: its load is {:.0} N, its buckling load {limit:.0} N",
                beam.name, -load
            ));
        }
    }
    if study.model().modes().squares[0] < 0.0 {
        warnings.push("the machine is unstable under its own weight".to_owned());
    }
    let feedback = study.design_model().feedback;
    if feedback != FeedbackKind::Both
        && grow(&transmission_zeros(
            &study.plant().plant.state_space,
            feedback,
        )?)
    {
        warnings.push(
            "with the sensor outputs held at zero, the machine is unstable under gravity: see host-gen zeros"
                .to_owned(),
        );
    }
    Ok(warnings)
}
