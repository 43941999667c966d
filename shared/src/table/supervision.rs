//! Thresholds and times of the supervisor.

use serde::{Deserialize, Serialize};

/// Thresholds and times of the supervisor. Times are in samples; a window is
/// [`Supervision::window`] samples long.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Supervision {
    /// Factor by which the gain changes per sample between
    /// [`GENTLE`](crate::supervisor::GENTLE) and 1, above 1. The machine's motion decays
    /// while the gain is still small, before a large gain could saturate the legs.
    pub ramp: f32,
    /// Time a soft start waits at gain [`QUIET`](crate::supervisor::QUIET), samples. For
    /// as long again it averages the sensors, and the AC coupling starts from these
    /// averages: while the machine moved, the coupling's own averages moved with it.
    pub settle: u32,
    /// Time the outputs take from their values at a fault to the safe codes, samples.
    pub safe_ramp: u32,
    /// Consecutive samples at a rail after which a sensor is a fault.
    pub rail: u32,
    /// Consecutive samples with the same code after which a sensor is a fault; 0
    /// switches the check off, for sensors so quiet that their code may stay the same.
    pub stuck: u32,
    /// Smallest spike, ADC codes, for the table's sensors and for the force sensors used
    /// together with them; 0 switches the check off for that kind. A spike is a single
    /// code at least this far from the codes before and after it, and many times as far
    /// as those are from each other.
    pub spike: [u16; 2],
    /// Number of spikes within one second that is a fault.
    pub spikes: u32,
    /// Number of consecutive samples that could not be read that is a fault.
    pub lost: u32,
    /// Number of missed deadlines that a window may have. One more is a fault.
    pub late: u32,
    /// Time with the clamp active that is a fault, samples. Four samples without
    /// clamping cancel one with.
    pub saturated: u32,
    /// Time without a valid frame on the link, while the legs are driven, that is a fault,
    /// samples; 0 switches the check off.
    pub silence: u32,
    /// Length of a window, samples, 16 to 2²⁰ − 1.
    pub window: u32,
    /// Factor above 1. A window counts as growing if the largest variance of the leg
    /// forces is more than this factor times that of the window before.
    pub growth: f32,
    /// Number of consecutive growing windows that is a fault.
    pub grown: u32,
    /// Rms of a leg force, as a fraction of its limit, below which growth is not a fault.
    pub level: f32,
    /// Ratio above 1 of a sensor's rms to the median rms of its kind. A sensor above this
    /// ratio is implausible in that window.
    pub wild: f32,
    /// Ratio above 1 of the median rms of a kind to a sensor's rms. A sensor above this
    /// ratio is implausible in that window.
    pub dull: f32,
    /// Number of consecutive windows with an implausible rms that is a fault.
    pub strange: u32,
}
