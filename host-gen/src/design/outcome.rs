//! A design, and the errors when there is none.

use serde::{Deserialize, Serialize};
use shared::LEGS;
use shared::table::{TableError, ValidTable};

use crate::closed_loop::{PeakSensitivity, RollOffUse};
use crate::control::Shape;
use crate::machine::MachineError;
use crate::numeric::NumericError;

/// How the loop gain rolls off above the crossover.
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
        shapes: Box<[Shape; LEGS]>,
    },
}

/// A controller for a machine, verified on the sampled, delayed loop.
#[derive(Clone, Debug, Serialize)]
pub struct Design {
    /// The table that a board runs.
    #[serde(skip)]
    pub table: ValidTable,
    /// How the loop gain rolls off above the crossover.
    pub shaping: Shaping,
    /// Corner of the AC coupling, second order, Hz.
    pub ac_coupling_hz: f64,
    /// Corner of the integrators' leak, Hz.
    pub leak_hz: f64,
    /// Peak sensitivity of the sampled loop.
    pub peak_sensitivity: PeakSensitivity,
    /// How much of the limit at high frequency the loop uses, if there is one.
    pub roll_off: Option<RollOffUse>,
    /// The same controller on randomly perturbed machines; with the modal law only.
    pub drawn: Option<PerturbedSet>,
    /// Frequency above which the machine as a whole is isolated from the floor
    /// (transmissibility below 1/√2) with the ideal law, Hz.
    pub isolation_from_ideal_hz: f64,
    /// Frequency above which the machine as a whole is isolated from the floor
    /// (transmissibility below 1/√2) with the table, Hz.
    pub isolation_from_hz: f64,
    /// Real part of the slowest pole of the sampled loop, 1/s; negative.
    pub slowest_decay: f64,
    /// Whether the loop is stable at each of 25 gains of the soft start, from the
    /// smallest to 1.
    pub soft_start: bool,
    /// Highest σ_max(G11) in each band of the machine.
    pub bands: Vec<Band>,
    /// What the loop costs between a tenth of the target frequency and the lowest band; `None`
    /// if a band begins there.
    pub below: Option<Below>,
}

/// How much the loop raises σ_max(G11) below the bands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Below {
    /// Where the lowest band begins, Hz.
    pub high_hz: f64,
    /// The most by which the sampled loop raises σ_max(G11), dB.
    pub db: f64,
    /// The frequency of that, Hz.
    pub hz: f64,
}

/// A controller on randomly perturbed machines, as [`crate::machine::Machine::drawn`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PerturbedSet {
    /// Number of machines.
    pub samples: usize,
    /// Number of machines on which the loop is stable.
    pub stable: usize,
    /// Highest peak sensitivity of the stable loops, as [`PeakSensitivity::bounded`].
    pub peak_sensitivity: f64,
}

/// The highest peak of σ_max(G11) in a band.
#[derive(Clone, Debug, Serialize)]
pub struct Band {
    /// Name of the band.
    pub name: String,
    /// Lower end of the band, Hz.
    pub low_hz: f64,
    /// Upper end of the band, Hz.
    pub high_hz: f64,
    /// Highest σ_max(G11) without control, dB.
    pub open_db: f64,
    /// Highest σ_max(G11) with the ideal law, without sampling and delay, dB; NaN if that
    /// loop is unstable.
    pub ideal_db: f64,
    /// Highest σ_max(G11) with the sampled, delayed law of the board, dB.
    pub sampled_db: f64,
}

/// Errors of the search for a design.
#[derive(Clone, Debug, thiserror::Error)]
pub enum DesignError {
    /// The board's parameters give no valid table.
    #[error("the board's parameters give no valid table: {0}")]
    Table(#[from] TableError),
    /// No shaping was found that reaches the target.
    #[error(
        "no controller was found that reaches the target of {asked:.3} Hz with damping {damping} on this board: {refusal}"
    )]
    Unreachable {
        /// Target suspension frequency ω_n/2π, Hz.
        asked: f64,
        /// Target relative damping ζ_n.
        damping: f64,
        /// Why, and what to change.
        refusal: Refusal,
    },
    /// The machine is unstable without control: gravity or a negative stiffness tips it over.
    #[error(
        "the machine does not stand without control: a mode grows at {hz:.3} Hz (host-gen modes), and a controller is designed for a machine that stands. Make the suspension stiffer, lower the centre of gravity, take away negative stiffness, or turn gravity if the machine hangs"
    )]
    Falls {
        /// Rate of growth of the fastest growing mode over 2π, Hz.
        hz: f64,
    },
    /// A numerical computation failed.
    #[error(transparent)]
    Numeric(#[from] NumericError),
}

/// Why a target is not reached, and what to change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refusal {
    /// The reason, without a full stop.
    pub reason: String,
    /// What to change.
    pub advice: Advice,
    /// The lowest frequency found that is reached with both kinds of sensors, Hz, where that is
    /// the way out.
    pub both: Option<f64>,
}

impl core::fmt::Display for Refusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{}. {}", self.reason, self.advice)?;
        match self.both {
            Some(hz) => write!(
                f,
                ". With control.feedback = \"both\", {hz} Hz can be reached"
            ),
            None => Ok(()),
        }
    }
}

/// Advice for a target that is not reached.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Advice {
    /// The nearest target frequency found that is reached with the same damping, Hz: above
    /// the requested one, or below the suspension modes.
    Nearest(f64),
    /// No frequency between the requested one and the suspension modes was found that is
    /// reached with this damping.
    NoFrequency,
    /// The shapes come from the machine's file; nothing was searched.
    OtherShapes,
}

impl core::fmt::Display for Advice {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Nearest(hz) => write!(
                f,
                "The nearest frequency found that can be reached with the same damping: control.frequency = {hz}. A shorter delay (board.sample_rate, conversion_delay, output_delay) or a higher control.max_sensitivity also helps"
            ),
            Self::NoFrequency => f.write_str(
                "No frequency between it and the suspension modes was found that can be reached with this damping. Shorten the delay (board.sample_rate, conversion_delay, output_delay) or raise control.max_sensitivity, or control.roll_off.hz if there is one",
            ),
            Self::OtherShapes => f.write_str(
                "Change control.shapes, or remove it to search for shapes",
            ),
        }
    }
}

/// Errors of a machine's model and of its design.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The machine gives no valid model.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// No design was found, or a computation failed.
    #[error(transparent)]
    Design(#[from] DesignError),
}

impl From<NumericError> for StudyError {
    fn from(error: NumericError) -> Self {
        Self::Design(error.into())
    }
}
