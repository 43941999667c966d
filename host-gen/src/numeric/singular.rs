//! The largest singular value of a complex matrix, and a bound on the smallest.

use nalgebra::{Complex, Const, Dyn, OMatrix, SVector};
use shared::LEGS;

use super::six::ComplexMatrix6;

/// The largest singular value; infinite if an entry is not finite.
///
/// By Lanczos' iteration on GᴴG: a few products with G, where all singular
/// values take some thirty times as many: curves over
/// frequency need only the largest.
pub fn largest_singular_value<const N: usize>(
    matrix: &OMatrix<Complex<f64>, Dyn, Const<N>>,
) -> f64 {
    if !matrix.iter().all(|z| z.re.is_finite() && z.im.is_finite()) {
        return f64::INFINITY;
    }
    let scale = matrix
        .iter()
        .map(|z| z.re.abs().max(z.im.abs()))
        .fold(0.0, f64::max);
    if scale == 0.0 {
        return 0.0;
    }
    // GᴴG by parts: real products are much faster than complex ones.
    let (re, im) = (matrix.map(|z| z.re / scale), matrix.map(|z| z.im / scale));
    let cross = re.transpose() * &im;
    let real = re.transpose() * &re + im.transpose() * &im;
    let imaginary = cross - cross.transpose();
    // A start with a part along everything, also where symmetry parts the
    // coordinates.
    let mut v = [0.5, 0.1].map(|least| {
        SVector::<f64, N>::from_fn(|i, _| {
            least + ((1.0 + i as f64) * 0.618_033_988_749_895).fract()
        })
    });
    let norm = |v: &[SVector<f64, N>; 2]| (v[0].norm_squared() + v[1].norm_squared()).sqrt();
    let length = norm(&v);
    v.iter_mut().for_each(|part| part.unscale_mut(length));
    let mut before = [SVector::<f64, N>::zeros(); 2];
    // GᴴG along the directions so far: tridiagonal, with its off-diagonal
    // entries before the diagonal ones.
    let mut diagonal = [0.0; STEPS];
    let mut beside = [0.0; STEPS];
    let mut largest = 0.0;
    let mut still = 0;
    for k in 0..STEPS {
        let [x, y] = &v;
        let image = [real * x - imaginary * y, real * y + imaginary * x];
        diagonal[k] = image[0].dot(x) + image[1].dot(y);
        // Above every eigenvalue of the matrix with one row more.
        let apart = 0.5 * (largest - diagonal[k]);
        let above = 0.5 * (largest + diagonal[k]) + (apart * apart + beside[k] * beside[k]).sqrt();
        let next = largest_of_tridiagonal(&diagonal[..=k], &beside[1..=k], above);
        still = if next - largest <= 1e-11 * next {
            still + 1
        } else {
            0
        };
        largest = next;
        // Less its parts along the last two directions. Those before come back
        // by rounding only as the largest value is found.
        let rest: [_; 2] =
            core::array::from_fn(|i| image[i] - v[i] * diagonal[k] - before[i] * beside[k]);
        let length = norm(&rest);
        if still == 2 || length <= 1e-14 * largest || k + 1 == STEPS {
            break;
        }
        beside[k + 1] = length;
        before = v;
        v = rest.map(|part| part / length);
    }
    scale * largest.sqrt()
}

/// Far more steps than the iteration takes with the 24 columns or fewer here.
const STEPS: usize = 48;

