//! Noise with the spectrum of a sensor.

use core::f64::consts::PI;
use std::sync::Arc;

use nalgebra::Complex;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rustfft::{Fft, FftPlanner};
use shared::LEGS;

use crate::machine::NoiseDensity;

/// Block lengths, samples. The longest takes 13 s at 20 kHz.
const LENGTHS: [f64; 2] = [1024.0, 262_144.0];

/// Blocks per period of the lowest frequency at which the density changes.
const RESOLUTION: f64 = 10.0;

/// Independent Gaussian noises, one for each leg, with a given density up to half the sample rate.
///
/// Blocks of noise are made from their Fourier coefficients, which are independent with the
/// density's variances. Each block fades in as a sine over its first half, while the one before
/// fades out, so that the power is the same at all times. The spectrum is the density, smeared by
/// half the inverse of the block's length: the length is at least ten periods of the lowest
/// frequency at which the density changes, up to 262 144 samples.
pub(super) struct ShapedNoise {
    /// Standard deviation of each coefficient's real part, and of its imaginary part.
    deviations: Vec<f64>,
    inverse: Arc<dyn Fft<f64>>,
    random: ChaCha8Rng,
    /// The block that fades in, and the second half of the one before: two noises as the real and
    /// the imaginary part of each.
    blocks: [Vec<Complex<f64>>; LEGS / 2],
    before: [Vec<Complex<f64>>; LEGS / 2],
    /// The next sample within the first half of the block.
    at: usize,
}

impl ShapedNoise {
    /// Noise of `density` for a sample `rate`, Hz.
    pub(super) fn new(density: &NoiseDensity, rate: f64, random: ChaCha8Rng) -> Self {
        let [least, most] = LENGTHS;
        let lowest = density.breaks().fold(f64::INFINITY, f64::min);
        let length = (RESOLUTION * rate / lowest).clamp(least, most) as usize;
        let length = length.next_power_of_two();
        let apart = rate / length as f64;
        // The real part of Σ (a + jb)·e^(jωt) over both signs of ω has the variance of the a, and
        // each sign has half of the density.
        let deviations = (0..length)
            .map(|k| density.at(k.min(length - k) as f64 * apart) * (0.5 * apart).sqrt())
            .collect();
        let blank = || core::array::from_fn(|_| Vec::new());
        let mut noise = Self {
            deviations,
            inverse: FftPlanner::new().plan_fft_inverse(length),
            random,
            blocks: blank(),
            before: blank(),
            at: 0,
        };
        // A block for the first to fade in over.
        noise.next_blocks();
        noise.next_blocks();
        noise
    }

    /// The noises at the next sample, in the unit of the density times √Hz.
    pub(super) fn sample(&mut self) -> [f64; LEGS] {
        let half = self.deviations.len() / 2;
        if self.at == half {
            self.next_blocks();
        }
        let (fade_in, fade_out) = (PI * (self.at as f64 + 0.5) / (2 * half) as f64).sin_cos();
        let mut noises = [0.0; LEGS];
        let pairs = self.blocks.iter().zip(&self.before);
        for (pair, (block, before)) in noises.chunks_exact_mut(2).zip(pairs) {
            let both = block[self.at] * fade_in + before[self.at] * fade_out;
            pair.copy_from_slice(&[both.re, both.im]);
        }
        self.at += 1;
        noises
    }

    fn next_blocks(&mut self) {
        let Self {
            deviations,
            inverse,
            random,
            ..
        } = self;
        let half = deviations.len() / 2;
        for (block, before) in self.blocks.iter_mut().zip(&mut self.before) {
            before.clear();
            before.extend(block.iter().skip(half));
            let mut normal = || -> f64 { StandardNormal.sample(random) };
            block.clear();
            block.extend(
                deviations
                    .iter()
                    .map(|d| Complex::new(normal(), normal()) * *d),
            );
            inverse.process(block);
        }
        self.at = 0;
    }
}
