//! Motions of rigid bodies: a translation, m, and a rotation, rad.

use nalgebra::{Matrix6, MatrixXx6, Vector3};

/// The motion of a point of a rigid body from the motion of its reference point, 6×6.
///
/// `at` and `reference` are the positions of the two points, m. A rotation φ moves a point at v by
/// φ × v = −[v]×·φ.
pub(crate) fn transport(at: &Vector3<f64>, reference: &Vector3<f64>) -> Matrix6<f64> {
    let mut matrix = Matrix6::identity();
    matrix
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&-(at - reference).cross_matrix());
    matrix
}

/// The six motions of a rigid body, as columns of `size` rows: translations along x, y and z, 1 m,
/// and rotations, 1 rad, about `reference`, m.
///
/// The rows are the motions of the points `at`, m, six each; what comes after them rests.
pub(crate) fn rigid_motions(
    at: &[Vector3<f64>],
    reference: &Vector3<f64>,
    size: usize,
) -> MatrixXx6<f64> {
    let mut rigid = MatrixXx6::zeros(size);
    for (i, at) in at.iter().enumerate() {
        rigid
            .fixed_view_mut::<6, 6>(6 * i, 0)
            .copy_from(&transport(at, reference));
    }
    rigid
}
