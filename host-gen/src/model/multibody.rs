//! The linear multibody model: bodies, Euler–Bernoulli beams and springs on a moving base.
//!
//! The N coordinates x are relative to a frame that moves with the base. In this order:
//!
//! - for each rigid body, the translation of its centre of gravity, m, and its rotation, rad;
//! - the same for each node that no rigid body carries, in the order of the file, and for the nodes
//!   between the elements of beams with mass, beam by beam, from P to Q;
//! - the modal coordinates of flexible bodies.
//!
//! The base motion b is the translation of its point at C, m, and its rotation, rad. C is the mean
//! position of the nodes. The absolute motion of the machine is x + Φ·b, and deformations depend on x alone. So Eq. (1)
//! becomes
//!
//! ```text
//! M·ẍ + D·ẋ + K·x = −P·b̈ + Eᵀ·σ,  P = M·Φ + M_b
//! ```
//!
//! with the leg forces σ, N, and the elongations E·x of the legs. M_b is the inertia that couples
//! x to the base itself: that of beams with mass that end on it. The degrees of freedom
//! q_d = E_d·x, Eq. (7), and the floor inputs q_r = R·b, Eq. (8), turn this into Eq. (2). Those of
//! the coordinates that are not of bodies are degrees of freedom as they are.
//!
//! A leg force is that of a stack along the whole leg, whose material is strained evenly: equal and
//! opposite forces at the two ends of every element. Those at inner nodes cancel, so that one pair
//! at the ends of the leg remains, as for a leg without mass. Likewise a force sensor reads the
//! mean axial force along the leg, σ − (EA/L)·e1 − c·ė1 with the elongation e1 between its ends.

use core::ops::Deref;

use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, MatrixXx6, RowVector6, Vector3};

use super::independence::{dependent, follows_from, reach};
use super::structure::StructureModel;
use crate::machine::{Carrier, Deformation, Direction, EntryError, Machine, MachineError};
use crate::numeric::motion::transport;
use crate::numeric::six::to_dynamic;

/// The linear model of a machine with N coordinates, Eq. (1): that of its structure, whose fields it
/// has, with degrees of freedom, legs and floor inputs.
#[derive(Clone, Debug)]
pub struct Multibody {
    structure: StructureModel,
    /// R, 6×6: displacements q_r of the floor inputs, m, from base motion, that is, the
    /// translation at C, m, and the rotation, rad. Between their accelerations, of which q̈_r is
    /// Eq. (8), the matrix is the same.
    pub floor: Matrix6<f64>,
    /// E_d, N×N: the degrees of freedom q_d of Eq. (7) from x. The deformations of the file, m,
    /// then the coordinates that are not of bodies, m and rad.
    pub coordinates: DMatrix<f64>,
    /// E, 6×N: elongations e1 of the legs, m, from x. Rows are in the order of the actuators.
    pub elongations: Matrix6xX<f64>,
}

impl Deref for Multibody {
    type Target = StructureModel;

    fn deref(&self) -> &StructureModel {
        &self.structure
    }
}

/// The matrices of Eq. (2), for N coordinates: M_d·q̈_d + D_d·q̇_d + K_d·q_d = −M_r·q̈_r + B_0·σ_a.
#[derive(Clone, Debug)]
pub struct EquationOfMotion {
    /// M_d of Eq. (2), N×N, kg, and kg m and kg m² for rotations in q_d.
    pub mass: DMatrix<f64>,
    /// D_d of Eq. (2), N×N, N s/m, and N s and N m s.
    pub damping: DMatrix<f64>,
    /// K_d of Eq. (2), N×N, N/m, and N and N m.
    pub stiffness: DMatrix<f64>,
    /// M_r of Eq. (2), N×6, kg and kg m: for the floor accelerations q̈_r, m/s².
    pub rheonomic: MatrixXx6<f64>,
    /// B_0 of Eq. (2), N×6, without unit: for the leg forces σ_a, N, in the order of the
    /// actuators. A positive force makes the leg longer.
    pub input: MatrixXx6<f64>,
}

