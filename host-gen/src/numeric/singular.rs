//! The largest singular value of a complex matrix, and a test for a lower bound on the smallest.

use nalgebra::{Complex, Const, Dyn, OMatrix};
use shared::LEGS;

use super::six::ComplexMatrix6;

/// The largest singular value of a matrix; infinite if an entry is not finite.
///
/// Uses the Lanczos iteration on GᴴG. Curves over frequency need only the largest value, and a
/// few matrix products find it about thirty times faster than a full decomposition.
pub fn largest_singular_value<const N: usize>(
    matrix: &OMatrix<Complex<f64>, Dyn, Const<N>>,
) -> f64 {
    let mut rows = vec![[[0.0; N]; 2]; matrix.nrows()];
    for (j, column) in matrix.column_iter().enumerate() {
        for (row, z) in rows.iter_mut().zip(column.iter()) {
            [row[0][j], row[1][j]] = [z.re, z.im];
        }
    }
    let Some(scale) = largest_magnitude(&rows) else {
        return f64::INFINITY;
    };
    if scale == 0.0 {
        return 0.0;
    }
    // The inverse of a subnormal number can be infinite.
    let scale = scale.max(f64::MIN_POSITIVE);
    let inverse = 1.0 / scale;
    for x in rows.as_flattened_mut().as_flattened_mut() {
        *x *= inverse;
    }
    let square = square(&rows);
    // The start vector has a component along every eigenvector, also where symmetry decouples
    // the coordinates.
    let mut v = [0.5, 0.1].map(|least| {
        core::array::from_fn(|i| least + ((1.0 + i as f64) * 0.618_033_988_749_895).fract())
    });
    let length = norm(&v);
    v = v.map(|part| part.map(|x| x / length));
    let mut before = [[0.0; N]; 2];
    // GᴴG in the basis built so far is tridiagonal. `beside[k]` is the off-diagonal entry
    // between rows k − 1 and k.
    let mut diagonal = [0.0; STEPS];
    let mut beside = [0.0; STEPS];
    let mut largest = 0.0;
    // An upper bound for the eigenvalues of the tridiagonal matrix.
    let mut above = 0.0;
    for k in 0..STEPS {
        let mut rest = product(&square, &v);
        diagonal[k] = dot(&rest, &v);
        let apart: f64 = 0.5 * (above - diagonal[k]);
        above = 0.5 * (above + diagonal[k]) + (apart * apart + beside[k] * beside[k]).sqrt();
        // Orthogonal to the last two vectors only. Rounding brings the earlier ones back only
        // once the largest value has converged.
        for part in 0..2 {
            for i in 0..N {
                rest[part][i] -= v[part][i] * diagonal[k] + before[part][i] * beside[k];
            }
        }
        let length = norm(&rest);
        let last = length <= 1e-14 * above || k + 1 == STEPS;
        // The largest value stands still over two steps, not over one by chance.
        if last || k >= 4 && k % 2 == 0 {
            above = largest_of_tridiagonal(&diagonal[..=k], &beside[1..=k], above);
            if last || above - largest <= 1e-11 * above {
                break;
            }
            largest = above;
        }
        beside[k + 1] = length;
        before = v;
        let inverse = 1.0 / length;
        v = rest.map(|part| part.map(|x| x * inverse));
    }
    scale * above.sqrt()
}

/// Limit on Lanczos steps, far more than matrices of at most 24 columns need.
const STEPS: usize = 48;

/// A complex vector: the real parts of its `N` entries, then the imaginary parts. Loops over
/// either take vector registers, as those over complex numbers do not.
type Parts<const N: usize> = [[f64; N]; 2];

/// The largest magnitude of a real or imaginary part; none if one is not finite.
fn largest_magnitude<const N: usize>(rows: &[Parts<N>]) -> Option<f64> {
    let mut largest = [0.0; N];
    // Zero, or NaN if any number is not finite.
    let mut zero = [0.0; N];
    for part in rows.as_flattened() {
        for j in 0..N {
            let size = part[j].abs();
            largest[j] = if size > largest[j] { size } else { largest[j] };
            zero[j] += 0.0 * size;
        }
    }
    zero.iter()
        .all(|x| *x == 0.0)
        .then(|| largest.into_iter().fold(0.0, f64::max))
}

/// The rows of GᴴG; `rows` are those of G.
fn square<const N: usize>(rows: &[Parts<N>]) -> [Parts<N>; N] {
    let mut square = [[[0.0; N]; 2]; N];
    for i in 0..N {
        let mut real = [0.0; N];
        let mut imaginary = [0.0; N];
        for [re, im] in rows {
            let (a, b) = (re[i], im[i]);
            for j in 0..N {
                real[j] += a * re[j] + b * im[j];
                imaginary[j] += a * im[j] - b * re[j];
            }
        }
        square[i] = [real, imaginary];
    }
    square
}

/// The product of a Hermitian matrix and a vector.
fn product<const N: usize>(matrix: &[Parts<N>; N], [x, y]: &Parts<N>) -> Parts<N> {
    let mut sums = [[0.0; N]; 2];
    for i in 0..N {
        // Column i is the conjugate of row i.
        let [real, imaginary] = &matrix[i];
        for j in 0..N {
            sums[0][j] += real[j] * x[i] + imaginary[j] * y[i];
            sums[1][j] += real[j] * y[i] - imaginary[j] * x[i];
        }
    }
    sums
}

/// The real part of aᴴ·b.
fn dot<const N: usize>(a: &Parts<N>, b: &Parts<N>) -> f64 {
    let products: [f64; N] = core::array::from_fn(|i| a[0][i] * b[0][i] + a[1][i] * b[1][i]);
    products.iter().sum()
}

fn norm<const N: usize>(v: &Parts<N>) -> f64 {
    dot(v, v).sqrt()
}

/// The largest eigenvalue of a symmetric tridiagonal matrix with the off-diagonal entries
/// `beside`, all far below 10⁶.
///
/// Laguerre's iteration on the characteristic polynomial starts at the upper bound `above`. All
/// roots are real, so it descends to the largest root and does not overshoot. The polynomial and
/// its derivatives come from the recurrence of the leading minors, without a division.
fn largest_of_tridiagonal(diagonal: &[f64], beside: &[f64], above: f64) -> f64 {
    let n = diagonal.len() as f64;
    let mut x = above;
    for _ in 0..60 {
        // A leading minor of x − T with its first and second derivative, and the one before it.
        let mut minor = [x - diagonal[0], 1.0, 0.0];
        let mut before = [1.0, 0.0, 0.0];
        let mut positive = minor[0] > 0.0;
        for (d, b) in diagonal[1..].iter().zip(beside) {
            let (u, square) = (x - d, b * b);
            let next = [
                u * minor[0] - square * before[0],
                u * minor[1] + minor[0] - square * before[1],
                u * minor[2] + 2.0 * minor[1] - square * before[2],
            ];
            (before, minor) = (minor, next);
            positive &= minor[0] > 0.0;
        }
        // At the root, or below it by rounding.
        if !positive {
            break;
        }
        let slope = minor[1] / minor[0];
        let bend = slope * slope - minor[2] / minor[0];
        let root = ((n - 1.0) * (n * bend - slope * slope)).max(0.0).sqrt();
        let step = n / (slope + root);
        x -= step;
        if step.is_nan() || step <= 1e-14 * x {
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
