//! Band-limited noise: the motion of the base.

use nalgebra::{Matrix4, RowVector4, Vector4};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::machine::Simulation;

/// White noise through two second-order Butterworth filters, one at each end of the band:
/// independent for each of the base's six motions, each with the rms of the settings.
pub(super) struct BandNoise {
    filters: [Biquad; 2],
    /// Both states of each filter, for each motion.
    states: [[[f64; 6]; 2]; 2],
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

    /// Filters one sample of `N` signals.
    fn step<const N: usize>(&self, [first, second]: &mut [[f64; N]; 2], x: [f64; N]) -> [f64; N] {
        let mut y = [0.0; N];
        for i in 0..N {
            y[i] = self.b[0] * x[i] + first[i];
            first[i] = self.b[1] * x[i] - self.a[0] * y[i] + second[i];
            second[i] = self.b[2] * x[i] - self.a[1] * y[i];
        }
        y
    }
}

/// The energy of the impulse response of two sections, one after the other.
///
/// It is Σ hₖ² = d² + c·P·cᵀ for the states x(k+1) = A·x + b·u, y = c·x + d·u, with
/// P = Σ Aᵏ·b·bᵀ·Aᵏᵀ. Each step of the sum doubles the number of its terms, so that a slow corner
/// takes no longer than a fast one.
fn energy(filters: &[Biquad; 2]) -> f64 {
    // The response of states and output to a unit state or a unit input.
    let response = |at: Option<usize>| {
        let mut states = [[[0.0]; 2]; 2];
        if let Some(at) = at {
            states[at / 2][at % 2] = [1.0];
        }
        let mut x = [if at.is_none() { 1.0 } else { 0.0 }];
        for (filter, state) in filters.iter().zip(&mut states) {
            x = filter.step(state, x);
        }
        let states = states.as_flattened().as_flattened();
        (Vector4::from_column_slice(states), x[0])
    };
    let columns = [0, 1, 2, 3].map(|at| response(Some(at)));
    let mut a = Matrix4::from_columns(&columns.map(|(states, _)| states));
    let c = RowVector4::from(columns.map(|(_, y)| y));
    let (b, d) = response(None);
    let mut p = b * b.transpose();
    // 2⁶⁴ terms are more than any corner needs.
    for _ in 0..64 {
        p += a * p * a.transpose();
        a *= a;
    }
    d * d + (c * p * c.transpose()).x
}

impl BandNoise {
    pub(super) fn new(settings: &Simulation, period: f64, random: ChaCha8Rng) -> Self {
        let [low, high] = settings.floor_band;
        let filters = [
            Biquad::butterworth(low, period, true),
            Biquad::butterworth(high, period, false),
        ];
        Self {
            filters,
            states: [[[0.0; 6]; 2]; 2],
            // The filters scale the rms of white noise by the root of their energy.
            scale: settings.floor_rms / energy(&filters).sqrt(),
            random,
        }
    }

    pub(super) fn sample(&mut self) -> [f64; 6] {
        let white: [f64; 6] = core::array::from_fn(|_| StandardNormal.sample(&mut self.random));
        let mut x = white.map(|x| x * self.scale);
        for (filter, states) in self.filters.iter().zip(&mut self.states) {
            x = filter.step(states, x);
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the sum of the impulse response itself, over many periods of the lower corner.
    #[test]
    fn the_energy_is_that_of_the_impulse_response() {
        for [low, high] in [[1.0, 200.0], [50.0, 60.0], [20.0, 400.0]] {
            let filters = [
                Biquad::butterworth(low, 1e-3, true),
                Biquad::butterworth(high, 1e-3, false),
            ];
            let mut states = [[[0.0]; 2]; 2];
            let sum: f64 = (0..100_000)
                .map(|k| {
                    let mut x = [if k == 0 { 1.0 } else { 0.0 }];
                    for (filter, state) in filters.iter().zip(&mut states) {
                        x = filter.step(state, x);
                    }
                    x[0] * x[0]
                })
                .sum();
            let found = energy(&filters);
            assert!((found / sum - 1.0).abs() < 1e-9, "{found} against {sum}");
        }
    }
}
