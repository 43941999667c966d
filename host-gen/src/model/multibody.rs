//! Rigid bodies and Euler–Bernoulli beams on a moving base, linearised.
//!
//! Body coordinates x hold, for each body, the translation of its centre of
//! gravity and its rotation, six numbers, relative to where the moving base
//! carries it. Deformations depend on x alone; with the base motion b
//! (translation of the origin and rotation) the absolute motion is x + Φ b and
//!
//! ```text
//! M·ẍ + K·x = −M·Φ·b̈ + Eᵀσ
//! ```
//!
//! The chosen deformations q_d = E_d·x turn this into Eq. (2). The floor inputs
//! q_r are six motions on the base, q_r = R·b.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Matrix6xX, MatrixXx6, RowVector6, Vector3};

use super::beam::{deformation_stiffness, deformations_from_bodies, transport};
use super::gravity::Statics;
use super::independence::{dependent, reach};
use crate::machine::{Carrier, Damping, Deformation, Direction, EntryError, Machine, MachineError};
use crate::numeric::eigen::generalised_eigen;
use crate::numeric::six::to_dynamic;

/// The linear model of a machine.
#[derive(Clone, Debug)]
pub struct Multibody {
    /// M in body coordinates, 6n×6n, kg and kg m².
    pub mass: DMatrix<f64>,
    /// K in body coordinates, 6n×6n: elastic, and under gravity geometric too.
    pub stiffness: DMatrix<f64>,
    /// Static loads, and the geometric stiffness they make.
    pub statics: Statics,
    /// Dampers along beams, in body coordinates, 6n×6n.
    dampers: DMatrix<f64>,
    /// Σ η·K of the beams with loss factor η.
    losses: DMatrix<f64>,
    damping: Damping,
    /// Φ, 6n×6: body motion when the base moves and nothing deforms.
    pub ride: MatrixXx6<f64>,
    /// R, 6×6: floor inputs from base motion.
    pub floor: Matrix6<f64>,
    /// E_d, 6n×6n: q_d from body coordinates.
    pub coordinates: DMatrix<f64>,
    /// Elongations e1 of the actuated beams from body coordinates, 6×6n.
    pub elongations: Matrix6xX<f64>,
}

/// The machine in the form of Eq. (2).
#[derive(Clone, Debug)]
pub struct EquationOfMotion {
    /// M_d, kg.
    pub mass: DMatrix<f64>,
    /// D_d, N s/m.
    pub damping: DMatrix<f64>,
    /// K_d, N/m.
    pub stiffness: DMatrix<f64>,
    /// M_r, 6n×6, kg.
    pub rheonomic: MatrixXx6<f64>,
    /// B_0, 6n×6.
    pub input: MatrixXx6<f64>,
}

/// The undamped modes, and how damping acts on them.
#[derive(Clone, Debug)]
pub struct Modes {
    /// ω², rad²/s², ascending. Negative where gravity makes the machine fall.
    pub squares: DVector<f64>,
    /// Shapes in body coordinates as columns, VᵀMV = 1.
    pub shapes: DMatrix<f64>,
    /// Δ = VᵀDV, 1/s: diagonal but for dampers along beams.
    pub damping: DMatrix<f64>,
}

impl Modes {
    /// Natural frequencies, Hz; negative for the rate of a mode that falls.
    pub fn hertz(&self) -> Vec<f64> {
        self.squares
            .iter()
            .map(|square| square.signum() * square.abs().sqrt() / core::f64::consts::TAU)
            .collect()
    }
}

impl Multibody {
    /// Assembles the model and checks that the arrangement can be described by
    /// the chosen coordinates and moved by the floor inputs.
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
        // After the check: without gravity nothing may be loose.
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
                    "dependent degrees of freedom: \"{}\" follows from those before it; choose another deformation",
                    machine.deformation_name(machine.coordinates[i])
                ),
            ));
        }
        if let Some(i) = dependent(&to_dynamic(&self.floor), length) {
            return Err(EntryError::new(
                format!("floor.inputs.{}", machine.floor[i].name),
                "follows from the inputs before it; the six must fix the motion of a rigid base",
            ));
        }
        let modes = self.eigen();
        let (lowest, highest) = (modes.0[0], modes.0[modes.0.len() - 1]);
        // Rounding leaves some 1e-13 of the largest.
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
                "can move without deforming any beam that is stiff; hold it by more beams or stiffer ones",
            ));
        }
        Ok(())
    }

    fn eigen(&self) -> (DVector<f64>, DMatrix<f64>) {
        generalised_eigen(&self.stiffness, &self.mass)
            .expect("every body's mass and inertia were checked to be positive definite")
    }

    /// The undamped modes of the machine.
    pub fn modes(&self) -> Modes {
        let (squares, shapes) = self.eigen();
        let [alpha, beta] = self.damping.rayleigh;
        let mut damping = DMatrix::from_diagonal(&squares.map(|square| {
            2.0 * self.damping.modal * square.abs().sqrt() + alpha + beta * square.abs()
        }));
        // Exactly diagonal where there are no dampers.
        if self.dampers.amax() > 0.0 {
            damping += shapes.transpose() * &self.dampers * &shapes;
        }
        // A loss factor takes η times the strain energy per radian: a mode's
        // damping is half the mean of η over its strain energy.
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

    /// Eq. (2).
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

    /// R⁻¹: base motion from the floor inputs.
    pub fn floor_inverse(&self) -> Matrix6<f64> {
        self.floor
            .try_inverse()
            .expect("the floor inputs were checked to be independent")
    }

    /// The translation of a node along a direction: its row from body
    /// coordinates (zero for a base node), and its row from base motion.
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

    /// The translation of a node in a motion of the bodies.
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

    /// The mean translation along an axis, 0 to 2, of the ends of the actuated
    /// legs that are not on the base, as [`Multibody::direction`] gives it.
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
        // Independent legs have an end on a body: checked before.
        (sum.0 / count, sum.1 / count)
    }

    /// A deformation's row from body coordinates.
    pub fn deformation(&self, machine: &Machine, d: Deformation) -> DVector<f64> {
        deformations_from_bodies(machine, &machine.beams[d.beam])
            .row(d.component)
            .transpose()
    }
}