/// The largest eigenvalue of a symmetric tridiagonal matrix, by Newton's
/// iteration on its characteristic polynomial from a bound `above`: all roots
/// are real, so it comes down to the largest and never passes it.
fn largest_of_tridiagonal(diagonal: &[f64], beside: &[f64], above: f64) -> f64 {
    let mut x = above;
    for _ in 0..60 {
        // Pivots of x − T, and the sum of their logarithms' derivatives.
        let mut lowest = x - diagonal[0];
        let mut inverse = 1.0 / lowest;
        let mut slope = 1.0;
        let mut sum = inverse;
        for (d, b) in diagonal[1..].iter().zip(beside) {
            let ratio = b * inverse;
            slope = 1.0 + ratio * ratio * slope;
            let pivot = x - d - b * ratio;
            lowest = lowest.min(pivot);
            inverse = 1.0 / pivot;
            sum += slope * inverse;
        }
        // At the root itself, or past it by rounding.
        if !(sum.is_finite() && lowest > 0.0) {
            break;
        }
        let step = 1.0 / sum;
        x -= step;
        if step <= 1e-14 * x {
            break;
        }
    }
    x
}

/// Whether no singular value of a matrix is below 1/`bound`: of a return
/// difference 1 + L, whether the sensitivity is within `bound`.
///
/// (1 + L)ᴴ(1 + L) − 1/bound² is then positive definite, which a factorisation
/// shows much faster than singular values do.
pub(crate) fn smallest_is_above(matrix: ComplexMatrix6, bound: f64) -> bool {
    let mut square = matrix.ad_mul(&matrix);
    let floor = 1.0 / (bound * bound);
    for i in 0..LEGS {
        square[(i, i)] -= floor;
    }
    is_positive_definite(square)
}

/// nalgebra's complex Cholesky factorisation takes square roots of negative
/// pivots, so the pivots are looked at here.
fn is_positive_definite(mut m: ComplexMatrix6) -> bool {
    for k in 0..LEGS {
        let pivot = m[(k, k)].re;
        if pivot.is_nan() || pivot <= 0.0 {
            return false;
        }
        for i in k + 1..LEGS {
            let factor = m[(i, k)] / pivot;
            for j in k + 1..=i {
                let entry = factor * m[(j, k)].conj();
                m[(i, j)] -= entry;
            }
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against nalgebra's decomposition: random matrices, equal singular values,
    /// low rank, blocks that do not see each other, few rows, any scale.
    #[test]
    fn the_largest_singular_value_is_that_of_the_decomposition() {
        use proptest::prelude::*;
        use proptest::test_runner::{Config, TestRunner};

        let mut runner = TestRunner::new_with_rng(
            Config::with_cases(2000),
            proptest::test_runner::TestRng::from_seed(
                proptest::test_runner::RngAlgorithm::ChaCha,
                &[7; 32],
            ),
        );
        let case = (
            1usize..14,
            0..5,
            -150i32..150,
            prop::collection::vec(-1.0..1.0f64, 2 * 14 * 6),
        );
        runner
            .run(&case, |(rows, kind, decade, entries)| {
                type G = OMatrix<Complex<f64>, Dyn, Const<6>>;
                let entry = |i: usize, j: usize| {
                    let at = 2 * (6 * i + j);
                    Complex::new(entries[at], entries[at + 1])
                };
                let mut g = G::from_fn(rows, |i, j| match kind {
                    0 => entry(i, j),
                    // Columns that do not see each other, two of one size.
                    1 if i == j => Complex::from(entry(i / 2, 0).norm()),
                    // Rank one.
                    2 => entry(i, 0) * entry(0, j),
                    // Two blocks.
                    3 if (i < 3) == (j < 3) => entry(i, j),
                    // A resonance: rank one far above the rest.
                    4 => entry(i, 0) * entry(0, j) * 1e3 + entry(i, j),
                    _ => Complex::ZERO,
                });
                g *= Complex::from(10f64.powi(decade));
                let expected = g.singular_values().max();
                let found = largest_singular_value(&g);
                prop_assert!(
                    (found - expected).abs() <= 1e-11 * expected,
                    "{found:e} for {expected:e}: {g}"
                );
                Ok(())
            })
            .unwrap();
        let mut g = OMatrix::<Complex<f64>, Dyn, Const<6>>::zeros(4);
        assert_eq!(largest_singular_value(&g), 0.0);
        g[(2, 3)].im = f64::NAN;
        assert_eq!(largest_singular_value(&g), f64::INFINITY);
    }
}
