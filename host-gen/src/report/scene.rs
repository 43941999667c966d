//! The machine for the 3D view: nodes, beams, bodies, sensors, actuators. The mode shapes
//! are in the mode analysis.

use serde::Serialize;

use crate::machine::{Carrier, Direction, Machine, Structure};

/// The parts of a machine for the 3D view. Indices count from 0.
#[derive(Clone, Debug, Serialize)]
pub struct Scene {
    /// All nodes, in the order of the file.
    pub nodes: Vec<SceneNode>,
    /// All beams, in the order of the file.
    pub beams: Vec<SceneBeam>,
    /// All bodies, in the order of the file.
    pub bodies: Vec<SceneBody>,
    /// All springs and joints, in the order of the file.
    pub springs: Vec<SceneSpring>,
    /// All point masses, in the order of the file.
    pub point_masses: Vec<ScenePointMass>,
    /// Accelerometers with their directions; empty if there are none.
    pub accelerometers: Vec<Arrow>,
    /// Beams with a force sensor, by index in `beams`.
    pub force_sensors: Vec<usize>,
    /// Floor inputs with their directions, Eq. (8).
    pub floor: Vec<Arrow>,
}

/// A node of the 3D view.
#[derive(Clone, Debug, Serialize)]
pub struct SceneNode {
    /// Name in the file.
    pub name: String,
    /// Position, m.
    pub at: [f64; 3],
    /// Body that carries the node, by index in [`Scene::bodies`]; none for the base, or if the
    /// node is free.
    pub body: Option<usize>,
    /// Whether the node moves by itself, held by beams or as one of a flexible body. Left out if
    /// not.
    #[serde(skip_serializing_if = "is_false")]
    pub free: bool,
}

fn is_false(x: &bool) -> bool {
    !x
}

/// A beam of the 3D view.
#[derive(Clone, Debug, Serialize)]
pub struct SceneBeam {
    /// Name in the file.
    pub name: String,
    /// End nodes p and q, by index in [`Scene::nodes`].
    pub ends: [usize; 2],
    /// Channel of its actuator, from 1; none without an actuator.
    pub channel: Option<usize>,
    /// EA/L, N/m.
    pub axial: f64,
    /// EI/L in both planes, N m.
    pub bending: [f64; 2],
    /// GJ/L, N m.
    pub torsion: f64,
}

/// A body of the 3D view.
#[derive(Clone, Debug, Serialize)]
pub struct SceneBody {
    /// Name in the file.
    pub name: String,
    /// Mass, kg.
    pub mass: f64,
    /// Inertia about the centre of gravity, by rows, kg m².
    pub inertia: [[f64; 3]; 3],
    /// Position of the centre of gravity, m.
    pub cog: [f64; 3],
}

/// A spring or joint of the 3D view.
#[derive(Clone, Debug, Serialize)]
pub struct SceneSpring {
    /// Name in the file.
    pub name: String,
    /// Nodes p and q, by index in [`Scene::nodes`]; they may be at one place.
    pub ends: [usize; 2],
    /// Stiffness along its local x, y and z axes, N/m, then about these, N m; of either sign.
    pub stiffness: [f64; 6],
}

/// A point mass of the 3D view.
#[derive(Clone, Debug, Serialize)]
pub struct ScenePointMass {
    /// Name in the file.
    pub name: String,
    /// Node, by index in [`Scene::nodes`].
    pub node: usize,
    /// Mass, kg.
    pub mass: f64,
}

/// A direction at a node of the 3D view.
#[derive(Clone, Debug, Serialize)]
pub struct Arrow {
    /// Name in the file.
    pub name: String,
    /// Node, by index in [`Scene::nodes`].
    pub node: usize,
    /// Unit vector.
    pub direction: [f64; 3],
}

impl Scene {
    /// The scene of `machine`.
    pub fn new(machine: &Machine) -> Self {
        let mut scene = Self::of_structure(machine);
        for (channel, leg) in machine.actuators.iter().enumerate() {
            scene.beams[*leg].channel = Some(channel + 1);
        }
        let arrow = |d: &Direction| Arrow {
            name: d.name.clone(),
            node: d.node,
            direction: d.direction.into(),
        };
        Self {
            accelerometers: machine.accelerometers.iter().flatten().map(arrow).collect(),
            force_sensors: machine.force_sensors.iter().flatten().copied().collect(),
            floor: machine.floor.iter().map(arrow).collect(),
            ..scene
        }
    }

    /// The scene of a machine without control.
    pub fn of_structure(machine: &Structure) -> Self {
        let nodes = machine.nodes.iter().map(|node| SceneNode {
            name: node.name.clone(),
            at: node.at.into(),
            body: match node.carrier {
                Carrier::Base | Carrier::Free | Carrier::Flexible(_) => None,
                Carrier::Body(body) => Some(body),
            },
            free: matches!(node.carrier, Carrier::Free | Carrier::Flexible(_)),
        });
        let beams = machine.beams.iter().map(|beam| SceneBeam {
            name: beam.name.clone(),
            ends: beam.ends,
            channel: None,
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
        let springs = machine.springs.iter().map(|spring| SceneSpring {
            name: spring.name.clone(),
            ends: spring.ends,
            stiffness: spring.stiffness.into(),
        });
        let point_masses = machine.point_masses.iter().map(|mass| ScenePointMass {
            name: mass.body.name.clone(),
            node: mass.node,
            mass: mass.body.mass,
        });
        Self {
            nodes: nodes.collect(),
            beams: beams.collect(),
            bodies: bodies.collect(),
            springs: springs.collect(),
            point_masses: point_masses.collect(),
            accelerometers: Vec::new(),
            force_sensors: Vec::new(),
            floor: Vec::new(),
        }
    }
}
