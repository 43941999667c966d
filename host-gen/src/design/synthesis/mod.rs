//! Synthesis of the shapes of the modal law by Newton's method on frequency responses.
//!
//! All requirements are upper limits of σ_max of transfer matrices of the sampled loop on a grid
//! of frequencies, on the machine of the file and on perturbed ones. Barriers keep the matrices
//! below their limits, and the path of the barriers' minima leads to a local optimum. The
//! eigenvalues of the loop gain, followed over the same grid, tell whether a loop is stable.

mod barrier;
mod descent;
mod parameters;
mod points;
mod problem;

use core::f64::consts::{FRAC_1_SQRT_2, TAU};
use core::ops::Range;

use nalgebra::{Complex, SMatrix};
use rayon::prelude::*;
use shared::LEGS;

use barrier::Rows;
use descent::{CLOSELY, Care, ROUGHLY};
use parameters::Parameters;
use points::{Goal, Limits, Openings, Output, Point, Purpose, Source, blocks};
use problem::{Problem, Stage};

use crate::closed_loop::SLOWEST;
use crate::closed_loop::isolation::isolation_band;
use crate::closed_loop::sensitivity::ELSEWHERE;
use crate::control::gains::ModalTransform;
use crate::control::law::{ac_coupling, channel_response};
use crate::control::shape::{Filter, Resonance};
use crate::control::{Shape, table};
use crate::design::Study;
use crate::design::sources::Sources;
use crate::machine::{FeedbackKind, Target};
use crate::numeric::frequencies::grid;
use crate::numeric::quadrature::nodes;
use crate::numeric::six::ComplexMatrix6;
use crate::plant::{Gain, Response};
use crate::progress::Progress;

/// The part of a limit that is used: a peak between two points of the grid may be higher.
const MARGIN: f64 = 0.995;

/// Settings of a synthesis.
pub(super) struct Synthesis<'a> {
    pub(super) study: &'a Study,
    pub(super) target: Target,
    /// The 0 dB reference of σ_max(G11) for each band, dB.
    pub(super) reference_db: &'a [f64],
    /// The frequency above which the machine as a whole must be isolated from the floor, Hz.
    pub(super) isolation: f64,
    /// Centre and half width, Hz, of peaks that a fast loop may have beside those of the plant.
    pub(super) sharp: &'a [(f64, f64)],
    /// The perturbed machines on which the design must also hold.
    pub(super) drawn: &'a [Option<Study>],
    pub(super) progress: &'a dyn Progress,
}

