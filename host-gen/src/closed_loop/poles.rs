//! Poles and zeros as frequency and damping, and stability.

use nalgebra::Complex;
use serde::Serialize;

/// A pole or zero s of a continuous linear system.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pole {
    /// Real part of s, 1/s; negative if stable.
    pub re: f64,
    /// Imaginary part of s, rad/s.
    pub im: f64,
    /// Natural frequency |s|/2π, Hz.
    pub hz: f64,
    /// Relative damping −Re s/|s|; negative if unstable, 0 for s = 0.
    pub damping: f64,
}

impl From<Complex<f64>> for Pole {
    fn from(s: Complex<f64>) -> Self {
        Self {
            re: s.re,
            im: s.im,
            hz: s.norm() / core::f64::consts::TAU,
            damping: if s == Complex::ZERO {
                0.0
            } else {
                -s.re / s.norm()
            },
        }
    }
}

/// Whether all of the continuous `poles` are in the left half plane.
pub fn stable(poles: &[Complex<f64>]) -> bool {
    poles.iter().all(|s| s.re < 0.0)
}
