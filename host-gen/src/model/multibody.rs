//! The linear multibody model: rigid bodies and Euler–Bernoulli beams on a moving base.
//!
//! Body coordinates x are, for each body, the translation of its centre of gravity, m, and its
//! rotation, rad, both relative to a frame that moves with the base. n bodies have 6n
//! coordinates. The base motion b is the translation of the origin, m, and the rotation, rad.
//! The absolute motion of the bodies is x + Φ·b, and deformations depend on x alone. So Eq. (1)
//! becomes
//!
//! ```text
//! M·ẍ + D·ẋ + K·x = −M·Φ·b̈ + Eᵀ·σ
//! ```
//!
//! with the leg forces σ, N, and the elongations E·x of the legs. The degrees of freedom
//! q_d = E_d·x, Eq. (7), and the floor inputs q_r = R·b, Eq. (8), turn this into Eq. (2).

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Matrix6xX, MatrixXx6, RowVector6, Vector3};

use super::beam::{deformation_stiffness, deformations_from_bodies, transport};
use super::gravity::Statics;
use super::independence::{dependent, reach};
use crate::machine::{Carrier, Damping, Deformation, Direction, EntryError, Machine, MachineError};
use crate::numeric::eigen::generalised_eigen;
use crate::numeric::six::to_dynamic;

/// The linear model of a machine with n bodies, Eq. (1), in body coordinates.
#[derive(Clone, Debug)]
pub struct Multibody {
    /// M of Eq. (1) in body coordinates, 6n×6n, kg and kg m².
    pub mass: DMatrix<f64>,
    /// K of Eq. (1) in body coordinates, 6n×6n, N/m, N and N m: elastic, plus the geometric
    /// stiffness under gravity.
    pub stiffness: DMatrix<f64>,
    /// Static loads under gravity and their geometric stiffness; empty without gravity.
    pub statics: Statics,
    /// Dampers along beams, in body coordinates, 6n×6n, N s/m, N s and N m s.
    dampers: DMatrix<f64>,
    /// Σ η·K over the beams with loss factor η, in body coordinates, 6n×6n.
    losses: DMatrix<f64>,
    damping: Damping,
    /// Φ, 6n×6: motion of the bodies from the motion of the base if no beam deforms. The base
    /// motion is the translation of the origin, m, and the rotation, rad.
    pub ride: MatrixXx6<f64>,
    /// R, 6×6: floor inputs q_r of Eq. (8), m, from base motion, that is, the translation of the
    /// origin, m, and the rotation, rad.
    pub floor: Matrix6<f64>,
    /// E_d, 6n×6n: the degrees of freedom q_d of Eq. (7), m, from body coordinates.
    pub coordinates: DMatrix<f64>,
    /// E, 6×6n: elongations e1 of the legs, m, from body coordinates. Rows are in the order of
    /// the actuators.
    pub elongations: Matrix6xX<f64>,
}

/// The matrices of Eq. (2), for n bodies: M_d·q̈_d + D_d·q̇_d + K_d·q_d = −M_r·q̈_r + B_0·σ_a.
#[derive(Clone, Debug)]
pub struct EquationOfMotion {
    /// M_d of Eq. (2), 6n×6n, kg.
    pub mass: DMatrix<f64>,
    /// D_d of Eq. (2), 6n×6n, N s/m.
    pub damping: DMatrix<f64>,
    /// K_d of Eq. (2), 6n×6n, N/m.
    pub stiffness: DMatrix<f64>,
    /// M_r of Eq. (2), 6n×6, kg: for the floor accelerations q̈_r, m/s².
    pub rheonomic: MatrixXx6<f64>,
    /// B_0 of Eq. (2), 6n×6, without unit: for the leg forces σ_a, N, in the order of the
    /// actuators. A positive force makes the leg longer.
    pub input: MatrixXx6<f64>,
}

