//! Gravity and preload: static loads of beams and springs, and the resulting geometric stiffness.
//!
//! The nodes of the machine file are the equilibrium: the loads of beams and springs balance the weight
//! and what beams are built in with there. A load changes the stiffness in two ways. Forces and moments in a beam act through its
//! deformations to second order: an axial force N, tension positive, adds 6N/(5L) against lateral
//! motion if both ends are clamped, and bending moments couple twist and lateral bending. And a
//! body that rotates moves the points at which forces act on it. A flexible body does so with its
//! mean rotation, and its inner loads do not stiffen it.
//!
//! The inner points of a beam without mass are in equilibrium at any time. A loaded beam is divided
//! into parts and reduced to its two ends, which gives the stiffness near buckling, too. So is each
//! element of a beam with mass, whose weight acts on the element's ends.

use core::f64::consts::{PI, TAU};

use nalgebra::linalg::Cholesky;
use nalgebra::{DMatrix, DVector, Matrix3, RowDVector, Vector3};

use super::beam::{
    Joints, beam_deformations, beam_mass, deformation_stiffness, deformations, joints, motions,
    own_axes, released_bending,
};
use super::flexible::mean_rotation;
use super::layout::{Follow, Layout, Owner, Point};
use super::spring;
use crate::machine::{Beam, Carrier, Structure};

/// Static loads under gravity and preload, and their geometric stiffness.
#[derive(Clone, Debug, Default)]
pub struct Statics {
    /// Axial force of each beam, in the order of the machine's beams, N, tension positive: its mean
    /// over the length, if the beam has mass. Empty without gravity and preload.
    pub axial: Vec<f64>,
    /// For each beam, in the order of the machine's beams, whether it buckles between its ends
    /// under its axial force and its moments. Empty without gravity and preload.
    pub buckled: Vec<bool>,
    /// Geometric stiffness in the N coordinates, N×N, N/m, N and N m. Empty without gravity and
    /// preload.
    pub geometric: DMatrix<f64>,
}

/// Elements of a loaded beam. The load at which a cantilever tips over sideways is right to 0.1 %
/// then, and all else to 0.01 %.
const PARTS: usize = 20;

/// The compressive force at which a beam buckles between its nodes if these do not turn, N,
/// positive.
///
/// This is Euler's load for the weaker plane: 4π²·EI/L² with both ends fixed, π²·EI/L² where joints
/// release both, and 20.19·EI/L², the square of the first root of tan x = x, where one is released.
/// A plane without bending stiffness is that of a hinged strut, which stays straight; `None` if both
/// are.
pub fn buckling_load(beam: &Beam) -> Option<f64> {
    let planes = beam.stiffness.bending.iter().zip(released_bending(beam));
    let bends = planes.filter(|(plane, _)| **plane > 0.0);
    let loads = bends.map(|(plane, released)| {
        let root = match released {
            [false, false] => TAU,
            [true, false] | [false, true] => 4.493_409_457_909_064,
            [true, true] => PI,
        };
        root * root * plane / beam.length
    });
    loads.reduce(f64::min)
}

