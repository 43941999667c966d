//! The linear model of what vibrates, with or without control.

use core::ops::Range;

use nalgebra::allocator::Allocator;
use nalgebra::{
    DMatrix, DVector, DefaultAllocator, Dim, Dyn, Matrix6, MatrixXx6, OMatrix, RowVector6, U6,
    Vector3,
};

use super::beam::{beam_mass, deformation_stiffness, deformations, motions, stiffness_factor};
use super::flexible::Elastic;
use super::gravity::Statics;
use super::independence::{INDEPENDENT, centre, reach};
use super::inertia::Inertia;
use super::layout::{Follow, Layout, Owner, Point};
use super::spring;
use crate::machine::{
    Beam, Damping, Deformation, Direction, EntryError, FlexibleBody, MachineError, Spring,
    Structure,
};
use crate::numeric::eigen::factored_eigen;
use crate::numeric::motion::transport;

/// The linear model of a structure with N coordinates, Eq. (1) without leg forces;
/// [`super::multibody`] says which coordinates.
#[derive(Clone, Debug)]
pub struct StructureModel {
    /// M of Eq. (1), N×N, kg, kg m and kg m².
    pub mass: DMatrix<f64>,
    /// K of Eq. (1), N×N, N/m, N and N m: elastic, with that of springs of negative stiffness, plus
    /// the geometric stiffness under gravity.
    pub stiffness: DMatrix<f64>,
    /// Static loads under gravity and preload, and their geometric stiffness; empty without both.
    pub statics: Statics,
    /// Dampers along beams and in springs, and modal damping of flexible bodies, N×N, N s/m, N s and
    /// N m s.
    dampers: DMatrix<f64>,
    /// Σ η·K over the beams, flexible bodies and springs with loss factor η, N×N.
    losses: DMatrix<f64>,
    damping: Damping,
    /// Φ, N×6: motion of the machine from the motion of the base if nothing deforms. The base
    /// motion is the translation at C, the mean position of the nodes, m, and the rotation, rad.
    pub ride: MatrixXx6<f64>,
    /// M_b, N×6, kg, kg m and kg m²; `None` where no beam with mass ends on the base.
    pub(super) footing: Option<MatrixXx6<f64>>,
    /// C, m: the reference point of rigid motions.
    pub(super) centre: Vector3<f64>,
    pub(super) layout: Layout,
    /// B, with BᵀB the positive elastic stiffness, √(N/m): six rows for each element of each beam,
    /// then those of each flexible body, then six for each spring.
    factor: DMatrix<f64>,
    /// G, with −GᵀG the negative elastic stiffness, √(N/m): six rows for each spring.
    negative: DMatrix<f64>,
    /// The rows of B of each beam, then of each flexible body, then of each spring.
    rows: Vec<Range<usize>>,
    pub(super) inertia: Inertia,
    /// ω² and V, as in [`Modes`].
    eigen: (DVector<f64>, DMatrix<f64>),
}

/// The undamped modes of a machine with N coordinates, and the damping in modal coordinates.
///
/// There are N modes, less one for each motion without inertia: these follow the others
/// without a motion of their own.
#[derive(Clone, Debug)]
pub struct Modes {
    /// ω², rad²/s², one for each mode, ascending; negative for a mode that gravity or a
    /// negative stiffness makes unstable.
    pub squares: DVector<f64>,
    /// V, N rows: mode shapes as columns, with VᵀMV = 1.
    pub shapes: DMatrix<f64>,
    /// Δ = VᵀDV, 1/s. Diagonal unless there are dampers, or flexible bodies with modal damping.
    pub damping: DMatrix<f64>,
}

impl Modes {
    /// Natural frequencies, Hz, ascending. For an unstable mode, minus its rate of growth over 2π.
    pub fn hertz(&self) -> Vec<f64> {
        self.squares
            .iter()
            .map(|square| square.signum() * square.abs().sqrt() / core::f64::consts::TAU)
            .collect()
    }
}

/// Something without inertia: its entry in the file, a sentence about it, what an actuator does
/// to it, and what helps against that.
pub(super) struct Inert {
    pub(super) entry: String,
    pub(super) cause: String,
    pub(super) verb: &'static str,
    pub(super) fix: &'static str,
}

