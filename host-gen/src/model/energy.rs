//! The energy of each mode by its parts, and the kind of mode that follows from it.

use nalgebra::{DMatrix, Matrix3xX};
use serde::Serialize;

use super::beam::beam_mass;
use super::design_model::alike;
use super::layout::Point;
use super::multibody::Multibody;
use super::structure::{Modes, Part, StructureModel};
use crate::machine::{Carrier, Machine, Structure};
use crate::numeric::six::to_dynamic;

/// The share of one beam or body in the energy of a mode.
#[derive(Clone, Debug, Serialize)]
pub struct Share {
    /// The name of the beam or body in the machine file.
    pub name: String,
    /// Share of the energy, 0 to 1 unless a stiffness is negative. All shares of the strain energy add up to 1, and so do those of
    /// the kinetic energy.
    pub share: f64,
}

/// The kind of a mode, by the place of its strain energy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// At least half of the strain energy is in beams with an actuator, and in beams and springs with
    /// an end on the base.
    Suspension,
    /// More than half of the strain energy is elsewhere.
    Internal,
}

/// The energies of one mode.
///
/// The shapes of modes with equal natural frequencies can be mixed at will. Such modes share their
/// mean energies and one modal mass, which do not depend on the mixture.
#[derive(Clone, Debug, Serialize)]
pub struct Energies {
    /// Suspension or internal, by the place of the strain energy.
    pub kind: Kind,
    /// Modal mass, kg: the mass with the mode's kinetic energy if it moves as the point with the
    /// largest motion does.
    ///
    /// The points are the nodes, the nodes between the segments of beams, and the centres of
    /// gravity. For rotation there are two more kinds: at each node of a beam with mass, a point at
    /// the beam's radius of gyration from its axis, and for each body and point mass, a point at its
    /// radius of gyration from the axis of rotation.
    pub modal_mass: f64,
    /// Share of each beam in the elastic strain energy, in the order of the machine's beams;
    /// then that of each flexible body, then of each spring. A negative stiffness has a negative
    /// share.
    pub strain: Vec<Share>,
    /// Share of each body in the kinetic energy, in the order of the machine's bodies; then that
    /// of each flexible body, then of each beam with mass, then of each point mass.
    pub kinetic: Vec<Share>,
}

/// The energies of each of the `modes`, in their order.
///
/// Strain energy is elastic: it does not contain the geometric part that gravity adds.
pub fn energies(machine: &Machine, model: &Multibody, modes: &Modes) -> Vec<Energies> {
    of_structure(machine, &machine.actuators, model, modes)
}

/// The same of a structure, with the `legs` that have actuators, by index of the beam.
pub fn of_structure(
    machine: &Structure,
    legs: &[usize],
    model: &StructureModel,
    modes: &Modes,
) -> Vec<Energies> {
    let groups = alike(modes.squares.as_slice()).into_iter();
    groups
        .flat_map(|group| {
            let shapes = modes.shapes.columns_range(group.clone()).into_owned();
            let energies = of_group(machine, legs, model, &shapes);
            group.map(move |_| energies.clone())
        })
        .collect()
}

