//! Linear independence of rows that measure motions of the machine.

use nalgebra::{DMatrix, DVector, Vector3};

use crate::machine::Structure;
use crate::numeric::rows::first_dependent_row;

/// The smallest part of a row, relative to its length, that must be orthogonal to the rows
/// before it for the row to count as independent.
///
/// Singular arrangements whose coordinates are rounded to six digits stay below it.
pub const INDEPENDENT: f64 = 1e-5;

/// C, m: the mean position of the nodes, the reference point of rigid motions. Far from the machine
/// itself a rotation would look like a translation.
pub(crate) fn centre(machine: &Structure) -> Vector3<f64> {
    let sum: Vector3<f64> = machine.nodes.iter().map(|node| node.at).sum();
    sum / machine.nodes.len() as f64
}

/// A length, m, that makes rotations comparable with translations: the rms distance of the nodes
/// from [`centre`], or 1 m if all nodes coincide.
pub(crate) fn reach(machine: &Structure) -> f64 {
    let middle = centre(machine);
    let squares = machine.nodes.iter();
    let squares = squares.map(|node| (node.at - middle).norm_squared());
    let square = squares.sum::<f64>() / machine.nodes.len() as f64;
    if square > 0.0 { square.sqrt() } else { 1.0 }
}

/// The index of the first row that depends linearly on the rows before it; `None` if all are
/// independent.
///
/// The columns are three translations and three rotations in turn. `length`, m, scales the
/// rotations, as [`reach`] gives it.
pub(crate) fn dependent(rows: &DMatrix<f64>, length: f64) -> Option<usize> {
    first_dependent_row(&scaled(rows, length), INDEPENDENT)
}

/// The rows before `row` from which it follows, as [`dependent`] found it: their indices.
pub(crate) fn follows_from(rows: &DMatrix<f64>, length: f64, row: usize) -> Vec<usize> {
    let scaled = scaled(rows, length);
    let before = scaled.rows(0, row).transpose();
    let solved = before.svd(true, true);
    let parts = solved.solve(&scaled.row(row).transpose(), INDEPENDENT);
    let parts = parts.unwrap_or_else(|_| DVector::from_element(row, 1.0));
    let largest = parts.amax();
    (0..row)
        .filter(|&i| parts[i].abs() > 1e-3 * largest)
        .collect()
}

/// With rotations times `length`, m.
fn scaled(rows: &DMatrix<f64>, length: f64) -> DMatrix<f64> {
    let mut scaled = rows.clone();
    for (j, mut column) in scaled.column_iter_mut().enumerate() {
        if j % 6 >= 3 {
            column /= length;
        }
    }
    scaled
}
