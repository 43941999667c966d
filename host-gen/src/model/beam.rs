//! Deformations, stiffness and mass of a beam between two points.

use nalgebra::{DMatrix, Matrix3, RowVector3};

use super::layout::{Follow, Point};
use crate::machine::Beam;

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

/// Whether the joints at p and at q release bending in each plane, the one of e3, e4 and the one of
/// e5, e6.
pub(crate) fn released_bending(beam: &Beam) -> [[bool; 2]; 2] {
    let [p, q] = beam.released;
    [[p[1], q[1]], [p[2], q[2]]]
}

/// Whether a joint releases the rotation about the beam's own axis.
fn turns_about_itself(beam: &Beam) -> bool {
    beam.released.iter().any(|[about_own, ..]| *about_own)
}

/// Stiffness of a beam for the deformations e1 to e6 between its nodes, 6×6, N/m.
///
/// EA/L for e1, GJ/L³ for e2, and EI/L³·[[4, −2], [−2, 4]] for each bending plane. Where a joint
/// releases a rotation, that of the beam's end follows without a moment: 3EI/L³ remains in the plane
/// if the other end is fixed.
pub(crate) fn deformation_stiffness(beam: &Beam) -> DMatrix<f64> {
    let per_area = 1.0 / (beam.length * beam.length);
    let mut s = DMatrix::zeros(6, 6);
    s[(0, 0)] = beam.stiffness.axial;
    if !turns_about_itself(beam) {
        s[(1, 1)] = beam.stiffness.torsion * per_area;
    }
    let planes = beam.stiffness.bending.iter().zip(released_bending(beam));
    for (plane, (bending, released)) in planes.enumerate() {
        let i = 2 + 2 * plane;
        match released {
            [false, false] => {
                s[(i, i)] = 4.0 * bending * per_area;
                s[(i + 1, i + 1)] = 4.0 * bending * per_area;
                s[(i, i + 1)] = -2.0 * bending * per_area;
                s[(i + 1, i)] = -2.0 * bending * per_area;
            }
            [true, false] => s[(i + 1, i + 1)] = 3.0 * bending * per_area,
            [false, true] => s[(i, i)] = 3.0 * bending * per_area,
            [true, true] => {}
        }
    }
    s
}

/// F, 6×6, √(N/m), with FᵀF the [`deformation_stiffness`] of a beam.
pub(crate) fn stiffness_factor(beam: &Beam) -> DMatrix<f64> {
    let mut f = DMatrix::zeros(6, 6);
    f[(0, 0)] = beam.stiffness.axial.sqrt();
    if !turns_about_itself(beam) {
        f[(1, 1)] = beam.stiffness.torsion.sqrt() / beam.length;
    }
    let planes = beam.stiffness.bending.iter().zip(released_bending(beam));
    for (plane, (bending, released)) in planes.enumerate() {
        let i = 2 + 2 * plane;
        let size = bending.sqrt() / beam.length;
        let one_end = 3f64.sqrt() * size;
        match released {
            [false, false] => {
                f[(i, i)] = 2.0 * size;
                f[(i, i + 1)] = -size;
                f[(i + 1, i + 1)] = one_end;
            }
            [true, false] => f[(i + 1, i + 1)] = one_end,
            [false, true] => f[(i, i)] = one_end,
            [true, true] => {}
        }
    }
    f
}

/// The joints of a beam, in its own axes.
pub(crate) struct Joints {
    /// The released rotations of its ends, by their places among the twelve motions.
    pub(crate) released: Vec<usize>,
    /// K_rr: stiffness of the beam against these alone, N m.
    pub(crate) own: DMatrix<f64>,
    /// T, 12×12: the motions of the beam's ends from those of its nodes. The released rotations
    /// follow the others without a moment.
    pub(crate) follow: DMatrix<f64>,
}

