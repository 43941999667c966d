//! Machines side by side.

use serde::{Serialize, Serializer};
use shared::LEGS;

use super::compliance::{Compliance, Highest, LoadCompliance};
use crate::closed_loop::Pole;
use crate::design::{Design, DesignedStudy, NoDesign, Study, StudyError};
use crate::machine::FeedbackKind;
use crate::model::energy::{Kind, energies};

/// Result of `host-gen compare`: key figures of several machines side by side.
#[derive(Debug, Serialize)]
pub struct MachineComparison {
    pub(crate) machines: Vec<MachineColumn>,
}

#[derive(Debug, Serialize)]
pub(crate) struct MachineColumn {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) feedback: &'static str,
    pub(crate) suspension_hz: Vec<f64>,
    pub(crate) internal_hz: Vec<f64>,
    pub(crate) rigid_modes_hz: [f64; LEGS],
    pub(crate) acceleration_zeros_hz: Vec<f64>,
    pub(crate) force_zeros_hz: Vec<f64>,
    /// Largest magnitude in the proportional gains: N/(m/s²), or without unit for force
    /// feedback.
    pub(crate) largest_gain: f64,
    /// Of the node of each load along or about it.
    pub(crate) compliance: Vec<OwnCompliance>,
    /// The design; `null` in JSON if there is none.
    #[serde(serialize_with = "design_or_null")]
    pub(crate) shaped: Result<Design, NoDesign>,
}

/// How far a load displaces its own node.
#[derive(Debug, Serialize)]
pub(crate) struct OwnCompliance {
    pub(crate) load: String,
    /// `"m/N"` or `"rad/(N m)"`.
    pub(crate) unit: &'static str,
    /// Magnitude at rest, without and with control.
    pub(crate) at_rest: f64,
    pub(crate) open_highest: Highest,
    /// None without a design.
    pub(crate) closed_highest: Option<Highest>,
}

impl OwnCompliance {
    fn new(load: &LoadCompliance) -> Self {
        let own = load.own();
        Self {
            load: load.name.clone(),
            unit: match own.unit {
                "rad" => "rad/(N m)",
                _ => "m/N",
            },
            at_rest: own.fixed.abs(),
            open_highest: own.open_highest,
            closed_highest: own.closed_highest,
        }
    }
}

fn design_or_null<S: Serializer>(
    design: &Result<Design, NoDesign>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    design.as_ref().ok().serialize(serializer)
}

impl MachineComparison {
    /// Compares machines, one column for each, in the given order.
    ///
    /// # Errors
    /// [`StudyError`] if a machine gives no valid model or an eigenvalue iteration does
    /// not converge.
    pub fn new<'a>(
        machines: impl IntoIterator<Item = &'a DesignedStudy>,
    ) -> Result<Self, StudyError> {
        let machines = machines
            .into_iter()
            .map(MachineColumn::new)
            .collect::<Result<_, _>>()?;
        Ok(Self { machines })
    }
}

impl MachineColumn {
    fn new(DesignedStudy { study, design }: &DesignedStudy) -> Result<Self, StudyError> {
        let kinds = Study::of_each_kind(study.machine())?;
        // Empty without sensors of this kind.
        let zeros = |feedback| -> Result<Vec<f64>, StudyError> {
            let mut kinds = kinds.iter();
            let Some(study) = kinds.find(|study| study.design_model().feedback == feedback) else {
                return Ok(Vec::new());
            };
            let zeros = study.zeros()?;
            let upper = zeros.into_iter().filter(|s| s.im >= 0.0);
            Ok(upper.map(|s| Pole::from(s).hz).collect())
        };
        let modes = study.model().modes();
        let energies = energies(study.machine(), study.model(), &modes);
        let of = |kind| {
            let pairs = modes.hertz().into_iter().zip(&energies);
            let those = pairs.filter(|(_, energies)| energies.kind == kind);
            those.map(|(hz, _)| hz).collect()
        };
        let compliance = Compliance::of(study, design.as_ref().ok())?;
        let loads = compliance.iter().flat_map(|found| &found.loads);
        Ok(Self {
            machine: study.machine().name.clone(),
            model_sha256: study.machine().digest.to_string(),
            feedback: study.design_model().feedback.name(),
            suspension_hz: of(Kind::Suspension),
            internal_hz: of(Kind::Internal),
            rigid_modes_hz: study.design_model().hertz(),
            acceleration_zeros_hz: zeros(FeedbackKind::Acceleration)?,
            force_zeros_hz: zeros(FeedbackKind::Force)?,
            largest_gain: study.gains().proportional.amax(),
            compliance: loads.map(OwnCompliance::new).collect(),
            shaped: design.clone(),
        })
    }
}