impl Statics {
    /// The loads of `machine` under its gravity and preload, from its static displacement `sag` in its
    /// coordinates.
    ///
    /// Each element of a beam is loaded by its own deformation. Its weight acts on its ends, as
    /// in [`Multibody`](super::multibody::Multibody).
    pub(crate) fn new(machine: &Structure, layout: &Layout, sag: &DVector<f64>) -> Self {
        let size = sag.len();
        let mut geometric = DMatrix::zeros(size, size);
        let mut axial = Vec::new();
        let mut buckled = Vec::new();
        let mut turned = vec![Matrix3::zeros(); machine.flexible.len()];
        // The force `push` on what moves the `point`, at a place that turns with it.
        let mut turn = |geometric: &mut DMatrix<f64>,
                        point: &Point,
                        at: &Vector3<f64>,
                        push: &Vector3<f64>| {
            let Some(Follow { first, .. }) = point.follow else {
                return;
            };
            let centre = match layout.owner(first) {
                Owner::Body(body) => machine.bodies[body].cog,
                Owner::Node(node) => match machine.nodes[node].carrier {
                    Carrier::Flexible(body) => {
                        turned[body] += turned_arm(push, &(at - machine.flexible[body].cog));
                        return;
                    }
                    Carrier::Base | Carrier::Body(_) | Carrier::Free => point.at,
                },
                Owner::Inner(..) => point.at,
            };
            let mut block = geometric.fixed_view_mut::<3, 3>(first + 3, first + 3);
            block += turned_arm(push, &(at - centre));
        };
        for (i, beam) in machine.beams.iter().enumerate() {
            let whole = deformations(beam, &layout.ends(machine, i), size) * sag;
            axial.push((deformation_stiffness(beam) * whole)[0] + beam.preload);
            let points = layout.along(machine, i);
            let mut holds = true;
            for (part, ends) in beam.elements().zip(points.windows(2)) {
                let deformation = deformations(&part, ends, size) * sag;
                let mut stress = deformation_stiffness(&part) * &deformation;
                stress[0] += part.preload;
                let motions = motions(ends, size);
                let (of_ends, part_holds) = beam_geometric(&part, &stress);
                geometric += motions.transpose() * of_ends * &motions;
                holds &= part_holds;
                // Forces of the element's ends on what they move with.
                let mut push = -(beam_deformations(&part).transpose() * stress);
                if part.mass > 0.0 {
                    let falls = DVector::from_fn(12, |i, _| match i % 6 {
                        axis @ 0..3 => machine.gravity[axis],
                        _ => 0.0,
                    });
                    push += beam_mass(&part) * falls;
                }
                for (end, point) in ends.iter().enumerate() {
                    let push: Vector3<f64> = push.fixed_rows::<3>(6 * end).into_owned();
                    turn(&mut geometric, point, &point.at, &push);
                }
            }
            buckled.push(!holds);
        }
        for spring in &machine.springs {
            let ends = spring.ends.map(|end| *layout.node(end));
            let relative = spring::relative(spring, &ends, size);
            let load = spring::load(spring, &relative, sag);
            geometric += spring::geometric(spring, &ends, &load, size);
            let push: Vector3<f64> = load.fixed_rows::<3>(0).into_owned();
            for (point, push) in ends.iter().zip([push, -push]) {
                turn(&mut geometric, point, &spring.at, &push);
            }
        }
        for point in &machine.point_masses {
            let weight = point.body.mass * machine.gravity;
            let node = layout.node(point.node);
            turn(&mut geometric, node, &node.at, &weight);
        }
        for (i, (body, turned)) in machine.flexible.iter().zip(turned).enumerate() {
            let rotation = mean_rotation(machine, body);
            let of_body = rotation.transpose() * turned * rotation;
            layout.add_of_flexible(machine, i, &of_body, &mut geometric);
        }
        Self {
            axial,
            buckled,
            geometric,
        }
    }
}

/// Geometric stiffness, N m, against rotation of a body with the force `push`, N, at `arm`, m,
/// from its centre of gravity.
///
/// A rotation φ moves the point r by ½(φ(φ·r) − r·φ²) to second order.
fn turned_arm(push: &Vector3<f64>, arm: &Vector3<f64>) -> Matrix3<f64> {
    let outer = push * arm.transpose();
    Matrix3::identity() * push.dot(arm) - 0.5 * (outer + outer.transpose())
}