impl Synthesis<'_> {
    /// The best shapes found; none if no loop was found within all limits.
    pub(super) fn run(&self) -> Option<[Shape; LEGS]> {
        match self.target.feedback {
            FeedbackKind::Both => self.solve::<{ 2 * LEGS }>(true),
            FeedbackKind::Acceleration | FeedbackKind::Force => self.solve::<LEGS>(true),
        }
    }

    /// Whether a loop is found within all limits.
    pub(super) fn is_feasible(&self) -> bool {
        let found = match self.target.feedback {
            FeedbackKind::Both => self.solve::<{ 2 * LEGS }>(false),
            FeedbackKind::Acceleration | FeedbackKind::Force => self.solve::<LEGS>(false),
        };
        found.is_some()
    }

    /// The best shapes, if any are found with which the loop is stable at every gain of the soft
    /// start; else the best without this limit; or any.
    fn solve<const K: usize>(&self, best: bool) -> Option<[Shape; LEGS]> {
        let mut problem = self.problem::<K>();
        problem.limits.soft_start = best;
        let found = self.solve_one(&mut problem, best);
        if found.is_some() || !best {
            return found;
        }
        problem.limits.soft_start = false;
        self.solve_one(&mut problem, true)
    }

    /// The same within the limits of `problem`.
    fn solve_one<const K: usize>(
        &self,
        problem: &mut Problem<K>,
        best: bool,
    ) -> Option<[Shape; LEGS]> {
        let starts = self.starts(&problem.thinned(THINNED, false));
        let n = problem.parameters.count();
        if !best {
            let coarse = problem.thinned(THINNED, true);
            return starts.into_iter().find_map(|x| {
                let x = self.inside(&coarse, x)?;
                let x = self.inside(problem, x)?;
                Some(problem.parameters.shapes(&x[..n]))
            });
        }
        let set = self.drawn();
        let limits = problem.limits;
        let mut found: Option<Vec<f64>> = None;
        for round in 0..ROUNDS {
            // From the start again: what is best then may be far from what was best before, or not.
            let before = found.iter().map(|x| x[..n].to_vec());
            let from: Vec<_> = starts.iter().cloned().chain(before).collect();
            let Some(x) = self.best_of(problem, &from) else {
                break;
            };
            problem.limits = limits;
            let (highest, beyond) = problem.exceeded(&set, &x[..n]);
            found = Some(x);
            if highest <= 1.0 {
                break;
            }
            if round == 0 && highest < NEARLY {
                problem.limits = limits.scaled(0.99 / highest);
            } else {
                problem.beside.extend(beyond);
            }
        }
        let rounded: Vec<f64> = found?[..n]
            .iter()
            .map(|x| (x / LATTICE).round() * LATTICE)
            .collect();
        Some(
            problem
                .parameters
                .shapes(&rounded)
                .map(|shape| shape.paired()),
        )
    }

    /// The best variables found from `starts` on.
    fn best_of<const K: usize>(
        &self,
        problem: &Problem<K>,
        starts: &[Vec<f64>],
    ) -> Option<Vec<f64>> {
        let n = problem.parameters.count();
        let coarse = problem.thinned(THINNED, true);
        let tried = starts.par_iter().filter_map(|x| {
            let x = self.inside(&coarse, x.clone())?;
            let x = self.best(&coarse, x, [FIRST, ROUGH], ROUGHLY)?;
            Some((coarse.cost(&x), x))
        });
        let tried: Vec<_> = tried.collect();
        let (_, mut x) = tried.into_iter().min_by(|(a, _), (b, _)| a.total_cmp(b))?;
        x.truncate(n);
        let x = self.inside(problem, x)?;
        self.best(problem, x, [ROUGH, FINE], CLOSELY)
    }

    /// The points of the loops of the perturbed machines on which a design must hold.
    fn drawn<const K: usize>(&self) -> Vec<Vec<Point<K>>> {
        let transform = ModalTransform::new(self.study.design_model());
        let studies = self.drawn.par_iter().flatten();
        studies
            .map(|study| {
                let mut points = self.points(study, &transform);
                points.retain(Point::is_of_loop);
                points
            })
            .collect()
    }

    /// Moves the parameters `x` inside all limits, if that is found.
    fn inside<const K: usize>(&self, problem: &Problem<K>, mut x: Vec<f64>) -> Option<Vec<f64>> {
        let n = problem.parameters.count();
        let (excess, _) = problem.excess(&x)?;
        if excess.ln() < INSIDE {
            return Some(x);
        }
        x.push((1.1 * excess).ln());
        // A low weight leads far away from where the limits are nearly kept.
        let near = excess.ln() < NEAR;
        let weights = if near { [FINE, FINER] } else { [ROUGH, MIDDLE] };
        for weight in weights {
            let enough = |x: &[f64]| x[n] < ENOUGH;
            x = descent::follow(
                problem,
                Stage::Feasibility,
                x,
                [weight; 2],
                ROUGHLY,
                self.progress,
                enough,
            );
            // What is far outside at the first weight does not get inside at the next.
            if x[n] < ENOUGH || !near && x[n] > HOPELESS {
                break;
            }
        }
        let inside = x[n] < 0.0;
        x.truncate(n);
        inside.then_some(x)
    }

    /// The best variables from the parameters `x` on, which are inside all limits.
    fn best<const K: usize>(
        &self,
        problem: &Problem<K>,
        mut x: Vec<f64>,
        weights: [f64; 2],
        care: Care,
    ) -> Option<Vec<f64>> {
        if problem.levels > 0 {
            let (_, levels) = problem.excess(&x)?;
            let top = levels.iter().copied().fold(f64::MIN, f64::max);
            x.extend(levels.iter().map(|level| level + 0.1));
            x.push(top + 0.2);
        }
        Some(descent::follow(
            problem,
            Stage::Performance,
            x,
            weights,
            care,
            self.progress,
            |_| false,
        ))
    }

    fn problem<const K: usize>(&self) -> Problem<K> {
        let machine = self.study.machine();
        let model = self.study.design_model();
        let transform = ModalTransform::new(model);
        let complex = |m: nalgebra::Matrix6<f64>| m.map(Complex::from);
        let pair = |m: nalgebra::Matrix6<f64>| {
            let m = complex(m);
            [m, m.try_inverse().expect("modes are independent")]
        };
        let [input, inverse] = pair(transform.input);
        let mut sensors = vec![[inverse, input]];
        sensors.extend(transform.beside.map(|beside| {
            let [input, inverse] = pair(beside);
            [inverse, input]
        }));
        let levels = match machine.measure() {
            None => machine.bands.len().max(1),
            Some(_) => 0,
        };
        Problem {
            parameters: Parameters {
                groups: model.groups(),
                both: K > LEGS,
                period: machine.board.period(),
                frequency: self.target.frequency,
            },
            openings: Openings {
                legs: pair(transform.output),
                sensors,
            },
            limits: Limits {
                modes: MARGIN * self.target.max_sensitivity,
                elsewhere: MARGIN * ELSEWHERE * self.target.max_sensitivity,
                roll_off: MARGIN,
                soft_start: true,
            },
            points: self.points(self.study, &transform),
            beside: Vec::new(),
            levels,
        }
    }

    /// The points of the machine of `study` with the law of the machine that is designed.
    fn points<const K: usize>(&self, study: &Study, transform: &ModalTransform) -> Vec<Point<K>> {
        let machine = self.study.machine();
        let model = self.study.design_model();
        let sampled = study.plant();
        let plant = &sampled.plant;
        let period = sampled.period;
        let output = transform.output.map(Complex::from);
        let inputs = [Some(transform.input), transform.beside];
        let inputs: Vec<ComplexMatrix6> = inputs
            .into_iter()
            .flatten()
            .map(|m| m.map(Complex::from))
            .collect();
        // The rows of all sensors in modal coordinates.
        let channels = |gain: &Gain, right: &ComplexMatrix6| -> Rows<K> {
            let mut rows = Rows::<K>::zeros();
            for (kind, input) in inputs.iter().enumerate().take(K / LEGS) {
                let own = input * gain.fixed_rows::<LEGS>(kind * LEGS) * right;
                rows.fixed_rows_mut::<LEGS>(kind * LEGS).copy_from(&own);
            }
            rows
        };
        let slow = |part: f64| table::coefficient(part * self.target.frequency, period);
        let (high_pass, leak) = (slow(table::AC_COUPLING), slow(table::LEAK));
        let neutral = Shape {
            sections: [Filter::PASS; Shape::SECTIONS],
            split_hz: None,
        };
        let gains = table::channels(model, &self.target, &[neutral; LEGS], period);
        let point = |hz: f64, purpose: Purpose<K>| {
            let z = sampled.z(hz);
            let high_pass = ac_coupling(high_pass, z);
            let plant: SMatrix<Complex<f64>, K, LEGS> =
                channels(&sampled.response(hz).g22(), &output);
            Point {
                delta: z - 1.0,
                // Only accelerometers have AC coupling beside force sensors.
                base: core::array::from_fn(|k| {
                    let gain = channel_response(&gains[k % LEGS], 0, leak, z);
                    if k < LEGS { high_pass * gain } else { gain }
                }),
                plant,
                purpose,
            }
        };
        let mut peaks = plant.peaks();
        peaks.extend(self.sharp);
        // What moves with the floor.
        let shaken = |response: &Response, rows: Range<usize>, floor: &ComplexMatrix6| Source {
            direct: blocks(&(response.from_floor(rows) * floor)),
            to_modes: channels(&response.from_floor(plant.sensors()), floor),
        };
        let output_of = |hz: f64, from_legs: Gain, sources: Vec<Source<K>>, goal: Goal| {
            let from_modes = blocks(&(from_legs * output));
            let output = Output {
                from_modes,
                sources,
                goal,
            };
            point(hz, Purpose::Output(output))
        };
        let seen = |rows: Range<usize>, floor: ComplexMatrix6, hz: f64, goal: Goal| {
            let response = sampled.response(hz);
            let source = shaken(&response, rows.clone(), &floor);
            output_of(hz, response.from_legs(rows), vec![source], goal)
        };
        let limit = |limit: f64, level: Option<usize>| Goal::Below { limit, level };
        let identity = ComplexMatrix6::identity();
        let low = SLOWEST * self.target.frequency;
        let mut points: Vec<Point<K>> = grid(low, 0.5 / period, LOOP_POINTS, &peaks)
            .into_iter()
            .map(|hz| {
                let roll_off = self.target.roll_off;
                point(
                    hz,
                    Purpose::Loop {
                        roll_off: roll_off.map_or(f64::INFINITY, |limit| limit.limit(hz)),
                    },
                )
            })
            .collect();
        let [_, high] = isolation_band(model, self.target.frequency);
        let whole = plant.rigid_floor.map(Complex::from);
        for hz in grid(self.isolation, high.max(1.1 * self.isolation), 60, &peaks) {
            points.push(seen(plant.whole(), whole, hz, limit(FRAC_1_SQRT_2, None)));
        }
        let mut band = |low: f64, high: f64, count: usize, reference_db: f64, index: usize| {
            let reference = 10f64.powf(reference_db / 20.0);
            for hz in grid(low, high, count, &peaks) {
                let goal = limit(reference, Some(index));
                points.push(seen(plant.performance(), identity, hz, goal));
            }
        };
        match machine.measure() {
            None if machine.bands.is_empty() => {
                band(self.isolation, high.max(2.0 * self.isolation), 120, 0.0, 0);
            }
            None => {
                for (index, ((_, low, high), &reference_db)) in
                    machine.bands.iter().zip(self.reference_db).enumerate()
                {
                    band(*low, *high, 40, reference_db, index);
                }
            }
            Some(measure) => {
                let sources = Sources::new(study, measure);
                let singular: Vec<_> = peaks
                    .iter()
                    .map(|(hz, width)| Complex::new(*hz, *width))
                    .collect();
                let exponent = |hz: f64| sources.exponent(hz);
                for (hz, weight) in nodes(&sources.breaks(), &singular, exponent) {
                    let (from_legs, moving) = sources.at(hz);
                    let moving = moving.iter().map(|source| Source {
                        direct: blocks(&source.direct),
                        to_modes: channels(&source.sensed, &identity),
                    });
                    let goal = Goal::Square(weight * sources.weight(hz));
                    points.push(output_of(hz, from_legs, moving.collect(), goal));
                }
            }
        }
        points
    }

    /// The parameters of stable loops, that with the least excess over a limit first: for
    /// each of some kinds of shapes, the same in all modes, the best crossover frequency.
    fn starts<const K: usize>(&self, problem: &Problem<K>) -> Vec<Vec<f64>> {
        let fastest = 1.0 / (TAU * self.study.machine().board.whole_delay());
        let hertz = self.study.design_model().hertz();
        let root = |mode: usize| hertz[mode] / self.target.frequency;
        // Poles and zeros that cancel: at different frequencies, so that the filters are not
        // alike, or they would stay alike.
        let neutral = |part: f64| {
            let pair = Resonance {
                hz: part * fastest,
                damping: 1.0,
            };
            Filter {
                zeros: pair,
                poles: pair,
            }
        };
        let beyond = 0.4 * self.study.machine().board.sample_rate;
        // A section that turns the resonance of the sensors into a faster, damped pair of poles.
        let sensor = &self.study.machine().board.sensor;
        let inverse = sensor.resonance.map(|peak| Filter {
            zeros: Resonance {
                hz: peak.hz,
                damping: peak.damping,
            },
            poles: Resonance {
                hz: fastest.max(peak.hz),
                damping: 1.0,
            },
        });
        let shape = |lags: [f64; 2], zero: f64, split: f64| {
            let second = inverse.unwrap_or(neutral(0.25));
            let mut sections = [neutral(0.25), second, neutral(0.06)];
            sections[0] = Filter {
                zeros: Resonance::real([zero, beyond]),
                poles: Resonance::real(lags),
            };
            Shape {
                sections,
                split_hz: Some(split),
            }
        };
        let splits = if K > LEGS { &SPLITS[..] } else { &SPLITS[..1] };
        let mut kinds = Vec::new();
        for &split in splits {
            for kind in 0..4 {
                kinds.push((split, kind));
            }
        }
        let mut starts: Vec<_> = kinds
            .into_par_iter()
            .filter_map(|(split, kind)| {
                (0..36)
                    .filter_map(|n| {
                        let crossover = fastest * SLOWER.powi(n);
                        let slope = |mode: usize, apart: f64| {
                            let lag = crossover / (apart.sqrt() * root(mode));
                            shape([lag, lag], crossover / apart, split)
                        };
                        let one = |corner: f64| shape([corner, beyond], beyond, split);
                        let shapes: [Shape; LEGS] = core::array::from_fn(|mode| match kind {
                            0 => slope(mode, 8.0),
                            1 => slope(mode, 16.0),
                            2 => one(crossover / root(mode).powi(2)),
                            _ => one(crossover / root(0).powi(2)),
                        });
                        let x = problem.parameters.of_shapes(&shapes);
                        let excess = problem.excess(&x)?.0;
                        Some((excess, x))
                    })
                    .min_by(|(a, _), (b, _)| a.total_cmp(b))
            })
            .collect();
        starts.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        starts.truncate(STARTS);
        starts.into_iter().map(|(_, x)| x).collect()
    }
}

