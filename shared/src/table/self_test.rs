//! Test signal of the self-test and of the pilot, and the expected answers.

use serde::{Deserialize, Serialize};

use crate::LEGS;

/// A complex gain from a leg force to a sensor, unit of the sensor per N.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Phasor {
    /// Real part: in phase with the force.
    pub re: f32,
    /// Imaginary part: a quarter turn ahead of the force.
    pub im: f32,
}

impl Phasor {
    /// No answer.
    pub const ZERO: Self = Self { re: 0.0, im: 0.0 };
}

/// Test signal of the self-test and of the pilot, and the answers expected from the
/// sensors.
///
/// The self-test runs before the loop is closed. The pilot is the same test with a far
/// smaller sine and longer measurements while the loop is closed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SelfTest {
    /// Frequency of the sine: phase advance per sample, in units of 2⁻³² turns.
    pub step: u32,
    /// Amplitude of the sine in the self-test, N.
    pub amplitude: f32,
    /// Time from the start of a leg's sine to the start of its measurement, samples: the
    /// transient decays.
    pub settle: u32,
    /// Time the self-test measures each leg, samples, at least 16.
    pub measure: u32,
    /// Amplitude of the sine in the pilot, N; 0 switches the pilot off.
    pub pilot: f32,
    /// Time the pilot measures each leg, samples, at least 16.
    pub watch: u32,
    /// Largest relative error of the answers, above 0. For a sensor it is the root of the
    /// sum of squares over all legs, for a leg that over all sensors of one kind, each
    /// divided by that of the expected answers.
    pub tolerance: f32,
    /// Expected answer of each sensor, `sensors[leg][sensor]`.
    pub sensors: [[Phasor; LEGS]; LEGS],
    /// Expected answer of each force sensor of a [`Complement`](super::Complement),
    /// `forces[leg][sensor]`; zero without one.
    pub forces: [[Phasor; LEGS]; LEGS],
}