/// What is elastic, in the order of the rows of B.
pub(crate) enum Part<'a> {
    Beam(&'a Beam),
    Flexible(&'a FlexibleBody),
    Spring(&'a Spring),
}

impl<'a> Part<'a> {
    /// All parts of a machine.
    pub(crate) fn all(machine: &'a Structure) -> impl Iterator<Item = Self> {
        let flexible = machine.flexible.iter().map(Self::Flexible);
        let springs = machine.springs.iter().map(Self::Spring);
        machine
            .beams
            .iter()
            .map(Self::Beam)
            .chain(flexible)
            .chain(springs)
    }

    /// The name in the machine file.
    pub(crate) fn name(&self) -> &'a str {
        match self {
            Self::Beam(beam) => &beam.name,
            Self::Flexible(body) => &body.name,
            Self::Spring(spring) => &spring.name,
        }
    }
}

/// Modes whose ω² differ by this factor are the farthest apart that double precision resolves.
const FARTHEST: f64 = 1e18;

impl StructureModel {
    /// The model of `structure`.
    ///
    /// # Errors
    /// If a body can move and no beam, no spring and no weight holds it.
    pub fn new(structure: &Structure) -> Result<Self, MachineError> {
        let mut model = Self::assemble(structure);
        let held = model.hold(structure);
        held.map_err(|fault| structure.locate(fault))?;
        Ok(model)
    }

    /// Assembles M, D and K of Eq. (1). The modes are not there before [`hold`](Self::hold).
    pub(super) fn assemble(machine: &Structure) -> Self {
        let layout = Layout::new(machine);
        let size = layout.size();
        let centre = centre(machine);
        let mut mass = DMatrix::zeros(size, size);
        let mut ride = MatrixXx6::zeros(size);
        for (i, body) in machine.bodies.iter().enumerate() {
            mass.fixed_view_mut::<6, 6>(6 * i, 6 * i)
                .copy_from(&body.mass_matrix());
            ride.fixed_view_mut::<6, 6>(6 * i, 0)
                .copy_from(&transport(&body.cog, &centre));
        }
        let beams = 0..machine.beams.len();
        let along: Vec<_> = beams.map(|beam| layout.along(machine, beam)).collect();
        let own = (0..machine.nodes.len()).map(|node| *layout.node(node));
        let own = own.filter(|point| {
            point
                .follow
                .is_some_and(|at| layout.own().contains(&at.first))
        });
        let inner = along.iter().flat_map(|points| &points[1..points.len() - 1]);
        for point in own.chain(inner.copied()) {
            if let Some(follow) = point.follow {
                ride.fixed_view_mut::<6, 6>(follow.first, 0)
                    .copy_from(&transport(&point.at, &centre));
            }
        }
        let mut stiffness = DMatrix::zeros(size, size);
        let mut dampers = DMatrix::zeros(size, size);
        let mut losses = DMatrix::zeros(size, size);
        let mut footing = None;
        let mut spread = vec![false; size];
        let elements = machine
            .beams
            .iter()
            .map(|beam| beam.segments)
            .sum::<usize>();
        let elastic = machine.flexible.iter();
        let elastic = elastic
            .map(|body| body.stiffness.nrows() - 6)
            .sum::<usize>();
        let springs = machine.springs.len();
        let mut factor = DMatrix::zeros(6 * elements + elastic + 6 * springs, size);
        let mut negative = DMatrix::zeros(6 * springs, size);
        let mut rows = Vec::new();
        let mut next = 0;
        for (i, (beam, points)) in machine.beams.iter().zip(&along).enumerate() {
            let first = next;
            for (part, ends) in beam.elements().zip(points.windows(2)) {
                let deformed = deformations(&part, ends, size);
                let of_part = deformed.transpose() * deformation_stiffness(&part) * &deformed;
                losses += beam.loss_factor * &of_part;
                stiffness += of_part;
                factor
                    .rows_mut(next, 6)
                    .copy_from(&(stiffness_factor(&part) * deformed));
                next += 6;
                if part.mass > 0.0 {
                    let motions = motions(ends, size);
                    let momentum = motions.transpose() * beam_mass(&part);
                    for (i, point) in ends.iter().enumerate() {
                        match point.follow {
                            Some(follow) => spread[follow.first..follow.first + 6].fill(true),
                            None => {
                                let of_base = momentum.columns(6 * i, 6);
                                *footing.get_or_insert_with(|| MatrixXx6::zeros(size)) +=
                                    of_base * transport(&point.at, &centre);
                            }
                        }
                    }
                    mass += momentum * motions;
                }
            }
            rows.push(first..next);
            let whole = deformations(beam, &layout.ends(machine, i), size);
            dampers += beam.damper * whole.row(0).transpose() * whole.row(0);
        }
        for (i, body) in machine.flexible.iter().enumerate() {
            layout.add_of_flexible(machine, i, &body.mass, &mut mass);
            let elastic = Elastic::new(body);
            if body.modal_damping > 0.0 {
                let of_body = elastic.modal_damping(machine, body);
                layout.add_of_flexible(machine, i, &of_body, &mut dampers);
            }
            let of_body = elastic.factor;
            let first = next;
            next += of_body.nrows();
            let own = layout.flexible(machine, i);
            for (&i, column) in own.iter().zip(of_body.column_iter()) {
                spread[i] = true;
                factor
                    .view_mut((first, i), (column.len(), 1))
                    .copy_from(&column);
            }
            rows.push(first..next);
            let own_factor = factor.rows_range(first..next).into_owned();
            let elastic = own_factor.transpose() * own_factor;
            losses += body.loss_factor * &elastic;
            stiffness += elastic;
        }
        for (i, spring) in machine.springs.iter().enumerate() {
            let ends = spring.ends.map(|end| *layout.node(end));
            let relative = spring::relative(spring, &ends, size);
            let [stiff, soft] = [1.0, -1.0].map(|sign| spring::factor(spring, sign, &relative));
            let elastic = stiff.transpose() * &stiff;
            losses += spring.loss_factor * &elastic;
            stiffness += elastic - soft.transpose() * &soft;
            dampers += relative.transpose() * Matrix6::from_diagonal(&spring.damper) * &relative;
            factor.rows_mut(next, 6).copy_from(&stiff);
            negative.rows_mut(6 * i, 6).copy_from(&soft);
            rows.push(next..next + 6);
            next += 6;
        }
        for point in &machine.point_masses {
            if let Some(Follow { first, map }) = layout.node(point.node).follow {
                let mut block = mass.fixed_view_mut::<6, 6>(first, first);
                block += map.transpose() * point.body.mass_matrix() * map;
                spread[first..first + 6].fill(true);
            }
        }
        let inertia = Inertia::new(machine, &layout, &mass, &spread);
        Self {
            mass,
            stiffness,
            statics: Statics::default(),
            dampers,
            losses,
            damping: machine.damping.clone(),
            ride,
            footing,
            centre,
            layout,
            factor,
            negative,
            rows,
            inertia,
            eigen: (DVector::zeros(0), DMatrix::zeros(0, 0)),
        }
    }

    /// What has no inertia in `motion`, one of those without.
    pub(super) fn inert(&self, machine: &Structure, motion: &[f64]) -> Inert {
        let size = |from: usize| motion[from..from + 3].iter().map(|x| x * x).sum::<f64>();
        let most = |rotation: usize| {
            let sixes = 0..self.layout.owners().len();
            let order =
                |a: &usize, b: &usize| size(6 * a + rotation).total_cmp(&size(6 * b + rotation));
            sixes.max_by(order).unwrap_or(0)
        };
        let (turned, shifted) = (most(3), most(0));
        let rotates = size(6 * turned + 3) > 0.0;
        let owner = self.layout.owners()[if rotates { turned } else { shifted }];
        let entry = owner.entry(machine);
        if !rotates {
            return Inert {
                entry,
                cause: format!("{} has no mass", owner.subject()),
                verb: "moves it",
                fix: "let a body carry it, or give a beam that ends on it a mass",
            };
        }
        let turn = Vector3::from_column_slice(&motion[6 * turned + 3..6 * turned + 6]).normalize();
        // Adding zero turns -0.00 into 0.00.
        let parts = turn
            .iter()
            .map(|x| format!("{:.2}", (100.0 * x).round() / 100.0 + 0.0));
        let axis = parts.collect::<Vec<_>>().join(", ");
        let body = matches!(owner, Owner::Body(_));
        Inert {
            entry: if body {
                format!("{entry}.inertia")
            } else {
                entry
            },
            cause: format!(
                "a rotation of {} has no inertia, about [{axis}]",
                owner.subject()
            ),
            verb: "turns it",
            fix: "give it a small inertia, or move the end of the leg onto the axis",
        }
    }

    /// Finds the modes and the static loads, and checks that beams, springs or weight hold every
    /// body.
    pub(super) fn hold(&mut self, machine: &Structure) -> Result<(), EntryError> {
        let lengths = self.layout.lengths(machine);
        self.hold_turns(machine)?;
        self.eigen = self.natural();
        let free = self.free(&lengths);
        let preload = machine.beams.iter().map(|beam| beam.preload.abs());
        let preload = preload.fold(0.0, f64::max);
        // What loads the machine, as an acceleration of all of it.
        let loading = machine.gravity.norm() + preload / self.heaviest();
        if loading == 0.0 {
            return match free.first() {
                Some(&i) => Err(EntryError::new(
                    self.owner_of(i).entry(machine),
                    format!(
                        "{} can move without deforming any beam or spring that is stiff",
                        self.owner_of(i).subject()
                    ),
                )
                .fix("support it by more or stiffer beams or springs")),
                None => self.resolve(machine),
            };
        }
        let sag = self.sag(machine, &free)?;
        self.statics = Statics::new(machine, &self.layout, &sag);
        self.stiffness += &self.statics.geometric;
        self.hold_turns(machine)?;
        self.eigen = self.natural();
        let slow = 1e-6 * loading / reach(machine);
        let mut free = self.free(&lengths).into_iter();
        let free = free.find(|&i| self.eigen.0[i].abs() < slow);
        match free {
            Some(i) => Err(EntryError::new(
                self.owner_of(i).entry(machine),
                format!(
                    "{} can move without deforming any beam or spring, and its weight does not hold it either",
                    self.owner_of(i).subject()
                ),
            )
            .fix("support it by more beams or springs")),
            None => self.resolve(machine),
        }
    }

    /// Checks that beams or springs hold the motions without inertia.
    fn hold_turns(&self, machine: &Structure) -> Result<(), EntryError> {
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
        let motion = without * held.eigenvectors.column(softest);
        let inert = self.inert(machine, motion.as_slice());
        Err(EntryError::new(
            inert.entry,
            format!("{}, and no beam or spring holds it", inert.cause),
        )
        .fix("give it a small inertia, a beam with bending or torsional stiffness, or a spring with rotational_stiffness"))
    }

    /// Checks that double precision resolves the slowest mode beside the fastest.
    fn resolve(&self, machine: &Structure) -> Result<(), EntryError> {
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
        let energy = |rows: &Range<usize>| strain.rows_range(rows.clone()).norm_squared();
        let parts = Part::all(machine).zip(&self.rows);
        let stiffest = parts.max_by(|(_, a), (_, b)| energy(a).total_cmp(&energy(b)));
        let Some((part, _)) = stiffest else {
            return Ok(());
        };
        let joins = "make it less stiff, or make one body of what it joins";
        let (entry, what, fix) = match part {
            Part::Beam(beam) => (format!("beams.{}", beam.name), "beam", joins),
            Part::Flexible(body) => (
                format!("flexible_bodies.{}", body.name),
                "flexible body",
                "reduce it to fewer modes and nodes",
            ),
            Part::Spring(spring) => (format!("springs.{}", spring.name), "spring", joins),
        };
        let hertz = |square: f64| square.abs().sqrt() / core::f64::consts::TAU;
        Err(EntryError::new(
            entry,
            format!(
                "natural frequencies from {:.1e} to {:.1e} Hz are too far apart for double precision, and this {what} makes the highest",
                hertz(lowest),
                hertz(highest)
            ),
        )
        .fix(fix))
    }

    /// The modes that deform no beam, no flexible body and no spring, by index.
    fn free(&self, lengths: &DVector<f64>) -> Vec<usize> {
        let (squares, shapes) = &self.eigen;
        let highest = squares.amax();
        let rows: Vec<DVector<f64>> = self
            .factor
            .row_iter()
            .map(|row| row.transpose().component_div(lengths))
            .filter(|row| row.norm() > 0.0)
            .map(|row| row.normalize())
            .collect();
        (0..squares.len())
            // Where rounding of typed positions can be all that is stiff.
            .filter(|&i| squares[i].abs() <= 1e-10 * highest)
            .filter(|&i| {
                let shape = shapes.column(i).component_mul(lengths);
                let motion = INDEPENDENT * shape.norm();
                rows.iter().all(|row| row.dot(&shape).abs() <= motion)
            })
            .collect()
    }

    /// What has the most kinetic energy in a mode.
    fn owner_of(&self, mode: usize) -> Owner {
        let shape = self.eigen.1.column(mode);
        let energy = |i: usize| {
            let part = shape.rows(6 * i, 6);
            part.dot(&(self.mass.view((6 * i, 6 * i), (6, 6)) * part))
        };
        let sixes = 0..self.layout.owners().len();
        let heaviest = sixes.max_by(|&a, &b| energy(a).total_cmp(&energy(b)));
        self.layout.owners()[heaviest.unwrap_or(0)]
    }

    /// The largest mass of a translation, kg.
    fn heaviest(&self) -> f64 {
        let diagonal = self.mass.diagonal();
        let translations = diagonal.iter().enumerate();
        let translations = translations.filter(|(i, _)| i % 6 < 3);
        translations.map(|(_, mass)| *mass).fold(0.0, f64::max)
    }

    /// The static displacement x under gravity and preload, N, of the elastic machine; none
    /// along the `free` modes.
    fn sag(&self, machine: &Structure, free: &[usize]) -> Result<DVector<f64>, EntryError> {
        let (squares, shapes) = &self.eigen;
        let falls = RowVector6::from_fn(|_, i| if i < 3 { machine.gravity[i] } else { 0.0 });
        let falls = falls.transpose();
        let mut weight = &self.mass * (&self.ride * falls);
        if let Some(footing) = &self.footing {
            weight += footing * falls;
        }
        for (i, beam) in machine.beams.iter().enumerate() {
            if beam.preload != 0.0 {
                let size = self.layout.size();
                let elongation = deformations(beam, &self.layout.ends(machine, i), size);
                weight -= elongation.row(0).transpose() * beam.preload;
            }
        }
        let push = shapes.transpose() * weight;
        let mut sag = DVector::zeros(shapes.nrows());
        for (i, shape) in shapes.column_iter().enumerate() {
            if !free.contains(&i) {
                sag.axpy(push[i] / squares[i], &shape, 1.0);
            } else if push[i].abs() > 10.0 * INDEPENDENT * push.norm() {
                return Err(EntryError::new(
                    self.owner_of(i).entry(machine),
                    format!(
                        "{} falls: no beam or spring carries its weight",
                        self.owner_of(i).subject()
                    ),
                )
                .fix("support it by more beams or springs"));
            }
        }
        Ok(sag)
    }

    /// ω² and V of the undamped modes, with VᵀMV = 1 and the largest entry of each shape positive.
    ///
    /// What has no inertia follows statically.
    fn natural(&self) -> (DVector<f64>, DMatrix<f64>) {
        let Inertia { with, without } = &self.inertia;
        let mut basis = with.clone();
        if without.ncols() > 0 {
            let held = without.transpose() * &self.stiffness * without;
            let pull = without.transpose() * &self.stiffness * with;
            let follow = held.lu().solve(&pull);
            basis -= without * follow.expect("these motions were checked to be held");
        }
        let mut rest = None;
        if self.negative.nrows() > 0 {
            let soft = &self.negative * &basis;
            rest = Some(-(soft.transpose() * soft));
        }
        let geometric = &self.statics.geometric;
        if geometric.nrows() > 0 {
            let geometric = basis.transpose() * geometric * &basis;
            rest = Some(match rest {
                Some(negative) => negative + geometric,
                None => geometric,
            });
        }
        let (squares, turned) = factored_eigen(&(&self.factor * &basis), rest.as_ref());
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
        let mut damping = DMatrix::from_diagonal(&DVector::from_fn(squares.len(), |i, _| {
            let ratio = *self.damping.modes.get(i).unwrap_or(&self.damping.modal);
            let square = squares[i].abs();
            2.0 * ratio * square.sqrt() + alpha + beta * square
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

    /// `rows`·P, k×6: the momentum of the motions that are the k `rows` of N entries, with the
    /// machine riding on the base at 1 m/s and 1 rad/s.
    pub(crate) fn momentum<R: Dim>(&self, rows: &OMatrix<f64, R, Dyn>) -> OMatrix<f64, R, U6>
    where
        DefaultAllocator: Allocator<R, Dyn> + Allocator<R, U6>,
    {
        let of_machine = rows * &self.mass * &self.ride;
        match &self.footing {
            Some(footing) => of_machine + rows * footing,
            None => of_machine,
        }
    }

    /// N×6: the machine moves as one rigid body with the base, except for the nodes of beams that
    /// no body carries, which follow statically with the base at rest. [`ride`](Self::ride) if
    /// there are none. `None` if nothing holds these nodes.
    pub(crate) fn as_one_body(&self, machine: &Structure) -> Option<MatrixXx6<f64>> {
        let mut shapes = self.ride.clone();
        let own = self.layout.of_beams(machine);
        if !own.is_empty() {
            for &i in &own {
                shapes.row_mut(i).fill(0.0);
            }
            let rows = self.stiffness.select_rows(&own);
            let pull = &rows * &shapes;
            let follow = rows.select_columns(&own).lu().solve(&pull)?;
            for (&i, row) in own.iter().zip(follow.row_iter()) {
                shapes.set_row(i, &-row);
            }
        }
        Some(shapes)
    }

    /// Twice the strain energy, J, of the part with this index in the motions `x`, as columns, all
    /// added; that of a negative stiffness is negative.
    ///
    /// Parts are the beams, then the flexible bodies, then the springs.
    pub(crate) fn strain(&self, machine: &Structure, part: usize, x: &DMatrix<f64>) -> f64 {
        let stiff = (self.factor.rows_range(self.rows[part].clone()) * x).norm_squared();
        let springs = machine.beams.len() + machine.flexible.len();
        match part.checked_sub(springs) {
            Some(spring) => stiff - (self.negative.rows(6 * spring, 6) * x).norm_squared(),
            None => stiff,
        }
    }

    /// The points of a beam, by its index, from P to Q.
    pub(crate) fn along(&self, machine: &Structure, beam: usize) -> Vec<Point> {
        self.layout.along(machine, beam)
    }

    /// A node of the machine, by its index.
    pub(crate) fn node(&self, node: usize) -> &Point {
        self.layout.node(node)
    }

    /// The coordinates of a flexible body, by its index, in the order of its matrices.
    pub(crate) fn flexible(&self, machine: &Structure, body: usize) -> Vec<usize> {
        self.layout.flexible(machine, body)
    }

    /// What the coordinates belong to, six by six, those of modes left out.
    pub(crate) fn owners(&self) -> &[Owner] {
        self.layout.owners()
    }

    /// The translation of a node along a direction, m, as two rows: N entries from x, zero for a
    /// base node, and six from base motion.
    ///
    /// The sum of both parts is the absolute translation.
    pub fn direction(&self, machine: &Structure, d: &Direction) -> (DVector<f64>, RowVector6<f64>) {
        let node = &machine.nodes[d.node];
        let relative = self.motion(d, 0);
        let ride = d.direction.transpose() * transport(&node.at, &self.centre).fixed_rows::<3>(0);
        (relative, ride)
    }

    /// The rotation of a node relative to the base about an axis, rad, as a row of N entries from x:
    /// zero for a base node.
    pub(crate) fn rotation(&self, d: &Direction) -> DVector<f64> {
        self.motion(d, 3)
    }

    /// The motion of a node relative to the base along or about a direction, as a row of N entries
    /// from x; `first` is that of the node's coordinates, 0 for translations, 3 for rotations.
    fn motion(&self, d: &Direction, first: usize) -> DVector<f64> {
        let mut relative = DVector::zeros(self.mass.nrows());
        if let Some(follow) = self.layout.node(d.node).follow {
            let row = d.direction.transpose() * follow.map.fixed_rows::<3>(first);
            relative
                .rows_mut(follow.first, 6)
                .copy_from(&row.transpose());
        }
        relative
    }

    /// The translation of a node relative to the base, m, for a motion x of the machine, N.
    pub fn translation(&self, node: usize, motion: &DVector<f64>) -> Vector3<f64> {
        match self.layout.node(node).follow {
            None => Vector3::zeros(),
            Some(follow) => follow.map.fixed_rows::<3>(0) * motion.fixed_rows::<6>(follow.first),
        }
    }

    /// A deformation of a beam between its ends, m, as a row of N entries from x.
    pub fn deformation(&self, machine: &Structure, d: Deformation) -> DVector<f64> {
        let ends = self.layout.ends(machine, d.beam);
        deformations(&machine.beams[d.beam], &ends, self.layout.size())
            .row(d.component)
            .transpose()
    }
}
