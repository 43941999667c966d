//! Eigenvalues of symmetric pairs, of general matrices and of matrix pencils.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, EvdParams, evd_real, evd_scratch};
use faer::{Par, Spec};
use nalgebra::linalg::Cholesky;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, DMatrix, DVector};

use super::NumericError;

/// Solves K·v = λ·M·v for a symmetric K (`stiffness`) and a positive definite M (`mass`).
///
/// Returns λ in ascending order and the eigenvectors as the columns of V, with VᵀMV = 1 and the
/// largest entry of each column positive. `None` if M is not positive definite.
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

/// All eigenvalues of a square matrix, in no particular order.
///
/// Uses faer: nalgebra's Schur iteration does not converge for the closed loops here, which have
/// several equal eigenvalues.
///
/// # Errors
/// [`NumericError::NotConverged`] if the iteration does not converge.
pub fn eigenvalues(matrix: &DMatrix<f64>) -> Result<Vec<Complex<f64>>, NumericError> {
    // Forces, displacements and sensor values differ by many orders of magnitude. Balancing
    // makes rounding errors relative to each of them.
    let mut scaled = matrix.clone();
    balance_parlett_reinsch(&mut scaled);
    let n = scaled.nrows();
    let scaled = faer::Mat::from_fn(n, n, |i, j| scaled[(i, j)]);
    let (mut re, mut im) = (Diag::zeros(n), Diag::zeros(n));
    // One pair of shifts at a time, whatever the size: with many of them at once, faer's
    // iteration stagnates for minutes on loops with dozens of poles close together.
    let mut settings = Spec::<EvdParams, f64>::default();
    settings.schur.blocking_threshold = usize::MAX;
    let none = ComputeEigenvectors::No;
    let room = evd_scratch::<f64>(n, none, none, Par::Seq, settings);
    evd_real(
        scaled.as_ref(),
        re.as_mut(),
        im.as_mut(),
        None,
        None,
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(room)),
        settings,
    )
    .map_err(|_| NumericError::NotConverged)?;
    Ok((0..n).map(|i| Complex::new(re[i], im[i])).collect())
}

/// Sweeps after which the Jacobi iterations end. They converge quadratically; ten are many.
const SWEEPS: usize = 40;

/// Turns the plane of columns i and j of `matrix`.
fn turn(matrix: &mut DMatrix<f64>, i: usize, j: usize, cos: f64, sin: f64) {
    for row in 0..matrix.nrows() {
        let (a, b) = (matrix[(row, i)], matrix[(row, j)]);
        matrix[(row, i)] = cos * a - sin * b;
        matrix[(row, j)] = sin * a + cos * b;
    }
}

/// Cosine and sine of the turn that makes [[a, c], [c, b]] diagonal.
fn jacobi(a: f64, b: f64, c: f64) -> (f64, f64) {
    let theta = (b - a) / (2.0 * c);
    // Roots alone, which every processor computes alike.
    let tan = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let cos = 1.0 / (tan * tan + 1.0).sqrt();
    (cos, tan * cos)
}

/// The eigenvalues of BᵀB + S, ascending, and the eigenvectors as columns. `factor` is B, and
/// `rest` a symmetric S.
///
/// Jacobi's method, first on the columns of B, then on the sum. Unlike an iteration on BᵀB itself,
/// it resolves eigenvalues that are 1e20 times smaller than the largest.
pub fn factored_eigen(
    factor: &DMatrix<f64>,
    rest: Option<&DMatrix<f64>>,
) -> (DVector<f64>, DMatrix<f64>) {
    let n = factor.ncols();
    let mut b = factor.clone();
    let mut vectors = DMatrix::identity(n, n);
    // Columns below this are nothing but rounding.
    let zero = f64::EPSILON * f64::EPSILON * b.norm_squared();
    for _ in 0..SWEEPS {
        let mut done = true;
        for i in 0..n {
            for j in i + 1..n {
                let (x, y) = (b.column(i).norm_squared(), b.column(j).norm_squared());
                let dot = b.column(i).dot(&b.column(j));
                if x.min(y) > zero && dot.abs() > 4.0 * f64::EPSILON * (x * y).sqrt() {
                    let (cos, sin) = jacobi(x, y, dot);
                    turn(&mut b, i, j, cos, sin);
                    turn(&mut vectors, i, j, cos, sin);
                    done = false;
                }
            }
        }
        if done {
            break;
        }
    }
    let mut sum = DMatrix::from_diagonal(&DVector::from_iterator(
        n,
        b.column_iter().map(|column| column.norm_squared()),
    ));
    if let Some(rest) = rest {
        sum += vectors.transpose() * rest * &vectors;
        diagonalise(&mut sum, &mut vectors);
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| sum[(a, a)].total_cmp(&sum[(b, b)]));
    let values = DVector::from_iterator(n, order.iter().map(|&i| sum[(i, i)]));
    (values, vectors.select_columns(&order))
}

