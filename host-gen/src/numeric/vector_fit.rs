//! Rational functions with common poles through sampled responses.
//!
//! Vector fitting: a function that is 1 at infinity up to a factor, with the assumed poles, is sought
//! whose product with every response has no other poles; its zeros are better poles. B. Gustavsen
//! and A. Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052; with the relaxed factor of
//! B. Gustavsen, 21 (2006) 1587, and each response eliminated by itself.

use core::cmp::Ordering;

use nalgebra::{Complex, DMatrix, DVector};

use super::eigen::eigenvalues;

/// Damping of the assumed poles.
const ASSUMED: f64 = 0.01;

/// Rounds in which the poles move.
const ROUNDS: usize = 20;

/// A sum of partial fractions and a constant, for several responses with the same poles.
#[derive(Clone, Debug)]
pub struct Rational {
    /// In s/2π, Hz: stable; real ones, and of conjugate pairs those with a positive imaginary part.
    pub poles: Vec<Complex<f64>>,
    /// A row for each coefficient, a column for each response; the constant is last.
    coefficients: DMatrix<f64>,
}

/// The partial fractions of real coefficients at s/2π = j·`hz`: one of a real pole, two of a pair.
fn fractions(poles: &[Complex<f64>], hz: f64) -> Vec<Complex<f64>> {
    let s = Complex::new(0.0, hz);
    let mut all = Vec::new();
    for pole in poles {
        let own = (s - pole).inv();
        if pole.im == 0.0 {
            all.push(own);
        } else {
            let conjugate = (s - pole.conj()).inv();
            all.push(own + conjugate);
            all.push((own - conjugate) * Complex::i());
        }
    }
    all
}

/// The zeros of Σ c·fraction + d.
fn zeros(poles: &[Complex<f64>], c: &[f64], d: f64) -> Option<Vec<Complex<f64>>> {
    let order = c.len();
    let mut a = DMatrix::zeros(order, order);
    let mut b = DVector::zeros(order);
    let mut at = 0;
    for pole in poles {
        a[(at, at)] = pole.re;
        if pole.im == 0.0 {
            b[at] = 1.0;
            at += 1;
        } else {
            a[(at + 1, at + 1)] = pole.re;
            (a[(at, at + 1)], a[(at + 1, at)]) = (pole.im, -pole.im);
            b[at] = 2.0;
            at += 2;
        }
    }
    let moved = a - b * DVector::from_column_slice(c).transpose() / d;
    // Unstable ones are mirrored.
    let stable = |zero: Complex<f64>| Complex::new(-zero.re.abs(), zero.im);
    let all = eigenvalues(&moved).ok()?;
    let mut half: Vec<_> = all
        .into_iter()
        .filter(|zero| zero.im >= 0.0)
        .map(stable)
        .collect();
    half.sort_by(|a, b| a.im.partial_cmp(&b.im).unwrap_or(Ordering::Equal));
    Some(half)
}

/// The real and the imaginary parts of `rows` of complex numbers, one below the other.
fn split(rows: &DMatrix<Complex<f64>>) -> DMatrix<f64> {
    let count = rows.nrows();
    DMatrix::from_fn(2 * count, rows.ncols(), |i, j| {
        let x = rows[(i % count, j)];
        if i < count { x.re } else { x.im }
    })
}

