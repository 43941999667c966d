//! The result of `host-gen campaign`.

use serde::Serialize;

use crate::design::Study;
use crate::simulate::faults::DefectOutcome;

/// Result of `host-gen campaign`: one outcome for each case.
#[derive(Debug, Serialize)]
pub struct CampaignSummary {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) feedback: &'static str,
    /// Longest allowed time from a fault to the safe codes, s.
    pub(crate) bound: f64,
    pub(crate) outcomes: Vec<DefectOutcome>,
}

impl CampaignSummary {
    /// The `outcomes` of a campaign with `study`.
    pub fn new(study: &Study, outcomes: Vec<DefectOutcome>) -> Self {
        Self {
            machine: study.machine().name.clone(),
            model_sha256: study.machine().digest.to_string(),
            feedback: study.design_model().feedback.name(),
            bound: study.machine().supervision.safe_ramp,
            outcomes,
        }
    }

    /// Whether in every case all outputs stayed within their limits and, after a fault,
    /// the outputs reached the safe codes in time.
    pub fn is_safe(&self) -> bool {
        self.outcomes.iter().all(|o| o.inside && o.safe)
    }
}