/// Makes a symmetric matrix diagonal by turns, which `vectors` take part in.
fn diagonalise(matrix: &mut DMatrix<f64>, vectors: &mut DMatrix<f64>) {
    let n = matrix.nrows();
    let zero = f64::EPSILON * f64::EPSILON * matrix.amax();
    for _ in 0..SWEEPS {
        let mut done = true;
        for i in 0..n {
            for j in i + 1..n {
                let (a, b, c) = (matrix[(i, i)], matrix[(j, j)], matrix[(i, j)]);
                if c.abs() > zero.max(f64::EPSILON * (a * b).abs().sqrt()) {
                    let (cos, sin) = jacobi(a, b, c);
                    turn(matrix, i, j, cos, sin);
                    for column in 0..n {
                        let (x, y) = (matrix[(i, column)], matrix[(j, column)]);
                        matrix[(i, column)] = cos * x - sin * y;
                        matrix[(j, column)] = sin * x + cos * y;
                    }
                    matrix[(i, j)] = 0.0;
                    matrix[(j, i)] = 0.0;
                    turn(vectors, i, j, cos, sin);
                    done = false;
                }
            }
        }
        if done {
            break;
        }
    }
}

/// The finite eigenvalues λ of A·v = λ·B·v, where B may be singular.
///
/// Infinite eigenvalues are left out. Rounding can turn one into a very large value, which is
/// returned.
///
/// # Errors
/// [`NumericError::NotConverged`] if the iteration does not converge.
pub fn generalised_eigenvalues(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
) -> Result<Vec<Complex<f64>>, NumericError> {
    let n = a.nrows();
    let eigen = faer::Mat::from_fn(n, n, |i, j| a[(i, j)])
        .generalized_eigen(faer::Mat::from_fn(n, n, |i, j| b[(i, j)]))
        .map_err(|_| NumericError::NotConverged)?;
    let ratios = (0..n).map(|i| eigen.S_a()[i] / eigen.S_b()[i]);
    Ok(ratios
        .filter(|z| z.re.is_finite() && z.im.is_finite())
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

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

    /// A chain of springs from 1 to 1e24: the soft one alone decides the lowest eigenvalue.
    #[test]
    fn a_soft_spring_on_stiff_ones_keeps_its_digits() {
        let springs = [1e24, 1e12, 1.0_f64];
        let b = DMatrix::from_fn(3, 3, |i, j| {
            springs[i].sqrt() * [[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]][i][j]
        });
        let (values, vectors) = factored_eigen(&b, None);
        // 1/k adds up along the chain: the ends' compliance is 1 + 1e-12 + 1e-24.
        assert!((values[0] - 1.0).abs() < 1e-11, "{values}");
        assert!((vectors.column(0)[2].abs() - 1.0).abs() < 1e-11);
        let one = vectors.transpose() * &vectors - DMatrix::identity(3, 3);
        assert!(one.amax() < 1e-14);

        // With a negative S the sum is what a plain iteration finds.
        let s = DMatrix::from_row_slice(3, 3, &[-3.0, 1.0, 0.5, 1.0, -2.0, 0.1, 0.5, 0.1, 1.0]);
        let b = DMatrix::from_row_slice(2, 3, &[1.0, 2.0, 0.3, -1.0, 0.5, 0.2]);
        let (values, vectors) = factored_eigen(&b, Some(&s));
        let sum = b.transpose() * &b + &s;
        let plain = sum.symmetric_eigenvalues();
        let mut plain: Vec<f64> = plain.iter().copied().collect();
        plain.sort_by(f64::total_cmp);
        for (i, plain) in plain.into_iter().enumerate() {
            assert!((values[i] - plain).abs() < 1e-13, "{values}");
            let v = vectors.column(i);
            assert!((&sum * v - values[i] * v).norm() < 1e-13);
        }
    }
}