/// Geometric stiffness, 12×12, of a beam with the `stress` of its six deformations, N, for its
/// twelve end motions; and whether its inner points are held in stable equilibrium.
///
/// A beam without stiffness against bending or twist is one element: a plane without bending
/// stiffness stays straight, as in a bar with hinged ends. Rotations that joints release are in
/// equilibrium, too.
fn beam_geometric(beam: &Beam, stress: &DVector<f64>) -> (DMatrix<f64>, bool) {
    let local = own_axes(beam);
    let [y, z] = beam.stiffness.bending;
    let (mut of_ends, mut holds) = if y > 0.0 && z > 0.0 && beam.stiffness.torsion > 0.0 {
        divided(beam, stress)
    } else {
        let stress = core::array::from_fn(|i| stress[i]);
        (element(beam.length, [y > 0.0, z > 0.0], stress), true)
    };
    if let Some(Joints {
        released,
        own,
        follow,
    }) = joints(beam)
    {
        // Counted from the elastic following, as in `divided`: nothing cancels.
        let pull = of_ends.select_rows(&released) * &follow;
        let within = own + of_ends.select_rows(&released).select_columns(&released);
        holds &= Cholesky::new(within.clone()).is_some();
        of_ends = follow.transpose() * of_ends * follow;
        if let Some(followed) = within.lu().solve(&pull) {
            of_ends -= pull.transpose() * followed;
        }
    }
    (local.transpose() * of_ends * local, holds)
}

/// [`beam_geometric`] in the beam's own axes, of a beam in [`PARTS`] elements.
///
/// The inner points are counted from the cubic shape that the elastic beam takes between its
/// ends. Then the elastic stiffness does not couple them to the ends, and nothing cancels.
fn divided(beam: &Beam, stress: &DVector<f64>) -> (DMatrix<f64>, bool) {
    let inner = 6 * (PARTS - 1);
    let part = Beam {
        axes: Matrix3::identity(),
        ..beam.part(PARTS)
    };
    let elastic = beam_deformations(&part);
    let elastic = elastic.transpose() * deformation_stiffness(&part) * elastic;
    let mut ends = DMatrix::zeros(12, 12);
    let mut coupling = DMatrix::zeros(inner, 12);
    let mut within = DMatrix::zeros(inner, inner);
    for k in 0..PARTS {
        // The bending moment is linear along the beam, all other loads are constant.
        let along = |p: f64, q: f64, k: usize| {
            let at = k as f64 / PARTS as f64;
            PARTS as f64 * (p * (1.0 - at) + q * at)
        };
        let stress = [
            stress[0],
            stress[1] * PARTS as f64,
            along(stress[2], stress[3], k),
            along(stress[2], stress[3], k + 1),
            along(stress[4], stress[5], k),
            along(stress[4], stress[5], k + 1),
        ];
        let geometric = element(part.length, [true; 2], stress);
        let mut follows = DMatrix::zeros(12, 12);
        for end in 0..2 {
            let at = (k + end) as f64 / PARTS as f64;
            let rows = follow(at, beam.length);
            follows.rows_mut(6 * end, 6).copy_from(&rows);
        }
        let from_ends = &geometric * &follows;
        ends += follows.transpose() * &from_ends;
        // Of the element's two points, those that are inner ones.
        let own = if k == 0 { 6..12 } else { 0..12 };
        let own = own.start..if k + 1 == PARTS { 6 } else { own.end };
        let first = 6 * k + own.start - 6;
        let mut rows = coupling.rows_mut(first, own.len());
        rows += from_ends.rows_range(own.clone());
        let mut block = within.view_mut((first, first), (own.len(), own.len()));
        block += (&elastic + geometric).view((own.start, own.start), (own.len(), own.len()));
    }
    let holds = Cholesky::new(within.clone()).is_some();
    // Exactly at the critical load the inner points have no equilibrium; then without them.
    if let Some(followed) = within.lu().solve(&coupling) {
        ends -= coupling.transpose() * followed;
    }
    (ends, holds)
}

