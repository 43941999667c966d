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

    /// The faster of two real poles or zeros over their natural frequency, and the natural
    /// frequency over the slower one; none if they are complex.
    fn spread(self) -> Option<f64> {
        let zeta = self.damping;
        // The slow root is −1/(ζ + √(ζ² − 1)), without cancellation.
        (zeta >= 1.0).then(|| zeta + (zeta * zeta - 1.0).sqrt())
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
        .paired()
    }
}

impl Shape {
    /// Number of filters of a shape.
    pub const SECTIONS: usize = 3;

    /// The same product of filters, each with the zeros that are nearest to its poles, the
    /// slowest filter first.
    ///
    /// In single precision it matters which zeros go with which poles: a filter whose zeros are
    /// at a ten thousandth of its poles' frequency has a gain of 10⁸ at high frequency, and the
    /// next one takes it off again.
    #[must_use]
    pub fn paired(&self) -> Self {
        let zeros = pairings(self.sections.map(|filter| filter.zeros));
        let poles = pairings(self.sections.map(|filter| filter.poles));
        let apart = |zeros: &[Resonance; Self::SECTIONS], poles: &[Resonance; Self::SECTIONS]| {
            let both = zeros.iter().zip(poles);
            both.map(|(zeros, poles)| (zeros.hz / poles.hz).ln().powi(2))
                .sum::<f64>()
        };
        let mut best = (f64::INFINITY, self.sections);
        for poles in &poles {
            for zeros in &zeros {
                for order in ORDERS {
                    let zeros = order.map(|i| zeros[i]);
                    let sum = apart(&zeros, poles);
                    if sum < best.0 {
                        let filter = |i| Filter {
                            zeros: zeros[i],
                            poles: poles[i],
                        };
                        best = (sum, core::array::from_fn(filter));
                    }
                }
            }
        }
        let mut sections = best.1;
        sections.sort_by(|a, b| a.poles.hz.total_cmp(&b.poles.hz));
        Self { sections, ..*self }
    }

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

/// All orders of the filters of a shape.
const ORDERS: [[usize; Shape::SECTIONS]; 6] = [
    [0, 1, 2],
    [0, 2, 1],
    [1, 0, 2],
    [1, 2, 0],
    [2, 0, 1],
    [2, 1, 0],
];

/// All ways to have the roots of `pairs` in pairs: real ones can change their partners.
fn pairings(pairs: [Resonance; Shape::SECTIONS]) -> Vec<[Resonance; Shape::SECTIONS]> {
    let mut complex = Vec::new();
    let mut real = Vec::new();
    for pair in pairs {
        match pair.spread() {
            Some(spread) => real.extend([pair.hz / spread, pair.hz * spread]),
            None => complex.push(pair),
        }
    }
    let mut all = Vec::new();
    partners(&real, &mut complex, &mut all);
    all
}

/// Adds to `all` what `pairs` and the real roots with the corner frequencies `real`, Hz, can be.
fn partners(real: &[f64], pairs: &mut Vec<Resonance>, all: &mut Vec<[Resonance; Shape::SECTIONS]>) {
    let Some((first, others)) = real.split_first() else {
        all.extend(<[Resonance; Shape::SECTIONS]>::try_from(&pairs[..]));
        return;
    };
    for (i, partner) in others.iter().enumerate() {
        let rest = [&others[..i], &others[i + 1..]].concat();
        pairs.push(Resonance::real([*first, *partner]));
        partners(&rest, pairs, all);
        pairs.pop();
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
        if let Some(fast) = resonance.spread() {
            let [a, b] = [fast, 1.0 / fast].map(|root| -(-omega * root).exp_m1());
            return Self {
                sum: a + b,
                product: a * b,
            };
        }
        // 1 − e^x = −2·e^(x/2)·sinh(x/2), without cancellation.
        let zeta = resonance.damping;
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

    /// The continuous pair at `hz`, Hz; 1 at zero frequency.
    fn continuous(r: Resonance, hz: f64) -> Complex<f64> {
        let x = Complex::new(0.0, hz / r.hz);
        1.0 + 2.0 * r.damping * x + x * x
    }

    /// Paired filters have the same product, and none of them has a gain far from one that
    /// another takes off again.
    #[test]
    fn pairs_are_near() {
        let filter = |z: [f64; 2], p: [f64; 2]| Filter {
            zeros: Resonance {
                hz: z[0],
                damping: z[1],
            },
            poles: Resonance {
                hz: p[0],
                damping: p[1],
            },
        };
        // Found by a search; its error in single precision was 50 dB above the sensors' noise.
        let shape = Shape {
            sections: [
                filter([1698.84, 3.0283], [0.0196456, 0.241255]),
                filter([430.566, 1.00541], [16.2144, 4.70676]),
                filter([0.0111146, 7.17355], [300.365, 0.236951]),
            ],
            split_hz: None,
        };
        let paired = shape.paired();
        let value =
            |filter: &Filter, hz: f64| continuous(filter.zeros, hz) / continuous(filter.poles, hz);
        for n in -30..50 {
            let hz = 10f64.powf(0.1 * f64::from(n));
            let product = |shape: &Shape| -> Complex<f64> {
                shape.sections.iter().map(|f| value(f, hz)).product()
            };
            let error = (product(&paired) / product(&shape) - 1.0).norm();
            assert!(error < 1e-12, "{hz} Hz: {error:e}");
        }
        let highest = |shape: &Shape| {
            let gains = shape.sections.map(|f| (f.zeros.hz / f.poles.hz).ln().abs());
            gains.into_iter().fold(0.0, f64::max)
        };
        // Together the zeros are 85 times as fast as the poles.
        assert!(highest(&shape) > 10.0);
        assert!(highest(&paired) < 4.0, "{}", highest(&paired));
        assert_eq!(paired.paired(), paired);
    }

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
            let Filter { zeros, poles } = shape.sections[1];
            let expected = first(30.0) * first(4000.0) / first(0.9) / first(250.0)
                * continuous(zeros, hz)
                / continuous(poles, hz);
            let z = Complex::cis(TAU * hz * period);
            let found: Complex<f64> = sections.iter().map(|s| section_response(s, z)).product();
            // The mapping of the roots, and single precision.
            let error = (found / expected - 1.0).norm();
            assert!(error < TAU * hz * period + 1e-4, "{hz} Hz: {error:e}");
        }
    }
}
