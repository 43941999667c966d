//! The energy of each mode by beam and body, and the kind of mode that follows from it.

use serde::Serialize;

use super::beam::{deformation_stiffness, deformations_from_bodies};
use super::multibody::{Modes, Multibody};
use crate::machine::{Carrier, Machine};

/// The share of one beam or body in the energy of a mode.
#[derive(Clone, Debug, Serialize)]
pub struct Share {
    /// The name of the beam or body in the machine file.
    pub name: String,
    /// Share of the energy, 0 to 1. The shares of all beams, or of all bodies, add up to 1.
    pub share: f64,
}

/// The kind of a mode, by the place of its strain energy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// At least half of the strain energy is in beams that end on the base.
    Suspension,
    /// More than half of the strain energy is in beams between bodies.
    Internal,
}

/// The energies of one mode.
#[derive(Clone, Debug, Serialize)]
pub struct Energies {
    /// Suspension or internal, by the place of the strain energy.
    pub kind: Kind,
    /// Modal mass, kg: the mass with the mode's kinetic energy if it moves as the node with the
    /// largest translation does.
    pub modal_mass: f64,
    /// Share of each beam in the elastic strain energy, in the order of the machine's beams.
    pub strain: Vec<Share>,
    /// Share of each body in the kinetic energy, in the order of the machine's bodies.
    pub kinetic: Vec<Share>,
}

/// The energies of each of the `modes`, in their order.
///
/// Strain energy is elastic: it does not contain the geometric part that gravity adds.
pub fn energies(machine: &Machine, model: &Multibody, modes: &Modes) -> Vec<Energies> {
    let beams: Vec<_> = machine
        .beams
        .iter()
        .map(|beam| {
            let rows = deformations_from_bodies(machine, beam);
            rows.transpose() * deformation_stiffness(beam) * rows
        })
        .collect();
    modes
        .shapes
        .column_iter()
        .map(|shape| {
            let strain: Vec<f64> = beams
                .iter()
                .map(|beam| shape.dot(&(beam * shape)))
                .collect();
            let total: f64 = strain.iter().sum();
            let on_base: f64 = machine
                .beams
                .iter()
                .zip(&strain)
                .filter(|(beam, _)| {
                    let base = |end: usize| machine.nodes[end].carrier == Carrier::Base;
                    beam.ends.into_iter().any(base)
                })
                .map(|(_, energy)| energy)
                .sum();
            let kinetic = machine.bodies.iter().enumerate().map(|(i, body)| {
                let part = shape.rows(6 * i, 6);
                let mass = model.mass.view((6 * i, 6 * i), (6, 6));
                // VᵀMV = 1, so these add up to 1 without scaling.
                Share {
                    name: body.name.clone(),
                    share: part.dot(&(mass * part)),
                }
            });
            let largest = (0..machine.nodes.len())
                .map(|node| model.translation(machine, node, &shape.into_owned()).norm())
                .fold(0.0, f64::max);
            Energies {
                kind: if on_base >= 0.5 * total {
                    Kind::Suspension
                } else {
                    Kind::Internal
                },
                modal_mass: 1.0 / (largest * largest),
                kinetic: kinetic.collect(),
                strain: machine
                    .beams
                    .iter()
                    .zip(&strain)
                    .map(|(beam, energy)| Share {
                        name: beam.name.clone(),
                        share: energy / total,
                    })
                    .collect(),
            }
        })
        .collect()
}
