//! What a design is, and why there is none.

use serde::{Deserialize, Serialize};
use shared::LEGS;
use shared::table::{TableError, ValidTable};

use crate::closed_loop::PeakSensitivity;
use crate::control::Shape;
use crate::machine::MachineError;
use crate::numeric::NumericError;

/// What rolls the loop off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shaping {
    /// The direct law: one low-pass for all channels.
    Common {
        /// Corner of the low-pass, Hz.
        corner_hz: f64,
    },
    /// The modal law: a shape for each mode.
    Modes {
        /// Slowest mode first.
        shapes: [Shape; LEGS],
    },
}

/// A controller for a machine, verified on the sampled, delayed loop.
#[derive(Clone, Debug, Serialize)]
pub struct Design {
    /// The table that a board runs.
    #[serde(skip)]
    pub table: ValidTable,
    /// What rolls the loop off.
    pub shaping: Shaping,
    /// Corner of the AC coupling, second order, Hz.
    pub ac_coupling_hz: f64,
    /// Corner of the integrators' leak, Hz.
    pub leak_hz: f64,
    /// Peak sensitivity of the sampled loop.
    pub peak_sensitivity: PeakSensitivity,
    /// The same controller on randomly perturbed machines; with the modal law only.
    pub drawn: Option<PerturbedSet>,
    /// The frequency above which the machine does not follow the floor under the
    /// ideal law, Hz.
    pub isolation_from_ideal_hz: f64,
    /// The frequency above which the machine does not follow the floor under the
    /// table, Hz.
    pub isolation_from_hz: f64,
    /// Real part of the slowest pole of the sampled loop, 1/s; negative.
    pub slowest_decay: f64,
    /// Whether the loop is stable at each of 25 gains of the soft start.
    pub soft_start: bool,
    /// Peaks of σ_max(G11) by band.
    pub bands: Vec<Band>,
}

/// A controller on randomly perturbed machines, as [`crate::machine::Machine::drawn`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PerturbedSet {
    /// Number of machines.
    pub samples: usize,
    /// Number of machines on which the loop is stable.
    pub stable: usize,
    /// Highest peak sensitivity of the stable ones, as
    /// [`PeakSensitivity::bounded`].
    pub peak_sensitivity: f64,
}

/// The highest peak of σ_max(G11) in a band.
#[derive(Clone, Debug, Serialize)]
pub struct Band {
    /// Name.
    pub name: String,
    /// Hz.
    pub low_hz: f64,
    /// Hz.
    pub high_hz: f64,
    /// Without control, dB.
    pub open_db: f64,
    /// Under the unsampled, undelayed law, dB; not a number where that loop is
    /// unstable.
    pub ideal_db: f64,
    /// As sampled on the board, dB.
    pub sampled_db: f64,
}

/// Why there is no design.
#[derive(Debug, thiserror::Error)]
pub enum DesignError {
    /// The board's numbers make no valid table.
    #[error("the board's numbers make no valid table: {0}")]
    Table(#[from] TableError),
    /// No shaping was found that reaches the target.
    #[error(
        "the target of {asked:.3} Hz with damping {damping} cannot be reached on this board: {reason}. {advice}"
    )]
    Unreachable {
        /// ω_n/2π, Hz.
        asked: f64,
        /// ζ_n.
        damping: f64,
        /// What prevents it.
        reason: String,
        /// What to change.
        advice: Advice,
    },
    /// A computation has no result.
    #[error(transparent)]
    Numeric(#[from] NumericError),
}

/// What can be done about a target that is not reached.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Advice {
    /// The nearest target frequency that is reached with the same damping, Hz.
    Nearest(f64),
    /// No frequency below the highest suspension mode is reached.
    NoFrequency,
    /// The shapes come from the file; nothing was searched.
    OtherShapes,
}

impl core::fmt::Display for Advice {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Nearest(hz) => write!(
                f,
                "Nearest that can, with the same damping: control.frequency = {hz}. A shorter delay (board.sample_rate, conversion_delay, output_delay) or a higher control.max_sensitivity also helps"
            ),
            Self::NoFrequency => f.write_str(
                "No frequency below the suspension modes can be reached with this damping: shorten the delay (board.sample_rate, conversion_delay, output_delay) or raise control.max_sensitivity",
            ),
            Self::OtherShapes => f.write_str(
                "Change control.shapes, or remove them to have shapes searched",
            ),
        }
    }
}

/// Why a machine has no study, or its loop no design.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The machine makes no model.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// The loop has no design.
    #[error(transparent)]
    Design(#[from] DesignError),
}

impl From<NumericError> for StudyError {
    fn from(error: NumericError) -> Self {
        Self::Design(error.into())
    }
}
