//! Eigenvalues of symmetric pairs, of general matrices and of matrix pencils.

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
    faer::Mat::from_fn(scaled.nrows(), scaled.ncols(), |i, j| scaled[(i, j)])
        .eigenvalues()
        .map_err(|_| NumericError::NotConverged)
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
}
