//! The motion of the base, sample by sample.

use rand_chacha::ChaCha8Rng;

use super::band_noise::BandNoise;
use crate::floor::Record;
use crate::machine::Simulation;

/// What moves the base.
pub(super) enum BaseMotion {
    /// Noise in a band.
    Noise(Box<BandNoise>),
    /// A record, again and again.
    Recorded {
        /// Accelerations along x, y and z, m/s².
        samples: Vec<[f64; 3]>,
        next: usize,
    },
}

impl BaseMotion {
    pub(super) fn noise(settings: &Simulation, period: f64, random: ChaCha8Rng) -> Self {
        Self::Noise(Box::new(BandNoise::new(settings, period, random)))
    }

    pub(super) fn recorded(record: &Record, period: f64) -> Self {
        let [x, y, z] = record.accelerations(1.0 / period);
        let axes = x.into_iter().zip(y).zip(z);
        Self::Recorded {
            samples: axes.map(|((x, y), z)| [x, y, z]).collect(),
            next: 0,
        }
    }

    /// The base's six motions, as columns of the plant's base, m/s². A record has no rotations.
    pub(super) fn sample(&mut self) -> [f64; 6] {
        match self {
            Self::Noise(noise) => noise.sample(),
            Self::Recorded { samples, next } => {
                let [x, y, z] = samples[*next];
                *next = (*next + 1) % samples.len();
                [x, y, z, 0.0, 0.0, 0.0]
            }
        }
    }
}
