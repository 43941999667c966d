//! Gravity: static loads of the beams and the resulting geometric stiffness.
//!
//! The nodes of the machine file are the equilibrium under gravity: the loads balance the weight
//! there. A load changes the stiffness in two ways. An axial force N, tension positive, adds
//! geometric stiffness against lateral motion of a beam: 6N/(5L) if both ends are clamped. And
//! a body that rotates moves the points at which forces act on it.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::beam::{
    beam_deformations, deformation_stiffness, deformations_from_bodies, end_motions,
};
use crate::machine::{Beam, Carrier, Machine};

/// Static loads under gravity and their geometric stiffness.
#[derive(Clone, Debug, Default)]
pub struct Statics {
    /// Axial force of each beam, in the order of the machine's beams, N, tension positive. Empty
    /// without gravity.
    pub axial: Vec<f64>,
    /// Geometric stiffness in body coordinates, 6n×6n for n bodies, N/m, N and N m. Empty without
    /// gravity.
    pub geometric: DMatrix<f64>,
}

/// The compressive force at which a beam with both ends clamped buckles, N, positive.
///
/// This is Euler's 4π²·EI/L² for the plane with the smaller bending stiffness.
pub fn buckling_load(beam: &Beam) -> f64 {
    let [y, z] = beam.stiffness.bending;
    let tau = core::f64::consts::TAU;
    tau * tau * y.min(z) / beam.length
}

impl Statics {
    /// The loads of `machine` under its gravity, from its static displacement `sag` in body
    /// coordinates, 6n for n bodies.
    pub(crate) fn new(machine: &Machine, sag: &DVector<f64>) -> Self {
        let size = sag.len();
        let mut geometric = DMatrix::zeros(size, size);
        let mut axial = Vec::new();
        for beam in &machine.beams {
            let rows = deformations_from_bodies(machine, beam);
            let deformation = &rows * sag;
            let stress = deformation_stiffness(beam) * &deformation;
            let force = stress[0];
            axial.push(force);
            let ends = end_motions(machine, beam, size);
            geometric += ends.transpose() * beam_geometric(beam, force) * &ends;
            // Forces of the beam's ends on the bodies.
            let push = -(beam_deformations(beam).transpose() * stress);
            for (end, &node) in beam.ends.iter().enumerate() {
                let node = &machine.nodes[node];
                if let Carrier::Body(body) = node.carrier {
                    let arm = node.at - machine.bodies[body].cog;
                    let push: Vector3<f64> = push.fixed_rows::<3>(6 * end).into_owned();
                    let mut block = geometric.fixed_view_mut::<3, 3>(6 * body + 3, 6 * body + 3);
                    block += turned_arm(&push, &arm);
                }
            }
        }
        Self { axial, geometric }
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

/// Geometric stiffness, 12×12, of a beam with axial force `force`, N, tension positive, for its
/// twelve end motions.
///
/// The deflection is cubic in a plane with bending stiffness, and straight as in a bar with
/// hinged ends in a plane without.
fn beam_geometric(beam: &Beam, force: f64) -> DMatrix<f64> {
    let length = beam.length;
    let mut total = DMatrix::zeros(12, 12);
    let y = beam.axes.row(1);
    let z = beam.axes.row(2);
    // Deflection along `across`; its slope is a rotation about `about`.
    for (bending, across, about) in [
        (beam.stiffness.bending[0], z, -y),
        (beam.stiffness.bending[1], y, z.into_owned()),
    ] {
        // Deflection and slope (v, θ) of each end from the twelve motions.
        let mut ends = DMatrix::zeros(4, 12);
        for end in 0..2 {
            ends.view_mut((2 * end, 6 * end), (1, 3)).copy_from(&across);
            ends.view_mut((2 * end + 1, 6 * end + 3), (1, 3))
                .copy_from(&about);
        }
        let l = length;
        #[rustfmt::skip]
        let plane = if bending > 0.0 {
            DMatrix::from_row_slice(4, 4, &[
                36.0, 3.0 * l, -36.0, 3.0 * l,
                3.0 * l, 4.0 * l * l, -3.0 * l, -l * l,
                -36.0, -3.0 * l, 36.0, -3.0 * l,
                3.0 * l, -l * l, -3.0 * l, 4.0 * l * l,
            ]) / (30.0 * l)
        } else {
            DMatrix::from_row_slice(4, 4, &[
                1.0, 0.0, -1.0, 0.0,
                0.0, 0.0, 0.0, 0.0,
                -1.0, 0.0, 1.0, 0.0,
                0.0, 0.0, 0.0, 0.0,
            ]) / l
        };
        total += force * ends.transpose() * plane * ends;
    }
    total
}
