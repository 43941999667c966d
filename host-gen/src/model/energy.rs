//! Where a mode has its energy, and what that says of it.

use serde::Serialize;

use super::beam::{deformation_stiffness, deformations_from_bodies};
use super::multibody::{Modes, Multibody};
use crate::machine::{Carrier, Machine};

/// A part of a machine and its share of a mode's energy.
#[derive(Clone, Debug, Serialize)]
pub struct Share {
    /// The beam or body.
    pub name: String,
    /// 0 to 1; the shares of a mode add up to 1.
    pub share: f64,
}

/// What a mode is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Most strain energy in beams that stand on the base.
    Suspension,
    /// Most in beams between bodies.
    Internal,
}

/// The energies of one mode.
#[derive(Clone, Debug, Serialize)]
pub struct Energies {
    /// By where the strain energy is, not by number.
    pub kind: Kind,
    /// Mass that moves with the largest translation of any node, kg.
    pub modal_mass: f64,
    /// Strain energy per beam.
    pub strain: Vec<Share>,
    /// Kinetic energy per body.
    pub kinetic: Vec<Share>,
}

/// The energies of every mode. Strain is elastic: gravity's part is not shared
/// out.
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
                // VᵀMV = 1: these add up to 1 as they are.
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