impl Rational {
    /// Fits `pairs` pairs of poles to responses at `hz`, ascending: a row for each frequency, a
    /// column for each response. Each counts with its weight.
    ///
    /// None if an iteration does not converge, or there are fewer frequencies than unknowns of a
    /// response and the poles together.
    pub fn fit(
        hz: &[f64],
        responses: &DMatrix<Complex<f64>>,
        weights: &DMatrix<f64>,
        pairs: usize,
    ) -> Option<Self> {
        let order = 2 * pairs;
        if hz.len() <= order || hz[0] <= 0.0 {
            return None;
        }
        let last = hz[hz.len() - 1];
        let mut poles: Vec<_> = (0..pairs)
            .map(|k| {
                let part = (k as f64 + 0.5) / pairs as f64;
                let hz = hz[0] * (last / hz[0]).powf(part);
                Complex::new(-ASSUMED * hz, hz)
            })
            .collect();
        for _ in 0..ROUNDS {
            let basis = basis(&poles, hz);
            let mut rows = Vec::new();
            for (response, weight) in responses.column_iter().zip(weights.column_iter()) {
                let both = DMatrix::from_fn(hz.len(), 2 * (order + 1), |k, j| {
                    let part = basis[(k, j % (order + 1))] * weight[k];
                    if j <= order {
                        part
                    } else {
                        -part * response[k]
                    }
                });
                let r = split(&both).qr().r();
                // What is left when the response's own coefficients are eliminated.
                let count = r.nrows().min(2 * (order + 1)) - (order + 1);
                rows.push(
                    r.view((order + 1, order + 1), (count, order + 1))
                        .into_owned(),
                );
            }
            let count: usize = rows.iter().map(DMatrix::nrows).sum();
            let mut all = DMatrix::zeros(count + 1, order + 1);
            let mut at = 0;
            for part in &rows {
                all.rows_mut(at, part.nrows()).copy_from(part);
                at += part.nrows();
            }
            // Its mean real part is 1, with a weight like that of the rest.
            let scale = all.norm() / hz.len() as f64;
            for j in 0..=order {
                let sum: f64 = basis.column(j).iter().map(|x| x.re).sum();
                all[(count, j)] = scale * sum;
            }
            let mut right = DVector::zeros(count + 1);
            right[count] = scale * hz.len() as f64;
            let solved = least_squares(all, &right)?;
            let (d, c) = solved.as_slice().split_last()?;
            poles = zeros(
                &poles,
                c,
                if d.abs() > 1e-8 {
                    *d
                } else {
                    1e-8_f64.copysign(*d)
                },
            )?;
        }
        Self::with_poles(hz, responses, weights, poles)
    }

    /// The best function with these `poles`, which are as [`Rational::poles`].
    ///
    /// None if a weight or a response is not finite.
    pub fn with_poles(
        hz: &[f64],
        responses: &DMatrix<Complex<f64>>,
        weights: &DMatrix<f64>,
        poles: Vec<Complex<f64>>,
    ) -> Option<Self> {
        let basis = basis(&poles, hz);
        let columns: Option<Vec<_>> = responses
            .column_iter()
            .zip(weights.column_iter())
            .map(|(response, weight)| {
                let left =
                    DMatrix::from_fn(hz.len(), basis.ncols(), |k, j| basis[(k, j)] * weight[k]);
                let right = DMatrix::from_fn(hz.len(), 1, |k, _| response[k] * weight[k]);
                least_squares(split(&left), &split(&right).column(0).into_owned())
            })
            .collect();
        Some(Self {
            coefficients: DMatrix::from_columns(&columns?),
            poles,
        })
    }

    /// Sum of the squares of all weighted errors.
    pub fn misfit(
        &self,
        hz: &[f64],
        responses: &DMatrix<Complex<f64>>,
        weights: &DMatrix<f64>,
    ) -> f64 {
        let square = |(k, hz): (usize, &f64)| {
            let found = self.at(*hz);
            let parts = found.iter().enumerate();
            parts
                .map(|(j, x)| ((x - responses[(k, j)]) * weights[(k, j)]).norm_sqr())
                .sum::<f64>()
        };
        hz.iter().enumerate().map(square).sum()
    }

    /// The same if each pole with a damping ratio below `most` had one that is larger by `added`, and
    /// its own frequency. Response j is one of s^p/(s² + 2ζω·s + ω²) with p = `powers(j)`, so residues
    /// change.
    pub fn damped(&self, added: f64, most: f64, powers: impl Fn(usize) -> i32) -> Self {
        let mut moved = self.clone();
        let mut at = 0;
        for pole in &mut moved.poles {
            if pole.im == 0.0 {
                at += 1;
                continue;
            }
            let own = *pole;
            let ratio = -own.re / own.norm();
            if ratio < most {
                let ratio = ratio + added;
                *pole = Complex::new(-ratio, (1.0 - ratio * ratio).sqrt()) * own.norm();
                for (j, mut column) in moved.coefficients.column_iter_mut().enumerate() {
                    let residue = Complex::new(column[at], column[at + 1]);
                    let residue = residue * (*pole / own).powi(powers(j)) * (own.im / pole.im);
                    (column[at], column[at + 1]) = (residue.re, residue.im);
                }
            }
            at += 2;
        }
        moved
    }

