//! The cost of the synthesis: barriers of all terms of all machines, with gradient and curvature.

use core::f64::consts::FRAC_PI_2;

use nalgebra::{Complex, DMatrix, DVector};
use rayon::prelude::*;
use shared::LEGS;

use super::barrier::{Curvature, LevelCurvature};
use super::parameters::{GroupFilters, MOST_PER_GROUP, Parameters};
use super::points::{Goal, Limits, Openings, Point, PointCost, Purpose, Widening};
use crate::numeric::loci::{Eigenvalues, continued};

/// What the variables are besides the parameters, and what is minimised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// One level: the logarithm of the factor by which all limits are widened.
    Feasibility,
    /// A level for each band, and an upper limit of these. Or no level, and the mean square.
    Performance,
}

/// The loop of a machine, with limits that also some points of perturbed machines must keep.
pub(super) struct Problem<const K: usize> {
    pub(super) parameters: Parameters,
    pub(super) openings: Openings,
    pub(super) limits: Limits,
    /// The points of the machine that is designed; those of the loop first, in ascending frequency.
    pub(super) points: Vec<Point<K>>,
    /// Points of the loops of perturbed machines.
    pub(super) beside: Vec<Point<K>>,
    /// Number of levels in the stage of performance.
    pub(super) levels: usize,
}

/// The curves of the eigenvalues of L over frequency.
#[derive(Default)]
struct Loci {
    /// The last ones; zero at first, because AC coupling makes the loop gain zero at z = 1.
    before: Eigenvalues,
    /// The angle by which all 1 + λ have turned.
    turned: f64,
}

impl Loci {
    /// Goes on to `eigenvalues`; whether one crosses the real axis below −1 on its way there.
    fn crosses(&mut self, eigenvalues: Eigenvalues) -> bool {
        let to = continued(&self.before, &eigenvalues);
        let mut crosses = false;
        for (a, b) in self.before.iter().zip(&to) {
            self.turned += ((b + 1.0) / (a + 1.0)).arg();
            // Where the chord meets the real axis.
            let across = (a.im < 0.0) != (b.im < 0.0);
            crosses |= across && (a.re * b.im - b.re * a.im) / (b.im - a.im) < -1.0;
        }
        self.before = to;
        crosses
    }

    /// Whether they encircle −1. Plant and controller are stable, so a stable loop's do not.
    fn encircle(&self) -> bool {
        self.turned.abs() > FRAC_PI_2
    }
}

/// A cost with its gradient and curvature.
pub(super) struct Expansion {
    pub(super) value: f64,
    pub(super) gradient: DVector<f64>,
    pub(super) curvature: DMatrix<f64>,
}

/// Part of the mean level beside the highest one in the cost.
const MEAN: f64 = 0.5;

/// Limits on a part of the points, as a part of those on all.
const BETWEEN: f64 = 0.97;

/// Points that are summed in one go: sums do not depend on the number of processors.
const CHUNK: usize = 16;

/// The sums of a chunk of points.
struct Sums {
    terms: Expansion,
    square: Option<Expansion>,
    eigenvalues: Vec<Eigenvalues>,
}

impl Expansion {
    fn zero(n: usize) -> Self {
        Self {
            value: 0.0,
            gradient: DVector::zeros(n),
            curvature: DMatrix::zeros(n, n),
        }
    }

    fn add(&mut self, other: &Self) {
        self.value += other.value;
        self.gradient += &other.gradient;
        self.curvature += &other.curvature;
    }
}

/// The channel gains at a point, and the derivatives of their logarithms: for each group and kind
/// of sensors, by the parameters of the group.
struct Channels<const K: usize> {
    gains: [Complex<f64>; K],
    slopes: Vec<[Complex<f64>; MOST_PER_GROUP]>,
}

/// Channels with equal gains: those of a group with one kind of sensors.
struct Slot {
    group: usize,
    channels: core::ops::Range<usize>,
}

impl<const K: usize> Problem<K> {
    const KINDS: usize = K / LEGS;

