//! Shapes for the channels of the modal law: the best that the sampled, delayed
//! loop with the flexible plant bears.
//!
//! The corners and dampings of all shapes lie on a fixed lattice, evenly in the
//! logarithm, and the search goes from point to point. So it ends at the same
//! shapes on every processor, whatever the last bits of its sums.

use core::cell::Cell;
use core::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, TAU};
use core::ops::Range;

use nalgebra::{Complex, Matrix6};
use rayon::prelude::*;
use shared::LEGS;

use crate::closed_loop::{ELSEWHERE, grid, keeps};
use crate::design::{Design, alike};
use crate::law::{ac_coupling, channel_response, low_pass};
use crate::linear::largest_singular_value;
use crate::machine::{Feedback, Machine, Minimise, Target};
use crate::plant::{Gain, SampledPlant};
use crate::shape::{Resonance, Shape};
use crate::shaping::{SLOWEST, isolation_band};
use crate::table;

type Six = Matrix6<Complex<f64>>;

/// Points of the lattice lie this far apart, in part of their value.
const LATTICE: f64 = 0.02;

/// Numbers of a shape on the lattice: three of its first section, four of its
/// second, and the split between two kinds of sensors.
const NUMBERS: usize = 8;
const LAGS: usize = 3;
const SECTIONS: usize = 7;
const SPLIT: usize = 7;

/// Splits to begin with, Hz.
const SPLITS: [f64; 5] = [5.0, 30.0, 120.0, 500.0, 2000.0];

/// From one crossover that is tried to the next.
const SLOWER: f64 = 0.8;

/// A shape as lattice numbers: hz or damping = exp(LATTICE·n).
type Place = [i32; NUMBERS];

fn shape(place: &Place, both: bool) -> Shape {
    let [lag, second, zero, a, b, c, d, split] = place.map(|n| (LATTICE * f64::from(n)).exp());
    Shape {
        lags_hz: [lag, second],
        zero_hz: zero,
        notch: Resonance { hz: a, damping: b },
        notch_poles: Resonance { hz: c, damping: d },
        split_hz: both.then_some(split),
    }
}

fn nearest(value: f64) -> i32 {
    // Logarithms of frequencies and dampings: far within an i32.
    (value.ln() / LATTICE).round() as i32
}

/// The loop at one frequency, in modal coordinates.
struct Point {
    z: Complex<f64>,
    /// T_in·G22·T_out.
    plant: Six,
    /// The same of the force sensors beside.
    beside: Option<Six>,
}

/// What the channels do at one frequency.
struct Channels {
    gains: [Complex<f64>; LEGS],
    /// How much each takes of the accelerometers and of the force sensors beside
    /// them.
    split: Option<[[Complex<f64>; 2]; LEGS]>,
}

impl Channels {
    /// What the channels see of both kinds.
    fn blend(&self, own: &Six, beside: Option<&Six>) -> Six {
        let mut blend = *own;
        if let (Some(split), Some(beside)) = (self.split, beside) {
            for (i, [part, rest]) in split.into_iter().enumerate() {
                for (x, other) in blend.row_mut(i).iter_mut().zip(beside.row(i).iter()) {
                    *x = part * *x + rest * other;
                }
            }
        }
        blend
    }
}

/// Outputs at one frequency.
struct Seen {
    hz: f64,
    point: Point,
    /// From the floor to the outputs, and to the modes, by the sensors and by
    /// those beside.
    open: Gain,
    to_modes: Six,
    to_modes_beside: Option<Six>,
    /// From the modes to the outputs.
    from_modes: Gain,
}

/// What is to be small, and what counts as nothing, dB.
struct Aim {
    points: Vec<Seen>,
    reference_db: f64,
}

/// A search for one machine and target.
pub struct Search<'a> {
    machine: &'a Machine,
    design: &'a Design,
    target: Target,
    loops: Vec<Point>,
    aims: Vec<Aim>,
    /// From rigid floor motion to the rigid whole, where that is to be small.
    isolation: Vec<Seen>,
    /// Channels that are shaped alike, because their modes are.
    groups: Vec<Range<usize>>,
    /// T_in and T_out and their inverses.
    input: Six,
    input_inverse: Six,
    output: Six,
    output_inverse: Six,
}

/// A step that gains less, dB, is not taken.
const WORTH_IT: f64 = 0.01;

