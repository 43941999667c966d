//! The motion of the base, sample by sample.

use rand_chacha::ChaCha8Rng;

use super::band_noise::BandNoise;
use crate::floor::Record;
use crate::machine::Simulation;

/// What moves the base.
pub(super) enum BaseMotion {
    /// Noise in a band.
    Noise(Box<BandNoise>),
    /// What was recorded, again and again.
    Recorded {
        /// The six motions.
        samples: Vec<[f64; 6]>,
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
        // A record has no rotations.
        Self::given(axes.map(|((x, y), z)| [x, y, z, 0.0, 0.0, 0.0]).collect())
    }

    pub(super) fn given(samples: Vec<[f64; 6]>) -> Self {
        Self::Recorded { samples, next: 0 }
    }

    /// The base's six motions, as columns of the plant's base, m/s²; of a loaded plant, its loads.
    pub(super) fn sample(&mut self) -> [f64; 6] {
        match self {
            Self::Noise(noise) => noise.sample(),
            Self::Recorded { samples, next } => {
                let sample = samples[*next];
                *next = (*next + 1) % samples.len();
                sample
            }
        }
    }
}
