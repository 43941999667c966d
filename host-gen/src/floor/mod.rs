//! The motion of the ground: vibration criteria and spectra.
//!
//! Spectra are one-sided densities.

pub mod criterion;
pub mod record;
pub mod spectrum;

use core::f64::consts::TAU;

use nalgebra::Vector6;

pub use criterion::Criterion;
pub use record::{Record, Welch};
pub use spectrum::{STRONGEST, Spectrum};

use crate::numeric::power_law::steeper;

/// Bandwidth of a one-third-octave band relative to its centre frequency, 2^(1/6) −
/// 2^(−1/6).
const THIRD: f64 = 0.231_563;

/// The axes x, y and z.
pub(crate) const AXES: usize = 3;

/// Vibration of the floor: the acceleration of the rigid base along each of x, y and z,
/// independent of each other, and of its rotations as the machine's file says.
#[derive(Clone, Debug, PartialEq)]
pub enum Floor {
    /// At the limit of a vibration criterion in every one-third-octave band.
    Criterion(Criterion),
    /// White acceleration, one-sided amplitude density, m/s²/√Hz.
    White(f64),
    /// A spectrum given point by point, along each of x, y and z.
    Table(Spectrum),
    /// Spectra along x, y and z.
    Axes(Box<[Spectrum; AXES]>),
}

/// A floor and what it is called.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedFloor {
    /// The floor.
    pub floor: Floor,
    /// Its name, for people.
    pub name: String,
}

impl From<Floor> for NamedFloor {
    fn from(floor: Floor) -> Self {
        let name = floor.name();
        Self { floor, name }
    }
}

impl Floor {
    /// What it is, in words.
    pub fn name(&self) -> String {
        match self {
            Self::Criterion(criterion) => criterion.name().to_owned(),
            Self::White(density) => format!("white, {density:.3e} m/s²/√Hz"),
            Self::Table(_) | Self::Axes(_) => "of the file".to_owned(),
        }
    }

    /// One-sided acceleration densities along x, y and z at `hz`, Hz, in m/s²/√Hz.
    pub fn densities(&self, hz: f64) -> [f64; AXES] {
        match self {
            Self::Criterion(criterion) => {
                [TAU * hz * criterion.velocity(hz) / (THIRD * hz).sqrt(); AXES]
            }
            Self::White(density) => [*density; AXES],
            Self::Table(spectrum) => [spectrum.density(hz); AXES],
            Self::Axes(spectra) => spectra.each_ref().map(|spectrum| spectrum.density(hz)),
        }
    }

    /// Densities, m/s²/√Hz, of the motions of the base: those along x, y and z, and what the rotations
    /// about these are a part of: with `waves` that along z, that again, and the root mean square of
    /// those along x and y; else the root mean square of all three.
    pub(crate) fn motions(&self, hz: f64, waves: bool) -> Vector6<f64> {
        let [x, y, z] = self.densities(hz);
        if waves {
            let level = x.hypot(y) * core::f64::consts::FRAC_1_SQRT_2;
            return Vector6::new(x, y, z, z, z, level);
        }
        let mean = (x * x + y * y + z * z).sqrt() / (AXES as f64).sqrt();
        Vector6::new(x, y, z, mean, mean, mean)
    }

    /// The frequencies for which the floor is given, lowest and highest, Hz.
    pub fn range(&self) -> [f64; 2] {
        match self {
            Self::Criterion(_) | Self::White(_) => [0.0, f64::INFINITY],
            Self::Table(spectrum) => spectrum.range(),
            Self::Axes(spectra) => {
                let ranges = spectra.each_ref().map(Spectrum::range);
                let low = ranges.iter().map(|[low, _]| *low).fold(0.0, f64::max);
                let high = ranges.iter().map(|[_, high]| *high);
                [low, high.fold(f64::INFINITY, f64::min)]
            }
        }
    }

    /// The frequencies at which the density is not smooth, Hz.
    pub(crate) fn breaks(&self) -> Vec<f64> {
        match self {
            Self::Criterion(criterion) => criterion.breaks().to_vec(),
            Self::White(_) => Vec::new(),
            Self::Table(spectrum) => spectrum.hertz().collect(),
            Self::Axes(spectra) => spectra.iter().flat_map(Spectrum::hertz).collect(),
        }
    }

    /// How steep the power density is at `hz`, Hz, where it is steeper than a criterion: about
    /// d ln density²/d ln hz, the steepest axis.
    pub(crate) fn exponent(&self, hz: f64) -> f64 {
        match self {
            Self::Criterion(_) | Self::White(_) => 0.0,
            Self::Table(spectrum) => spectrum.exponent(hz),
            Self::Axes(spectra) => {
                let all = spectra.iter().map(|spectrum| spectrum.exponent(hz));
                all.fold(0.0, steeper)
            }
        }
    }
}