/// Times what follows the floor: worse than any dB.
const LATE: f64 = 1e4;

/// The search ends after this many trials at the latest.
pub const TRIALS: usize = 15_000;

/// Enough to compare boards by: some dB from the best.
pub const ROUGH_TRIALS: usize = 4_000;

/// The bound is kept this far, for peaks between the points of the grid.
const MARGIN: f64 = 0.995;

impl<'a> Search<'a> {
    /// For `target`. The peak of σ_max(G11) in each band of the machine counts
    /// from `reference_db`; above `isolation` Hz the whole must not follow the
    /// floor. `sharp` are peaks, as Hz and half width, that a fast loop may
    /// have beside those of the plant.
    pub fn new(
        machine: &'a Machine,
        design: &'a Design,
        plant: &SampledPlant,
        target: Target,
        reference_db: &[f64],
        isolation: f64,
        sharp: &[(f64, f64)],
    ) -> Self {
        let transform = design.transform();
        let input = transform.input.map(Complex::from);
        let output = transform.output.map(Complex::from);
        let beside = transform.beside.map(|input| input.map(Complex::from));
        // A kind's six rows of a gain to the sensors.
        let of_kind = |gain: &Gain, input: Six, first: usize| -> Six {
            input * gain.fixed_rows::<LEGS>(first)
        };
        let point = |hz: f64| {
            let g22 = plant.response(hz).g22();
            Point {
                z: plant.z(hz),
                plant: of_kind(&g22, input, 0) * output,
                beside: beside.map(|input| of_kind(&g22, input, LEGS) * output),
            }
        };
        let mut peaks = plant.plant.peaks();
        peaks.extend(sharp);
        let seen = |rows: Range<usize>, floor: Six| {
            let point = &point;
            move |hz: Vec<f64>| -> Vec<Seen> {
                hz.into_iter()
                    .map(|hz| {
                        let response = plant.response(hz);
                        let sensed = response.from_floor(plant.plant.sensors());
                        Seen {
                            hz,
                            point: point(hz),
                            open: response.from_floor(rows.clone()) * floor,
                            to_modes: of_kind(&sensed, input, 0) * floor,
                            to_modes_beside: beside
                                .map(|input| of_kind(&sensed, input, LEGS) * floor),
                            from_modes: response.from_legs(rows.clone()) * output,
                        }
                    })
                    .collect()
            }
        };
        let [_, high] = isolation_band(design, target.frequency);
        let performance = seen(plant.plant.performance(), Six::identity());
        let aims = match target.minimise {
            // Without bands, where the machine is to be quiet at all.
            Minimise::Peaks if machine.bands.is_empty() => {
                vec![Aim {
                    points: performance(grid(isolation, high.max(2.0 * isolation), 120, &peaks)),
                    reference_db: 0.0,
                }]
            }
            Minimise::Peaks => machine
                .bands
                .iter()
                .zip(reference_db)
                .map(|((_, low, high), &reference_db)| Aim {
                    points: performance(grid(*low, *high, 60, &peaks)),
                    reference_db,
                })
                .collect(),
            Minimise::Rms => {
                let [low, high] = machine.simulation.floor_band;
                vec![Aim {
                    points: performance(grid(low, high, 120, &peaks)),
                    reference_db: 0.0,
                }]
            }
        };
        let whole = seen(
            plant.plant.whole(),
            plant.plant.rigid_floor.map(Complex::from),
        );
        Self {
            machine,
            design,
            target,
            loops: grid(SLOWEST * target.frequency, 0.5 / plant.period, 450, &peaks)
                .into_iter()
                .map(point)
                .collect(),
            aims,
            isolation: whole(grid(isolation, high.max(1.1 * isolation), 30, &[])),
            groups: alike(&design.omega.map(|omega| omega * omega)),
            input,
            input_inverse: input.try_inverse().expect("modes are independent"),
            output,
            output_inverse: output.try_inverse().expect("modes are independent"),
        }
    }

    /// Whether there are two kinds of sensors.
    fn both(&self) -> bool {
        self.target.feedback == Feedback::Both
    }

    fn shapes(&self, places: &[Place]) -> [Shape; LEGS] {
        let both = self.both();
        let mut shapes = [shape(&places[0], both); LEGS];
        for (group, place) in self.groups.iter().zip(places) {
            shapes[group.clone()].fill(shape(place, both));
        }
        shapes
    }