/// The undamped modes of a machine with n bodies, and the damping in modal coordinates.
#[derive(Clone, Debug)]
pub struct Modes {
    /// ω², rad²/s², 6n, ascending; negative for a mode that gravity makes unstable.
    pub squares: DVector<f64>,
    /// V, 6n×6n: mode shapes in body coordinates as columns, with VᵀMV = 1.
    pub shapes: DMatrix<f64>,
    /// Δ = VᵀDV, 6n×6n, 1/s. Diagonal unless there are dampers along beams.
    pub damping: DMatrix<f64>,
}

impl Modes {
    /// Natural frequencies, Hz, ascending. For a mode that gravity makes unstable, minus its rate
    /// of growth over 2π.
    pub fn hertz(&self) -> Vec<f64> {
        self.squares
            .iter()
            .map(|square| square.signum() * square.abs().sqrt() / core::f64::consts::TAU)
            .collect()
    }
}

impl Multibody {
    /// Assembles M, D and K of Eq. (1), the degrees of freedom q_d of Eq. (7), and the floor
    /// inputs q_r of Eq. (8).
    ///
    /// # Errors
    /// If the deformations in q_d depend on each other, the floor inputs do not determine the
    /// motion of a rigid base, or a body can move without deforming a beam.
    pub fn new(machine: &Machine) -> Result<Self, MachineError> {
        let size = 6 * machine.bodies.len();
        let mut mass = DMatrix::zeros(size, size);
        let mut ride = MatrixXx6::zeros(size);
        for (i, body) in machine.bodies.iter().enumerate() {
            let m = Matrix3::from_diagonal_element(body.mass);
            mass.fixed_view_mut::<3, 3>(6 * i, 6 * i).copy_from(&m);
            mass.fixed_view_mut::<3, 3>(6 * i + 3, 6 * i + 3)
                .copy_from(&body.inertia);
            ride.fixed_view_mut::<6, 6>(6 * i, 0)
                .copy_from(&transport(&body.cog, &Vector3::zeros()));
        }
        let mut stiffness = DMatrix::zeros(size, size);
        let mut dampers = DMatrix::zeros(size, size);
        let mut losses = DMatrix::zeros(size, size);
        let deformations: Vec<_> = machine
            .beams
            .iter()
            .map(|beam| deformations_from_bodies(machine, beam))
            .collect();
        for (beam, rows) in machine.beams.iter().zip(&deformations) {
            let of_beam = rows.transpose() * deformation_stiffness(beam) * rows;
            losses += beam.loss_factor * &of_beam;
            stiffness += of_beam;
            dampers += beam.damper * rows.row(0).transpose() * rows.row(0);
        }
        let row = |d: &Deformation| deformations[d.beam].row(d.component);
        let coordinates =
            DMatrix::from_rows(&machine.coordinates.iter().map(row).collect::<Vec<_>>());
        let elongations =
            Matrix6xX::from_rows(&machine.actuators.map(|beam| deformations[beam].row(0)));
        let floor = Matrix6::from_rows(&machine.floor.each_ref().map(|input| {
            let at = machine.nodes[input.node].at;
            input.direction.transpose() * transport(&at, &Vector3::zeros()).fixed_rows::<3>(0)
        }));
        let mut model = Self {
            mass,
            stiffness,
            statics: Statics::default(),
            dampers,
            losses,
            damping: machine.damping,
            ride,
            floor,
            coordinates,
            elongations,
        };
        model
            .check(machine)
            .map_err(|fault| machine.locate(fault))?;
        // After the check, because the loads need a stiffness that is positive definite.
        if machine.gravity != Vector3::zeros() {
            model.statics = Statics::new(machine, &model.stiffness);
            model.stiffness += &model.statics.geometric;
        }
        Ok(model)
    }

