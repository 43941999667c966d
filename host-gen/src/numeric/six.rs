//! 6×6 matrices, with one row and one column for each leg.

use nalgebra::{Complex, DMatrix, Matrix6};
use shared::LEGS;

/// A complex 6×6 matrix.
pub type ComplexMatrix6 = Matrix6<Complex<f64>>;

/// Copies a 6×6 matrix into a matrix of dynamic size.
pub(crate) fn to_dynamic(matrix: &Matrix6<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(LEGS, LEGS, matrix.as_slice())
}

/// Copies the first six rows and columns of a matrix into a matrix of fixed size.
///
/// Panics if the matrix is smaller.
pub(crate) fn to_six(matrix: &DMatrix<f64>) -> Matrix6<f64> {
    matrix.fixed_view::<6, 6>(0, 0).into_owned()
}

const _: () = assert!(LEGS == 6, "the 6×6 types here are the six legs");