    /// The dB that these places come to, or far more if they do not isolate where
    /// they should; none if they are not stable within the bound.
    fn level(&self, places: &[Place]) -> Option<f64> {
        let period = self.machine.board.period();
        let shapes = self.shapes(places);
        let channels = table::channels(self.design, &self.target, &shapes, period);
        let slow = |part: f64| table::coefficient(part * self.target.frequency, period);
        let (high_pass, leak) = (slow(table::AC_COUPLING), slow(table::LEAK));
        let splits = shapes.map(|shape| shape.split_hz.map(|hz| table::coefficient(hz, period)));
        let at = |z: Complex<f64>| {
            let high_pass = ac_coupling(high_pass, z);
            let gains = channels
                .each_ref()
                .map(|channel| channel_response(channel, Shape::SECTIONS, leak, z));
            if self.both() {
                // AC coupling is the accelerometers' alone.
                let parts = |c: Option<f64>| {
                    let low = low_pass(c.unwrap_or(1.0), z);
                    [high_pass * low, 1.0 - low]
                };
                Channels {
                    gains,
                    split: Some(splits.map(parts)),
                }
            } else {
                Channels {
                    gains: gains.map(|gain| high_pass * gain),
                    split: None,
                }
            }
        };
        let bound = MARGIN * self.target.max_sensitivity;
        let within = |point: &Point| {
            let channels = at(point.z);
            let modes = point.return_difference(&channels);
            keeps(modes, bound)
                && keeps(self.output * modes * self.output_inverse, ELSEWHERE * bound)
                && keeps(
                    self.input_inverse * point.at_sensors(&channels) * self.input,
                    ELSEWHERE * bound,
                )
        };
        // A few first: most places fail there.
        let inside = self.loops.iter().step_by(9).all(within)
            && self.loops.par_iter().with_min_len(64).all(within);
        if !inside {
            return None;
        }
        // Nyquist: sections and plant are stable, so det(1 + L) must not go
        // round zero.
        let determinants: Vec<_> = self
            .loops
            .par_iter()
            .with_min_len(64)
            .map(|point| point.return_difference(&at(point.z)).determinant())
            .collect();
        // It begins at 1: AC coupling leaves nothing of the loop at z = 1.
        let mut before = Complex::ONE;
        let mut turned = 0.0;
        for determinant in determinants {
            turned += (determinant / before).arg();
            before = determinant;
        }
        if turned.abs() > FRAC_PI_2 {
            return None;
        }
        let follows = self
            .isolation
            .iter()
            .map(|seen| largest_singular_value(&seen.closed(&at(seen.point.z))))
            .fold(0.0, f64::max);
        if follows > FRAC_1_SQRT_2 {
            return Some(LATE * follows);
        }
        let levels: Vec<f64> = self
            .aims
            .iter()
            .map(|aim| aim.level(self.target.minimise, at))
            .collect();
        let mean = levels.iter().sum::<f64>() / levels.len() as f64;
        let worst = levels.into_iter().fold(f64::MIN, f64::max);
        Some(worst + 0.1 * mean)
    }

    /// Goes to `to` if that is better; equal to rounding is not.
    fn go(&self, places: &mut Vec<Place>, to: Vec<Place>, best: &mut f64) -> bool {
        if !to.iter().all(|place| self.allowed(place)) {
            return false;
        }
        match self.level(&to) {
            Some(level) if level < *best - WORTH_IT => {
                *places = to;
                *best = level;
                true
            }
            _ => false,
        }
    }

    /// The best shapes found; none if nothing is stable within the bound, or does
    /// not isolate from near the corner. Ends after `most` trials at the latest;
    /// `progress` is called after every one.
    pub fn run(&self, most: usize, progress: impl Fn()) -> Option<[Shape; LEGS]> {
        let (mut places, mut best) = self.start()?;
        let trials = Cell::new(0);
        let progress = || {
            trials.set(trials.get() + 1);
            progress();
            trials.get() < most
        };
        self.scan(&mut places, &mut best, &progress);
        self.scan(&mut places, &mut best, &progress);
        let split = self.both().then_some(SPLIT);
        let numbers = |count| (0..count).chain(split).collect::<Vec<_>>();
        for (count, steps) in [(LAGS, &[16, 8, 4][..]), (SECTIONS, &[16, 8, 4, 2, 1])] {
            for &step in steps {
                self.settle(&mut places, &mut best, &numbers(count), step, &progress);
            }
        }
        (best < LATE * FRAC_1_SQRT_2).then(|| self.shapes(&places))
    }