    fn check(&self, machine: &Machine) -> Result<(), EntryError> {
        let length = reach(machine);
        if let Some(i) = dependent(&self.coordinates, length) {
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
        let modes = self.eigen();
        let (lowest, highest) = (modes.0[0], modes.0[modes.0.len() - 1]);
        // Rounding errors are about 1e-13 of the largest eigenvalue.
        if lowest <= 1e-10 * highest {
            let shape = modes.1.column(0);
            let heaviest = (0..machine.bodies.len())
                .map(|i| {
                    let part = shape.rows(6 * i, 6);
                    let block = self.mass.view((6 * i, 6 * i), (6, 6));
                    part.dot(&(block * part))
                })
                .enumerate()
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .map_or(0, |(i, _)| i);
            return Err(EntryError::new(
                format!("bodies.{}", machine.bodies[heaviest].name),
                "this body can move without deforming any stiff beam",
            )
            .fix("support it by more or stiffer beams"));
        }
        Ok(())
    }

    fn eigen(&self) -> (DVector<f64>, DMatrix<f64>) {
        generalised_eigen(&self.stiffness, &self.mass)
            .expect("every body's mass and inertia were checked to be positive definite")
    }

    /// The undamped modes, and the damping in modal coordinates.
    ///
    /// Damping is the sum of modal damping, Rayleigh damping, loss factors and dampers.
    pub fn modes(&self) -> Modes {
        let (squares, shapes) = self.eigen();
        let [alpha, beta] = self.damping.rayleigh;
        let mut damping = DMatrix::from_diagonal(&squares.map(|square| {
            2.0 * self.damping.modal * square.abs().sqrt() + alpha + beta * square.abs()
        }));
        // Without dampers the product would add rounding errors off the diagonal.
        if self.dampers.amax() > 0.0 {
            damping += shapes.transpose() * &self.dampers * &shapes;
        }
        // A loss factor η dissipates η times the peak strain energy per radian. So the relative
        // damping of a mode is half the mean of η, weighted by strain energy.
        for (i, shape) in shapes.column_iter().enumerate() {
            let lost = shape.dot(&(&self.losses * shape));
            if lost > 0.0 {
                damping[(i, i)] += lost / squares[i].abs().sqrt();
            }
        }
        Modes {
            squares,
            shapes,
            damping,
        }
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
            rheonomic: &back * &self.mass * &self.ride * floor,
            input: &back * self.elongations.transpose(),
            mass,
        }
    }

    /// R⁻¹, 6×6: the motion of the base, that is, the translation of the origin, m, and the
    /// rotation, rad, from the floor inputs q_r of Eq. (8), m.
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
        let mut motions = transport(&Vector3::zeros(), &(sum / count));
        for (mut column, part) in motions.column_iter_mut().skip(3).zip(&machine.rotation) {
            column *= *part;
        }
        self.floor * motions
    }

    /// The translation of a node along a direction, m, as two rows: 6n entries from body
    /// coordinates, zero for a base node, and six from base motion.
    ///
    /// The sum of both parts is the absolute translation.
    pub fn direction(&self, machine: &Machine, d: &Direction) -> (DVector<f64>, RowVector6<f64>) {
        let node = &machine.nodes[d.node];
        let mut relative = DVector::zeros(self.mass.nrows());
        if let Carrier::Body(body) = node.carrier {
            let row = d.direction.transpose()
                * transport(&node.at, &machine.bodies[body].cog).fixed_rows::<3>(0);
            relative.rows_mut(6 * body, 6).copy_from(&row.transpose());
        }
        let ride =
            d.direction.transpose() * transport(&node.at, &Vector3::zeros()).fixed_rows::<3>(0);
        (relative, ride)
    }

    /// The translation of a node relative to the base, m, for a motion of the bodies in body
    /// coordinates, 6n.
    pub fn translation(
        &self,
        machine: &Machine,
        node: usize,
        motion: &DVector<f64>,
    ) -> Vector3<f64> {
        let node = &machine.nodes[node];
        match node.carrier {
            Carrier::Base => Vector3::zeros(),
            Carrier::Body(body) => {
                transport(&node.at, &machine.bodies[body].cog).fixed_rows::<3>(0)
                    * motion.fixed_rows::<6>(6 * body)
            }
        }
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

    /// A deformation of a beam, m, as a row of 6n entries from body coordinates.
    pub fn deformation(&self, machine: &Machine, d: Deformation) -> DVector<f64> {
        deformations_from_bodies(machine, &machine.beams[d.beam])
            .row(d.component)
            .transpose()
    }
}
