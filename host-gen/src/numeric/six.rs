//! Matrices with six rows or columns, one for each leg.

use nalgebra::{Complex, DMatrix, Matrix6};
use shared::LEGS;

/// Complex, six by six.
pub type ComplexMatrix6 = Matrix6<Complex<f64>>;

/// A 6×6 matrix as one of any size.
pub(crate) fn to_dynamic(matrix: &Matrix6<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(LEGS, LEGS, matrix.as_slice())
}

/// A matrix that is known to be 6×6 as one that always is.
pub(crate) fn to_six(matrix: &DMatrix<f64>) -> Matrix6<f64> {
    matrix.fixed_view::<6, 6>(0, 0).into_owned()
}

const _: () = assert!(LEGS == 6, "the 6×6 types here are the six legs");