impl Multibody {
    /// Assembles M, D and K of Eq. (1), the degrees of freedom q_d of Eq. (7), and the
    /// displacements q_r whose accelerations q̈_r are the floor inputs of Eq. (8).
    ///
    /// # Errors
    /// If the deformations in q_d depend on each other, the floor inputs do not determine the
    /// motion of a rigid base, or a body can move and no beam, no spring and no weight holds it.
    pub fn new(machine: &Machine) -> Result<Self, MachineError> {
        let structure = StructureModel::assemble(machine);
        let (layout, centre) = (&structure.layout, &structure.centre);
        let size = layout.size();
        let mut coordinates = DMatrix::zeros(size, size);
        for (i, d) in machine.coordinates.iter().enumerate() {
            coordinates.set_row(i, &structure.deformation(machine, *d).transpose());
        }
        for i in layout.own() {
            coordinates[(i, i)] = 1.0;
        }
        let elongations = Matrix6xX::from_rows(&machine.actuators.map(|beam| {
            let elongation = Deformation { beam, component: 0 };
            structure.deformation(machine, elongation).transpose()
        }));
        let floor = Matrix6::from_rows(&machine.floor.each_ref().map(|input| {
            let at = machine.nodes[input.node].at;
            input.direction.transpose() * transport(&at, centre).fixed_rows::<3>(0)
        }));
        let mut model = Self {
            structure,
            floor,
            coordinates,
            elongations,
        };
        let checked = model.check(machine);
        let checked = checked.and_then(|()| model.structure.hold(machine));
        checked.map_err(|fault| machine.locate(fault))?;
        Ok(model)
    }

    /// The arrangement, without stiffness.
    fn check(&self, machine: &Machine) -> Result<(), EntryError> {
        let length = reach(machine);
        // The other coordinates are degrees of freedom as they are, so the deformations must
        // determine the motion of the bodies with these held.
        let bodies = self.layout.own().start;
        let of_bodies = self.coordinates.view((0, 0), (bodies, bodies)).into_owned();
        if let Some(i) = dependent(&of_bodies, length) {
            let legs = DMatrix::from_rows(&self.elongations.row_iter().collect::<Vec<_>>());
            // Then no choice of coordinates helps.
            if let Some(leg) = dependent(&legs, length) {
                let name = |i: usize| format!("\"{}\"", machine.beams[machine.actuators[i]].name);
                let others = follows_from(&legs, length, leg).into_iter().map(name);
                return Err(EntryError::new(
                    "actuators.beams",
                    format!(
                        "singular actuator arrangement: the elongation of {} follows from {}",
                        name(leg),
                        match others.collect::<Vec<_>>() {
                            others if others.is_empty() => "nothing: no body moves it".to_owned(),
                            others => format!("those of {}", others.join(", ")),
                        }
                    ),
                )
                .fix("change the position or the direction of one of these legs"));
            }
            return Err(EntryError::new(
                "coordinates.deformations",
                format!(
                    "dependent degrees of freedom: \"{}\" follows from those before it",
                    machine.deformation_name(machine.coordinates[i])
                ),
            )
            .fix("choose another deformation"));
        }
        if let Some(i) = dependent(&to_dynamic(&self.floor), length) {
            return Err(EntryError::new(
                format!("floor.inputs.{}", machine.floor[i].name),
                "this input follows from the inputs before it, but six inputs must determine the motion of a rigid base",
            )
            .fix("change its node or its direction"));
        }
        // A leg that moved something without inertia would answer at once, with an acceleration
        // like that of the force.
        let moved = &self.elongations * &self.inertia.without;
        for (leg, row) in moved.row_iter().enumerate() {
            if row.amax() > 1e-9 * length {
                let motion = self.inertia.without.column(row.transpose().iamax());
                let leg = &machine.beams[machine.actuators[leg]].name;
                let inert = self.inert(machine, motion.as_slice());
                return Err(EntryError::new(
                    inert.entry,
                    format!(
                        "{}, and the actuator in \"{leg}\" {}",
                        inert.cause, inert.verb
                    ),
                )
                .fix(inert.fix));
            }
        }
        Ok(())
    }

