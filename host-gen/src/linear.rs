//! Small linear algebra that nalgebra does not have.

use nalgebra::linalg::Cholesky;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, Const, DMatrix, DVector, Dyn, OMatrix, SVector};

/// The first row that is a combination of the rows before it, to `tolerance`
/// of its own length.
pub fn first_dependent_row(rows: &DMatrix<f64>, tolerance: f64) -> Option<usize> {
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for (i, row) in rows.row_iter().enumerate() {
        let mut rest = row.transpose();
        let length = rest.norm();
        // Twice, because once leaves rounding of the size of the condition.
        for _ in 0..2 {
            for direction in &basis {
                let along = direction.dot(&rest);
                rest.axpy(-along, direction, 1.0);
            }
        }
        if rest.norm() <= tolerance * length || length == 0.0 {
            return Some(i);
        }
        basis.push(rest.normalize());
    }
    None
}

/// K v = λ M v for symmetric K and positive definite M: λ ascending, and the
/// vectors as columns with VᵀMV = 1 and the largest entry of each positive.
/// None if M is not positive definite.
pub fn generalised_eigen(
    stiffness: &DMatrix<f64>,
    mass: &DMatrix<f64>,
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let factor = Cholesky::new(mass.clone())?;
    let l = factor.l();
    // L⁻¹ K L⁻ᵀ
    let half = l.solve_lower_triangular(stiffness)?;
    let mut reduced = l.solve_lower_triangular(&half.transpose())?;
    reduced = 0.5 * (&reduced + reduced.transpose());
    let eigen = reduced.symmetric_eigen();
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let values = DVector::from_iterator(order.len(), order.iter().map(|&i| eigen.eigenvalues[i]));
    let sorted = eigen.eigenvectors.select_columns(&order);
    let mut vectors = l.transpose().solve_upper_triangular(&sorted)?;
    for mut column in vectors.column_iter_mut() {
        if column[column.icamax()] < 0.0 {
            column.neg_mut();
        }
    }
    Some((values, vectors))
}

/// All eigenvalues of a general matrix. None if the iteration does not end.
///
/// By faer: nalgebra's Schur iteration does not converge on the closed loops
/// here, which have several equal eigenvalues.
pub fn eigenvalues(matrix: &DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    // Forces, displacements and sensor values differ by many decades: scaled
    // first, so that rounding is relative to each.
    let mut scaled = matrix.clone();
    balance_parlett_reinsch(&mut scaled);
    faer::Mat::from_fn(scaled.nrows(), scaled.ncols(), |i, j| scaled[(i, j)])
        .eigenvalues()
        .ok()
}

/// The finite λ of A v = λ B v for a singular B: those that infinity has are
/// left out or, through rounding, very large. None if the iteration does not
/// end.
pub fn generalised_eigenvalues(a: &DMatrix<f64>, b: &DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    let n = a.nrows();
    let eigen = faer::Mat::from_fn(n, n, |i, j| a[(i, j)])
        .generalized_eigen(faer::Mat::from_fn(n, n, |i, j| b[(i, j)]))
        .ok()?;
    let ratios = (0..n).map(|i| eigen.S_a()[i] / eigen.S_b()[i]);
    Some(
        ratios
            .filter(|z| z.re.is_finite() && z.im.is_finite())
            .collect(),
    )
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dependent_row_is_named() {
        let rows = DMatrix::from_row_slice(3, 3, &[1.0, 2.0, 3.0, 0.0, 1.0, 0.0, 2.0, 5.0, 6.0]);
        assert_eq!(first_dependent_row(&rows, 1e-9), Some(2));
        let free = DMatrix::from_row_slice(3, 3, &[1.0, 2.0, 3.0, 0.0, 1.0, 0.0, 2.0, 5.0, 6.1]);
        assert_eq!(first_dependent_row(&free, 1e-9), None);
    }

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

    /// x⁴ − 10x³ + 35x² − 50x + 24 = (x−1)(x−2)(x−3)(x−4), as a companion matrix.
    #[test]
    fn companion_eigenvalues_are_the_roots() {
        let c = DMatrix::from_row_slice(
            4,
            4,
            &[
                10.0, -35.0, 50.0, -24.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0,
                0.0,
            ],
        );
        let mut roots: Vec<f64> = eigenvalues(&c).unwrap().iter().map(|z| z.re).collect();
        roots.sort_by(f64::total_cmp);
        for (root, expected) in roots.iter().zip([1.0, 2.0, 3.0, 4.0]) {
            assert!((root - expected).abs() < 1e-9);
        }
    }
}
