//! Flexible bodies in the model.

use nalgebra::{DMatrix, Matrix3xX, Matrix6};

use crate::machine::{FlexibleBody, Machine};
use crate::numeric::motion::rigid_motions;
use crate::numeric::unit_diagonal::{scaled, to_ones};

/// B of a flexible body, with BᵀB its stiffness, √(N/m): one row for each elastic motion, all but
/// the six rigid ones; a column for each row of its matrices.
pub(super) fn flexible_factor(body: &FlexibleBody) -> DMatrix<f64> {
    let n = body.stiffness.nrows();
    // Scaled, so that rounding is relative to each coordinate's own stiffness.
    let scale = to_ones(&body.stiffness);
    let eigen = scaled(&body.stiffness, &scale).symmetric_eigen();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    order.truncate(n - 6);
    let mut factor = eigen.eigenvectors.select_columns(&order).transpose();
    for (mut row, &i) in factor.row_iter_mut().zip(&order) {
        row *= eigen.eigenvalues[i].max(0.0).sqrt();
    }
    for (mut column, scale) in factor.column_iter_mut().zip(&scale) {
        column /= *scale;
    }
    factor
}

/// The mean rotation of a flexible body about its centre of gravity, rad, 3 rows, from the motion in
/// the coordinates of its matrices: that of the rigid motion with the same momentum.
pub(super) fn mean_rotation(machine: &Machine, body: &FlexibleBody) -> Matrix3xX<f64> {
    let at = body.nodes.iter().map(|&node| machine.nodes[node].at);
    let at: Vec<_> = at.collect();
    let rigid = rigid_motions(&at, &body.cog, body.mass.nrows());
    let momentum = rigid.transpose() * &body.mass;
    let whole: Matrix6<f64> = &momentum * rigid;
    // A body without inertia about an axis has no mean rotation about it.
    let inverse = whole
        .pseudo_inverse(1e-12 * whole.amax())
        .unwrap_or_else(|_| Matrix6::zeros());
    (inverse * momentum).fixed_rows::<3>(3).into_owned()
}