/// Logarithm of the part of the limits at which a loop is inside of them.
const INSIDE: f64 = -0.005;

/// The same at which the search for one ends.
const ENOUGH: f64 = -0.02;

/// The same at which it is given up.
const HOPELESS: f64 = 0.7;

/// The same below which the limits are nearly kept.
const NEAR: f64 = 0.4;

/// Most searches, each with the points at which perturbed machines came close to a limit before.
const ROUNDS: usize = 4;

/// Where these exceed a limit by less than this factor, a lower limit for the machine that is
/// designed is tried first.
const NEARLY: f64 = 1.05;

/// Every so many points of a grid are enough to tell which start is best.
const THINNED: usize = 2;

/// Starts that are followed; what is best then is refined.
const STARTS: usize = 2;

/// Weights of what is minimised beside the barriers. For the result: the first, the last to compare
/// starts, and the last of all, [`FINE`], at which the barriers keep a level some hundredths of a
/// dB above its minimum. To get inside the limits: [`ROUGH`] and [`MIDDLE`] from far outside,
/// [`FINE`] and [`FINER`] from nearby.
const FIRST: f64 = 15.0;
const ROUGH: f64 = 250.0;
const MIDDLE: f64 = 1e3;
const FINE: f64 = 4e3;
const FINER: f64 = 1.6e4;

/// Parameters are rounded to a multiple of this, so that the last bits of a processor's sums do
/// not show.
const LATTICE: f64 = 1e-4;

/// Frequencies of the loop, evenly spaced in the logarithm, beside those at peaks.
const LOOP_POINTS: usize = 180;

/// Initial crossover frequencies between two kinds of sensors, Hz.
const SPLITS: [f64; 5] = [5.0, 30.0, 120.0, 500.0, 2000.0];

/// Ratio of successive trial crossover frequencies of the loop.
const SLOWER: f64 = 0.8;