    /// Whether a coarse search finds anything.
    pub fn is_feasible(&self) -> bool {
        self.start().is_some_and(|(mut places, mut best)| {
            let late = LATE * FRAC_1_SQRT_2;
            if best >= late {
                self.scan(&mut places, &mut best, &|| true);
            }
            best < late
        })
    }

    /// Coarse, one mode after the other.
    fn scan(&self, places: &mut Vec<Place>, best: &mut f64, progress: &impl Fn() -> bool) {
        for group in 0..places.len() {
            for mut place in self.coarse(group) {
                place[SPLIT] = places[group][SPLIT];
                let mut to = places.clone();
                to[group] = place;
                self.go(places, to, best);
                progress();
            }
        }
    }

    /// The best of the loops that are alike in all modes: with a slope of −2
    /// below the crossover, or with one lag for each mode or for all.
    fn start(&self) -> Option<(Vec<Place>, f64)> {
        let all = |place: &dyn Fn(usize) -> Place| -> Vec<Place> {
            (0..self.groups.len()).map(place).collect()
        };
        let splits = if self.both() {
            &SPLITS[..]
        } else {
            &SPLITS[..1]
        };
        // A lag and a zero that cancel.
        let one_lag = |corner: f64| self.place([corner, self.neutral()], self.neutral());
        (0..36)
            .flat_map(|n| {
                let crossover = self.fastest() * SLOWER.powi(n);
                let slowest = self.root(0).powi(2);
                [
                    all(&|group| self.lags(group, crossover, 8.0, 1.0)),
                    all(&|group| self.lags(group, crossover, 16.0, 1.0)),
                    all(&|group| one_lag(crossover / self.root(group).powi(2))),
                    all(&|_| one_lag(crossover / slowest)),
                ]
            })
            .flat_map(|places| {
                splits.iter().map(move |&split| {
                    let mut places = places.clone();
                    for place in &mut places {
                        place[SPLIT] = nearest(split);
                    }
                    places
                })
            })
            .filter_map(|places| self.level(&places).map(|level| (places, level)))
            .min_by(|(_, a), (_, b)| a.total_cmp(b))
    }

    /// f_mode/f_n: above the modes, the plant times the gains is its square.
    fn root(&self, group: usize) -> f64 {
        self.design.hertz()[self.groups[group].start] / self.target.frequency
    }

    /// No loop crosses over faster than the inverse of its delay, Hz.
    fn fastest(&self) -> f64 {
        1.0 / (TAU * self.machine.board.whole_delay())
    }

    fn coarse(&self, group: usize) -> Vec<Place> {
        let mut all = Vec::new();
        for n in 0..16 {
            let crossover = self.fastest() * SLOWER.powi(n);
            for apart in [1.5, 2.0, 3.0, 4.5, 6.0, 8.0, 11.0, 16.0, 24.0, 32.0] {
                for split in [1.0, 2.0, 4.0] {
                    all.push(self.lags(group, crossover, apart, split));
                }
            }
        }
        all
    }

    /// Two lags `split` times below and above their mean, a zero `apart` times
    /// below the crossover, Hz.
    fn lags(&self, group: usize, crossover: f64, apart: f64, split: f64) -> Place {
        let lag = crossover / (apart.sqrt() * self.root(group));
        self.place([lag * split, lag / split], crossover / apart)
    }

    /// Lags and a zero, Hz, and a second section that does nothing.
    fn place(&self, lags: [f64; 2], zero: f64) -> Place {
        let [a, b] = lags.map(nearest);
        let neutral = nearest(self.neutral());
        [a, b, nearest(zero), neutral, 0, neutral, 0, 0]
    }

    /// Where what does nothing begins to be moved from, Hz.
    fn neutral(&self) -> f64 {
        0.25 * self.fastest()
    }

