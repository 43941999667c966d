//! The largest singular value of a complex matrix, and a test for a lower bound on the smallest.

use nalgebra::{Complex, Const, Dyn, OMatrix, SVector};
use shared::LEGS;

use super::six::ComplexMatrix6;

/// The largest singular value of a matrix; infinite if an entry is not finite.
///
/// Uses the Lanczos iteration on GᴴG. Curves over frequency need only the largest value, and a
/// few matrix products find it about thirty times faster than a full decomposition.
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
    // Real and imaginary part of GᴴG: real products are much faster than complex ones.
    let (re, im) = (matrix.map(|z| z.re / scale), matrix.map(|z| z.im / scale));
    let cross = re.transpose() * &im;
    let real = re.transpose() * &re + im.transpose() * &im;
    let imaginary = cross - cross.transpose();
    // The start vector has a component along every eigenvector, also where symmetry decouples
    // the coordinates.
    let mut v = [0.5, 0.1].map(|least| {
        SVector::<f64, N>::from_fn(|i, _| {
            least + ((1.0 + i as f64) * 0.618_033_988_749_895).fract()
        })
    });
    let norm = |v: &[SVector<f64, N>; 2]| (v[0].norm_squared() + v[1].norm_squared()).sqrt();
    let length = norm(&v);
    v.iter_mut().for_each(|part| part.unscale_mut(length));
    let mut before = [SVector::<f64, N>::zeros(); 2];
    // GᴴG in the basis built so far is tridiagonal. `beside[k]` is the off-diagonal entry
    // between rows k − 1 and k.
    let mut diagonal = [0.0; STEPS];
    let mut beside = [0.0; STEPS];
    let mut largest = 0.0;
    let mut still = 0;
    for k in 0..STEPS {
        let [x, y] = &v;
        let image = [real * x - imaginary * y, real * y + imaginary * x];
        diagonal[k] = image[0].dot(x) + image[1].dot(y);
        // An upper bound for the eigenvalues of the matrix with the new row.
        let apart = 0.5 * (largest - diagonal[k]);
        let above = 0.5 * (largest + diagonal[k]) + (apart * apart + beside[k] * beside[k]).sqrt();
        let next = largest_of_tridiagonal(&diagonal[..=k], &beside[1..=k], above);
        still = if next - largest <= 1e-11 * next {
            still + 1
        } else {
            0
        };
        largest = next;
        // Orthogonal to the last two vectors only. Rounding brings the earlier ones back only
        // once the largest value has converged.
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

/// Limit on Lanczos steps, far more than matrices of at most 24 columns need.
const STEPS: usize = 48;

/// The largest eigenvalue of a symmetric tridiagonal matrix with the off-diagonal entries
/// `beside`.
///
/// Newton's iteration on the characteristic polynomial starts at the upper bound `above`. All
/// roots are real, so it descends to the largest root and does not overshoot.
fn largest_of_tridiagonal(diagonal: &[f64], beside: &[f64], above: f64) -> f64 {
    let mut x = above;
    for _ in 0..60 {
        // Pivots of x − T, and the sum of their logarithmic derivatives.
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
        // At the root, or below it by rounding.
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

/// Whether all singular values of a matrix exceed 1/`bound`.
///
/// For a return difference 1 + L this says that the sensitivity (1 + L)⁻¹ is below `bound`.
/// Then (1 + L)ᴴ(1 + L) − 1/bound² is positive definite. A factorisation tests this much faster
/// than singular values do.
pub(crate) fn smallest_is_above(matrix: ComplexMatrix6, bound: f64) -> bool {
    let mut square = matrix.ad_mul(&matrix);
    let floor = 1.0 / (bound * bound);
    for i in 0..LEGS {
        square[(i, i)] -= floor;
    }
    is_positive_definite(square)
}

/// Whether a Hermitian matrix is positive definite.
///
/// nalgebra's complex Cholesky factorisation takes square roots of negative pivots and does not
/// fail, so this checks the pivots itself.
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

    /// Compared with nalgebra's decomposition: random matrices, equal singular values, low rank,
    /// decoupled blocks, few rows, any scale.
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
                    // Orthogonal columns, in pairs of equal norm.
                    1 if i == j => Complex::from(entry(i / 2, 0).norm()),
                    // Rank one.
                    2 => entry(i, 0) * entry(0, j),
                    // Two blocks.
                    3 if (i < 3) == (j < 3) => entry(i, j),
                    // A resonance: one rank-one part dominates.
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