/// Translation and rotation at the part `at` of an elastic beam's length, 6×12, from the twelve
/// motions of its ends, in the beam's own axes: linear along and about x, cubic across.
fn follow(at: f64, length: f64) -> DMatrix<f64> {
    let mut rows = DMatrix::zeros(6, 12);
    let t = at;
    for linear in [0, 3] {
        rows[(linear, linear)] = 1.0 - t;
        rows[(linear, 6 + linear)] = t;
    }
    // Deflection, then slope by the length, from deflection and slope of p, then of q.
    let deflection = [
        1.0 - 3.0 * t * t + 2.0 * t * t * t,
        t * (1.0 - t) * (1.0 - t),
        t * t * (3.0 - 2.0 * t),
        t * t * (t - 1.0),
    ];
    let slope = [
        6.0 * t * (t - 1.0),
        (1.0 - t) * (1.0 - 3.0 * t),
        6.0 * t * (1.0 - t),
        t * (3.0 * t - 2.0),
    ];
    // The slope of y is a rotation about z, that of z one about −y.
    for (across, about, sign) in [(1, 5, 1.0), (2, 4, -1.0)] {
        for (end, column) in [0, 6].into_iter().enumerate() {
            rows[(across, column + across)] = deflection[2 * end];
            rows[(across, column + about)] = sign * length * deflection[2 * end + 1];
            rows[(about, column + across)] = sign * slope[2 * end] / length;
            rows[(about, column + about)] = slope[2 * end + 1];
        }
    }
    rows
}

