//! The linear multibody model: rigid bodies and Euler–Bernoulli beams on a moving base.
//!
//! Body coordinates x are, for each body, the translation of its centre of gravity, m, and its
//! rotation, rad, both relative to a frame that moves with the base. n bodies have 6n
//! coordinates. The base motion b is the translation of its point at C, m, and its rotation, rad;
//! C is the mean position of the nodes.
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

use super::beam::{deformation_stiffness, deformations_from_bodies, stiffness_factor, transport};
use super::gravity::Statics;
use super::independence::{INDEPENDENT, centre, dependent, follows_from, reach};
use crate::machine::{Carrier, Damping, Deformation, Direction, EntryError, Machine, MachineError};
use crate::numeric::eigen::factored_eigen;
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
    /// motion is the translation at C, the mean position of the nodes, m, and the rotation, rad.
    pub ride: MatrixXx6<f64>,
    /// R, 6×6: displacements q_r of the floor inputs, m, from base motion, that is, the
    /// translation at C, m, and the rotation, rad. Between their accelerations, of which q̈_r is
    /// Eq. (8), the matrix is the same.
    pub floor: Matrix6<f64>,
    /// E_d, 6n×6n: the degrees of freedom q_d of Eq. (7), m, from body coordinates.
    pub coordinates: DMatrix<f64>,
    /// E, 6×6n: elongations e1 of the legs, m, from body coordinates. Rows are in the order of
    /// the actuators.
    pub elongations: Matrix6xX<f64>,
    /// C, m: the reference point of rigid motions.
    centre: Vector3<f64>,
    /// B, with BᵀB the elastic stiffness in body coordinates: six rows for each beam, √(N/m).
    factor: DMatrix<f64>,
    inertia: Inertia,
    /// ω² and V, as in [`Modes`].
    eigen: (DVector<f64>, DMatrix<f64>),
}

/// Body coordinates, with and without inertia.
#[derive(Clone, Debug)]
struct Inertia {
    /// X as columns, with XᵀMX = 1.
    with: DMatrix<f64>,
    /// The rotations without inertia, of point masses and thin rods, as columns.
    without: DMatrix<f64>,
}

/// A principal moment of inertia, relative to the body's largest one and to its mass times the
/// square of the machine's size, that counts as zero.
const NO_INERTIA: f64 = 1e-12;

