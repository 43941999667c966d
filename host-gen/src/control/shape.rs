//! The shaping of one channel: poles and zeros in Hz, and the second-order sections made from
//! them.

use core::f64::consts::TAU;

use nalgebra::Complex;
use serde::{Deserialize, Serialize};
use shared::table::{SECTIONS, Section};

use crate::machine::{ResonanceEntry, ShapeEntry};

/// The shaping of one mode's channel, with gain 1 at low frequency.
///
/// The first section has two lags and a zero. The second has a pair of zeros and a pair of poles:
/// a notch or a resonance. With both kinds of sensors, the shape also has the frequency at which
/// the force sensors take over from the accelerometers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// Corner frequencies of the two lags, Hz.
    pub lags_hz: [f64; 2],
    /// Corner frequency of the zero, Hz.
    pub zero_hz: f64,
    /// The pair of zeros of the second section.
    pub notch: Resonance,
    /// The pair of poles of the second section.
    pub notch_poles: Resonance,
    /// Crossover frequency, Hz: the accelerometers act below it and the force sensors above it.
    /// `None` with one kind of sensors.
    pub split_hz: Option<f64>,
}

/// A pair of poles or zeros.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Resonance {
    /// Natural frequency ω/2π, Hz.
    pub hz: f64,
    /// Relative damping; above 1 the pair is real.
    pub damping: f64,
}

impl From<&ShapeEntry> for Shape {
    fn from(entry: &ShapeEntry) -> Self {
        let resonance = |entry: &ResonanceEntry| Resonance {
            hz: entry.hz,
            damping: entry.damping,
        };
        Self {
            lags_hz: entry.lags_hz,
            zero_hz: entry.zero_hz,
            notch: resonance(&entry.notch),
            notch_poles: resonance(&entry.notch_poles),
            split_hz: entry.split_hz,
        }
    }
}

impl Shape {
    /// Number of sections of a shape.
    pub const SECTIONS: usize = 2;

    /// The sections of this shape for the sample period `period`, s. Unused sections pass their
    /// input unchanged.
    ///
    /// Poles and zeros are mapped by z = e^(sT). The zero at infinity of the first section is
    /// mapped to z = 0, so that the section has no delay.
    pub fn sections(&self, period: f64) -> [Section; SECTIONS] {
        let lags = Pair::real(self.lags_hz.map(|hz| fall(hz, period)));
        let zeros = Pair::real([fall(self.zero_hz, period), 1.0]);
        let mut sections = [Section::PASS; SECTIONS];
        sections[0] = section(zeros, lags);
        sections[1] = section(
            Pair::of(self.notch, period),
            Pair::of(self.notch_poles, period),
        );
        sections
    }
}

/// 1 − e^(−2π·hz·T), the distance of a real root from z = 1, for a corner frequency in Hz and the
/// period T in s.
fn fall(hz: f64, period: f64) -> f64 {
    -(-TAU * hz * period).exp_m1()
}

/// Two roots as the polynomial δ² + sum·δ + product in δ = z − 1.
#[derive(Clone, Copy)]
struct Pair {
    sum: f64,
    product: f64,
}

impl Pair {
    /// Two real roots at δ = −a and δ = −b.
    fn real([a, b]: [f64; 2]) -> Self {
        Self {
            sum: a + b,
            product: a * b,
        }
    }

    fn of(resonance: Resonance, period: f64) -> Self {
        let omega = TAU * resonance.hz * period;
        let zeta = resonance.damping;
        let root = Complex::from(zeta * zeta - 1.0).sqrt();
        // 1 − e^x = −2·e^(x/2)·sinh(x/2), without cancellation.
        let [a, b] = [root, -root].map(|root| {
            let half = 0.5 * omega * (root - zeta);
            -2.0 * half.exp() * half.sinh()
        });
        Self {
            sum: (a + b).re,
            product: (a * b).re,
        }
    }
}

/// The section with these zeros and poles and the gain 1 at zero frequency.
fn section(zeros: Pair, poles: Pair) -> Section {
    let gain = poles.product / zeros.product;
    let rate = poles.product.sqrt();
    Section {
        rate: rate as f32,
        damping: (poles.sum / rate) as f32,
        direct: gain as f32,
        band: (gain * (zeros.sum - poles.sum) / rate) as f32,
        low: (1.0 - gain) as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::law::section_response;

    /// Far below the sample rate a section has the response of the continuous poles and zeros.
    #[test]
    fn sections_are_the_continuous_ones_at_low_frequency() {
        let shape = Shape {
            lags_hz: [0.9, 250.0],
            zero_hz: 30.0,
            notch: Resonance {
                hz: 90.0,
                damping: 0.1,
            },
            notch_poles: Resonance {
                hz: 110.0,
                damping: 1.4,
            },
            split_hz: None,
        };
        let period = 1e-6;
        let sections = shape.sections(period);
        for hz in [0.01, 0.5, 3.0, 40.0, 89.0, 150.0, 900.0] {
            let s = Complex::new(0.0, TAU * hz);
            let first = |corner: f64| 1.0 + s / (TAU * corner);
            let second = |r: Resonance| {
                let x = s / (TAU * r.hz);
                1.0 + 2.0 * r.damping * x + x * x
            };
            let expected = first(30.0) / first(0.9) / first(250.0) * second(shape.notch)
                / second(shape.notch_poles);
            let z = Complex::cis(TAU * hz * period);
            let found = section_response(&sections[0], z) * section_response(&sections[1], z);
            // Half a sample of phase from the zero at z = 0, and single precision.
            let error = (found / expected - 1.0).norm();
            assert!(error < TAU * hz * period + 1e-4, "{hz} Hz: {error:e}");
        }
    }
}
