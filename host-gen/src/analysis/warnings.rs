//! Warnings about a machine, and the sources of its numbers.

use serde::Serialize;

use crate::design::Study;
use crate::design::study::Growth;
use crate::machine::{Certainty, FeedbackKind, Provenance};
use crate::model::gravity::buckling_load;
use crate::numeric::NumericError;

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
    let statics = &study.model().statics;
    let loads = statics.axial.iter().zip(&statics.buckled);
    for (beam, (load, buckled)) in study.machine().beams.iter().zip(loads) {
        if let Some(limit) = buckling_load(beam)
            && -load > limit
        {
            warnings.push(format!(
                "{} buckles: its load is {:.0} N, its buckling load {limit:.0} N",
                beam.name, -load
            ));
        } else if *buckled {
            warnings.push(format!(
                "{} buckles between its ends under its bending moments and its axial force of {load:.0} N",
                beam.name
            ));
        }
    }
    if let Some(hz) = study.falls() {
        warnings.push(format!(
            "the machine falls under its own weight: a mode grows at {hz:.3} Hz"
        ));
    }
    if study.design_model().feedback != FeedbackKind::Both {
        match study.growth()? {
            None => {}
            Some(Growth::Weight) => warnings.push(
                "with the sensor outputs held at zero, the machine is unstable under gravity: see host-gen zeros"
                    .to_owned(),
            ),
            Some(Growth::Placement) => warnings.push(
                "from leg forces to sensors there is an unstable zero, which limits the gain: see host-gen zeros"
                    .to_owned(),
            ),
        }
    }
    Ok(warnings)
}
