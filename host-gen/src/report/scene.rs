//! The machine as something to look at: points, beams, bodies, sensors,
//! actuators. How its parts move in a mode stands with the modes.

use serde::Serialize;

use crate::machine::{Carrier, Direction, Machine};

/// What there is to draw. Positions in m.
#[derive(Clone, Debug, Serialize)]
pub struct Scene {
    /// All nodes.
    pub nodes: Vec<SceneNode>,
    /// All beams.
    pub beams: Vec<SceneBeam>,
    /// All bodies.
    pub bodies: Vec<SceneBody>,
    /// Accelerometers.
    pub accelerometers: Vec<Arrow>,
    /// Force sensors: beams by index.
    pub force_sensors: Vec<usize>,
    /// Rheonomic inputs.
    pub floor: Vec<Arrow>,
}

/// A node.
#[derive(Clone, Debug, Serialize)]
pub struct SceneNode {
    /// Name.
    pub name: String,
    /// m.
    pub at: [f64; 3],
    /// The body it moves with, by index; the base if none.
    pub body: Option<usize>,
}

/// A beam.
#[derive(Clone, Debug, Serialize)]
pub struct SceneBeam {
    /// Name.
    pub name: String,
    /// Nodes by index.
    pub ends: [usize; 2],
    /// Its channel, from 1, if it has an actuator.
    pub channel: Option<usize>,
    /// EA/L, N/m.
    pub axial: f64,
    /// EI/L in both planes, N m.
    pub bending: [f64; 2],
    /// GJ/L, N m.
    pub torsion: f64,
}

/// A body.
#[derive(Clone, Debug, Serialize)]
pub struct SceneBody {
    /// Name.
    pub name: String,
    /// kg.
    pub mass: f64,
    /// About the centre of gravity, kg m².
    pub inertia: [[f64; 3]; 3],
    /// Centre of gravity, m.
    pub cog: [f64; 3],
}

/// A direction at a node.
#[derive(Clone, Debug, Serialize)]
pub struct Arrow {
    /// Name.
    pub name: String,
    /// Node by index.
    pub node: usize,
    /// Of length 1.
    pub direction: [f64; 3],
}

impl Scene {
    /// Of a machine.
    pub fn new(machine: &Machine) -> Self {
        let arrow = |d: &Direction| Arrow {
            name: d.name.clone(),
            node: d.node,
            direction: d.direction.into(),
        };
        let nodes = machine.nodes.iter().map(|node| SceneNode {
            name: node.name.clone(),
            at: node.at.into(),
            body: match node.carrier {
                Carrier::Base => None,
                Carrier::Body(body) => Some(body),
            },
        });
        let beams = machine.beams.iter().enumerate().map(|(i, beam)| SceneBeam {
            name: beam.name.clone(),
            ends: beam.ends,
            channel: machine
                .actuators
                .iter()
                .position(|leg| *leg == i)
                .map(|channel| channel + 1),
            axial: beam.stiffness.axial,
            bending: beam.stiffness.bending,
            torsion: beam.stiffness.torsion,
        });
        let bodies = machine.bodies.iter().map(|body| SceneBody {
            name: body.name.clone(),
            mass: body.mass,
            inertia: body.inertia.transpose().into(),
            cog: body.cog.into(),
        });
        Self {
            nodes: nodes.collect(),
            beams: beams.collect(),
            bodies: bodies.collect(),
            accelerometers: machine.accelerometers.iter().flatten().map(arrow).collect(),
            force_sensors: machine.force_sensors.iter().flatten().copied().collect(),
            floor: machine.floor.iter().map(arrow).collect(),
        }
    }
}