    fn channels(&self, filters: &[GroupFilters], point: &Point<K>) -> Channels<K> {
        let n = self.parameters.per_group();
        let mut gains = point.base;
        let mut all = Vec::with_capacity(filters.len() * Self::KINDS);
        for (group, filters) in self.parameters.groups.iter().zip(filters) {
            let mut slopes = [Complex::ZERO; MOST_PER_GROUP];
            let count = n - usize::from(self.parameters.both);
            let product = filters.sections(point.delta, &mut slopes[..count]);
            let split = filters.split(point.delta);
            for (kind, (factor, slope)) in split.into_iter().take(Self::KINDS).enumerate() {
                for mode in group.clone() {
                    gains[kind * LEGS + mode] *= product * factor;
                }
                let mut own = slopes;
                if self.parameters.both {
                    own[n - 1] = slope;
                }
                all.push(own);
            }
        }
        Channels { gains, slopes: all }
    }

    /// The slots, in the order of [`Channels::slopes`].
    fn slots(&self) -> Vec<Slot> {
        let groups = self.parameters.groups.iter().enumerate();
        groups
            .flat_map(|(group, modes)| {
                (0..Self::KINDS).map(move |kind| {
                    let first = kind * LEGS;
                    Slot {
                        group,
                        channels: first + modes.start..first + modes.end,
                    }
                })
            })
            .collect()
    }

    /// Adds what a point costs by its channel gains to the expansion by all variables. Of the
    /// curvature between two groups only the part above the diagonal.
    fn chain(
        &self,
        sum: &mut Expansion,
        slots: &[Slot],
        channels: &Channels<K>,
        cost: &Curvature<K>,
    ) {
        let n = self.parameters.per_group();
        sum.value += cost.value;
        for (a, own) in slots.iter().enumerate() {
            let slopes = &channels.slopes[a][..n];
            let gradient: Complex<f64> = own.channels.clone().map(|k| cost.gradient[k]).sum();
            for (j, slope) in slopes.iter().enumerate() {
                sum.gradient[own.group * n + j] += (gradient * slope).re;
            }
            for (b, beside) in slots.iter().enumerate().skip(a) {
                let mut hermitian = Complex::<f64>::ZERO;
                let mut symmetric = Complex::<f64>::ZERO;
                for k in own.channels.clone() {
                    for l in beside.channels.clone() {
                        hermitian += cost.hermitian[(k, l)];
                        symmetric += cost.symmetric[(k, l)];
                    }
                }
                let image: [Complex<f64>; MOST_PER_GROUP] =
                    channels.slopes[a].map(|slope| hermitian * slope + symmetric * slope.conj());
                let mut block = sum
                    .curvature
                    .view_mut((own.group * n, beside.group * n), (n, n));
                for (m, other) in channels.slopes[b][..n].iter().enumerate() {
                    for (entry, image) in block.column_mut(m).iter_mut().zip(&image) {
                        *entry += image.re * other.re + image.im * other.im;
                    }
                }
                // Two kinds of sensors with one group: both orders lie in the same block.
                if a != b && own.group == beside.group {
                    for (j, image) in image[..n].iter().enumerate() {
                        let others = &channels.slopes[b];
                        for (entry, other) in block.column_mut(j).iter_mut().zip(others) {
                            *entry += image.re * other.re + image.im * other.im;
                        }
                    }
                }
            }
        }
    }

    /// Adds what a point costs by the logarithm of its limit; of the curvature only the part above
    /// the diagonal.
    fn chain_level(
        &self,
        sum: &mut Expansion,
        slots: &[Slot],
        channels: &Channels<K>,
        (index, level): &(usize, LevelCurvature<K>),
    ) {
        let n = self.parameters.per_group();
        let at = self.parameters.count() + index;
        sum.gradient[at] += level.slope;
        sum.curvature[(at, at)] += level.curvature;
        for (slot, slopes) in slots.iter().zip(&channels.slopes) {
            let mixed: Complex<f64> = slot.channels.clone().map(|k| level.mixed[k]).sum();
            for (j, slope) in slopes[..n].iter().enumerate() {
                sum.curvature[(slot.group * n + j, at)] += (mixed * slope).re;
            }
        }
    }

    /// Whether a point has a term in this stage.
    fn counts(stage: Stage, point: &Point<K>) -> bool {
        match &point.purpose {
            Purpose::Loop { .. } => true,
            Purpose::Output(output) => {
                let own = matches!(output.goal, Goal::Below { level: None, .. });
                stage == Stage::Performance || own
            }
        }
    }

