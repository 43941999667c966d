//! The designed controller compared with the ideal one: isolation by mode, margins,
//! delay, rounding, and designs for other boards.

use serde::Serialize;

use super::actuators::Actuators;
use super::bound::{Room, room};
use super::delay::DelayBudget;
use super::floors::FloorAnalysis;
use super::isolation::{AT, ModeIsolation};
use super::other_boards::{OtherBoard, other_boards};
use super::rounding::{Rounding, rounding};
use crate::closed_loop::SampledLoop;
use crate::closed_loop::budget::both_budgets;
use crate::closed_loop::margins::{Margins, margins};
use crate::design::{Cache, Design, Study, StudyError};
use crate::numeric::NumericError;
use crate::numeric::frequencies::pole_peaks;
use crate::progress::Progress;

/// Result of `host-gen design`: a design with isolation by mode, margins, delay and
/// rounding.
#[derive(Debug, Serialize)]
pub struct DesignAnalysis {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) feedback: &'static str,
    pub(crate) shaped: Design,
    /// With a roll-off only.
    pub(crate) room: Option<Room>,
    /// With a roll-off, where an rms is minimised.
    pub(crate) rms_room: Option<Room>,
    pub(crate) isolation_at_hz: [f64; AT.len()],
    pub(crate) modes: Vec<ModeIsolation>,
    pub(crate) margins: Margins,
    pub(crate) delay: DelayBudget,
    pub(crate) actuators: Actuators,
    pub(crate) rounding: Vec<Rounding>,
    /// On the floor of the file, in the band of its simulation.
    pub(crate) floor: FloorAnalysis,
    pub(crate) chart: Vec<OtherBoard>,
}

impl DesignAnalysis {
    /// Analyses `design` on the sampled loop of `study`.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn new(study: &Study, design: Design) -> Result<Self, NumericError> {
        let machine = study.machine();
        let closed = SampledLoop::new(study.plant(), &design.table);
        let poles = closed.poles()?;
        let motion = machine.floor_motion();
        let [open, under] = both_budgets(
            study.plant(),
            &machine.board,
            &design.table,
            &motion,
            machine.simulation.floor_band,
            machine.exposure,
        )?;
        let floor = FloorAnalysis::new(study, motion.name(), open, under).without_spectra();
        let [room, rms_room] = room(study, &design)?;
        Ok(Self {
            floor,
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            feedback: study.design_model().feedback.name(),
            isolation_at_hz: AT,
            modes: ModeIsolation::all(study, &closed, &poles)?,
            margins: margins(
                &closed,
                study.design_model(),
                &machine.target,
                &pole_peaks(&poles),
            ),
            delay: DelayBudget::new(&machine.board),
            actuators: Actuators::new(study, &closed, &pole_peaks(&poles)),
            rounding: rounding(machine, &design.table),
            room,
            rms_room,
            chart: Vec::new(),
            shaped: design,
        })
    }

    /// Adds rough designs for other sample rates and delays. This takes several times as
    /// long as one design. `progress` is called after every trial of the searches.
    ///
    /// # Errors
    /// [`StudyError`] if the machine with another board gives no valid model or a
    /// computation fails.
    pub fn with_other_boards(
        mut self,
        study: &Study,
        cache: Option<&Cache>,
        progress: &dyn Progress,
    ) -> Result<Self, StudyError> {
        self.chart = other_boards(study.machine(), cache, progress)?;
        Ok(self)
    }
}
