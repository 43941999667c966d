//! A Hooke–Jeeves pattern search for the shapes of the modal law.
//!
//! The corners and dampings of all shapes lie on a fixed lattice, evenly spaced in the
//! logarithm, and the search moves from point to point. So it ends at the same shapes on
//! every processor, even if its sums differ in the last bits.

use core::cell::Cell;
use core::f64::consts::TAU;
use core::ops::Range;

use shared::LEGS;

use super::objective::{MISSED, Objective};
use crate::control::Shape;
use crate::control::shape::Resonance;
use crate::machine::{Machine, Target};
use crate::model::design_model::{DesignModel, alike};
use crate::progress::Progress;

/// Relative distance between neighbouring points of the lattice.
const LATTICE: f64 = 0.02;

/// Numbers of a shape on the lattice: three of its first section, four of its
/// second, and the split between two kinds of sensors.
const NUMBERS: usize = 8;
const LAGS: usize = 3;
const SECTIONS: usize = 7;
const SPLIT: usize = 7;

/// Initial split frequencies, Hz.
const SPLITS: [f64; 5] = [5.0, 30.0, 120.0, 500.0, 2000.0];

/// Ratio of successive trial crossover frequencies.
const SLOWER: f64 = 0.8;

/// A shape as lattice numbers: hz or damping = exp(LATTICE·n).
type LatticePoint = [i32; NUMBERS];

fn shape(place: &LatticePoint, both: bool) -> Shape {
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

/// A step with a smaller improvement, dB, is not taken.
const WORTH_IT: f64 = 0.01;

/// Maximum number of trials of a full search.
pub(super) const TRIALS: usize = 15_000;

/// Maximum number of trials of a rough search: some dB from the best, enough to compare
/// boards.
pub(super) const ROUGH_TRIALS: usize = 4_000;

/// A search over the shapes of one machine's modes.
pub(super) struct PatternSearch<'a> {
    objective: Objective<'a>,
    machine: &'a Machine,
    model: &'a DesignModel,
    target: Target,
    /// Channels that get equal shapes, because their modes are equal.
    groups: Vec<Range<usize>>,
}

impl<'a> PatternSearch<'a> {
    /// A search for the shapes that are best under `objective`.
    pub(super) fn new(
        machine: &'a Machine,
        model: &'a DesignModel,
        target: Target,
        objective: Objective<'a>,
    ) -> Self {
        Self {
            objective,
            machine,
            model,
            target,
            groups: alike(&model.omega.map(|omega| omega * omega)),
        }
    }

    fn both(&self) -> bool {
        self.objective.both()
    }

    fn shapes(&self, places: &[LatticePoint]) -> [Shape; LEGS] {
        let both = self.both();
        let mut shapes = [shape(&places[0], both); LEGS];
        for (group, place) in self.groups.iter().zip(places) {
            shapes[group.clone()].fill(shape(place, both));
        }
        shapes
    }

    fn level(&self, places: &[LatticePoint]) -> Option<f64> {
        self.objective.level(&self.shapes(places))
    }

    /// Moves to `to` if the level there is lower by at least [`WORTH_IT`]; returns
    /// whether it moved.
    fn go(&self, places: &mut Vec<LatticePoint>, to: Vec<LatticePoint>, best: &mut f64) -> bool {
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

    /// The best shapes found in at most `most` trials; none if no loop was found that is
    /// stable within the bound and isolates from near the corner. `progress` is called
    /// after every trial.
    pub(super) fn run(&self, most: usize, progress: &dyn Progress) -> Option<[Shape; LEGS]> {
        let (mut places, mut best) = self.start()?;
        let trials = Cell::new(0);
        let progress = || {
            trials.set(trials.get() + 1);
            progress.advance();
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
        (best < MISSED).then(|| self.shapes(&places))
    }

    /// Whether a coarse search finds shapes that meet all constraints.
    pub(super) fn is_feasible(&self) -> bool {
        self.start().is_some_and(|(mut places, mut best)| {
            if best >= MISSED {
                self.scan(&mut places, &mut best, &|| true);
            }
            best < MISSED
        })
    }

    /// Tries a coarse set of shapes, one mode after the other.
    fn scan(&self, places: &mut Vec<LatticePoint>, best: &mut f64, progress: &impl Fn() -> bool) {
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

    /// The best starting point, of loops with the same kind of shape in all modes: a
    /// slope of −2 below the crossover, or one lag for each mode, or one lag for all.
    fn start(&self) -> Option<(Vec<LatticePoint>, f64)> {
        let all = |place: &dyn Fn(usize) -> LatticePoint| -> Vec<LatticePoint> {
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
        self.model.hertz()[self.groups[group].start] / self.target.frequency
    }

    /// Upper limit of the crossover frequency, from the delay, Hz.
    fn fastest(&self) -> f64 {
        1.0 / (TAU * self.machine.board.whole_delay())
    }

    fn coarse(&self, group: usize) -> Vec<LatticePoint> {
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
    fn lags(&self, group: usize, crossover: f64, apart: f64, split: f64) -> LatticePoint {
        let lag = crossover / (apart.sqrt() * self.root(group));
        self.place([lag * split, lag / split], crossover / apart)
    }

    /// Lags and a zero, Hz, and a second section without effect.
    fn place(&self, lags: [f64; 2], zero: f64) -> LatticePoint {
        let [a, b] = lags.map(nearest);
        let neutral = nearest(self.neutral());
        [a, b, nearest(zero), neutral, 0, neutral, 0, 0]
    }

    /// Initial frequency of a section without effect, Hz.
    fn neutral(&self) -> f64 {
        0.25 * self.fastest()
    }

    /// Moves by `step` lattice points in one number or two, group by group, until no move
    /// improves the level.
    fn settle(
        &self,
        places: &mut Vec<LatticePoint>,
        best: &mut f64,
        numbers: &[usize],
        step: i32,
        progress: &impl Fn() -> bool,
    ) {
        let mut moves: Vec<LatticePoint> = Vec::new();
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
        // Each group alone, then all groups together.
        let count = places.len();
        let parts: Vec<_> = (0..count)
            .map(|group| group..group + 1)
            .chain(core::iter::once(0..count))
            .collect();
        loop {
            let mut moved = false;
            for part in &parts {
                for direction in &moves {
                    // Again as long as it helps.
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

    /// Whether the board's sections can have these corners and dampings.
    fn allowed(&self, place: &LatticePoint) -> bool {
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
