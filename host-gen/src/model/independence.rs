//! Linear independence of rows that measure motions of the machine.

use nalgebra::{DMatrix, Vector3};

use crate::machine::Machine;
use crate::numeric::rows::first_dependent_row;

/// The smallest part of a row, relative to its length, that must be orthogonal to the rows
/// before it for the row to count as independent.
///
/// Singular arrangements whose coordinates are rounded to six digits stay below it.
pub const INDEPENDENT: f64 = 1e-5;

/// A length, m, that makes rotations comparable with translations: the rms distance of the nodes
/// from their mean position, or 1 m if all nodes coincide.
pub(crate) fn reach(machine: &Machine) -> f64 {
    let count = machine.nodes.len() as f64;
    let middle = machine.nodes.iter().map(|n| n.at).sum::<Vector3<f64>>() / count;
    let square = machine
        .nodes
        .iter()
        .map(|n| (n.at - middle).norm_squared())
        .sum::<f64>()
        / count;
    if square > 0.0 { square.sqrt() } else { 1.0 }
}

/// The index of the first row that depends linearly on the rows before it; `None` if all are
/// independent.
///
/// The columns are three translations and three rotations in turn. `length`, m, scales the
/// rotations, as [`reach`] gives it.
pub(crate) fn dependent(rows: &DMatrix<f64>, length: f64) -> Option<usize> {
    let mut scaled = rows.clone();
    for (j, mut column) in scaled.column_iter_mut().enumerate() {
        if j % 6 >= 3 {
            column /= length;
        }
    }
    first_dependent_row(&scaled, INDEPENDENT)
}