impl Inertia {
    fn new(machine: &Machine) -> Self {
        let size = 6 * machine.bodies.len();
        let length = reach(machine);
        let (mut with, mut without) = (Vec::new(), Vec::new());
        for (i, body) in machine.bodies.iter().enumerate() {
            for axis in 0..3 {
                let mut column = DVector::zeros(size);
                column[6 * i + axis] = 1.0 / body.mass.sqrt();
                with.push(column);
            }
            let (moments, axes) = body.principal();
            let scale = moments.amax().max(body.mass * length * length);
            for (moment, axis) in moments.iter().zip(axes.column_iter()) {
                let none = *moment <= NO_INERTIA * scale;
                let mut column = DVector::zeros(size);
                let size = if none { 1.0 } else { moment.sqrt() };
                column.rows_mut(6 * i + 3, 3).copy_from(&(axis / size));
                if none { &mut without } else { &mut with }.push(column);
            }
        }
        let columns = |all: Vec<DVector<f64>>| match &all[..] {
            [] => DMatrix::zeros(size, 0),
            all => DMatrix::from_columns(all),
        };
        Self {
            with: columns(with),
            without: columns(without),
        }
    }
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
///
/// There are 6n modes, less one for each rotation without inertia: these follow the others
/// without a motion of their own.
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

/// Modes whose ω² differ by this factor are the farthest apart that double precision resolves.
const FARTHEST: f64 = 1e18;

/// The body that turns most in a motion in body coordinates.
fn turning(motion: &[f64]) -> usize {
    let size = |i: &usize| {
        motion[6 * i + 3..6 * i + 6]
            .iter()
            .map(|x| x * x)
            .sum::<f64>()
    };
    let bodies = 0..motion.len() / 6;
    bodies
        .max_by(|a, b| size(a).total_cmp(&size(b)))
        .unwrap_or(0)
}

/// The axis about which that body turns, as text.
fn axis(motion: &[f64]) -> String {
    let body = turning(motion);
    let turn = Vector3::from_column_slice(&motion[6 * body + 3..6 * body + 6]).normalize();
    // Adding zero turns -0.00 into 0.00.
    let parts = turn
        .iter()
        .map(|x| format!("{:.2}", (100.0 * x).round() / 100.0 + 0.0));
    parts.collect::<Vec<_>>().join(", ")
}

impl Multibody {
    /// Assembles M, D and K of Eq. (1), the degrees of freedom q_d of Eq. (7), and the
    /// displacements q_r whose accelerations q̈_r are the floor inputs of Eq. (8).
    ///
    /// # Errors
    /// If the deformations in q_d depend on each other, the floor inputs do not determine the
    /// motion of a rigid base, or a body can move and neither a beam nor its weight holds it.
    pub fn new(machine: &Machine) -> Result<Self, MachineError> {
        let size = 6 * machine.bodies.len();
        let centre = centre(machine);
        let mut mass = DMatrix::zeros(size, size);
        let mut ride = MatrixXx6::zeros(size);
        for (i, body) in machine.bodies.iter().enumerate() {
            let m = Matrix3::from_diagonal_element(body.mass);
            mass.fixed_view_mut::<3, 3>(6 * i, 6 * i).copy_from(&m);
            mass.fixed_view_mut::<3, 3>(6 * i + 3, 6 * i + 3)
                .copy_from(&body.inertia);
            ride.fixed_view_mut::<6, 6>(6 * i, 0)
                .copy_from(&transport(&body.cog, &centre));
        }
        let mut stiffness = DMatrix::zeros(size, size);
        let mut dampers = DMatrix::zeros(size, size);
        let mut losses = DMatrix::zeros(size, size);
        let mut factor = DMatrix::zeros(6 * machine.beams.len(), size);
        let deformations: Vec<_> = machine
            .beams
            .iter()
            .map(|beam| deformations_from_bodies(machine, beam))
            .collect();
        for (i, (beam, rows)) in machine.beams.iter().zip(&deformations).enumerate() {
            let of_beam = rows.transpose() * deformation_stiffness(beam) * rows;
            losses += beam.loss_factor * &of_beam;
            stiffness += of_beam;
            dampers += beam.damper * rows.row(0).transpose() * rows.row(0);
            factor
                .rows_mut(6 * i, 6)
                .copy_from(&(stiffness_factor(beam) * rows));
        }
        let row = |d: &Deformation| deformations[d.beam].row(d.component);
        let coordinates =
            DMatrix::from_rows(&machine.coordinates.iter().map(row).collect::<Vec<_>>());
        let elongations =
            Matrix6xX::from_rows(&machine.actuators.map(|beam| deformations[beam].row(0)));
        let floor = Matrix6::from_rows(&machine.floor.each_ref().map(|input| {
            let at = machine.nodes[input.node].at;
            input.direction.transpose() * transport(&at, &centre).fixed_rows::<3>(0)
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
            centre,
            factor,
            inertia: Inertia::new(machine),
            eigen: (DVector::zeros(0), DMatrix::zeros(0, 0)),
        };
        let checked = model.check(machine).and_then(|()| model.hold(machine));
        checked.map_err(|fault| machine.locate(fault))?;
        Ok(model)
    }

    /// The arrangement, without stiffness.
    fn check(&self, machine: &Machine) -> Result<(), EntryError> {
        let length = reach(machine);
        if let Some(i) = dependent(&self.coordinates, length) {
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
        // A leg that turned a body without inertia would answer at once, with an acceleration
        // like that of the force.
        let turned = &self.elongations * &self.inertia.without;
        for (leg, row) in turned.row_iter().enumerate() {
            if row.amax() > 1e-9 * length {
                let turn = self.inertia.without.column(row.transpose().iamax());
                let leg = &machine.beams[machine.actuators[leg]].name;
                return Err(EntryError::new(
                    format!("bodies.{}.inertia", machine.bodies[turning(turn.as_slice())].name),
                    format!(
                        "a rotation of this body has no inertia, about [{}], and the actuator in \"{leg}\" turns it",
                        axis(turn.as_slice())
                    ),
                )
                .fix("give it a small inertia, or move the end of the leg onto the axis"));
            }
        }
        Ok(())
    }

    /// Finds the modes and the static loads, and checks that beams or weight hold every body.
    fn hold(&mut self, machine: &Machine) -> Result<(), EntryError> {
        let length = reach(machine);
        self.hold_turns(machine)?;
        self.eigen = self.natural();
        let free = self.free(length);
        let gravity = machine.gravity.norm();
        if gravity == 0.0 {
            return match free.first() {
                Some(&i) => Err(EntryError::new(
                    self.entry_of(machine, i),
                    "this body can move without deforming any beam that is stiff",
                )
                .fix("support it by more or stiffer beams")),
                None => self.resolve(machine),
            };
        }
        let sag = self.sag(machine, &free)?;
        self.statics = Statics::new(machine, &sag);
        self.stiffness += &self.statics.geometric;
        self.hold_turns(machine)?;
        self.eigen = self.natural();
        let slow = 1e-6 * gravity / length;
        let mut free = self.free(length).into_iter();
        let free = free.find(|&i| self.eigen.0[i].abs() < slow);
        match free {
            Some(i) => Err(EntryError::new(
                self.entry_of(machine, i),
                "this body can move without deforming any beam, and its weight does not hold it either",
            )
            .fix("support it by more beams")),
            None => self.resolve(machine),
        }
    }

    /// Checks that beams hold the rotations without inertia.
    fn hold_turns(&self, machine: &Machine) -> Result<(), EntryError> {
        let without = &self.inertia.without;
        if without.ncols() == 0 {
            return Ok(());
        }
        let held = without.transpose() * &self.stiffness * without;
        let scale = self.stiffness.diagonal().amax();
        let held = held.symmetric_eigen();
        let softest = held.eigenvalues.imin();
        if held.eigenvalues[softest] > 1e-14 * scale {
            return Ok(());
        }
        let turn = without * held.eigenvectors.column(softest);
        Err(EntryError::new(
            format!(
                "bodies.{}.inertia",
                machine.bodies[turning(turn.as_slice())].name
            ),
            format!(
                "a rotation of this body has no inertia, about [{}], and no beam holds it",
                axis(turn.as_slice())
            ),
        )
        .fix("give it a small inertia, or a beam with bending or torsional stiffness"))
    }

    /// Checks that double precision resolves the slowest mode beside the fastest.
    fn resolve(&self, machine: &Machine) -> Result<(), EntryError> {
        let (squares, shapes) = &self.eigen;
        let (lowest, highest) = (
            squares.iter().fold(f64::INFINITY, |a, x| a.min(x.abs())),
            squares.amax(),
        );
        if lowest > highest / FARTHEST {
            return Ok(());
        }
        let shape = shapes.column(squares.len() - 1);
        let strain = &self.factor * shape;
        let beam = (0..machine.beams.len()).max_by(|&a, &b| {
            let energy = |beam: usize| strain.rows(6 * beam, 6).norm_squared();
            energy(a).total_cmp(&energy(b))
        });
        let hertz = |square: f64| square.abs().sqrt() / core::f64::consts::TAU;
        Err(EntryError::new(
            format!("beams.{}", machine.beams[beam.unwrap_or(0)].name),
            format!(
                "natural frequencies from {:.1e} to {:.1e} Hz are too far apart for double precision, and this beam makes the highest",
                hertz(lowest),
                hertz(highest)
            ),
        )
        .fix("make it less stiff, or make one body of what it joins"))
    }

    /// The modes that deform no beam, by index.
    fn free(&self, length: f64) -> Vec<usize> {
        let (squares, shapes) = &self.eigen;
        let highest = squares.amax();
        let scale = |x: &mut [f64], by: f64| {
            for rotation in x.chunks_exact_mut(6) {
                rotation[3..].iter_mut().for_each(|x| *x *= by);
            }
        };
        let rows: Vec<DVector<f64>> = self
            .factor
            .row_iter()
            .map(|row| {
                let mut row = row.transpose();
                scale(row.as_mut_slice(), 1.0 / length);
                row
            })
            .filter(|row| row.norm() > 0.0)
            .map(|row| row.normalize())
            .collect();
        (0..squares.len())
            // Where rounding of typed positions can be all that is stiff.
            .filter(|&i| squares[i].abs() <= 1e-10 * highest)
            .filter(|&i| {
                let mut shape = shapes.column(i).into_owned();
                scale(shape.as_mut_slice(), length);
                let motion = INDEPENDENT * shape.norm();
                rows.iter().all(|row| row.dot(&shape).abs() <= motion)
            })
            .collect()
    }

    /// The entry of the body with the most kinetic energy in a mode.
    fn entry_of(&self, machine: &Machine, mode: usize) -> String {
        let shape = self.eigen.1.column(mode);
        let energy = |i: usize| {
            let part = shape.rows(6 * i, 6);
            part.dot(&(self.mass.view((6 * i, 6 * i), (6, 6)) * part))
        };
        let bodies = 0..machine.bodies.len();
        let heaviest = bodies.max_by(|&a, &b| energy(a).total_cmp(&energy(b)));
        format!("bodies.{}", machine.bodies[heaviest.unwrap_or(0)].name)
    }

    /// The static displacement under gravity in body coordinates, 6n, of the elastic machine; none
    /// along the `free` modes.
    fn sag(&self, machine: &Machine, free: &[usize]) -> Result<DVector<f64>, EntryError> {
        let (squares, shapes) = &self.eigen;
        let mut weight = DVector::zeros(shapes.nrows());
        for (i, body) in machine.bodies.iter().enumerate() {
            weight
                .rows_mut(6 * i, 3)
                .copy_from(&(machine.gravity * body.mass));
        }
        let push = shapes.transpose() * weight;
        let mut sag = DVector::zeros(shapes.nrows());
        for (i, shape) in shapes.column_iter().enumerate() {
            if !free.contains(&i) {
                sag.axpy(push[i] / squares[i], &shape, 1.0);
            } else if push[i].abs() > 10.0 * INDEPENDENT * push.norm() {
                return Err(EntryError::new(
                    self.entry_of(machine, i),
                    "this body falls: no beam carries its weight",
                )
                .fix("support it by more beams"));
            }
        }
        Ok(sag)
    }

    /// ω² and V of the undamped modes, with VᵀMV = 1 and the largest entry of each shape positive.
    ///
    /// Rotations without inertia follow statically.
    fn natural(&self) -> (DVector<f64>, DMatrix<f64>) {
        let Inertia { with, without } = &self.inertia;
        let mut basis = with.clone();
        if without.ncols() > 0 {
            let held = without.transpose() * &self.stiffness * without;
            let pull = without.transpose() * &self.stiffness * with;
            let follow = held.lu().solve(&pull);
            basis -= without * follow.expect("these rotations were checked to be held");
        }
        let geometric = &self.statics.geometric;
        let geometric = (geometric.nrows() > 0).then(|| basis.transpose() * geometric * &basis);
        let (squares, turned) = factored_eigen(&(&self.factor * &basis), geometric.as_ref());
        let mut shapes = basis * turned;
        for mut shape in shapes.column_iter_mut() {
            if shape[shape.icamax()] < 0.0 {
                shape.neg_mut();
            }
        }
        (squares, shapes)
    }

    /// The undamped modes, and the damping in modal coordinates.
    ///
    /// Damping is the sum of modal damping, Rayleigh damping, loss factors and dampers.
    pub fn modes(&self) -> Modes {
        let (squares, shapes) = self.eigen.clone();
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
        let ride = d.direction.transpose() * transport(&node.at, &self.centre).fixed_rows::<3>(0);
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
