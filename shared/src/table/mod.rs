//! The controller table: every number that configures a board.
//!
//! `host-gen` fills a [`Table`], the firmware links it as a constant, and the
//! simulation uses the same value. [`Table::validate`] turns it into a
//! [`ValidTable`], which is all that the step accepts. Validation is `const`, so
//! the compiler checks a table that is compiled into the firmware.

mod direct_path;
mod encode;
mod error;
mod law;
mod limits;
mod self_test;
mod supervision;
mod validate;

use core::fmt::{self, Display, Formatter};

use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::{AdcCode, Calibration, DacCode, Drive};

pub use direct_path::DirectPath;
pub use encode::TABLE_ROOM;
pub use error::TableError;
pub use law::{Channel, Complement, Direct, Law, Modal, Paths, SECTIONS, Section};
pub use limits::Limits;
pub use self_test::{Phasor, SelfTest};
pub use supervision::Supervision;
pub use validate::ValidTable;

/// Version of the table layout that this code reads.
pub const FORMAT_VERSION: u16 = 6;

/// SHA-256 of the machine description that a table was made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelDigest(pub [u8; 32]);

/// Hexadecimal, 64 digits.
impl Display for ModelDigest {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// The quantity that the table's six sensors measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Feedback {
    /// Absolute accelerations of the frame, m/s², Eq. (12).
    Acceleration,
    /// Whole leg forces, N, Eq. (11).
    Force,
}

/// Every number that configures a board. Plain data; [`Table::validate`] checks it.
///
/// The order of the fields is part of the layout: see [`FORMAT_VERSION`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// [`FORMAT_VERSION`] at the time the table was made.
    pub version: u16,
    /// Digest of the machine description that the table was made from.
    pub model: ModelDigest,
    /// Sample rate, Hz: one step per sample.
    pub sample_rate: f32,
    /// Delay from the sampling instant to the instant at which the outputs computed
    /// from that sample are latched, s. The loop was designed for this delay.
    pub latch: f32,
    /// The quantity that the sensors measure.
    pub feedback: Feedback,
    /// Calibration of each sensor channel, in the order of the law's columns.
    pub sensors: [Calibration; LEGS],
    /// Highest ADC code. The lowest is −`adc_max` − 1.
    pub adc_max: AdcCode,
    /// Coefficient of the AC coupling, two first-order high-passes in series on every
    /// sensor, 0 to 1 per sample; 0 switches the AC coupling off.
    pub ac_coupling: f32,
    /// Largest deviation that the averages of the AC coupling follow, in sensor units;
    /// larger ones count as this. Without a limit a shock would become an offset, and
    /// the legs would push against it for the time constant of the coupling.
    pub ac_limit: f32,
    /// The control law, from sensor values to leg forces.
    pub law: Law,
    /// Drive of each actuator channel, in the order of the law's rows.
    pub actuators: [Drive; LEGS],
    /// Highest DAC code. The lowest is 0.
    pub dac_max: DacCode,
    /// Thresholds and times of the supervisor.
    pub supervision: Supervision,
    /// Test signal of the self-test, and the answers expected from the sensors.
    pub self_test: SelfTest,
}

impl Table {
    /// The force sensors of a law with both kinds of sensors. None if the law uses
    /// only one kind.
    #[inline]
    pub const fn complement(&self) -> Option<&Complement> {
        match &self.law.paths {
            Paths::Direct(_) => None,
            Paths::Modal(modal) => modal.complement.as_ref(),
        }
    }
}
