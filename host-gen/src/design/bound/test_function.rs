//! Functions that are orthogonal to every causal loop.

use nalgebra::{Complex, DMatrix};
use serde::Serialize;

use crate::control::shape::{Pair, Resonance};
use crate::control::table::coefficient;

/// Φ(z) = z^power·Σ coefficient·ψ(z), a sum of stable ψ.
///
/// The integral of Φ·t over the unit circle is zero for every stable t whose powers of z⁻¹ begin
/// above `power`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TestFunction {
    /// The power of z before the sum.
    pub power: usize,
    /// The terms of the sum.
    pub terms: Vec<Term>,
    /// One coefficient for each term.
    pub coefficients: Vec<f64>,
}

/// ψ(z) = z^(−delay)·(n₀ + n₁·δ)/(d₀ + d₁·δ + d₂·δ²) with δ = z − 1: a delay, a lag or a
/// resonance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Term {
    /// Samples of delay.
    pub delay: u8,
    /// n₀ and n₁.
    pub numerator: [f64; 2],
    /// d₀, d₁ and d₂.
    pub denominator: [f64; 3],
}

impl Term {
    fn at(&self, z: Complex<f64>) -> Complex<f64> {
        let delta = z - 1.0;
        let [n0, n1] = self.numerator;
        let [d0, d1, d2] = self.denominator;
        let ratio = (delta * n1 + n0) / ((delta * d2 + d1) * delta + d0);
        z.powi(-i32::from(self.delay)) * ratio
    }

    fn delay(delay: u8) -> Self {
        Self {
            delay,
            numerator: [1.0, 0.0],
            denominator: [1.0, 0.0, 0.0],
        }
    }

    /// The terms of `pole` at the sample `period`, s, which are 1 in its passband: a lag with damping
    /// 1, else a resonance.
    fn of(pole: &Resonance, period: f64) -> Vec<Self> {
        let term = |numerator, denominator| Self {
            delay: 0,
            numerator,
            denominator,
        };
        if pole.damping >= 1.0 {
            let step = coefficient(pole.hz, period);
            return vec![term([step, 0.0], [step, 1.0, 0.0])];
        }
        let Pair { sum, product } = Pair::new(*pole, period);
        let denominator = [product, sum, 1.0];
        vec![
            term([product, 0.0], denominator),
            term([0.0, product.sqrt()], denominator),
        ]
    }
}

impl TestFunction {
    /// Terms of the `poles`, and delays of none to two samples, all with coefficient 0.
    pub(super) fn with_poles(power: usize, poles: &[Resonance], period: f64) -> Self {
        let delays = (0..3).map(Term::delay);
        let terms: Vec<_> = delays
            .chain(poles.iter().flat_map(|pole| Term::of(pole, period)))
            .collect();
        Self {
            power,
            coefficients: vec![0.0; terms.len()],
            terms,
        }
    }

    /// Leaves out what is more than `most` terms.
    pub(super) fn shorten(&mut self, most: usize) {
        self.terms.truncate(most);
        self.coefficients.truncate(most);
    }

    /// z^power·ψ(z) of each term.
    pub(super) fn parts(&self, z: Complex<f64>) -> Vec<Complex<f64>> {
        let shift = z.powu(self.power as u32);
        self.terms.iter().map(|term| shift * term.at(z)).collect()
    }

    /// Φ(z).
    pub fn at(&self, z: Complex<f64>) -> Complex<f64> {
        let parts = self.parts(z);
        let parts = parts.iter().zip(&self.coefficients);
        parts.map(|(part, coefficient)| part * *coefficient).sum()
    }

    /// Leaves out terms that depend on those before them at the points z of the unit circle with
    /// their weights. And the rest as combinations that are orthonormal there: one row for each
    /// point, and the matrix R by which their coefficients are those of the terms: R·terms.
    pub(super) fn orthonormal(
        &mut self,
        points: &[(Complex<f64>, f64)],
    ) -> (DMatrix<Complex<f64>>, DMatrix<f64>) {
        loop {
            let count = points.len();
            let mut rows = DMatrix::zeros(2 * count, self.terms.len());
            for (k, (z, weight)) in points.iter().enumerate() {
                for (j, part) in self.parts(*z).into_iter().enumerate() {
                    rows[(k, j)] = part.re * weight.sqrt();
                    rows[(count + k, j)] = part.im * weight.sqrt();
                }
            }
            let norms: Vec<f64> = rows.column_iter().map(|column| column.norm()).collect();
            let qr = rows.qr();
            let r = qr.r();
            let independent =
                |j: &usize| r[(*j, *j)].abs() > INDEPENDENT * norms[*j] && norms[*j] > 0.0;
            let kept: Vec<usize> = (0..self.terms.len()).filter(independent).collect();
            if kept.len() == self.terms.len() {
                let q = qr.q();
                let basis = DMatrix::from_fn(count, q.ncols(), |k, j| {
                    Complex::new(q[(k, j)], q[(count + k, j)]) / points[k].1.sqrt()
                });
                return (basis, r);
            }
            self.terms = kept.into_iter().map(|j| self.terms[j]).collect();
            self.coefficients = vec![0.0; self.terms.len()];
        }
    }
}

/// Part of its own norm by which a term must differ from those before it: what cancels in their
/// sum leaves six digits.
const INDEPENDENT: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;

    use super::*;

    /// The integral of Φ·t is zero for a stable t with enough delay, and not for one with less.
    #[test]
    fn it_is_orthogonal_to_delayed_loops() {
        let poles = [
            Resonance {
                hz: 200.0,
                damping: 1.0,
            },
            Resonance {
                hz: 900.0,
                damping: 0.05,
            },
        ];
        let mut function = TestFunction::with_poles(1, &poles, 1e-4);
        for (j, coefficient) in function.coefficients.iter_mut().enumerate() {
            *coefficient = 1.0 + j as f64;
        }
        let mean = |delay: i32| {
            let count = 20_000;
            let sum: Complex<f64> = (0..count)
                .map(|k| {
                    let z = Complex::cis(TAU * f64::from(k) / f64::from(count));
                    function.at(z) * z.powi(-delay) / (1.0 - 0.7 / z)
                })
                .sum();
            sum.re / f64::from(count)
        };
        assert!(mean(2).abs() < 1e-9 && mean(3).abs() < 1e-9);
        assert!(mean(1).abs() > 0.1);
    }
}