    /// The matrices of Eq. (2): M_d, D_d, K_d, M_r and B_0.
    ///
    /// They follow from body coordinates with x = E_d⁻¹·q_d.
    pub fn equation_of_motion(&self) -> EquationOfMotion {
        let inverse = self
            .coordinates
            .clone()
            .try_inverse()
            .expect("the coordinates were checked to be independent");
        let floor = self.floor_inverse();
        let back = inverse.transpose();
        let mass = &back * &self.mass * &inverse;
        let modes = self.modes();
        // S = E_d·V, so M·S = S⁻ᵀ.
        let momentum = &back * &self.mass * &modes.shapes;
        EquationOfMotion {
            damping: &momentum * modes.damping * momentum.transpose(),
            stiffness: &back * &self.stiffness * &inverse,
            rheonomic: self.momentum(&back) * floor,
            input: &back * self.elongations.transpose(),
            mass,
        }
    }

    /// Names of the degrees of freedom q_d.
    pub(crate) fn coordinate_names(&self, machine: &Machine) -> Vec<String> {
        let deformations = machine.coordinates.iter();
        let deformations = deformations.map(|d| machine.deformation_name(*d));
        deformations.chain(self.layout.names(machine)).collect()
    }

    /// R⁻¹, 6×6: the motion of the base, that is, the translation at C, m, and the rotation, rad,
    /// from the floor inputs q_r of Eq. (8), m.
    pub fn floor_inverse(&self) -> Matrix6<f64> {
        self.floor
            .try_inverse()
            .expect("the floor inputs were checked to be independent")
    }

    /// The floor inputs q_r of Eq. (8), m, that six independent motions of the base make, as
    /// columns, 6×6: one m along x, y and z, and the rotations about x, y and z that the machine
    /// has with each m of translation, through the mean position of the base's nodes.
    pub fn rigid_base(&self, machine: &Machine) -> Matrix6<f64> {
        let feet = machine.nodes.iter();
        let feet = feet.filter(|node| node.carrier == Carrier::Base);
        let (sum, count) = feet.fold((Vector3::zeros(), 0.0), |(sum, count), node| {
            (sum + node.at, count + 1.0)
        });
        // Not 0/0: the floor inputs are at nodes of the base.
        let mut motions = transport(&self.centre, &(sum / count));
        for (mut column, part) in motions.column_iter_mut().skip(3).zip(&machine.rotation) {
            column *= *part;
        }
        self.floor * motions
    }

    /// The mean translation of the frame's ends of the legs along an axis, 0 to 2 for x, y, z, in
    /// the form of [`Multibody::direction`].
    ///
    /// The frame's ends are those that are not on the base.
    pub(crate) fn mounts(&self, machine: &Machine, axis: usize) -> (DVector<f64>, RowVector6<f64>) {
        let mut sum = (DVector::zeros(self.mass.nrows()), RowVector6::zeros());
        let mut count = 0.0;
        for &leg in &machine.actuators {
            for &node in &machine.beams[leg].ends {
                if machine.nodes[node].carrier == Carrier::Base {
                    continue;
                }
                let direction = Direction {
                    name: String::new(),
                    node,
                    direction: Vector3::ith(axis, 1.0),
                };
                let (relative, ride) = self.direction(machine, &direction);
                sum.0 += relative;
                sum.1 += ride;
                count += 1.0;
            }
        }
        // Not 0/0: a leg without an end on a body has no elongation, and the legs were checked to
        // be independent.
        (sum.0 / count, sum.1 / count)
    }
}