/// The mean energies of modes with equal frequencies. `shapes` are the mass-normalised mode shapes
/// as columns.
fn of_group(
    machine: &Structure,
    legs: &[usize],
    model: &StructureModel,
    shapes: &DMatrix<f64>,
) -> Energies {
    let strain = Part::all(machine).enumerate().map(|(i, part)| {
        let on_base = |ends: [usize; 2]| {
            let base = |end: usize| machine.nodes[end].carrier == Carrier::Base;
            ends.into_iter().any(base)
        };
        let suspends = match part {
            Part::Beam(beam) => legs.contains(&i) || on_base(beam.ends),
            Part::Flexible(_) => false,
            Part::Spring(spring) => on_base(spring.ends),
        };
        (part.name(), suspends, model.strain(machine, i, shapes))
    });
    let strain: Vec<_> = strain.collect();
    let total: f64 = strain.iter().map(|(.., energy)| energy).sum();
    let in_legs = strain.iter().filter(|(_, suspends, _)| *suspends);
    let in_legs: f64 = in_legs.map(|(.., energy)| energy).sum();
    let kinetic = machine.bodies.iter().enumerate().map(|(i, body)| {
        let part = shapes.rows(6 * i, 6);
        let mass = to_dynamic(&body.mass_matrix());
        // VᵀMV = 1, so all shares add up to 1 without scaling.
        Share {
            name: body.name.clone(),
            share: (part.transpose() * mass * part).trace() / shapes.ncols() as f64,
        }
    });
    let of_flexible = machine.flexible.iter().enumerate().map(|(i, body)| {
        let part = shapes.select_rows(&model.flexible(machine, i));
        Share {
            name: body.name.clone(),
            share: (part.transpose() * &body.mass * part).trace() / shapes.ncols() as f64,
        }
    });
    let beams = machine.beams.iter().enumerate();
    let heavy = beams.filter(|(_, beam)| beam.mass > 0.0);
    let of_beams = heavy.clone().map(|(i, beam)| {
        let points = model.along(machine, i);
        let energies = beam
            .elements()
            .zip(points.windows(2))
            .map(|(element, ends)| {
                let mass = beam_mass(&element);
                let mut part = DMatrix::zeros(12, shapes.ncols());
                for (end, point) in ends.iter().enumerate() {
                    part.rows_mut(6 * end, 6).copy_from(&point.motion(shapes));
                }
                (part.transpose() * mass * part).trace()
            });
        Share {
            name: beam.name.clone(),
            share: energies.sum::<f64>() / shapes.ncols() as f64,
        }
    });
    let of_points = machine.point_masses.iter().map(|point| {
        let part = model.node(point.node).motion(shapes);
        let mass = point.body.mass_matrix();
        Share {
            name: point.body.name.clone(),
            share: (part.transpose() * mass * part).trace() / shapes.ncols() as f64,
        }
    });
    // Over all mixtures of the shapes, a point moves at most by the largest singular value.
    let most = |motion: Matrix3xX<f64>| motion.singular_values().max();
    let translation = |point: &Point| most(point.translation(shapes));
    let of_nodes = (0..machine.nodes.len()).map(|node| translation(model.node(node)));
    let of_skins = heavy.flat_map(|(i, beam)| {
        let gyration = (beam.polar_inertia / beam.mass).sqrt();
        let axis = beam.axes.row(0);
        let points = model.along(machine, i);
        points.into_iter().map(move |point| {
            let motion = point.motion(shapes);
            let turned = gyration * axis * motion.fixed_rows::<3>(3);
            turned.norm().max(translation(&point))
        })
    });
    let of_bodies = machine.bodies.iter().enumerate().flat_map(|(i, body)| {
        let motion = shapes.fixed_rows::<6>(6 * i);
        let turned = body.gyration() * motion.fixed_rows::<3>(3);
        [most(motion.fixed_rows::<3>(0).into_owned()), most(turned)]
    });
    let of_masses = machine.point_masses.iter().map(|point| {
        let motion = model.node(point.node).motion(shapes);
        most(point.body.gyration() * motion.fixed_rows::<3>(3))
    });
    let largest = of_nodes.chain(of_skins).chain(of_bodies).chain(of_masses);
    let largest = largest.fold(0.0, f64::max);
    Energies {
        kind: if in_legs >= 0.5 * total {
            Kind::Suspension
        } else {
            Kind::Internal
        },
        modal_mass: 1.0 / (largest * largest),
        kinetic: kinetic
            .chain(of_flexible)
            .chain(of_beams)
            .chain(of_points)
            .collect(),
        strain: strain
            .into_iter()
            .map(|(name, _, energy)| Share {
                name: name.to_owned(),
                share: energy / total,
            })
            .collect(),
    }
}