    /// The barriers of limits of parameters, of levels below their upper limit, and `weight` times
    /// what is minimised, without the mean square; none outside of the limits.
    fn sides(&self, stage: Stage, weight: f64, x: &[f64]) -> Option<Expansion> {
        let n = self.parameters.count();
        let mut sum = Expansion::zero(x.len());
        let mut value = 0.0;
        for (i, x) in x[..n].iter().enumerate() {
            let [low, high] = self.parameters.limits(i);
            for (room, sign) in [(x - low, 1.0), (high - x, -1.0)] {
                if room <= 0.0 {
                    return None;
                }
                value -= room.ln();
                sum.gradient[i] -= sign / room;
                sum.curvature[(i, i)] += 1.0 / (room * room);
            }
        }
        match stage {
            Stage::Feasibility => {
                value += weight * x[n];
                sum.gradient[n] += weight;
            }
            Stage::Performance if self.levels == 0 => {}
            Stage::Performance => {
                let top = n + self.levels;
                let part = weight * MEAN / self.levels as f64;
                for i in n..top {
                    let room = x[top] - x[i];
                    if room <= 0.0 {
                        return None;
                    }
                    value += part * x[i] - room.ln();
                    sum.gradient[i] += part + 1.0 / room;
                    sum.gradient[top] -= 1.0 / room;
                    let mixed = 1.0 / (room * room);
                    for (row, column, sign) in [(i, i, 1.0), (top, top, 1.0), (i, top, -1.0)] {
                        sum.curvature[(row, column)] += sign * mixed;
                    }
                }
                value += weight * x[top];
                sum.gradient[top] += weight;
            }
        }
        sum.value = value;
        Some(sum)
    }

    /// Whether the loop with these eigenvalues of L, in the order of their points, is stable; if it
    /// must start softly, at every gain up to one.
    fn is_stable(&self, loci: impl IntoIterator<Item = Option<Eigenvalues>>) -> bool {
        let mut curves = Loci::default();
        for eigenvalues in loci {
            let Some(eigenvalues) = eigenvalues else {
                return false;
            };
            if curves.crosses(eigenvalues) && self.limits.soft_start {
                return false;
            }
        }
        !curves.encircle()
    }

