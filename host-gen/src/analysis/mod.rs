//! What a machine and its controller do: modes, gains, zeros, poles, singular
//! values, vibration on floors, robustness, rounding, machines side by side.

use nalgebra::{Dim, Matrix, RawStorage};

use crate::machine::Machine;

pub mod compare;
pub mod controller;
pub mod criterion;
pub mod delay;
pub mod floors;
pub mod gains;
pub mod isolation;
pub mod modes;
pub mod other_boards;
pub mod plant_matrices;
pub mod poles;
pub mod robustness;
pub mod rounding;
pub mod sigma;
pub mod vibration;
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

/// The digest of a machine's description, hexadecimal.
pub(crate) fn digest(machine: &Machine) -> String {
    use std::fmt::Write as _;
    let mut text = String::new();
    for byte in machine.digest.0 {
        // Writing to a String cannot fail.
        write!(text, "{byte:02x}").unwrap_or_default();
    }
    text
}
