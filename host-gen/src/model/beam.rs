//! Deformations and stiffness of a massless beam between two nodes.

use nalgebra::{DMatrix, Matrix3, Matrix6, RowVector3, Vector3};

use crate::machine::{Beam, Carrier, Machine};

/// −[v]×, 3×3: a rotation φ moves a point at v by φ × v = −[v]×·φ.
fn lever(v: &Vector3<f64>) -> Matrix3<f64> {
    -v.cross_matrix()
}

/// The motion of a point of a rigid body from the motion of its reference point, 6×6.
///
/// A motion is a translation, m, and a rotation, rad. `at` and `reference` are the positions of
/// the two points, m.
pub(crate) fn transport(at: &Vector3<f64>, reference: &Vector3<f64>) -> Matrix6<f64> {
    let mut matrix = Matrix6::identity();
    matrix
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&lever(&(at - reference)));
    matrix
}

/// SPACAR's six deformations, m, to first order from the motions of the ends p and q, 6×12.
///
/// The motion of an end is its translation, m, and its rotation, rad. e1 is the elongation,
/// positive if the beam gets longer; e2 = L·twist. In the local x–z plane, e3 = −L·(rotation −
/// chord rotation) at p, and e4 is the same at q with the opposite sign. e5 and e6 are likewise
/// in the x–y plane.
pub(crate) fn beam_deformations(beam: &Beam) -> DMatrix<f64> {
    let [x, y, z] = [0, 1, 2].map(|i| beam.axes.row(i).into_owned());
    let length = beam.length;
    let mut rows = DMatrix::zeros(6, 12);
    let mut put = |row: usize, column: usize, values: RowVector3<f64>| {
        rows.fixed_view_mut::<1, 3>(row, column).copy_from(&values);
    };
    let (up, fp, uq, fq) = (0, 3, 6, 9);
    put(0, up, -x);
    put(0, uq, x);
    put(1, fp, -length * x);
    put(1, fq, length * x);
    put(2, up, z);
    put(2, uq, -z);
    put(2, fp, -length * y);
    put(3, up, -z);
    put(3, uq, z);
    put(3, fq, length * y);
    put(4, up, -y);
    put(4, uq, y);
    put(4, fp, -length * z);
    put(5, up, y);
    put(5, uq, -y);
    put(5, fq, length * z);
    rows
}

/// Stiffness of a beam for the deformations e1 to e6, 6×6, N/m.
///
/// EA/L for e1, GJ/L³ for e2, and EI/L³·[[4, −2], [−2, 4]] for each bending plane.
pub(crate) fn deformation_stiffness(beam: &Beam) -> DMatrix<f64> {
    let per_area = 1.0 / (beam.length * beam.length);
    let mut s = DMatrix::zeros(6, 6);
    s[(0, 0)] = beam.stiffness.axial;
    s[(1, 1)] = beam.stiffness.torsion * per_area;
    for (plane, bending) in beam.stiffness.bending.iter().enumerate() {
        let i = 2 + 2 * plane;
        s[(i, i)] = 4.0 * bending * per_area;
        s[(i + 1, i + 1)] = 4.0 * bending * per_area;
        s[(i, i + 1)] = -2.0 * bending * per_area;
        s[(i + 1, i)] = -2.0 * bending * per_area;
    }
    s
}

/// F, 6×6, √(N/m), with FᵀF the [`deformation_stiffness`] of a beam.
pub(crate) fn stiffness_factor(beam: &Beam) -> DMatrix<f64> {
    let mut f = DMatrix::zeros(6, 6);
    f[(0, 0)] = beam.stiffness.axial.sqrt();
    f[(1, 1)] = beam.stiffness.torsion.sqrt() / beam.length;
    for (plane, bending) in beam.stiffness.bending.iter().enumerate() {
        let i = 2 + 2 * plane;
        let size = bending.sqrt() / beam.length;
        f[(i, i)] = 2.0 * size;
        f[(i, i + 1)] = -size;
        f[(i + 1, i + 1)] = 3f64.sqrt() * size;
    }
    f
}

/// The deformations e1 to e6 of a beam, m, from body coordinates, 6×6n for n bodies.
///
/// Ends on the base do not move.
pub(crate) fn deformations_from_bodies(machine: &Machine, beam: &Beam) -> DMatrix<f64> {
    let ends = beam_deformations(beam);
    let mut rows = DMatrix::zeros(6, 6 * machine.bodies.len());
    for (end, &node) in beam.ends.iter().enumerate() {
        let node = &machine.nodes[node];
        if let Carrier::Body(body) = node.carrier {
            let mut block = rows.columns_mut(6 * body, 6);
            block += ends.columns(6 * end, 6) * transport(&node.at, &machine.bodies[body].cog);
        }
    }
    rows
}

/// The motions of both ends of a beam from body coordinates, 12×`size`.
///
/// The motion of an end is its translation, m, and its rotation, rad. Ends on the base do not
/// move.
pub(crate) fn end_motions(machine: &Machine, beam: &Beam, size: usize) -> DMatrix<f64> {
    let mut rows = DMatrix::zeros(12, size);
    for (end, &node) in beam.ends.iter().enumerate() {
        let node = &machine.nodes[node];
        if let Carrier::Body(body) = node.carrier {
            rows.view_mut((6 * end, 6 * body), (6, 6))
                .copy_from(&transport(&node.at, &machine.bodies[body].cog));
        }
    }
    rows
}
