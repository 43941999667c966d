//! The parameters of the synthesis: frequencies and dampings of all filters, as logarithms.

use core::f64::consts::TAU;
use core::ops::Range;

use nalgebra::Complex;
use shared::LEGS;

use crate::control::Shape;
use crate::control::shape::{Filter, Pair, Resonance};
use crate::control::table::coefficient;

/// Lowest and highest damping of a pair of poles or zeros: a sharp one would need the machine to
/// be known better than it is.
const DAMPINGS: [f64; 2] = [0.1, 60.0];

/// Highest frequency of a pair of poles or zeros, and of the crossover between two kinds of
/// sensors, as a part of the sample rate.
const HIGHEST: f64 = 0.45;

/// Lowest frequency of the same as a part of the target's.
const LOWEST: f64 = 0.2;

/// Parameters of a section: frequency and damping of its zeros, then of its poles.
const PER_SECTION: usize = 4;

/// Parameters of a group at most.
pub(super) const MOST_PER_GROUP: usize = PER_SECTION * Shape::SECTIONS + 1;

/// How parameters make shapes.
///
/// All parameters are natural logarithms. Modes with equal frequencies share theirs.
#[derive(Clone, Debug)]
pub(super) struct Parameters {
    /// Channels with equal shapes.
    pub(super) groups: Vec<Range<usize>>,
    /// Whether each mode has a crossover frequency between two kinds of sensors.
    pub(super) both: bool,
    /// Sample period, s.
    pub(super) period: f64,
    /// Target frequency, Hz.
    pub(super) frequency: f64,
}

/// A pair of roots with the derivatives of its coefficients by the logarithms of frequency and
/// damping.
#[derive(Clone, Copy)]
struct PairSlope {
    pair: Pair,
    sum: [f64; 2],
    product: [f64; 2],
}

/// The filters of one group of channels, ready to be evaluated at many frequencies.
pub(super) struct GroupFilters {
    /// Zeros and poles of each section.
    sections: [[PairSlope; 2]; Shape::SECTIONS],
    /// Coefficient of the crossover's low-pass, and its derivative by the logarithm of the
    /// frequency.
    split: Option<[f64; 2]>,
}

impl Parameters {
    /// Parameters of one group.
    pub(super) fn per_group(&self) -> usize {
        PER_SECTION * Shape::SECTIONS + usize::from(self.both)
    }

    /// All parameters.
    pub(super) fn count(&self) -> usize {
        self.groups.len() * self.per_group()
    }

    /// The parameters of `shapes`, moved within their limits.
    pub(super) fn of_shapes(&self, shapes: &[Shape; LEGS]) -> Vec<f64> {
        let mut all = Vec::with_capacity(self.count());
        for group in &self.groups {
            let shape = &shapes[group.start];
            for Filter { zeros, poles } in &shape.sections {
                for Resonance { hz, damping } in [zeros, poles] {
                    all.extend([hz.ln(), damping.ln()]);
                }
            }
            if self.both {
                all.push(shape.split_hz.unwrap_or(1.0).ln());
            }
        }
        for (i, x) in all.iter_mut().enumerate() {
            let [low, high] = self.limits(i);
            let room = 0.02 * (high - low);
            *x = x.clamp(low + room, high - room);
        }
        all
    }

    /// The shapes of the parameters `x`, one for each mode.
    pub(super) fn shapes(&self, x: &[f64]) -> [Shape; LEGS] {
        let shape = |x: &[f64]| {
            let resonance = |at: usize| Resonance {
                hz: x[at].exp(),
                damping: x[at + 1].exp(),
            };
            Shape {
                sections: core::array::from_fn(|i| Filter {
                    zeros: resonance(PER_SECTION * i),
                    poles: resonance(PER_SECTION * i + 2),
                }),
                split_hz: self.both.then(|| x[self.per_group() - 1].exp()),
            }
        };
        let mut shapes = [shape(x); LEGS];
        for (group, x) in self.groups.iter().zip(x.chunks(self.per_group())) {
            shapes[group.clone()].fill(shape(x));
        }
        shapes
    }

    /// Lower and upper limit of parameter `i`.
    pub(super) fn limits(&self, i: usize) -> [f64; 2] {
        let i = i % self.per_group();
        let damping = i < PER_SECTION * Shape::SECTIONS && i % 2 == 1;
        if damping {
            DAMPINGS.map(f64::ln)
        } else {
            [LOWEST * self.frequency, HIGHEST / self.period].map(f64::ln)
        }
    }

    /// The filters of each group with the parameters `x`.
    pub(super) fn filters(&self, x: &[f64]) -> Vec<GroupFilters> {
        let pair = |x: &[f64]| PairSlope::new(x[0].exp(), x[1].exp(), self.period);
        x.chunks(self.per_group())
            .map(|x| GroupFilters {
                sections: core::array::from_fn(|i| {
                    let x = &x[PER_SECTION * i..];
                    [pair(x), pair(&x[2..])]
                }),
                split: self.both.then(|| {
                    let hz = x[self.per_group() - 1].exp();
                    let turn = TAU * hz * self.period;
                    [coefficient(hz, self.period), turn * (-turn).exp()]
                }),
            })
            .collect()
    }
}

