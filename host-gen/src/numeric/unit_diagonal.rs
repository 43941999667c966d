//! Symmetric matrices scaled to a diagonal of ones, in which coordinates of different units compare.

use nalgebra::{DMatrix, DVector};

/// Factors that make the diagonal of a matrix ones; one where it is not above zero.
pub(crate) fn to_ones(matrix: &DMatrix<f64>) -> DVector<f64> {
    matrix
        .diagonal()
        .map(|x| if x > 0.0 { x.sqrt().recip() } else { 1.0 })
}

/// The matrix with row and column i multiplied by factor i.
pub(crate) fn scaled(matrix: &DMatrix<f64>, factors: &DVector<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| {
        factors[i] * matrix[(i, j)] * factors[j]
    })
}
