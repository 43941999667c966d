//! What may drive the legs and when: modes, the events that change them, faults.
//!
//! [`Mode::after`] is the whole table of states; `docs/supervisor.md` shows it and
//! a test holds the two against each other.

use serde::{Deserialize, Serialize};

use crate::table::TableError;

/// What the controller does with the legs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// Safe codes. Nothing has been tested since power came or a fault was
    /// cleared.
    Untested,
    /// Each leg in turn pushes a little and every sensor's answer is compared
    /// with the model's.
    Testing,
    /// Safe codes, or an injection.
    Idle,
    /// The gain rises.
    Starting,
    /// The loop is closed.
    Closed,
    /// The gain falls to nothing.
    Stopping,
    /// After a fault: the outputs go from where they were to the safe codes.
    Failing,
    /// Safe codes, latched until the fault is cleared.
    Failed,
}

/// What changes a mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Event {
    /// Asked: test sensors and legs.
    SelfTest,
    /// Asked: close the loop.
    Start,
    /// Asked: open it, or end a test or an injection.
    Stop,
    /// Asked: forget the fault.
    Clear,
    /// The test found all as it should be.
    Passed,
    /// A ramp, of the gain or to the safe codes, is at its end.
    Ramped,
    /// Something is wrong.
    Fault,
    /// Asked: run another table.
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

    /// The mode after an event; none if the event is refused, or cannot be, and
    /// the mode stays.
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
            // The first fault counts.
            (Self::Failing | Self::Failed, Event::Fault) => return None,
            (_, Event::Fault) => Self::Failing,
            _ => return None,
        })
    }

    /// Whether the law has a part in the legs' forces.
    pub const fn is_loop(self) -> bool {
        matches!(self, Self::Starting | Self::Closed | Self::Stopping)
    }

    /// Whether the outputs are under the control of a fault.
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

/// Why the loop was opened. Masks have a bit a channel: sensors from bit 0, the
/// force sensors beside them from bit 6, legs from bit 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cause {
    /// The table is not the one that was made: its checksum is wrong.
    Table,
    /// Sensors at an end of the ADC's range for too long.
    Rail(u16),
    /// Sensors that gave the same code for too long.
    Stuck(u16),
    /// Sensors that move far more or far less than the others.
    Implausible(u16),
    /// Self-test or pilot: sensors that did not answer as the model says.
    TestSensors(u16),
    /// Self-test or pilot: legs that did not push as the model says.
    TestLegs(u8),
    /// Too many samples in a row were not read.
    Lost,
    /// Too many deadlines were missed.
    Late,
    /// A force was not a finite number.
    NotFinite,
    /// The legs were at their limits for too long.
    Saturated,
    /// The forces grew and grew.
    Diverging,
    /// Nobody was heard on the link for too long.
    Silent,
    /// Sensors whose codes jump there and back, as bits turned on a bus or a bad
    /// contact do.
    Erratic(u16),
}

/// A latched fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// Why.
    pub cause: Cause,
    /// When, samples since power came.
    pub at: u64,
}

/// The gain that a soft start begins with and a soft stop ends after.
pub const GENTLE: f32 = 1e-3;

/// The gain under which a soft start lets the machine come to rest: enough to damp
/// its modes many times faster than they would be, too little to push hard.
pub const QUIET: f32 = 0.03;

/// When the supervisor acts. Counts are samples unless they say otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Supervision {
    /// Factor of the gain from sample to sample on its way from [`GENTLE`] to 1 and
    /// back: the machine's swing dies out under a gain that is still small, before
    /// a large one could ask more of the legs than they have.
    pub ramp: f32,
    /// A soft start waits so long at [`QUIET`], then settles the AC coupling on the
    /// mean of as many more: while the machine swung, the averages swung with it.
    pub settle: u32,
    /// From a fault to the safe codes.
    pub safe_ramp: u32,
    /// A sensor this long at a rail is a fault.
    pub rail: u32,
    /// A sensor this long at one code is a fault; 0 to leave it out, where quiet
    /// sensors do that.
    pub stuck: u32,
    /// One code of a sensor that is this far from those before and after it, and many
    /// times as far as they are from each other, is a spike; by kind, 0 to leave it
    /// out.
    pub spike: [u16; 2],
    /// So many spikes within a second are a fault.
    pub spikes: u32,
    /// So many samples in a row not read are a fault.
    pub lost: u32,
    /// More deadlines missed in a window than this are a fault.
    pub late: u32,
    /// Clamped for so long is a fault; four samples that are not make up for one
    /// that is.
    pub saturated: u32,
    /// Nobody heard for this long while the legs are driven is a fault; 0 to
    /// leave it out.
    pub silence: u32,
    /// Length of a window.
    pub window: u32,
    /// Forces that grow in power by this factor from window to window diverge,
    pub growth: f32,
    /// if they do so often in a row, windows,
    pub grown: u32,
    /// and come to this part of their limit, rms.
    pub level: f32,
    /// A sensor is implausible whose rms is this many times the median of its kind,
    pub wild: f32,
    /// or so many times less than that,
    pub dull: f32,
    /// for so many windows in a row.
    pub strange: u32,
}

impl Supervision {
    /// Whether the numbers make sense.
    pub(crate) const fn validate(&self) -> Result<(), TableError> {
        let counts = self.safe_ramp > 0
            && self.settle > 0
            && self.rail > 0
            && self.lost > 0
            && self.spikes > 0
            && self.saturated > 0
            // Longer than it takes to conclude one, a part a sample.
            && self.window >= 16
            // The sums of a window.
            && self.window < 1 << 20
            && self.grown > 0
            && self.strange > 0;
        let factors = self.ramp > 1.0
            && self.growth > 1.0
            && self.level > 0.0
            && self.wild > 1.0
            && self.dull > 1.0;
        let finite = self.ramp.is_finite()
            && self.growth.is_finite()
            && self.level.is_finite()
            && self.wild.is_finite()
            && self.dull.is_finite();
        if counts && factors && finite {
            Ok(())
        } else {
            Err(TableError::Supervision)
        }
    }
}
