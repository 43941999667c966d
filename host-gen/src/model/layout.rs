//! Which coordinates of x each part of the machine moves with.
//!
//! x has, in this order, six coordinates for each body, as [`super::multibody`] says; six for each
//! node that no body carries, in the order of the file: its translation, m, and its rotation, rad,
//! both relative to the base; and six of the same kind for each node between the elements of a
//! beam, beam by beam, from its end P to its end Q.

use core::ops::Range;

use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, Vector3};

use super::beam::transport;
use super::independence::reach;
use crate::machine::{Beam, Carrier, Machine};

/// The motion of a point, that is, its translation, m, and its rotation, rad, relative to the
/// base, from the six coordinates that it depends on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Follow {
    /// The first of the six.
    pub(crate) first: usize,
    /// Motion from these six.
    pub(crate) map: Matrix6<f64>,
}

/// A point of the machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point {
    /// Position, m.
    pub(crate) at: Vector3<f64>,
    /// How it moves; `None` with the base.
    pub(crate) follow: Option<Follow>,
}

impl Point {
    /// A point with six coordinates of its own, from `first` on.
    fn own(at: Vector3<f64>, first: usize) -> Self {
        let map = Matrix6::identity();
        let follow = Some(Follow { first, map });
        Self { at, follow }
    }

    /// The motion of the point in the motions `x` of the machine, as columns, 6×k.
    pub(crate) fn motion(&self, x: &DMatrix<f64>) -> Matrix6xX<f64> {
        match self.follow {
            Some(Follow { first, map }) => map * x.fixed_rows::<6>(first),
            None => Matrix6xX::zeros(x.ncols()),
        }
    }
}

/// What a coordinate belongs to, by index in the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Owner {
    /// A rigid body.
    Body(usize),
    /// A node that no body carries.
    Node(usize),
    /// A node between the elements of a beam: the beam, and the number of the node, from 1.
    Inner(usize, usize),
}

impl Owner {
    /// The entry in the machine file.
    pub(crate) fn entry(self, machine: &Machine) -> String {
        match self {
            Self::Body(body) => format!("bodies.{}", machine.bodies[body].name),
            Self::Node(node) => format!("nodes.{}", machine.nodes[node].name),
            Self::Inner(beam, _) => format!("beams.{}", machine.beams[beam].name),
        }
    }

    /// What moves, as the subject of a sentence about the entry.
    pub(crate) fn subject(self) -> &'static str {
        match self {
            Self::Body(_) => "this body",
            Self::Node(_) => "this node",
            Self::Inner(..) => "this beam",
        }
    }

    /// A name for lists: that of the body or node, or `BEAM[1]` for the first inner node.
    pub(crate) fn name(self, machine: &Machine) -> String {
        match self {
            Self::Body(body) => machine.bodies[body].name.clone(),
            Self::Node(node) => machine.nodes[node].name.clone(),
            Self::Inner(beam, inner) => format!("{}[{inner}]", machine.beams[beam].name),
        }
    }
}

/// Where the coordinates of each part are.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    /// The machine's nodes.
    nodes: Vec<Point>,
    /// For each beam, the first coordinate of its inner nodes.
    inner: Vec<usize>,
    /// For each six coordinates, what they belong to.
    owners: Vec<Owner>,
    bodies: usize,
}

impl Layout {
    pub(crate) fn new(machine: &Machine) -> Self {
        let bodies = machine.bodies.len();
        let mut owners: Vec<Owner> = (0..bodies).map(Owner::Body).collect();
        let nodes = machine.nodes.iter().enumerate();
        let nodes = nodes.map(|(i, node)| match node.carrier {
            Carrier::Base => Point {
                at: node.at,
                follow: None,
            },
            Carrier::Body(body) => Point {
                at: node.at,
                follow: Some(Follow {
                    first: 6 * body,
                    map: transport(&node.at, &machine.bodies[body].cog),
                }),
            },
            Carrier::Free => {
                owners.push(Owner::Node(i));
                Point::own(node.at, 6 * (owners.len() - 1))
            }
        });
        let nodes = nodes.collect();
        let mut inner = Vec::new();
        for (i, beam) in machine.beams.iter().enumerate() {
            inner.push(6 * owners.len());
            owners.extend((1..beam.segments).map(|node| Owner::Inner(i, node)));
        }
        Self {
            nodes,
            inner,
            owners,
            bodies,
        }
    }

    /// Number N of coordinates.
    pub(crate) fn size(&self) -> usize {
        6 * self.owners.len()
    }

    /// The coordinates that are not those of rigid bodies.
    pub(crate) fn own(&self) -> Range<usize> {
        6 * self.bodies..self.size()
    }

    /// What each six coordinates belong to.
    pub(crate) fn owners(&self) -> &[Owner] {
        &self.owners
    }

    /// What a coordinate belongs to.
    pub(crate) fn owner(&self, coordinate: usize) -> Owner {
        self.owners[coordinate / 6]
    }

    /// A node, by its index in the machine.
    pub(crate) fn node(&self, node: usize) -> &Point {
        &self.nodes[node]
    }

    /// The points of a beam, by its index: end P, those between its elements, end Q.
    pub(crate) fn along(&self, machine: &Machine, beam: usize) -> Vec<Point> {
        let Beam {
            ends: [p, q],
            segments,
            ..
        } = machine.beams[beam];
        let [p, q] = [self.nodes[p], self.nodes[q]];
        let between = (1..segments).map(|i| {
            let part = i as f64 / segments as f64;
            Point::own(p.at.lerp(&q.at, part), self.inner[beam] + 6 * (i - 1))
        });
        [p].into_iter().chain(between).chain([q]).collect()
    }

    /// The two ends of a beam, by its index.
    pub(crate) fn ends(&self, machine: &Machine, beam: usize) -> [Point; 2] {
        machine.beams[beam].ends.map(|end| self.nodes[end])
    }

    /// Factors that make all coordinates lengths, m: 1 for translations, the machine's
    /// [`reach`] for rotations.
    pub(crate) fn lengths(&self, machine: &Machine) -> DVector<f64> {
        let length = reach(machine);
        DVector::from_fn(self.size(), |i, _| if i % 6 < 3 { 1.0 } else { length })
    }

    /// Names of the coordinates that are not those of rigid bodies: `OWNER.x` to `OWNER.rz`.
    pub(crate) fn names(&self, machine: &Machine) -> Vec<String> {
        let own = self.owners[self.bodies..].iter();
        let names = own.flat_map(|owner| {
            let name = owner.name(machine);
            ["x", "y", "z", "rx", "ry", "rz"].map(|axis| format!("{name}.{axis}"))
        });
        names.collect()
    }
}