    /// Moves of `step` in one number or two, group by group, until none helps.
    fn settle(
        &self,
        places: &mut Vec<Place>,
        best: &mut f64,
        numbers: &[usize],
        step: i32,
        progress: &impl Fn() -> bool,
    ) {
        let mut moves: Vec<Place> = Vec::new();
        for (k, &i) in numbers.iter().enumerate() {
            for a in [-1, 1] {
                let mut one = [0; NUMBERS];
                one[i] = a;
                moves.push(one);
                for &j in &numbers[..k] {
                    for b in [-1, 1] {
                        let mut two = one;
                        two[j] = b;
                        moves.push(two);
                    }
                }
            }
        }
        // Each group by itself, then all alike.
        let count = places.len();
        let parts: Vec<_> = (0..count)
            .map(|group| group..group + 1)
            .chain(core::iter::once(0..count))
            .collect();
        loop {
            let mut moved = false;
            for part in &parts {
                for direction in &moves {
                    // On as long as it helps.
                    loop {
                        let mut to = places.clone();
                        for place in &mut to[part.clone()] {
                            for (number, way) in place.iter_mut().zip(direction) {
                                *number += step * way;
                            }
                        }
                        if !progress() {
                            return;
                        }
                        if !self.go(places, to, best) {
                            break;
                        }
                        moved = true;
                    }
                }
            }
            if !moved {
                return;
            }
        }
    }

    /// Corners that the board's sections can have.
    fn allowed(&self, place: &Place) -> bool {
        let shape = shape(place, self.both());
        let highest = 0.4 * self.machine.board.sample_rate;
        let lowest = 1e-3 * self.target.frequency;
        let corners = [
            shape.lags_hz[0],
            shape.lags_hz[1],
            shape.zero_hz,
            shape.notch.hz,
            shape.notch_poles.hz,
        ];
        let dampings = [shape.notch.damping, shape.notch_poles.damping];
        let mut corners = corners.iter().chain(&shape.split_hz);
        corners.all(|hz| (lowest..highest).contains(hz))
            && dampings.iter().all(|zeta| (0.1..10.0).contains(zeta))
    }
}

impl Point {
    /// 1 + T_in·G22·T_out·C, opened at the modal sensors.
    fn at_sensors(&self, channels: &Channels) -> Six {
        let mut difference = channels.blend(&self.plant, self.beside.as_ref());
        for (i, gain) in channels.gains.into_iter().enumerate() {
            difference.column_mut(i).iter_mut().for_each(|x| *x *= gain);
            difference[(i, i)] += 1.0;
        }
        difference
    }

    /// 1 + C·T_in·G22·T_out, opened at the forces along the modes.
    fn return_difference(&self, channels: &Channels) -> Six {
        let mut difference = channels.blend(&self.plant, self.beside.as_ref());
        for (i, gain) in channels.gains.into_iter().enumerate() {
            difference.row_mut(i).iter_mut().for_each(|x| *x *= gain);
            difference[(i, i)] += 1.0;
        }
        difference
    }
}

impl Seen {
    /// From the floor with the loop closed.
    fn closed(&self, channels: &Channels) -> Gain {
        // f = −C·(1 + G·C)⁻¹·T_in·G21.
        let difference = self.point.at_sensors(channels);
        let to_modes = channels.blend(&self.to_modes, self.to_modes_beside.as_ref());
        let Some(mut force) = difference.lu().solve(&to_modes) else {
            return self.open.map(|_| Complex::from(f64::INFINITY));
        };
        for (i, gain) in channels.gains.into_iter().enumerate() {
            force.row_mut(i).iter_mut().for_each(|x| *x *= gain);
        }
        &self.open - &self.from_modes * force
    }
}

impl Aim {
    /// dB over the reference.
    fn level(&self, minimise: Minimise, at: impl Fn(Complex<f64>) -> Channels + Sync) -> f64 {
        // The Frobenius norm is between σ_max and √6 times it, smooth, and a
        // fraction of the work.
        let all: Vec<f64> = self
            .points
            .par_iter()
            .with_min_len(32)
            .map(|seen| seen.closed(&at(seen.point.z)).norm())
            .collect();
        let squares = match minimise {
            // Half of it the highest point, half the mean over the grid, which
            // also feels what is not the highest.
            Minimise::Peaks => {
                let highest = all.iter().copied().fold(0.0, f64::max);
                let mean = all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64;
                highest * mean.sqrt()
            }
            Minimise::Rms => all
                .windows(2)
                .zip(self.points.windows(2))
                .map(|(x, at)| 0.5 * (x[0] * x[0] + x[1] * x[1]) * (at[1].hz - at[0].hz))
                .sum(),
        };
        10.0 * squares.log10() - self.reference_db
    }
}
