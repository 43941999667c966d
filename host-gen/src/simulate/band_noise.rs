//! Band-limited noise: the motion of the base.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::machine::Simulation;

/// White noise through two second-order Butterworth filters, one at each end of the band:
/// independent for each of the base's six motions, each with the rms of the settings.
pub(super) struct BandNoise {
    filters: [Biquad; 2],
    states: [[[f64; 2]; 2]; 6],
    scale: f64,
    random: ChaCha8Rng,
}

/// A second-order section, transposed direct form II.
#[derive(Clone, Copy)]
struct Biquad {
    b: [f64; 3],
    a: [f64; 2],
}

impl Biquad {
    /// Butterworth by the bilinear transform, its corner at `hz` exact.
    fn butterworth(hz: f64, period: f64, high_pass: bool) -> Self {
        let k = (core::f64::consts::PI * hz * period).tan();
        let norm = 1.0 / (1.0 + core::f64::consts::SQRT_2 * k + k * k);
        let b0 = if high_pass { norm } else { k * k * norm };
        Self {
            b: [b0, if high_pass { -2.0 * b0 } else { 2.0 * b0 }, b0],
            a: [
                2.0 * (k * k - 1.0) * norm,
                (1.0 - core::f64::consts::SQRT_2 * k + k * k) * norm,
            ],
        }
    }

    fn step(&self, state: &mut [f64; 2], x: f64) -> f64 {
        let y = self.b[0] * x + state[0];
        state[0] = self.b[1] * x - self.a[0] * y + state[1];
        state[1] = self.b[2] * x - self.a[1] * y;
        y
    }
}

impl BandNoise {
    pub(super) fn new(settings: &Simulation, period: f64, random: ChaCha8Rng) -> Self {
        let [low, high] = settings.floor_band;
        let filters = [
            Biquad::butterworth(low, period, true),
            Biquad::butterworth(high, period, false),
        ];
        // The filters scale the rms of white noise by the root of the energy of their
        // impulse response. Three periods of the lower corner contain all of it.
        let mut states = [[0.0; 2]; 2];
        let mut energy = 0.0;
        for k in 0..(3.0 / (low * period)).ceil() as usize {
            let mut x = if k == 0 { 1.0 } else { 0.0 };
            for (filter, state) in filters.iter().zip(&mut states) {
                x = filter.step(state, x);
            }
            energy += x * x;
        }
        Self {
            filters,
            states: [[[0.0; 2]; 2]; 6],
            scale: settings.floor_rms / energy.sqrt(),
            random,
        }
    }

    pub(super) fn sample(&mut self) -> [f64; 6] {
        core::array::from_fn(|i| {
            let white: f64 = StandardNormal.sample(&mut self.random);
            let mut x = white * self.scale;
            for (filter, state) in self.filters.iter().zip(&mut self.states[i]) {
                x = filter.step(state, x);
            }
            x
        })
    }
}