impl PairSlope {
    fn new(hz: f64, damping: f64, period: f64) -> Self {
        let pair = Pair::new(Resonance { hz, damping }, period);
        // The roots in z are e^(−x ± y) with x = ζωT and y² = (ωT)²·(ζ² − 1).
        let omega = TAU * hz * period;
        let x = damping * omega;
        let square = (x - omega) * (x + omega);
        // 2e^(−x)·cosh y and e^(−x)·sinh(y)/y, with real or imaginary y, without overflow.
        let (twice, slope) = if square > 0.0 {
            let y = square.sqrt();
            let [fast, slow] = [-x - y, y - x].map(f64::exp);
            (fast + slow, 0.5 * slow * -(-2.0 * y).exp_m1() / y)
        } else {
            let y = (-square).sqrt();
            let sinc = if y > 1e-8 { y.sin() / y } else { 1.0 };
            (2.0 * (-x).exp() * y.cos(), (-x).exp() * sinc)
        };
        let decay = (-2.0 * x).exp();
        // d(2e^(−x)·cosh y) = −2e^(−x)·cosh y·dx + e^(−x)·sinh(y)/y·d(y²).
        let [by_hz, by_damping] = [2.0 * square, 2.0 * x * x].map(|d| -twice * x + slope * d);
        Self {
            pair,
            sum: [-by_hz, -by_damping],
            product: [by_hz, by_damping].map(|d| -d - 2.0 * x * decay),
        }
    }

    /// The polynomial at δ over its value at δ = 0, and the derivatives of its logarithm.
    fn at(&self, delta: Complex<f64>) -> (Complex<f64>, [Complex<f64>; 2]) {
        let Pair { sum, product } = self.pair;
        let value = delta * (delta + sum) + product;
        let inverse = value.inv();
        let slopes = core::array::from_fn(|i| {
            (delta * self.sum[i] + self.product[i]) * inverse - self.product[i] / product
        });
        (value / product, slopes)
    }
}

impl GroupFilters {
    /// The product of all sections at δ = z − 1; `slopes` are the derivatives of its logarithm by
    /// the parameters of the sections.
    pub(super) fn sections(
        &self,
        delta: Complex<f64>,
        slopes: &mut [Complex<f64>],
    ) -> Complex<f64> {
        let mut product = Complex::ONE;
        for ([zeros, poles], slopes) in self.sections.iter().zip(slopes.chunks_mut(PER_SECTION)) {
            let (above, by_zeros) = zeros.at(delta);
            let (below, by_poles) = poles.at(delta);
            product *= above / below;
            for (slope, by) in slopes.iter_mut().zip(by_zeros) {
                *slope = by;
            }
            for (slope, by) in slopes[2..].iter_mut().zip(by_poles) {
                *slope = -by;
            }
        }
        product
    }

    /// The factors of the two kinds of sensors, low-pass and high-pass, at δ = z − 1, each with
    /// the derivative of its logarithm by the crossover frequency's; one and zero with one kind.
    pub(super) fn split(&self, delta: Complex<f64>) -> [(Complex<f64>, Complex<f64>); 2] {
        let Some([c, slope]) = self.split else {
            return [
                (Complex::ONE, Complex::ZERO),
                (Complex::ZERO, Complex::ZERO),
            ];
        };
        // z·c/(δ + c) and δ·(1 − c)/(δ + c).
        let inverse = (delta + c).inv();
        let low = (delta + 1.0) * c * inverse;
        let high = delta * (1.0 - c) * inverse;
        [
            (low, (1.0 / c - inverse) * slope),
            (high, (-1.0 / (1.0 - c) - inverse) * slope),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::law::{low_pass, section_response};

    /// The response against that of the table's sections, and every derivative against a
    /// difference.
    #[test]
    fn derivatives_are_differences() {
        let parameters = Parameters {
            groups: vec![0..2, 2..6],
            both: true,
            period: 5e-5,
            frequency: 1.0,
        };
        let start: Vec<f64> = (0..parameters.count())
            .map(|i| {
                let [low, high] = parameters.limits(i);
                low + (high - low) * (0.2 + 0.6 * ((i as f64 + 1.0) * 0.618).fract())
            })
            .collect();
        let n = parameters.per_group();
        for hz in [0.01, 0.7, 30.0, 900.0, 7000.0] {
            let z = Complex::cis(TAU * hz * parameters.period);
            let delta = z - 1.0;
            let at = |x: &[f64], group: usize| {
                let filters = &parameters.filters(x)[group];
                let mut slopes = vec![Complex::ZERO; n - 1];
                let sections = filters.sections(delta, &mut slopes);
                (sections, filters.split(delta), slopes)
            };
            let shapes = parameters.shapes(&start);
            for (group, mode) in [0, 5].into_iter().enumerate() {
                let (sections, split, slopes) = at(&start, group);
                let table = shapes[mode].sections(parameters.period);
                let expected: Complex<f64> = table.iter().map(|s| section_response(s, z)).product();
                // The table is in single precision.
                assert!((sections / expected - 1.0).norm() < 2e-4, "{hz} Hz");
                let low = low_pass(
                    coefficient(shapes[mode].split_hz.unwrap(), parameters.period),
                    z,
                );
                assert!((split[0].0 - low).norm() < 1e-12);
                assert!((split[1].0 - (1.0 - low)).norm() < 1e-12);
                for i in 0..n {
                    let moved = |by: f64| {
                        let mut x = start.clone();
                        x[group * n + i] += by;
                        let (sections, split, _) = at(&x, group);
                        [sections.ln(), split[0].0.ln(), split[1].0.ln()]
                    };
                    let (ahead, behind) = (moved(1e-5), moved(-1e-5));
                    let by = [0, 1, 2].map(|k| (ahead[k] - behind[k]) / 2e-5);
                    let found = if i + 1 < n {
                        [slopes[i], Complex::ZERO, Complex::ZERO]
                    } else {
                        [Complex::ZERO, split[0].1, split[1].1]
                    };
                    for (a, b) in by.into_iter().zip(found) {
                        assert!((a - b).norm() < 1e-5, "{hz} Hz, {i}: {a} {b}");
                    }
                }
            }
        }
    }
}
