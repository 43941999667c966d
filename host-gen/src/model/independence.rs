//! Whether rows describe independent motions.

use nalgebra::{DMatrix, Vector3};

use crate::machine::Machine;
use crate::numeric::rows::first_dependent_row;

/// How far, relative to its length, a row must stand out of the rows before it
/// to count as independent. Coordinates typed with six digits stay below it
/// where the arrangement is singular.
pub const INDEPENDENT: f64 = 1e-5;

/// A length that makes rotations comparable with translations: the rms
/// distance of the nodes from their middle, m.
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

/// The first dependent row of a matrix whose columns are translations and
/// rotations, three and three.
pub(crate) fn dependent(rows: &DMatrix<f64>, length: f64) -> Option<usize> {
    let mut scaled = rows.clone();
    for (j, mut column) in scaled.column_iter_mut().enumerate() {
        if j % 6 >= 3 {
            column /= length;
        }
    }
    first_dependent_row(&scaled, INDEPENDENT)
}