    fn levels<'x>(&self, x: &'x [f64]) -> &'x [f64] {
        &x[self.parameters.count()..]
    }

    fn widening<'x>(&self, stage: Stage, x: &'x [f64]) -> Widening<'x> {
        Widening {
            all: stage == Stage::Feasibility,
            levels: self.levels(x),
        }
    }

    /// The cost at the variables `x`, with derivatives; none if a limit is passed or a loop is
    /// unstable. `weight` multiplies what is minimised.
    pub(super) fn expand(&self, stage: Stage, weight: f64, x: &[f64]) -> Option<Expansion> {
        let n = x.len();
        let mut total = self.sides(stage, weight, x)?;
        let filters = self.parameters.filters(&x[..self.parameters.count()]);
        let squares = self.levels == 0 && stage == Stage::Performance;
        let widening = self.widening(stage, x);
        let slots = self.slots();
        let mut square = squares.then(|| Expansion::zero(n));
        let chunk = |points: &[Point<K>], limits: Limits| -> Option<Sums> {
            let mut sums = Sums {
                terms: Expansion::zero(n),
                square: squares.then(|| Expansion::zero(n)),
                eigenvalues: Vec::with_capacity(points.len()),
            };
            for point in points.iter().filter(|point| Self::counts(stage, point)) {
                let channels = self.channels(&filters, point);
                let PointCost {
                    terms,
                    level,
                    square,
                    eigenvalues,
                } = point.cost(&channels.gains, &self.openings, limits, widening)?;
                self.chain(&mut sums.terms, &slots, &channels, &terms);
                if let Some(level) = &level {
                    self.chain_level(&mut sums.terms, &slots, &channels, level);
                }
                if let Some(sum) = &mut sums.square
                    && square.value > 0.0
                {
                    self.chain(sum, &slots, &channels, &square);
                }
                sums.eigenvalues.extend(eigenvalues);
            }
            Some(sums)
        };
        let sums = |points: &[Point<K>], limits: Limits| {
            let chunks = points.par_chunks(CHUNK);
            let chunks = chunks.map(|points| chunk(points, limits));
            chunks.collect::<Option<Vec<Sums>>>()
        };
        let own = sums(&self.points, self.limits)?;
        let beside = sums(&self.beside, self.limits.of_perturbed())?;
        let eigenvalues = own.iter().flat_map(|sums| &sums.eigenvalues);
        if !self.is_stable(eigenvalues.map(|x| Some(*x))) {
            return None;
        }
        for sums in own.iter().chain(&beside) {
            total.add(&sums.terms);
            if let (Some(square), Some(part)) = (&mut square, &sums.square) {
                square.add(part);
            }
        }
        if let Some(square) = square {
            // Half the logarithm of the mean square; the curvature without that of the logarithm,
            // which is negative.
            let scale = 0.5 * weight / square.value;
            total.value += 0.5 * weight * square.value.ln();
            total.gradient += square.gradient * scale;
            total.curvature += square.curvature * scale;
        }
        total.curvature.fill_lower_triangle_with_upper_triangle();
        Some(total)
    }

    /// The same cost without derivatives.
    pub(super) fn value(&self, stage: Stage, weight: f64, x: &[f64]) -> Option<f64> {
        let mut total = self.sides(stage, weight, x)?.value;
        let filters = self.parameters.filters(&x[..self.parameters.count()]);
        let widening = self.widening(stage, x);
        let value = |points: &[Point<K>], limits: Limits| {
            let mut all = Vec::with_capacity(points.len());
            for point in points.iter().filter(|point| Self::counts(stage, point)) {
                let gains = self.channels(&filters, point).gains;
                all.push(point.value(&gains, &self.openings, limits, widening)?);
            }
            Some(all)
        };
        let values = |points: &[Point<K>], limits: Limits| {
            let chunks = points.par_chunks(CHUNK);
            let chunks = chunks.map(|points| value(points, limits));
            chunks.collect::<Option<Vec<_>>>()
        };
        let own = values(&self.points, self.limits)?;
        let beside = values(&self.beside, self.limits.of_perturbed())?;
        let eigenvalues = own.iter().flatten().filter_map(|(.., x)| *x);
        if !self.is_stable(eigenvalues.map(Some)) {
            return None;
        }
        let mut square = 0.0;
        for (barrier, part, _) in own.iter().chain(&beside).flatten() {
            total += barrier;
            square += part;
        }
        if self.levels == 0 && stage == Stage::Performance {
            total += 0.5 * weight * square.ln();
        }
        Some(total)
    }

    /// The largest factor by which the loop exceeds a limit with the parameters `x`, and for each
    /// level its lowest value; none if the loop is unstable.
    pub(super) fn excess(&self, x: &[f64]) -> Option<(f64, Vec<f64>)> {
        let filters = self.parameters.filters(x);
        // Most of the loops from which a search starts are unstable.
        let on_loop = self.points.iter().filter(|point| point.is_of_loop());
        let sector = self.limits.sector();
        let mut highest = 0.0_f64;
        if !self.is_stable(on_loop.map(|point| {
            let gains = self.channels(&filters, point).gains;
            let eigenvalues = point.eigenvalues(&gains)?;
            if let Some(sector) = sector {
                let near = eigenvalues.iter().filter_map(|x| sector.nearness(*x));
                highest = near.map(f64::sqrt).fold(highest, f64::max);
            }
            Some(eigenvalues)
        })) {
            return None;
        }
        let excesses = |points: &[Point<K>]| {
            let points = points.par_iter().with_min_len(CHUNK);
            let all = points.map(|point| self.excess_at(&filters, point));
            all.collect::<Vec<_>>()
        };
        let all = excesses(&self.points);
        highest = excesses(&self.beside).into_iter().fold(highest, f64::max);
        let mut levels = vec![0.0_f64; self.levels];
        for (excess, point) in all.into_iter().zip(&self.points) {
            match point.level() {
                Some(index) => levels[index] = levels[index].max(excess),
                None => highest = highest.max(excess),
            }
        }
        Some((highest, levels.into_iter().map(f64::ln).collect()))
    }

    /// The factor by which a limit is exceeded at a point.
    fn excess_at(&self, filters: &[GroupFilters], point: &Point<K>) -> f64 {
        let gains = self.channels(filters, point).gains;
        point.excess(&gains, &self.openings, self.limits)
    }

    /// The largest factor by which the loops of the machines of `set` exceed a limit with the
    /// parameters `x`, and the points at which they do. This does not tell whether they are stable.
    pub(super) fn exceeded(&self, set: &[Vec<Point<K>>], x: &[f64]) -> (f64, Vec<Point<K>>) {
        let filters = self.parameters.filters(x);
        let of_one = |points: &Vec<Point<K>>| {
            let mut highest = 0.0;
            let mut beyond = Vec::new();
            for point in points {
                let excess = self.excess_at(&filters, point);
                highest = f64::max(highest, excess);
                if excess > 1.0 {
                    beyond.push(point.clone());
                }
            }
            (highest, beyond)
        };
        let all: Vec<_> = set.par_iter().map(of_one).collect();
        let highest = all.iter().map(|(highest, _)| *highest).fold(0.0, f64::max);
        (
            highest,
            all.into_iter().flat_map(|(_, points)| points).collect(),
        )
    }

    /// What is minimised at the variables `x` of the stage of performance; infinite outside of the
    /// limits.
    pub(super) fn cost(&self, x: &[f64]) -> f64 {
        if let [levels @ .., top] = self.levels(x) {
            return top + MEAN / levels.len() as f64 * levels.iter().sum::<f64>();
        }
        // The barriers are the same with any weight.
        let value = |weight: f64| self.value(Stage::Performance, weight, x);
        let minimised = value(2.0).zip(value(1.0)).map(|(two, one)| two - one);
        minimised.unwrap_or(f64::INFINITY)
    }

    /// The same problem on every `stride`-th point of the loop, with all levels or without any.
    /// The limits leave room for what the points between are above them.
    pub(super) fn thinned(&self, stride: usize, with_levels: bool) -> Self {
        let points = self.points.iter().enumerate();
        let points = points.filter(|(i, point)| match &point.purpose {
            Purpose::Loop { .. } => i % stride == 0,
            Purpose::Output(output) => {
                with_levels || matches!(output.goal, Goal::Below { level: None, .. })
            }
        });
        Self {
            parameters: self.parameters.clone(),
            openings: self.openings.clone(),
            limits: self.limits.scaled(BETWEEN),
            points: points.map(|(_, point)| point.clone()).collect(),
            beside: self.beside.clone(),
            levels: self.levels,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_loop::SampledLoop;
    use crate::closed_loop::budget::budget;
    use crate::control::table;
    use crate::design::Study;
    use crate::design::synthesis::Synthesis;
    use crate::floor::{Criterion, Floor};
    use crate::machine::{Machine, Minimise, Penalty, RollOff};
    use crate::numeric::frequencies::pole_peaks;

    /// The gradient against differences of the cost, and the curvature of the levels against
    /// differences of the gradient, in both stages, for peaks and for the mean square.
    fn check<const K: usize>(file: &str, minimise: Minimise) {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
        let mut machine = Machine::load(&path.join(file)).unwrap();
        machine.target.minimise = minimise;
        machine.target.roll_off = Some(RollOff {
            hz: 2000.0,
            order: 1.0,
        });
        let study = Study::new(machine).unwrap();
        let synthesis = Synthesis {
            study: &study,
            target: study.machine().target,
            reference_db: &[-40.0, -10.0],
            isolation: 1.4,
            sharp: &[],
            drawn: &[],
            progress: &(),
        };
        let problem = synthesis.problem::<K>().thinned(2, true);
        let start = synthesis.starts(&problem).remove(0);
        let n = start.len();
        let (excess, levels) = problem.excess(&start).expect("a start is stable");
        let mut wide = start.clone();
        wide.push((1.3 * excess).ln());
        let mut inside = start;
        inside.extend(levels.iter().map(|level| level + 0.2));
        if let Some(top) = levels.into_iter().reduce(f64::max) {
            inside.push(top + 0.7);
        }
        for (stage, x) in [(Stage::Feasibility, wide), (Stage::Performance, inside)] {
            if stage == Stage::Performance && excess >= 1.0 {
                continue;
            }
            let expand = |x: &[f64]| problem.expand(stage, 3.0, x).expect("inside the limits");
            let here = expand(&x);
            assert!((problem.value(stage, 3.0, &x).unwrap() - here.value).abs() < 1e-9);
            for i in 0..x.len() {
                let moved = |by: f64| {
                    let mut x = x.clone();
                    x[i] += by;
                    expand(&x)
                };
                let (ahead, behind) = (moved(1e-5), moved(-1e-5));
                let slope = (ahead.value - behind.value) / 2e-5;
                let error = (slope - here.gradient[i]).abs();
                assert!(
                    error < 1e-4 * here.gradient.amax(),
                    "{stage:?} {i}: {slope}"
                );
                if i >= n {
                    let change = (ahead.gradient - behind.gradient) / 2e-5;
                    let own = here.curvature.column(i);
                    let error = (change - own).rows_range(n..).amax();
                    assert!(error < 1e-4 * own.amax(), "{stage:?} {i}");
                }
            }
        }
    }

    /// A loop that is stable, but not with 0.6 of its gain: its eigenvalue passes the real axis left of
    /// −1, goes round and comes back there.
    #[test]
    fn a_loop_that_is_only_stable_at_full_gain() {
        let encircles = |gain: f64| {
            let mut curves = Loci::default();
            let mut crosses = false;
            for (re, im) in [
                (0.0, 1.0),
                (-2.0, 1.0),
                (-2.0, -0.5),
                (-1.5, -0.5),
                (-1.3, 0.5),
            ]
            .into_iter()
            .chain([(0.5, 0.5), (0.1, -0.1)])
            {
                let mut eigenvalues = [Complex::ZERO; LEGS];
                eigenvalues[2] = Complex::new(re, im) * gain;
                crosses |= curves.crosses(eigenvalues);
            }
            (crosses, curves.encircle())
        };
        assert_eq!(encircles(1.0), (true, false));
        assert_eq!(encircles(0.6), (true, true));
        assert_eq!(encircles(0.4), (false, false));
    }

    /// Stability by the eigenvalues of L on the grid against the poles of the sampled loop, at full
    /// gain and at those of a soft start, for loops far and farther from stable ones. The argument of
    /// det(1 + L) alone, from point to point, calls two of the stable ones unstable.
    #[test]
    fn stability_is_that_of_the_poles() {
        let models = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
        let gains: Vec<f64> = (0..40)
            .map(|n| 1e-3_f64.powf(f64::from(n) / 40.0))
            .collect();
        let mut counts = [[0; 2]; 2];
        for file in ["metrology-frame.toml", "low-parasitic.toml"] {
            let study = Study::new(Machine::load(&models.join(file)).unwrap()).unwrap();
            let target = study.machine().target;
            let sharp = pole_peaks(&study.zeros().unwrap());
            let synthesis = Synthesis {
                study: &study,
                target,
                reference_db: &[-40.0, -10.0],
                isolation: 1.4,
                sharp: &sharp,
                drawn: &[],
                progress: &(),
            };
            let mut problem = synthesis.problem::<LEGS>();
            let starts = synthesis.starts(&problem);
            for step in 60..120_usize {
                let mut x = starts[step % starts.len()].clone();
                let wide = 0.02 * step as f64;
                for (i, x) in x.iter_mut().enumerate() {
                    *x += wide * ((0.618_034 * (i + 97 * step) as f64).fract() - 0.5);
                }
                let x = problem.parameters.of_shapes(&problem.parameters.shapes(&x));
                let shapes = problem.parameters.shapes(&x);
                let (machine, plant) = (study.machine(), study.plant());
                let model = study.design_model();
                let table = table::modal(machine, plant, model, &target, &shapes).unwrap();
                let closed = SampledLoop::new(plant, &table);
                for (soft, gains) in [&gains[..1], &gains[..]].into_iter().enumerate() {
                    problem.limits.soft_start = soft == 1;
                    let stable = problem.excess(&x).is_some();
                    assert_eq!(stable, closed.is_stable_with(gains), "{file} {step} {soft}");
                    counts[soft][usize::from(stable)] += 1;
                }
            }
        }
        let enough = counts.as_flattened().iter().all(|count| *count >= 5);
        assert!(enough, "{counts:?}");
    }

    /// The mean square against that of the noise budget, which knows no modal coordinates and finds
    /// its frequencies from the poles of the loop, not of the plant.
    fn check_mean_square<const K: usize>(file: &str, minimise: Minimise, penalty: Penalty) {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
        let mut machine = Machine::load(&path.join(file)).unwrap();
        machine.target.minimise = minimise;
        machine.target.penalty = Some(penalty);
        machine.exposure = Some(0.03);
        machine.spectrum = Some(Floor::Criterion(Criterion::VcE));
        let study = Study::new(machine).unwrap();
        let (machine, plant, model) = (study.machine(), study.plant(), study.design_model());
        let synthesis = Synthesis {
            study: &study,
            target: machine.target,
            reference_db: &[],
            isolation: 1.4,
            sharp: &pole_peaks(&study.zeros().unwrap()),
            drawn: &[],
            progress: &(),
        };
        let problem = synthesis.problem::<K>();
        let start = synthesis.starts(&problem).remove(0);
        let filters = problem.parameters.filters(&start);
        let parts = problem.points.iter().filter_map(|point| {
            let Purpose::Output(output) = &point.purpose else {
                return None;
            };
            matches!(output.goal, Goal::Square(_)).then(|| {
                let gains = problem.channels(&filters, point).gains;
                let none = Widening {
                    all: false,
                    levels: &[],
                };
                point
                    .value(&gains, &problem.openings, problem.limits, none)
                    .unwrap()
                    .1
            })
        });
        let found: f64 = parts.sum();
        let shapes = problem.parameters.shapes(&start);
        let table = table::modal(machine, plant, model, &machine.target, &shapes).unwrap();
        let band = machine.simulation.floor_band;
        let floor = machine.floor_motion();
        let budget = budget(
            plant,
            &machine.board,
            Some(&table),
            &floor,
            band,
            machine.exposure,
        );
        let budget = budget.unwrap();
        let measure = machine.measure().unwrap();
        let powers = budget
            .performance
            .iter()
            .map(|of| budget.measured(of, measure));
        let cost = |legs: &[Vec<_>], cost: f64| {
            let powers = legs.iter().flat_map(|leg| budget.power(leg));
            cost * cost * powers.sum::<f64>()
        };
        let costs = [
            cost(&budget.force, penalty.force),
            cost(&budget.stroke, penalty.stroke),
        ];
        let performance: f64 = powers.flatten().sum();
        // All of them matter.
        for (cost, size) in costs.into_iter().zip([penalty.force, penalty.stroke]) {
            assert_eq!(
                size > 0.0,
                cost > 0.1 * performance,
                "{costs:?} {performance:e}"
            );
        }
        let expected = performance + costs.iter().sum::<f64>();
        // The table's coefficients are single precision.
        let apart = (found / expected - 1.0).abs();
        assert!(apart < 1e-3, "{file} {minimise:?}: {found:e} {expected:e}");
    }

    #[test]
    fn the_mean_square_is_that_of_the_budget() {
        for minimise in [Minimise::Rms, Minimise::Average, Minimise::Deviation] {
            check_mean_square::<LEGS>("nucleo-h743.toml", minimise, Penalty::default());
        }
        check_mean_square::<{ 2 * LEGS }>("both-sensors.toml", Minimise::Rms, Penalty::default());
        let penalty = Penalty {
            force: 1e-4,
            stroke: 1e4,
        };
        check_mean_square::<LEGS>("nucleo-h743.toml", Minimise::Rms, penalty);
    }

    #[test]
    fn derivatives_are_differences() {
        check::<LEGS>("nucleo-h743.toml", Minimise::Peaks);
        check::<LEGS>("nucleo-h743.toml", Minimise::Rms);
        check::<{ 2 * LEGS }>("both-sensors.toml", Minimise::Peaks);
        check::<{ 2 * LEGS }>("both-sensors.toml", Minimise::Rms);
    }
}
