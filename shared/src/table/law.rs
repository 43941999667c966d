//! The control law of a table.

use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::Calibration;

/// The proportional-integral law of Eq. (14), Eq. (21) and Eq. (22).
///
/// First-order coefficients are in increment form, `state += c·(input − state)`. In
/// `f32` this keeps poles far below the sample rate that `1 − c` would lose. A corner
/// at `f` Hz has c = 1 − exp(−2π·f/rate).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Law {
    /// How sensor values become leg forces.
    pub paths: Paths,
    /// Fraction of each integral that leaks away per sample, 0 to 1.
    pub leak: f32,
    /// Fraction of the force cut off by the clamp that is subtracted from the integrals
    /// per sample, 0 to 1. The states of a modal law's sections decay by this fraction times the
    /// part of the force that is cut off.
    pub anti_windup: f32,
}

/// How sensor values become leg forces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[allow(
    clippy::large_enum_variant,
    reason = "there is one table, and no allocator for a box"
)]
pub enum Paths {
    /// From every sensor to every leg, with one roll-off for all sensors.
    Direct(Direct),
    /// Through the modes of the design model, each with its own shaping.
    Modal(Modal),
}

/// The gain matrices of Eq. (14), from sensors to legs.
///
/// Rows are actuators, columns are sensors. The unit is N per unit of the sensor:
/// N/(m/s²) for accelerations, 1 for forces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Direct {
    /// Coefficient of the roll-off, a first-order low-pass on every sensor, above 0 and
    /// up to 1; 1 switches the roll-off off.
    pub roll_off: f32,
    /// Proportional gain: K_a for accelerations, K_P for forces.
    pub proportional: Matrix6<f32>,
    /// Integral gain times half the sample period T: K_v·T/2 for accelerations, K_I·T/2
    /// for forces. The integral is trapezoidal: this times the sum of two consecutive
    /// samples is the increment of one period, N.
    pub integral: Matrix6<f32>,
}

/// From sensors to modes, one channel per mode, from modes to legs.
///
/// With the same sections in all channels this is the direct law with
/// K = output·diag·input: S of Eq. (17) makes the gains of Eq. (19), Eq. (20), Eq. (21)
/// and Eq. (22) diagonal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Modal {
    /// T_in, from sensors to modes. For accelerations S⁻¹·T_c⁻¹, which gives modal
    /// accelerations, √kg·m/s². For forces Sᵀ, which gives modal forces, N/√kg.
    pub input: Matrix6<f32>,
    /// Force sensors that are used together with accelerometers; none if the law uses
    /// one kind of sensor.
    pub complement: Option<Complement>,
    /// Shaping and gains of each mode.
    pub channels: [Channel; LEGS],
    /// Number of sections that run, the same for all channels, up to [`SECTIONS`].
    pub sections: usize,
    /// T_out = S⁻ᵀ, from modal forces, N/√kg, to leg forces, N.
    pub output: Matrix6<f32>,
}

/// Force sensors that take over from the accelerometers at high frequency.
///
/// Only the leg forces accelerate the machine as a rigid whole. So Sᵀ times the forces
/// equals the modal accelerations S⁻¹·T_c⁻¹·y, and the units agree: N/√kg is √kg·m/s².
/// In each channel the modal acceleration a passes a first-order low-pass, the modal
/// force f the complementary high-pass, and r is their sum:
///
/// ```text
/// d += split·(a − f − d)
/// r  = f + d
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Complement {
    /// Calibration of each force sensor channel, in the order of `input`'s columns.
    pub sensors: [Calibration; LEGS],
    /// Sᵀ, from leg forces, N, to modal forces, N/√kg.
    pub input: Matrix6<f32>,
    /// Coefficient of each mode's low-pass, above 0 and up to 1.
    pub split: [f32; LEGS],
}

/// Largest number of second-order sections in a channel.
pub const SECTIONS: usize = 3;

/// One mode: second-order sections in series, then proportional plus integral gain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Channel {
    /// Shaping. The first [`Modal::sections`] run.
    pub sections: [Section; SECTIONS],
    /// Proportional gain, ω²/ω_n² − 1.
    pub proportional: f32,
    /// Integral gain times half the sample period T, 2ζ_n·ω²/ω_n·T/2; trapezoidal as in
    /// [`Direct::integral`].
    pub integral: f32,
}

/// A second-order section, realised as two integrators in increment form. This keeps
/// slow poles and zeros accurate in `f32` at any sample rate:
///
/// ```text
/// y  = direct·u + band·x1 + low·x2     with the states before the update
/// x1 += rate·(u − damping·x1 − x2)     band-pass
/// x2 += rate·x1                        low-pass, with x1 before the update
/// ```
///
/// In steady state x1 = 0 and x2 = u. The poles are at z = 1 + δ with
/// δ² + rate·damping·δ + rate² = 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Section {
    /// Geometric mean of the distances of the two poles from z = 1.
    pub rate: f32,
    /// Twice the damping ratio of the poles.
    pub damping: f32,
    /// Gain from the input straight to the output. Far above all poles it is the gain of
    /// the whole section.
    pub direct: f32,
    /// Gain of the band-pass state x1.
    pub band: f32,
    /// Gain of the low-pass state x2. `direct` + `low` is the gain at 0 Hz.
    pub low: f32,
}

impl Section {
    /// Output equals input.
    pub const PASS: Self = Self {
        rate: 0.5,
        damping: 2.0,
        direct: 1.0,
        band: 0.0,
        low: 0.0,
    };
}
