//! How far loads on the machine displace it: over frequency, and over time.

use serde::Serialize;

use super::profile::Profile;
use super::push::{Pushed, push};
use crate::analysis::compliance::{Compliance, displacements};
use crate::design::{Design, Study};
use crate::machine::{EntryError, MachineError};
use crate::numeric::NumericError;
use crate::plant::SampledPlant;

/// Why the compliance of a machine is not known.
#[derive(Debug, thiserror::Error)]
pub enum ComplianceError {
    /// The file has no loads.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// A computation failed.
    #[error(transparent)]
    Numeric(#[from] NumericError),
}

/// Loads over time, and how their displacements are judged.
#[derive(Clone, Debug)]
pub struct Pushing<'a> {
    /// The loads.
    pub profile: &'a Profile,
    /// What they are, in words.
    pub name: String,
    /// Time to simulate, s.
    pub duration: f64,
    /// Within what of its last value a displacement is settled.
    pub tolerance: Tolerance,
}

/// Result of `host-gen compliance`.
#[derive(Debug, Serialize)]
pub struct ComplianceAnalysis {
    pub(crate) machine: String,
    model_sha256: String,
    /// Over frequency.
    #[serde(flatten)]
    pub(crate) compliance: Compliance,
    /// Under loads over time, if any were given.
    pub(crate) profile: Option<Response>,
}

/// What loads over time do.
#[derive(Debug, Serialize)]
pub(crate) struct Response {
    /// What the loads were, in words.
    pub(crate) name: String,
    /// Simulated time, s.
    pub(crate) duration: f64,
    /// Part of the largest displacement within which a displacement is settled, or the tolerance,
    /// m or rad.
    pub(crate) tolerance: Tolerance,
    /// Time of the last change of the loads, s.
    pub(crate) last_change: f64,
    pub(crate) outputs: Vec<Settling>,
    /// Largest force of a leg with control, N, and steps in which the clamp was active.
    pub(crate) force_peak: f64,
    pub(crate) clamped_steps: usize,
    /// Times, s, at which the displacements are given: at most [`SHOWN`].
    pub(crate) seconds: Vec<f64>,
}

/// Within what a displacement is settled.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Tolerance {
    /// A part of its largest magnitude without control.
    Part(f64),
    /// m or rad.
    Absolute(f64),
}

/// One displacement over time.
#[derive(Debug, Serialize)]
pub(crate) struct Settling {
    pub(crate) name: String,
    pub(crate) unit: &'static str,
    pub(crate) open: Course,
    pub(crate) closed: Course,
}

/// A displacement over time, without or with control.
#[derive(Debug, Serialize)]
pub(crate) struct Course {
    /// Largest magnitude, m or rad.
    pub(crate) peak: f64,
    /// Time from the last change of the loads until the displacement stays within the tolerance of
    /// where it ends at rest, s; none if it does not within the simulated time.
    pub(crate) settled_after: Option<f64>,
    /// At the times of the response, m or rad.
    pub(crate) displacement: Vec<f64>,
}

/// Most points of a displacement over time.
const SHOWN: usize = 2000;

impl ComplianceAnalysis {
    /// The compliance of `study`'s machine to its loads, without control and with `design`; and its
    /// response to loads over time, if there are any.
    ///
    /// # Errors
    /// [`ComplianceError::Machine`] if the file has no loads;
    /// [`ComplianceError::Numeric`] if an eigenvalue iteration does not converge.
    pub fn new(
        study: &Study,
        design: &Design,
        pushing: Option<Pushing<'_>>,
    ) -> Result<Self, ComplianceError> {
        let machine = study.machine();
        if machine.loads.is_empty() {
            let error = EntryError::new("", "the file has no loads").fix(
                "add [loads.NAME] with node and direction, of a force or a moment on the machine",
            );
            return Err(machine.locate(error).into());
        }
        let plant = study.loaded_plant()?;
        let compliance = Compliance::new(study, &plant, Some(design))?;
        let response = pushing.map(|pushing| respond(study, design, &plant, pushing));
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            compliance,
            profile: response,
        })
    }
}

fn respond(
    study: &Study,
    design: &Design,
    plant: &SampledPlant,
    Pushing {
        profile,
        name,
        duration,
        tolerance,
    }: Pushing<'_>,
) -> Response {
    let board = &study.machine().board;
    let steps = (duration * board.sample_rate).ceil() as usize;
    let loads: Vec<_> = (0..steps)
        .map(|k| profile.at(k as f64 * plant.period))
        .collect();
    let end = plant.plant.at_rest(plant.plant.performance()) * profile.last();
    let one = |closed| push(plant, board, &design.table, loads.clone(), closed);
    let (open, closed) = rayon::join(|| one(false), || one(true));
    let every = steps.div_ceil(SHOWN).max(1);
    let last_change = profile.last_change();
    let names = displacements(study.machine()).into_iter().enumerate();
    let settling = names.map(|(i, (name, unit))| {
        let peak = |pushed: &Pushed| {
            pushed.displacements[i]
                .iter()
                .fold(0.0, |a, x| x.abs().max(a))
        };
        let within = match tolerance {
            Tolerance::Part(part) => part * peak(&open),
            Tolerance::Absolute(size) => size,
        };
        let course = |pushed: &Pushed| {
            let all = &pushed.displacements[i];
            let last = all.iter().rposition(|x| (x - end[i]).abs() > within);
            let settled = match last {
                None => Some(0.0),
                // The mean of a period is that of its middle; within from the next on.
                Some(last) if last + 1 < steps => {
                    Some(((last + 1) as f64 * plant.period - last_change).max(0.0))
                }
                Some(_) => None,
            };
            Course {
                peak: peak(pushed),
                settled_after: settled,
                displacement: all.iter().copied().step_by(every).collect(),
            }
        };
        Settling {
            name,
            unit,
            open: course(&open),
            closed: course(&closed),
        }
    });
    Response {
        outputs: settling.collect(),
        name,
        duration,
        tolerance,
        last_change,
        force_peak: closed.force_peak,
        clamped_steps: closed.clamped_steps,
        seconds: (0..steps)
            .step_by(every)
            .map(|k| (k as f64 + 0.5) * plant.period)
            .collect(),
    }
}
