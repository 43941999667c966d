//! What a machine and its controller do: modes, gains, zeros, poles, singular
//! values, motion on floors and under loads, robustness, rounding, machines side by side.

use nalgebra::{Dim, Matrix, RawStorage};

pub(crate) mod actuators;
pub mod bound;
pub mod compare;
pub mod compliance;
pub mod controller;
pub mod delay;
pub mod floors;
pub mod gains;
pub mod isolation;
pub mod mat_file;
pub mod modes;
pub mod other_boards;
pub mod plant_matrices;
pub mod poles;
pub mod robustness;
pub mod rounding;
pub mod sigma;
mod signals;
pub mod warnings;
pub mod zeros;

/// A matrix by rows.
pub(crate) type Rows = Vec<Vec<f64>>;

pub(crate) fn rows<R: Dim, C: Dim, S: RawStorage<f64, R, C>>(
    matrix: &Matrix<f64, R, C, S>,
) -> Rows {
    matrix
        .row_iter()
        .map(|row| row.iter().copied().collect())
        .collect()
}
