//! Modes of the controller, the events that change them, and faults.
//!
//! [`Mode::after`] is the complete transition table. `docs/supervisor.md` shows it, and a
//! test compares the two.

use serde::{Deserialize, Serialize};

/// What drives the legs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// Safe codes. No self-test has passed since power-up, or since the last fault was
    /// cleared.
    Untested,
    /// The self-test: each leg in turn gets a small sine, and the answer of every sensor
    /// is compared with the model's.
    Testing,
    /// Safe codes, or an injection.
    Idle,
    /// Soft start: the loop is closed and its gain grows.
    Starting,
    /// The loop is closed at its target gain.
    Closed,
    /// Soft stop: the law's force fades to zero.
    Stopping,
    /// After a fault: the outputs move from their last values to the safe codes.
    Failing,
    /// Safe codes until the fault is cleared.
    Failed,
}

/// What changes the mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Event {
    /// Request: test sensors and legs.
    SelfTest,
    /// Request: close the loop.
    Start,
    /// Request: open the loop, or end a self-test or an injection.
    Stop,
    /// Request: clear the fault.
    Clear,
    /// The self-test passed.
    Passed,
    /// A ramp, of the gain or to the safe codes, has ended.
    Ramped,
    /// A fault was found.
    Fault,
    /// Request: run another table.
    Replace,
}

impl Mode {
    /// All modes.
    pub const ALL: [Self; 8] = [
        Self::Untested,
        Self::Testing,
        Self::Idle,
        Self::Starting,
        Self::Closed,
        Self::Stopping,
        Self::Failing,
        Self::Failed,
    ];

    /// The mode after an event. None if the event is refused or cannot happen; the mode
    /// then stays the same.
    pub const fn after(self, event: Event) -> Option<Self> {
        Some(match (self, event) {
            (Self::Untested | Self::Idle, Event::SelfTest) => Self::Testing,
            (Self::Testing, Event::Passed) => Self::Idle,
            (Self::Testing, Event::Stop) | (Self::Untested | Self::Idle, Event::Replace) => {
                Self::Untested
            }
            (Self::Idle, Event::Start) => Self::Starting,
            (Self::Idle, Event::Stop) => Self::Idle,
            (Self::Starting, Event::Ramped) => Self::Closed,
            (Self::Starting | Self::Closed | Self::Stopping, Event::Stop) => Self::Stopping,
            (Self::Stopping, Event::Ramped) => Self::Idle,
            (Self::Failing, Event::Ramped) => Self::Failed,
            (Self::Failed, Event::Clear) => Self::Untested,
            // Only the first fault is latched.
            (Self::Failing | Self::Failed, Event::Fault) => return None,
            (_, Event::Fault) => Self::Failing,
            _ => return None,
        })
    }

    /// Whether the control law drives the legs.
    pub const fn is_loop(self) -> bool {
        matches!(self, Self::Starting | Self::Closed | Self::Stopping)
    }

    /// Whether a fault is latched.
    pub const fn is_fault(self) -> bool {
        matches!(self, Self::Failing | Self::Failed)
    }
}

impl Event {
    /// All events.
    pub const ALL: [Self; 8] = [
        Self::SelfTest,
        Self::Start,
        Self::Stop,
        Self::Clear,
        Self::Passed,
        Self::Ramped,
        Self::Fault,
        Self::Replace,
    ];
}

/// The cause of a fault.
///
/// A mask of sensors has bit i for sensor i, and bit 6 + i for force sensor i of a
/// [`Complement`](crate::table::Complement). A mask of legs has bit i for leg i.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cause {
    /// The table does not match its checksum.
    Table,
    /// Sensors were at an end of the ADC's range for too long; mask of sensors.
    Rail(u16),
    /// Sensors gave the same code for too long; mask of sensors.
    Stuck(u16),
    /// Sensors had an rms far above or far below that of the others; mask of sensors.
    Implausible(u16),
    /// Self-test or pilot: sensors did not answer as the model predicts; mask of sensors.
    TestSensors(u16),
    /// Self-test or pilot: legs did not push as the model predicts; mask of legs.
    TestLegs(u8),
    /// Too many consecutive samples could not be read.
    Lost,
    /// Too many deadlines were missed.
    Late,
    /// A force was not a finite number.
    NotFinite,
    /// The forces were clamped for too long.
    Saturated,
    /// The forces grew from window to window.
    Diverging,
    /// No valid frame arrived on the link for too long.
    Silent,
    /// Codes of sensors jumped and returned, as with bit errors on a bus or a loose
    /// contact; mask of sensors.
    Erratic(u16),
}

/// A latched fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LatchedFault {
    /// Cause of the fault.
    pub cause: Cause,
    /// Time of the fault, samples since power-up.
    pub at: u64,
}

/// Gain at which a soft start begins, and below which a soft stop ends.
pub const GENTLE: f32 = 1e-3;

/// Gain at which a soft start waits until the machine is at rest. It damps the modes many
/// times faster than they decay by themselves, and asks for only small forces.
pub const QUIET: f32 = 0.03;
