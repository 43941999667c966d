//! The shaping of one mode of the modal law: second-order filters whose gain at low frequency is 1.

use core::f64::consts::TAU;

use nalgebra::Complex;
use serde::{Deserialize, Serialize};
use shared::table::{SECTIONS, Section};

use crate::machine::{FilterEntry, ResonanceEntry, ShapeEntry};

/// The shaping of one mode.
///
/// In front of its proportional and integral gain, each mode has filters with gain 1 at low
/// frequency. So the ideal gains stay unchanged at low frequency, and the loop gain rolls off
/// before the delay makes the loop unstable.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// The filters, in series.
    pub sections: [Filter; Self::SECTIONS],
    /// Crossover frequency, Hz: the accelerometers act below it and the force sensors above it.
    /// `None` with one kind of sensors.
    pub split_hz: Option<f64>,
}

/// A filter of second order, with gain 1 at zero frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Filter {
    /// The two zeros.
    pub zeros: Resonance,
    /// The two poles.
    pub poles: Resonance,
}

/// A pair of poles or zeros.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Resonance {
    /// Natural frequency ω/2π, Hz.
    pub hz: f64,
    /// Relative damping; above 1 the pair is real.
    pub damping: f64,
}

impl Resonance {
    /// Two real poles or zeros with the corner frequencies `corners`, Hz.
    pub fn real(corners: [f64; 2]) -> Self {
        let [a, b] = corners;
        let hz = (a * b).sqrt();
        Self {
            hz,
            damping: 0.5 * (a + b) / hz,
        }
    }
}

impl Filter {
    /// A filter that passes its input unchanged.
    pub const PASS: Self = Self {
        zeros: Resonance {
            hz: 100.0,
            damping: 1.0,
        },
        poles: Resonance {
            hz: 100.0,
            damping: 1.0,
        },
    };
}

impl From<&ShapeEntry> for Shape {
    fn from(entry: &ShapeEntry) -> Self {
        let resonance = |entry: &ResonanceEntry| Resonance {
            hz: entry.hz,
            damping: entry.damping,
        };
        let mut sections = [Filter::PASS; Self::SECTIONS];
        for (section, FilterEntry { zeros, poles }) in sections.iter_mut().zip(&entry.sections) {
            *section = Filter {
                zeros: resonance(zeros),
                poles: resonance(poles),
            };
        }
        Self {
            sections,
            split_hz: entry.split_hz,
        }
    }
}

impl Shape {
    /// Number of filters of a shape.
    pub const SECTIONS: usize = 3;

    /// The sections of this shape for the sample period `period`, s. Unused sections pass their
    /// input unchanged.
    ///
    /// Poles and zeros are mapped by z = e^(sT).
    pub fn sections(&self, period: f64) -> [Section; SECTIONS] {
        let mut sections = [Section::PASS; SECTIONS];
        for (section, filter) in sections.iter_mut().zip(&self.sections) {
            *section = discrete(
                Pair::new(filter.zeros, period),
                Pair::new(filter.poles, period),
            );
        }
        sections
    }
}

/// Two roots as the polynomial δ² + sum·δ + product in δ = z − 1.
#[derive(Clone, Copy)]
pub(crate) struct Pair {
    pub(crate) sum: f64,
    pub(crate) product: f64,
}

impl Pair {
    /// The pair mapped by z = e^(sT) with the sample period T = `period`, s.
    pub(crate) fn new(resonance: Resonance, period: f64) -> Self {
        let omega = TAU * resonance.hz * period;
        let zeta = resonance.damping;
        if zeta >= 1.0 {
            // The slow root is −1/(ζ + √(ζ² − 1)), without cancellation.
            let fast = zeta + (zeta * zeta - 1.0).sqrt();
            let [a, b] = [fast, 1.0 / fast].map(|root| -(-omega * root).exp_m1());
            return Self {
                sum: a + b,
                product: a * b,
            };
        }
        // 1 − e^x = −2·e^(x/2)·sinh(x/2), without cancellation.
        let root = Complex::new(-zeta, (1.0 - zeta * zeta).sqrt());
        let [a, b] = [root, root.conj()].map(|root| {
            let half = 0.5 * omega * root;
            -2.0 * half.exp() * half.sinh()
        });
        Self {
            sum: (a + b).re,
            product: (a * b).re,
        }
    }
}

/// The section with these zeros and poles and the gain 1 at zero frequency.
fn discrete(zeros: Pair, poles: Pair) -> Section {
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
            sections: [
                Filter {
                    zeros: Resonance::real([30.0, 4000.0]),
                    poles: Resonance::real([0.9, 250.0]),
                },
                Filter {
                    zeros: Resonance {
                        hz: 90.0,
                        damping: 0.1,
                    },
                    poles: Resonance {
                        hz: 110.0,
                        damping: 1.4,
                    },
                },
                Filter::PASS,
            ],
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
            let Filter { zeros, poles } = shape.sections[1];
            let expected = first(30.0) * first(4000.0) / first(0.9) / first(250.0) * second(zeros)
                / second(poles);
            let z = Complex::cis(TAU * hz * period);
            let found: Complex<f64> = sections.iter().map(|s| section_response(s, z)).product();
            // The mapping of the roots, and single precision.
            let error = (found / expected - 1.0).norm();
            assert!(error < TAU * hz * period + 1e-4, "{hz} Hz: {error:e}");
        }
    }
}
