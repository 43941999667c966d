//! Which coordinates of x each part of the machine moves with.
//!
//! x has, in this order, six coordinates for each body, as [`super::multibody`] says; six for each
//! node that no body carries, in the order of the file: its translation, m, and its rotation, rad,
//! both relative to the base; and six of the same kind for each node between the elements of a
//! beam, beam by beam, from its end P to its end Q; last the modal coordinates of each flexible
//! body.

use core::ops::Range;

use nalgebra::{DMatrix, DVector, Matrix3xX, Matrix6, Matrix6xX, Vector3};

use super::independence::reach;
use crate::machine::{Beam, Carrier, Structure};
use crate::numeric::motion::transport;

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

    /// The translation of the point, m, in the motions `x` of the machine, as columns, 3×k.
    pub(crate) fn translation(&self, x: &DMatrix<f64>) -> Matrix3xX<f64> {
        match self.follow {
            Some(Follow { first, map }) => map.fixed_rows::<3>(0) * x.fixed_rows::<6>(first),
            None => Matrix3xX::zeros(x.ncols()),
        }
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
    /// A node that no rigid body carries.
    Node(usize),
    /// A node between the elements of a beam: the beam, and the number of the node, from 1.
    Inner(usize, usize),
}

impl Owner {
    /// The entry in the machine file.
    pub(crate) fn entry(self, machine: &Structure) -> String {
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
    pub(crate) fn name(self, machine: &Structure) -> String {
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
    /// For each six coordinates of motion, what they belong to.
    owners: Vec<Owner>,
    /// For each flexible body, its modal coordinates.
    modal: Vec<Range<usize>>,
    bodies: usize,
}

impl Layout {
    pub(crate) fn new(machine: &Structure) -> Self {
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
            Carrier::Free | Carrier::Flexible(_) => {
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
        let mut next = 6 * owners.len();
        let modal = machine.flexible.iter().map(|body| {
            let first = next;
            next += body.modes();
            first..next
        });
        let modal = modal.collect();
        Self {
            nodes,
            inner,
            owners,
            modal,
            bodies,
        }
    }

    /// Number N of coordinates.
    pub(crate) fn size(&self) -> usize {
        self.modal
            .last()
            .map_or(6 * self.owners.len(), |last| last.end)
    }

    /// The coordinates that are not those of rigid bodies.
    pub(crate) fn own(&self) -> Range<usize> {
        6 * self.bodies..self.size()
    }

    /// What each six coordinates belong to, those of modes left out.
    pub(crate) fn owners(&self) -> &[Owner] {
        &self.owners
    }

    /// Those of the coordinates that are of nodes of beams which no body carries, rigid or
    /// flexible.
    pub(crate) fn of_beams(&self, machine: &Structure) -> Vec<usize> {
        let sixes = self.owners.iter().enumerate();
        let own = sixes.filter(|(_, owner)| match **owner {
            Owner::Body(_) => false,
            Owner::Node(node) => machine.nodes[node].carrier == Carrier::Free,
            Owner::Inner(..) => true,
        });
        own.flat_map(|(six, _)| 6 * six..6 * six + 6).collect()
    }

    /// What a coordinate belongs to that is not one of a mode.
    pub(crate) fn owner(&self, coordinate: usize) -> Owner {
        self.owners[coordinate / 6]
    }

    /// Whether a coordinate is a rotation.
    pub(crate) fn turns(&self, coordinate: usize) -> bool {
        coordinate < 6 * self.owners.len() && coordinate % 6 >= 3
    }

    /// The coordinates of a flexible body, by its index, in the order of its matrices.
    pub(crate) fn flexible(&self, machine: &Structure, body: usize) -> Vec<usize> {
        let nodes = machine.flexible[body].nodes.iter();
        let nodes = nodes.filter_map(|&node| self.nodes[node].follow);
        let nodes = nodes.flat_map(|follow| follow.first..follow.first + 6);
        nodes.chain(self.modal[body].clone()).collect()
    }

    /// Adds a matrix of a flexible body, in the order of the body's own matrices, to `whole`, N×N.
    pub(crate) fn add_of_flexible(
        &self,
        machine: &Structure,
        body: usize,
        of_body: &DMatrix<f64>,
        whole: &mut DMatrix<f64>,
    ) {
        let own = self.flexible(machine, body);
        for (&j, column) in own.iter().zip(of_body.column_iter()) {
            for (&i, x) in own.iter().zip(column.iter()) {
                whole[(i, j)] += x;
            }
        }
    }

    /// A node, by its index in the machine.
    pub(crate) fn node(&self, node: usize) -> &Point {
        &self.nodes[node]
    }

    /// The points of a beam, by its index: end P, those between its elements, end Q.
    pub(crate) fn along(&self, machine: &Structure, beam: usize) -> Vec<Point> {
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
    pub(crate) fn ends(&self, machine: &Structure, beam: usize) -> [Point; 2] {
        machine.beams[beam].ends.map(|end| self.nodes[end])
    }

    /// Factors that make all coordinates lengths, m: 1 for translations, the machine's
    /// [`reach`] for rotations.
    pub(crate) fn lengths(&self, machine: &Structure) -> DVector<f64> {
        let length = reach(machine);
        let mut lengths = DVector::from_element(self.size(), 1.0);
        for (i, x) in lengths.iter_mut().enumerate() {
            if self.turns(i) {
                *x = length;
            }
        }
        // A modal coordinate has the kinetic energy of the whole body at this velocity.
        for (body, modal) in machine.flexible.iter().zip(&self.modal) {
            let first = 6 * body.nodes.len();
            for (k, i) in modal.clone().enumerate() {
                let own = body.mass[(first + k, first + k)];
                if own > 0.0 {
                    lengths[i] = (own / body.total).sqrt();
                }
            }
        }
        lengths
    }

    /// Names of the coordinates that are not those of rigid bodies: `OWNER.x` to `OWNER.rz`, and
    /// `BODY.q1` and so on of a flexible body's modes.
    pub(crate) fn names(&self, machine: &Structure) -> Vec<String> {
        let own = self.owners[self.bodies..].iter();
        let names = own.flat_map(|owner| {
            let name = owner.name(machine);
            ["x", "y", "z", "rx", "ry", "rz"].map(|axis| format!("{name}.{axis}"))
        });
        let modes = machine.flexible.iter();
        let modes =
            modes.flat_map(|body| (1..=body.modes()).map(|k| format!("{}.q{k}", body.name)));
        names.chain(modes).collect()
    }
}