/// Geometric stiffness of one element, 12×12, for the twelve motions of its ends in its own axes:
/// Σ σ_i·∂²e_i/∂x², with the deformations e_i to second order.
///
/// These are SPACAR's definitions for large rotations (Jonker and Meijaard, reference 4 of the
/// paper): e1 is the length of the chord less that of the beam, e2 = L/2·(z_p·y_q − y_p·z_q) and
/// e3 = −L·c·z_p, e4 = L·c·z_q, e5 = L·c·y_p, e6 = −L·c·y_q, with the axes y and z of the ends,
/// which turn with them, and c along the chord; each with the terms by which a curved element is
/// shorter than its arc and twists. `bends` tells which plane has bending stiffness, the one of
/// e3, e4 and the one of e5, e6.
fn element(length: f64, bends: [bool; 2], stress: [f64; 6]) -> DMatrix<f64> {
    type Form = RowDVector<f64>;
    let motion = |i: usize| Form::from_fn(12, |_, j| f64::from(u8::from(i == j)));
    let l = length;
    let [dx, dy, dz] = [0, 1, 2].map(|axis| motion(6 + axis) - motion(axis));
    let [xp, yp, zp] = [3, 4, 5].map(motion);
    let [xq, yq, zq] = [9, 10, 11].map(motion);
    let e2 = l * (&xq - &xp);
    let [e3, e4] = [-&dz - l * &yp, &dz + l * &yq];
    let [e5, e6] = [&dy - l * &zp, -&dy + l * &zq];
    let mut total = DMatrix::zeros(12, 12);
    let mut add = |factor: f64, a: &Form, b: &Form| {
        total += factor * (a.transpose() * b + b.transpose() * a);
    };
    let [s1, s2, s3, s4, s5, s6] = stress;
    for (bends, across, [p, q]) in [(bends[0], &dz, [&e3, &e4]), (bends[1], &dy, [&e5, &e6])] {
        add(s1 / (2.0 * l), across, across);
        if bends {
            add(s1 / (15.0 * l), p, p);
            add(s1 / (30.0 * l), p, q);
            add(s1 / (15.0 * l), q, q);
        }
    }
    add(0.5 * l * s2, &zp, &yq);
    add(-0.5 * l * s2, &yp, &zq);
    add(-s2 / l, &e3, &e6);
    add(s2 / l, &e4, &e5);
    add(-0.5 * l * s3, &xp, &zp);
    add(0.5 * l * s4, &xq, &zq);
    add(s3, &dy, &xp);
    add(-s4, &dy, &xq);
    add((s3 - s4) / l, &dx, &dz);
    add(0.5 * l * s5, &xp, &yp);
    add(-0.5 * l * s6, &xq, &yq);
    add(s5, &dz, &xp);
    add(-s6, &dz, &xq);
    add((s6 - s5) / l, &dx, &dy);
    add((s3 - s4) / (6.0 * l), &e2, &(&e5 + &e6));
    add((s6 - s5) / (6.0 * l), &e2, &(&e3 + &e4));
    total
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Stiffness;

    /// Turning the whole element does no work: the second-order deformations of a rotation ω about
    /// the origin are zero, with the ends at x = 0 and x = L.
    #[test]
    fn a_rotation_of_the_whole_deforms_nothing() {
        let length = 0.7;
        let turn = Vector3::new(0.3, -0.4, 0.5);
        let beam = Beam {
            name: String::new(),
            ends: [0, 1],
            stiffness: Stiffness {
                axial: 1.0,
                bending: [1.0; 2],
                torsion: 1.0,
            },
            mass: 0.0,
            polar_inertia: 0.0,
            segments: 1,
            released: [[false; 3]; 2],
            loss_factor: 0.0,
            damper: 0.0,
            preload: 0.0,
            axes: Matrix3::identity(),
            length,
        };
        let at_q = Vector3::new(length, 0.0, 0.0);
        let mut first = DVector::zeros(12);
        first.rows_mut(3, 3).copy_from(&turn);
        first.rows_mut(6, 3).copy_from(&turn.cross(&at_q));
        first.rows_mut(9, 3).copy_from(&turn);
        let mut second = DVector::zeros(12);
        second
            .rows_mut(6, 3)
            .copy_from(&(0.5 * turn.cross(&turn.cross(&at_q))));
        let linear = beam_deformations(&beam) * second;
        for i in 0..6 {
            let stress = core::array::from_fn(|k| f64::from(u8::from(i == k)));
            let hessian = element(length, [true; 2], stress);
            let whole = 0.5 * (first.transpose() * hessian * &first)[0] + linear[i];
            assert!(whole.abs() < 1e-14, "e{}: {whole:e}", i + 1);
        }
    }

    /// Turning two free nodes and the loaded spring between them does no work: to second order, the
    /// motion of its ends and what its geometric stiffness adds cancel.
    #[test]
    fn a_rotation_of_the_whole_does_not_strain_a_spring() {
        let turn = Vector3::new(0.3, -0.4, 0.5);
        let places = [Vector3::new(0.2, 0.7, -0.1), Vector3::new(-0.4, 0.3, 0.6)];
        let ends = [0, 1].map(|i| Point {
            at: places[i],
            follow: Some(Follow {
                first: 6 * i,
                map: nalgebra::Matrix6::identity(),
            }),
        });
        let axes = nalgebra::Rotation3::from_euler_angles(0.3, 0.8, -0.5);
        let spring = crate::machine::Spring {
            name: String::new(),
            ends: [0, 1],
            at: places[0].lerp(&places[1], 0.5),
            axes: axes.matrix().transpose(),
            stiffness: nalgebra::Vector6::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
            damper: nalgebra::Vector6::zeros(),
            loss_factor: 0.0,
        };
        let mut first = DVector::zeros(12);
        let mut second = DVector::zeros(12);
        for (i, at) in places.iter().enumerate() {
            let moved = turn.cross(at);
            first.rows_mut(6 * i, 3).copy_from(&moved);
            first.rows_mut(6 * i + 3, 3).copy_from(&turn);
            second
                .rows_mut(6 * i, 3)
                .copy_from(&(0.5 * turn.cross(&moved)));
        }
        let relative = spring::relative(&spring, &ends, 12);
        for i in 0..12 {
            let sag = DVector::from_fn(12, |j, _| f64::from(u8::from(i == j)));
            let load = spring::load(&spring, &relative, &sag);
            let mut geometric = spring::geometric(&spring, &ends, &load, 12);
            let push: Vector3<f64> = load.fixed_rows::<3>(0).into_owned();
            for (end, push) in [push, -push].iter().enumerate() {
                let mut block = geometric.view_mut((6 * end + 3, 6 * end + 3), (3, 3));
                block += turned_arm(push, &(spring.at - places[end]));
            }
            let force = relative.transpose() * (&relative * &sag).component_mul(&spring.stiffness);
            let whole = 0.5 * (first.transpose() * geometric * &first)[0] + force.dot(&second);
            assert!(whole.abs() < 1e-14, "{i}: {whole:e}");
        }
    }
}
