//! Flexible bodies in the model.

use nalgebra::{DMatrix, Matrix3xX, Matrix6, Matrix6xX, MatrixXx6};

use crate::machine::{FlexibleBody, Structure};
use crate::numeric::motion::rigid_motions;
use crate::numeric::unit_diagonal::{scaled, to_ones};

/// The elastic motions of a flexible body, all but the six rigid ones, one for each row.
pub(super) struct Elastic {
    /// B, with BᵀB the stiffness, √(N/m); a column for each row of the body's matrices.
    pub(super) factor: DMatrix<f64>,
    /// X, with B·X = 1: motions that strain the body.
    motions: DMatrix<f64>,
}

impl Elastic {
    pub(super) fn new(body: &FlexibleBody) -> Self {
        let n = body.stiffness.nrows();
        // Scaled, so that rounding is relative to each coordinate's own stiffness.
        let scale = to_ones(&body.stiffness);
        let eigen = scaled(&body.stiffness, &scale).symmetric_eigen();
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        order.truncate(n - 6);
        let mut motions = eigen.eigenvectors.select_columns(&order);
        let mut factor = motions.transpose();
        for (i, &k) in order.iter().enumerate() {
            let size = eigen.eigenvalues[k].max(0.0).sqrt();
            factor.row_mut(i).scale_mut(size);
            motions.column_mut(i).unscale_mut(size);
        }
        for (i, scale) in scale.iter().enumerate() {
            factor.column_mut(i).unscale_mut(*scale);
            motions.row_mut(i).scale_mut(*scale);
        }
        Self { factor, motions }
    }

    /// Damping matrix of a body whose free elastic modes φ all have its damping ratio ζ, in the
    /// coordinates of its matrices: Kφ = ω²Mφ, and φᵀDφ = 2ζω for φᵀMφ = 1. A rigid motion is not
    /// damped.
    ///
    /// Modes are found by their 1/ω², of which one of a coordinate without mass has none: with the
    /// motions X without their rigid part, XᵀMX = V·ω⁻²·Vᵀ and D = Bᵀ·V·2ζω⁻¹·Vᵀ·B.
    pub(super) fn modal_damping(&self, machine: &Structure, body: &FlexibleBody) -> DMatrix<f64> {
        let (rigid, mean) = mean_motion(machine, body);
        let elastic = &self.motions - rigid * (mean * &self.motions);
        let eigen = (elastic.transpose() * &body.mass * elastic).symmetric_eigen();
        let mut damping = eigen.eigenvectors.transpose() * &self.factor;
        for (mut row, square) in damping.row_iter_mut().zip(&eigen.eigenvalues) {
            row *= (2.0 * body.modal_damping * square.max(0.0).sqrt()).sqrt();
        }
        damping.transpose() * damping
    }
}

/// The rigid motions R of a flexible body about its centre of gravity, as columns, and the rigid
/// motion with the same momentum, 6 rows, from the motion in the coordinates of its matrices.
fn mean_motion(machine: &Structure, body: &FlexibleBody) -> (MatrixXx6<f64>, Matrix6xX<f64>) {
    let at = body.nodes.iter().map(|&node| machine.nodes[node].at);
    let at: Vec<_> = at.collect();
    let rigid = rigid_motions(&at, &body.cog, body.mass.nrows());
    let momentum = rigid.transpose() * &body.mass;
    let whole: Matrix6<f64> = &momentum * &rigid;
    // A body without inertia about an axis has no mean rotation about it.
    let inverse = whole
        .pseudo_inverse(1e-12 * whole.amax())
        .unwrap_or_else(|_| Matrix6::zeros());
    (rigid, inverse * momentum)
}

/// The mean rotation of a flexible body about its centre of gravity, rad, 3 rows, from the motion in
/// the coordinates of its matrices: that of the rigid motion with the same momentum.
pub(super) fn mean_rotation(machine: &Structure, body: &FlexibleBody) -> Matrix3xX<f64> {
    let (_, mean) = mean_motion(machine, body);
    mean.fixed_rows::<3>(3).into_owned()
}