    /// All responses at `hz`, Hz.
    pub fn at(&self, hz: f64) -> DVector<Complex<f64>> {
        let mut parts = fractions(&self.poles, hz);
        parts.push(Complex::ONE);
        self.coefficients
            .map(Complex::from)
            .tr_mul(&DVector::from_vec(parts))
    }
}

/// The fractions of `poles` and the constant 1 at each frequency.
fn basis(poles: &[Complex<f64>], hz: &[f64]) -> DMatrix<Complex<f64>> {
    let rows: Vec<_> = hz
        .iter()
        .map(|hz| {
            let mut row = fractions(poles, *hz);
            row.push(Complex::ONE);
            DVector::from_vec(row).transpose()
        })
        .collect();
    DMatrix::from_rows(&rows)
}

/// The least squares solution, with columns scaled to 1: fractions differ by orders of magnitude.
fn least_squares(mut left: DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let norms: Vec<f64> = left.column_iter().map(|column| column.norm()).collect();
    for (mut column, norm) in left.column_iter_mut().zip(&norms) {
        column /= *norm;
    }
    let svd = left.svd(true, true);
    let mut solved = svd.solve(right, 1e-12 * svd.singular_values.max()).ok()?;
    for (x, norm) in solved.iter_mut().zip(&norms) {
        *x /= *norm;
    }
    solved.iter().all(|x| x.is_finite()).then_some(solved)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two responses with three common resonances, two of them close together and each narrower
    /// than the distance of the frequencies: the poles are found to rounding.
    #[test]
    fn it_finds_the_poles_of_a_rational_function() {
        let resonances = [(14.0, 0.005), (15.1, 0.01), (120.0, 0.003)];
        let hz: Vec<f64> = (0..20)
            .map(|k| 2.0 * 100f64.powf(f64::from(k) / 19.0))
            .collect();
        let damped = |sizes: [f64; 3], constant: f64, hz: f64, more: f64| {
            let parts = resonances.iter().zip(sizes).map(|((own, damping), size)| {
                let x = hz / own;
                Complex::from(size * x * x) / Complex::new(1.0 - x * x, 2.0 * (damping + more) * x)
            });
            parts.sum::<Complex<f64>>() + constant
        };
        let response = |sizes, constant, hz| damped(sizes, constant, hz, 0.0);
        let both = [([1.0, -0.5, 2.0], 0.3), ([0.2, 1.5, -0.1], 0.0)];
        let at = |k: usize, j: usize| response(both[j].0, both[j].1, hz[k]);
        let responses = DMatrix::from_fn(hz.len(), 2, at);
        let weights = responses.map(|x| 1.0 / x.norm());
        let found = Rational::fit(&hz, &responses, &weights, 4).unwrap();
        for (own, damping) in resonances {
            let near = found.poles.iter().map(|pole| {
                (pole.norm() / own - 1.0).abs() + (-pole.re / pole.norm() / damping - 1.0).abs()
            });
            assert!(
                near.fold(f64::MAX, f64::min) < 1e-6,
                "{own}: {:?}",
                found.poles
            );
        }
        let misfit = |rational: &Rational| rational.misfit(&hz, &responses, &weights);
        assert!(misfit(&found) < 1e-10);
        // Without one of the three there is no such function.
        let near = found
            .poles
            .iter()
            .position(|pole| (pole.im / 15.1 - 1.0).abs() < 0.01);
        let mut poles = found.poles.clone();
        poles.remove(near.unwrap());
        let without = Rational::with_poles(&hz, &responses, &weights, poles).unwrap();
        assert!(misfit(&without) > 0.1);
        // Between them, too.
        for k in 0..200 {
            let hz = 3.0 * 60f64.powf(f64::from(k) / 199.0);
            let error =
                found.at(hz) - DVector::from_fn(2, |j, _| response(both[j].0, both[j].1, hz));
            assert!(error.norm() < 1e-5 * found.at(hz).norm(), "{hz}");
            // And with more damping.
            let more = found.damped(0.1, 0.5, |_| 2).at(hz);
            let error = more - DVector::from_fn(2, |j, _| damped(both[j].0, both[j].1, hz, 0.1));
            assert!(error.norm() < 1e-5 * found.at(hz).norm(), "{hz}");
        }
    }
}