/// The joints of a beam of one element; `None` if both its ends are fixed.
///
/// A rotation against which the beam has no stiffness of its own is as good as fixed: nothing acts
/// on it.
pub(crate) fn joints(beam: &Beam) -> Option<Joints> {
    let fixed = Beam {
        axes: Matrix3::identity(),
        ..beam.part(1)
    };
    let deformed = beam_deformations(&fixed);
    let stiffness = deformed.transpose() * deformation_stiffness(&fixed) * deformed;
    let rotations = beam.released.iter().zip([3, 9]);
    let released = rotations.flat_map(|(axes, first)| {
        let axes = axes.iter().enumerate();
        axes.filter_map(move |(axis, released)| released.then_some(first + axis))
    });
    let released: Vec<usize> = released.filter(|&i| stiffness[(i, i)] > 0.0).collect();
    if released.is_empty() {
        return None;
    }
    let rows = stiffness.select_rows(&released);
    let own = rows.select_columns(&released);
    let mut pull = rows;
    for &i in &released {
        pull.column_mut(i).fill(0.0);
    }
    // At one end each, or bending at both, which is stiff by itself.
    let followed = own.clone().lu().solve(&pull)?;
    let mut follow = DMatrix::identity(12, 12);
    for (&i, row) in released.iter().zip(followed.row_iter()) {
        follow.set_row(i, &-row);
    }
    Some(Joints {
        released,
        own,
        follow,
    })
}

/// Consistent mass matrix of a beam of one element, 12×12, kg, kg m and kg m², for the motions of
/// its ends, each a translation, m, and a rotation, rad.
///
/// That of the shapes that the elastic beam takes between its ends: linear along and about its
/// axis, cubic across. The beam is a line with a moment of inertia about it: the rotation of its
/// sections about the other axes has none (Euler–Bernoulli). Behind a joint, the released rotation
/// of the beam's end follows the elastic shape.
pub(crate) fn beam_mass(beam: &Beam) -> DMatrix<f64> {
    let mut local = DMatrix::zeros(12, 12);
    for (axis, whole) in [(0, beam.mass), (3, beam.polar_inertia)] {
        let ends = [axis, 6 + axis];
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            local[(ends[i], ends[j])] = whole / if i == j { 3.0 } else { 6.0 };
        }
    }
    // For the deflections, and the slopes times the length.
    const CUBIC: [[f64; 4]; 4] = [
        [156.0, 22.0, 54.0, -13.0],
        [22.0, 4.0, 13.0, -3.0],
        [54.0, 13.0, 156.0, -22.0],
        [-13.0, -3.0, -22.0, 4.0],
    ];
    // The slope of y is a rotation about z, that of z one about −y.
    for (across, about, sign) in [(1, 5, 1.0), (2, 4, -1.0)] {
        let slope = sign * beam.length;
        let places = [
            (across, 1.0),
            (about, slope),
            (6 + across, 1.0),
            (6 + about, slope),
        ];
        for (row, (i, a)) in CUBIC.iter().zip(places) {
            for (entry, (j, b)) in row.iter().zip(places) {
                local[(i, j)] = beam.mass / 420.0 * a * b * entry;
            }
        }
    }
    if let Some(Joints { follow, .. }) = joints(beam) {
        local = follow.transpose() * local * follow;
    }
    let axes = own_axes(beam);
    axes.transpose() * local * axes
}

/// The motions of a beam's ends in its own axes, 12×12, from those in the axes of the file.
pub(crate) fn own_axes(beam: &Beam) -> DMatrix<f64> {
    DMatrix::from_fn(12, 12, |i, j| {
        if i / 3 == j / 3 {
            beam.axes[(i % 3, j % 3)]
        } else {
            0.0
        }
    })
}

/// The deformations e1 to e6, m, of a beam between the points `ends`, from N coordinates, 6×N.
pub(crate) fn deformations(beam: &Beam, ends: &[Point], size: usize) -> DMatrix<f64> {
    let of_ends = beam_deformations(beam);
    let mut rows = DMatrix::zeros(6, size);
    for (end, point) in ends.iter().enumerate() {
        if let Some(Follow { first, map }) = point.follow {
            let mut block = rows.columns_mut(first, 6);
            block += of_ends.columns(6 * end, 6) * map;
        }
    }
    rows
}

/// The motions of `points` from N coordinates, 6 rows for each point.
pub(crate) fn motions(points: &[Point], size: usize) -> DMatrix<f64> {
    let mut rows = DMatrix::zeros(6 * points.len(), size);
    for (i, point) in points.iter().enumerate() {
        if let Some(Follow { first, map }) = point.follow {
            rows.view_mut((6 * i, first), (6, 6)).copy_from(&map);
        }
    }
    rows
}
