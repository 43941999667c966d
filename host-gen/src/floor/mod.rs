//! The motion of the ground: vibration criteria and spectra.
//!
//! Spectra are one-sided densities.

pub mod criterion;
pub mod spectrum;

use core::f64::consts::TAU;

pub use criterion::Criterion;
pub use spectrum::{STRONGEST, Spectrum, SpectrumError};

/// Bandwidth of a one-third-octave band relative to its centre frequency, 2^(1/6) −
/// 2^(−1/6).
const THIRD: f64 = 0.231_563;

/// Vibration of the floor: the acceleration of the rigid base along each of x, y and z,
/// independent of each other, and of its rotations as the machine's file says.
#[derive(Clone, Debug, PartialEq)]
pub enum Floor {
    /// At the limit of a vibration criterion in every one-third-octave band.
    Criterion(Criterion),
    /// White acceleration, one-sided amplitude density, m/s²/√Hz.
    White(f64),
    /// A spectrum given point by point.
    Table(Spectrum),
}

impl Floor {
    /// What it is, in words.
    pub fn name(&self) -> String {
        match self {
            Self::Criterion(criterion) => criterion.name().to_owned(),
            Self::White(density) => format!("white, {density:e} m/s²/√Hz"),
            Self::Table(_) => "of the file".to_owned(),
        }
    }

    /// One-sided acceleration density at `hz`, Hz, in m/s²/√Hz.
    pub fn density(&self, hz: f64) -> f64 {
        match self {
            Self::Criterion(criterion) => TAU * hz * criterion.velocity(hz) / (THIRD * hz).sqrt(),
            Self::White(density) => *density,
            Self::Table(spectrum) => spectrum.density(hz),
        }
    }

    /// The frequencies for which the floor is given, lowest and highest, Hz.
    pub fn range(&self) -> [f64; 2] {
        match self {
            Self::Criterion(_) | Self::White(_) => [0.0, f64::INFINITY],
            Self::Table(spectrum) => spectrum.range(),
        }
    }

    /// The frequencies at which the density is not smooth, Hz.
    pub(crate) fn breaks(&self) -> Vec<f64> {
        match self {
            Self::Criterion(criterion) => criterion.breaks().to_vec(),
            Self::White(_) => Vec::new(),
            Self::Table(spectrum) => spectrum.hertz().collect(),
        }
    }

    /// How steep the power density is at `hz`, Hz, where it is steeper than a criterion: about
    /// d ln density²/d ln hz.
    pub(crate) fn exponent(&self, hz: f64) -> f64 {
        match self {
            Self::Criterion(_) | Self::White(_) => 0.0,
            Self::Table(spectrum) => spectrum.exponent(hz),
        }
    }
}
