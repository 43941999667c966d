//! Springs of no length between two points.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Matrix6xX, Vector3, Vector6};

use super::layout::{Follow, Point};
use crate::machine::Spring;
use crate::numeric::motion::transport;

/// The motion of a spring's end at Q relative to that at P, where it acts, in its own axes, 6×N:
/// translations, m, and rotations, rad, from N coordinates.
pub(super) fn relative(spring: &Spring, ends: &[Point; 2], size: usize) -> Matrix6xX<f64> {
    let mut turned = Matrix6::zeros();
    for half in [0, 3] {
        turned
            .fixed_view_mut::<3, 3>(half, half)
            .copy_from(&spring.axes);
    }
    let mut rows = Matrix6xX::zeros(size);
    for (point, sign) in ends.iter().zip([-1.0, 1.0]) {
        if let Some(Follow { first, map }) = point.follow {
            let mut block = rows.fixed_columns_mut::<6>(first);
            block += sign * turned * transport(&spring.at, &point.at) * map;
        }
    }
    rows
}

/// The six rows of the `relative` motion times the root of each stiffness with the `sign`; zero
/// for the others.
pub(super) fn factor(spring: &Spring, sign: f64, relative: &Matrix6xX<f64>) -> Matrix6xX<f64> {
    let roots = spring.stiffness.map(|k| (sign * k).max(0.0).sqrt());
    Matrix6::from_diagonal(&roots) * relative
}

/// The force, N, and the moment, N m, that a spring takes up in the motion `x`, in the axes of the
/// file: those on P; those on Q are opposite.
pub(super) fn load(spring: &Spring, relative: &Matrix6xX<f64>, x: &DVector<f64>) -> Vector6<f64> {
    let load: Vector6<f64> = (relative * x).component_mul(&spring.stiffness);
    let back = spring.axes.transpose();
    let mut turned = Vector6::zeros();
    for half in [0, 3] {
        turned
            .fixed_rows_mut::<3>(half)
            .copy_from(&(back * load.fixed_rows::<3>(half)));
    }
    turned
}

/// Geometric stiffness, N×N, of a spring with the `load` on P, without that of the arms on which
/// its ends are.
///
/// Its axes turn with the mean rotation of its two nodes: to second order, the force f works with
/// −f·(φ × δ), where δ is the relative translation and φ that rotation. The relative rotation is
/// that which turns P's axes into Q's, so that the moment m works with −½·m·(φ_P × φ_Q).
pub(super) fn geometric(
    spring: &Spring,
    ends: &[Point; 2],
    load: &Vector6<f64>,
    size: usize,
) -> DMatrix<f64> {
    let part = |point: &Point, from: usize| {
        let mut rows = DMatrix::zeros(3, size);
        if let Some(Follow { first, map }) = point.follow {
            let moved = transport(&spring.at, &point.at) * map;
            rows.columns_mut(first, 6)
                .copy_from(&moved.fixed_rows::<3>(from));
        }
        rows
    };
    let [p, q] = ends;
    let (turn_p, turn_q) = (part(p, 3), part(q, 3));
    let moved = part(q, 0) - part(p, 0);
    let cross = |from: usize| -> Matrix3<f64> {
        let part: Vector3<f64> = load.fixed_rows::<3>(from).into_owned();
        part.cross_matrix()
    };
    let mean = 0.5 * (&turn_p + &turn_q);
    let half = moved.transpose() * cross(0) * mean + 0.5 * turn_q.transpose() * cross(3) * turn_p;
    -(&half + half.transpose())
}
