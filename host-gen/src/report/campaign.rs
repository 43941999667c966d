//! What `host-gen campaign` has to say.

use serde::Serialize;

use crate::analysis::digest;
use crate::design::Study;
use crate::simulate::faults::DefectOutcome;

/// `host-gen campaign`.
#[derive(Debug, Serialize)]
pub struct CampaignSummary {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) feedback: &'static str,
    /// From a fault to the safe codes, s.
    pub(crate) bound: f64,
    pub(crate) outcomes: Vec<DefectOutcome>,
}

impl CampaignSummary {
    /// Of a study.
    pub fn new(study: &Study, outcomes: Vec<DefectOutcome>) -> Self {
        Self {
            machine: study.machine().name.clone(),
            model_sha256: digest(study.machine()),
            feedback: study.design_model().feedback.name(),
            bound: study.machine().supervision.safe_ramp,
            outcomes,
        }
    }

    /// Whether all outputs stayed within limits and every fault ended safe within
    /// its bound.
    pub fn is_safe(&self) -> bool {
        self.outcomes.iter().all(|o| o.inside && o.safe)
    }
}
