//! Poles as an engineer reads them.

use nalgebra::Complex;
use serde::Serialize;

/// A pole or zero s of a linear system.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pole {
    /// Re s, 1/s.
    pub re: f64,
    /// Im s, rad/s.
    pub im: f64,
    /// |s|/2π, Hz.
    pub hz: f64,
    /// −Re s/|s|: relative damping; negative where it grows.
    pub damping: f64,
}

impl From<Complex<f64>> for Pole {
    fn from(s: Complex<f64>) -> Self {
        Self {
            re: s.re,
            im: s.im,
            hz: s.norm() / core::f64::consts::TAU,
            damping: -s.re / s.norm(),
        }
    }
}

/// Whether all poles lie in the left half plane.
pub fn stable(poles: &[Complex<f64>]) -> bool {
    poles.iter().all(|s| s.re < 0.0)
}
