//! Which machine is it: what a file leaves uncertain, from responses measured in place.
//!
//! The estimate is the most probable one: the sum of the squares of the measured errors, relative to
//! their standard deviations, and of the changes of all uncertain quantities, relative to theirs, is
//! least. Resonances are so narrow that those of file and machine hardly overlap, and no search
//! would find from one to the other. So the first steps are made with much damping added to both, to
//! the model and to a rational function through what was measured, and less and less of it.

mod file;
mod parameters;
mod wiring;

use core::f64::consts::SQRT_2;

use nalgebra::{Complex, DMatrix, DVector};
use rayon::prelude::*;
use serde::Serialize;
use shared::LEGS;

pub use file::fitted_file;
pub use parameters::{Parameter, Quantity, Scale, changed, parameters};
use wiring::Wiring;

use crate::board::measure::{MeasuredLine, Measurement, RationalFit, Resonance, turn};
use crate::design::Study;
use crate::machine::{FeedbackKind, Machine};
use crate::progress::Progress;

/// Damping ratios that are added in the first steps, one after the other.
const ADDED: [f64; 5] = [0.3, 0.1, 0.03, 0.01, 0.003];

/// How much more certain gains, directions and delay are in these steps: they would make up for masses
/// and stiffnesses, and the search would stay where they do.
const FIRM: f64 = 10.0;

/// Relative errors that count as one standard deviation in these steps. With the larger ones, the
/// quantities stay nearer to those of the file; which of them leads to the true machine depends on how
/// far it is.
const ROUGH: [f64; 3] = [0.2, 0.05, 0.6];

/// With errors that are smaller than this many times those expected, there is no better minimum to be
/// sought.
const FOUND: f64 = 1.5;

/// Most steps with each.
const STEPS: usize = 60;

/// Most steps that show whether sensors and legs are wired otherwise: what they are off then is far
/// more than any machine is from its file.
const FEW: usize = 6;

/// A step that lessens the sum of the squares by a smaller part is the last.
const SETTLED: f64 = 1e-5;

/// With more of Levenberg's and Marquardt's damping a step may be short: along what is known together
/// only, the curvature is that of the changes alone, and smaller by as many orders of magnitude.
const SHORT: f64 = 1e-8;

/// No quantity is farther from the file's value, in standard deviations.
const FARTHEST: f64 = 20.0;

/// Steps for differences, in standard deviations: far below the width of a resonance.
const DIFFERENCE: f64 = 1e-6;

/// Above this part of its deviation before, a quantity is not determined by the measurement.
const UNDETERMINED: f64 = 0.5;

/// Correlation above which two quantities cannot be told apart.
const ALIKE: f64 = 0.95;

/// Relative distance from all modes of the model at which a measured resonance is one that the model
/// has not.
const STRANGE: f64 = 0.02;

/// Relative errors of a model that nobody would call wrong.
const GOOD: f64 = 0.02;

/// Relative distance within which lines show a resonance: about half of that from one line of a first
/// pass to the next.
const AROUND: f64 = 0.12;

/// Errors so many times as large as those expected, from noise and in a good model, have another
/// reason.
const UNEXPLAINED: f64 = 3.0;

/// A quantity that is farther from the file's value, in standard deviations, was hardly so by chance.
const FAR: f64 = 4.0;

/// Half the width of an interval of 95 %, in standard deviations.
const INTERVAL: f64 = 1.96;

/// A fitted quantity.
#[derive(Clone, Debug, Serialize)]
pub struct Estimate {
    /// What it is.
    pub name: String,
    /// Unit of the numbers.
    pub scale: Scale,
    /// Change of the file's value: relative, or in this unit.
    pub change: f64,
    /// Half the width of the interval that holds the true change with a probability of 95 %.
    pub interval: f64,
    /// The change in standard deviations before the measurement.
    pub deviations: f64,
    /// Whether that is so much that the file, or its uncertainty, must be wrong.
    pub far: bool,
    /// Whether the measurement says something about it: the interval is at most half of that before.
    pub determined: bool,
}

/// What is left between measurement and fitted model at a frequency.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Misfit {
    /// Frequency, Hz.
    pub hz: f64,
    /// Frobenius norm of measured minus fitted G22, relative to the measured one; the larger value of
    /// the two kinds of sensors.
    pub error: f64,
    /// The same before the fit.
    pub before: f64,
    /// The value expected from the scatter of the measurement.
    pub expected: f64,
}

/// A fitted machine.
#[derive(Clone, Debug, Serialize)]
pub struct Identification {
    /// All uncertain quantities.
    pub estimates: Vec<Estimate>,
    /// Groups of them that cannot be told apart: only some combination of each is known.
    pub alike: Vec<Vec<String>>,
    /// Root of the mean square of the measured errors, relative to their standard deviations: about 1
    /// if only noise is left.
    pub relative_misfit: f64,
    /// Frequencies, Hz, at which the model does not explain the measurement: the error that is left is
    /// several times that expected from noise and in a good model.
    pub unexplained: Vec<f64>,
    /// By frequency.
    pub lines: Vec<Misfit>,
    /// Measured resonances that the fitted model has not.
    pub strange: Vec<Resonance>,
    /// The fitted machine.
    #[serde(skip)]
    pub machine: Machine,
    /// The uncertain quantities with their changes in the unit of their scale, in the order of
    /// `estimates`.
    #[serde(skip)]
    pub changes: Vec<(Parameter, f64)>,
}

/// Why nothing was fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Too few lines are measured well enough.
    #[error(
        "only {0} lines are measured to better than 30 %: measure with more --averages or a larger --amplitude, on a quieter floor"
    )]
    Few(usize),
    /// The measurement is of other sensors.
    #[error(
        "it has {measured} sensors at each frequency, and the machine file feeds back {model}; measure with this file"
    )]
    Sensors {
        /// In the measurement.
        measured: usize,
        /// In the model.
        model: usize,
    },
    /// Sensors or legs are not where the file has them.
    #[error(
        "{}: so the model explains the measurement, and as the file has it, it does not; mend the cables, or the names or signs in the file, and measure again", .0.join(", and ")
    )]
    Wiring(Vec<String>),
    /// No model could be made on the way.
    #[error("the machine of the file gives no model, or none near it does")]
    NoModel,
}

/// Responses, in the order of [`RationalFit`]: a row for each frequency.
type Responses = DMatrix<Complex<f64>>;

/// One least squares problem.
struct Problem<'a> {
    machine: &'a Machine,
    parameters: &'a [Parameter],
    hertz: &'a [f64],
    target: Responses,
    weights: DMatrix<f64>,
    /// Damping ratio added to every mode.
    added: f64,
}

/// A point of a search.
#[derive(Clone)]
struct Point {
    /// Changes, in standard deviations.
    x: DVector<f64>,
    errors: DVector<f64>,
}

impl Point {
    /// The sum of squares that is to be least.
    fn square(&self) -> f64 {
        self.errors.norm_squared()
    }
}

impl Problem<'_> {
    fn machine(&self, x: &DVector<f64>) -> Machine {
        let changes = self.parameters.iter().zip(x.iter());
        let changes: Vec<_> = changes.map(|(p, x)| p.deviation * x).collect();
        let mut machine = changed(self.machine, self.parameters, &changes);
        let damping = &mut machine.damping;
        damping.modal += self.added;
        damping
            .modes
            .iter_mut()
            .for_each(|ratio| *ratio += self.added);
        machine
    }

    /// The change of the delay, s.
    fn delay(&self, x: &DVector<f64>) -> f64 {
        let own = self.parameters.iter().zip(x.iter());
        let mut own = own.filter(|(parameter, _)| parameter.quantity == Quantity::Delay);
        own.next()
            .map_or(0.0, |(parameter, x)| parameter.deviation * x)
    }

    /// The errors of the responses, then the changes; none if there is no such machine.
    fn errors(&self, x: &DVector<f64>) -> Option<DVector<f64>> {
        if !x.iter().all(|x| x.abs() < FARTHEST) {
            return None;
        }
        let mut found = responses(&self.machine(x), self.hertz)?;
        let delay = self.delay(x);
        for (mut row, hz) in found.row_iter_mut().zip(self.hertz) {
            row *= turn(*hz, delay);
        }
        // Half the square of an error is in its real part.
        let weights = self.weights.map(|weight| Complex::from(SQRT_2 * weight));
        let weighted = (found - &self.target).component_mul(&weights);
        let parts = weighted.iter().flat_map(|error| [error.re, error.im]);
        let changes = self.parameters.iter().zip(x.iter());
        let changes = changes.map(|(parameter, x)| {
            let firm = self.added > 0.0 && !parameter.quantity.is_mechanical();
            if firm { FIRM * x } else { *x }
        });
        let all: Vec<_> = parts.chain(changes).collect();
        all.iter()
            .all(|error| error.is_finite())
            .then(|| all.into())
    }

    /// Root of the mean square of the errors of the responses.
    fn relative_misfit(&self, point: &Point) -> f64 {
        let data = point.errors.len() - self.parameters.len();
        (point.errors.rows(0, data).norm_squared() / data as f64).sqrt()
    }

    fn at(&self, x: DVector<f64>) -> Option<Point> {
        let errors = self.errors(&x)?;
        Some(Point { x, errors })
    }

    /// The derivatives of the errors, a column for each quantity.
    fn derivatives(&self, point: &Point) -> Option<DMatrix<f64>> {
        let columns: Option<Vec<_>> = (0..self.parameters.len())
            .into_par_iter()
            .map(|k| {
                let mut x = point.x.clone();
                x[k] += DIFFERENCE;
                Some((self.errors(&x)? - &point.errors) / DIFFERENCE)
            })
            .collect();
        Some(DMatrix::from_columns(&columns?))
    }

    /// The covariance of the gradient: of what the errors of each column of G22, with these
    /// `covariances` by line, and the changes make of the products with the `derivatives`.
    fn scatter(
        &self,
        derivatives: &DMatrix<f64>,
        covariances: &[DMatrix<Complex<f64>>],
    ) -> DMatrix<f64> {
        let count = self.parameters.len();
        let lines = self.hertz.len();
        let mut sum = DMatrix::identity(count, count);
        for (k, covariance) in covariances.iter().enumerate() {
            let rows = covariance.nrows();
            for leg in 0..LEGS {
                let entry = |i: usize| leg * rows + i;
                // As `errors` has them: real and imaginary part of each line, entry by entry.
                let own = DMatrix::from_fn(rows, count, |i, p| {
                    let at = 2 * (entry(i) * lines + k);
                    Complex::new(derivatives[(at, p)], derivatives[(at + 1, p)])
                });
                let weighted = DMatrix::from_fn(rows, rows, |i, j| {
                    let [a, b] = [i, j].map(|i| self.weights[(k, entry(i))]);
                    covariance[(i, j)] * (a * b)
                });
                sum += (own.adjoint() * weighted * own).map(|x| x.re);
            }
        }
        sum
    }

    /// The least sum of squares near `x`, by Levenberg's and Marquardt's method.
    fn solve(&self, x: DVector<f64>, steps: usize, progress: &dyn Progress) -> Option<Point> {
        let mut point = self.at(x)?;
        let mut damping = 1e-3;
        for _ in 0..steps {
            let derivatives = self.derivatives(&point)?;
            let normal = derivatives.tr_mul(&derivatives);
            let gradient = derivatives.tr_mul(&point.errors);
            let before = point.square();
            let mut better = None;
            while better.is_none() && damping < 1e9 {
                let mut damped = normal.clone();
                for k in 0..damped.nrows() {
                    damped[(k, k)] *= 1.0 + damping;
                }
                let step = damped.cholesky()?.solve(&gradient);
                better = self
                    .at(&point.x - step)
                    .filter(|next| next.square() < before);
                damping *= if better.is_some() { 0.2 } else { 5.0 };
            }
            progress.advance();
            let Some(next) = better else { break };
            let after = next.square();
            point = next;
            // A short step says nothing about the minimum.
            if before - after < SETTLED * before && damping < SHORT {
                break;
            }
            damping = damping.max(1e-12);
        }
        Some(point)
    }
}

/// Most mistakes in the wiring that are sought.
const MISTAKES: usize = 3;

/// Groups of two and more of `count` things, each of which is `alike` another one of its group.
fn groups(count: usize, alike: impl Fn(usize, usize) -> bool) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for i in 0..count {
        let (near, mut others): (Vec<_>, Vec<_>) = groups
            .into_iter()
            .partition(|group| group.iter().any(|j| alike(i, *j)));
        let mut joined = near.concat();
        joined.push(i);
        others.push(joined);
        groups = others;
    }
    groups.retain(|group| group.len() > 1);
    groups
}

/// G22 of a machine at these frequencies; none if there is no such machine.
fn responses(machine: &Machine, hertz: &[f64]) -> Option<Responses> {
    let study = Study::new(machine.clone()).ok()?;
    let rows: Vec<_> = hertz
        .iter()
        .map(|hz| {
            let gain = study.plant().response(*hz).g22();
            DVector::from_column_slice(gain.as_slice()).transpose()
        })
        .collect();
    Some(DMatrix::from_rows(&rows))
}

/// The row of a machine's G22 from which on its sensors are of forces, and not of accelerations.
fn first_force(machine: &Machine) -> usize {
    match machine.target.feedback {
        FeedbackKind::Acceleration | FeedbackKind::Both => LEGS,
        FeedbackKind::Force => 0,
    }
}

/// What a search works on.
struct Search<'a> {
    machine: &'a Machine,
    parameters: &'a [Parameter],
    fit: &'a RationalFit,
    progress: &'a dyn Progress,
}

impl Search<'_> {
    /// The problem whose target is what was measured, wired as `wiring` says.
    fn exact(&self, wiring: &Wiring) -> Problem<'_> {
        self.problem(
            0.0,
            wiring.applied(&self.fit.responses),
            self.fit.weights.clone(),
        )
    }

    /// The problem with this `added` damping, and `error` as relative standard deviation.
    fn damped(&self, wiring: &Wiring, added: f64, error: f64) -> Problem<'_> {
        let target = wiring.applied(&self.fit.damped(added, first_force(self.machine)));
        let weights = self.fit.relative_weights(&target, error);
        self.problem(added, target, weights)
    }

    fn problem(&self, added: f64, target: Responses, weights: DMatrix<f64>) -> Problem<'_> {
        Problem {
            machine: self.machine,
            parameters: self.parameters,
            hertz: &self.fit.hertz,
            target,
            weights,
            added,
        }
    }

    fn begin(&self) -> DVector<f64> {
        DVector::zeros(self.parameters.len())
    }

    /// The most probable machine of several searches.
    fn best(&self, wiring: &Wiring) -> Option<Point> {
        let exact = self.exact(wiring);
        let mut best: Option<Point> = None;
        for error in ROUGH {
            let near = ADDED.into_iter().try_fold(self.begin(), |x, added| {
                let problem = self.damped(wiring, added, error);
                problem.solve(x, STEPS, self.progress).map(|point| point.x)
            });
            // Some lead to machines that cannot be.
            let Some(point) = near.and_then(|x| exact.solve(x, STEPS, self.progress)) else {
                continue;
            };
            let found = exact.relative_misfit(&point) < FOUND;
            if best
                .as_ref()
                .is_none_or(|best| point.square() < best.square())
            {
                best = Some(point);
            }
            if found {
                break;
            }
        }
        best
    }

    /// The wiring that explains a measurement far better than that of the file, if there is one.
    fn other_wiring(&self) -> Option<Wiring> {
        let rough = |wiring: &Wiring| {
            let point =
                self.damped(wiring, ADDED[0], ROUGH[0])
                    .solve(self.begin(), FEW, self.progress);
            point.map_or(f64::INFINITY, |point| point.square())
        };
        let rows = self.fit.responses.ncols() / LEGS;
        let mut found = Wiring::as_filed(rows);
        let mut least = rough(&found);
        for _ in 0..MISTAKES {
            let better = found
                .with_a_mistake_more()
                .map(|wiring| (rough(&wiring), wiring))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((square, wiring)) = better.filter(|(square, _)| *square < 0.5 * least) else {
                break;
            };
            (least, found) = (square, wiring);
        }
        found.is_other().then_some(found)
    }
}

/// Fits the uncertain quantities of `machine` to a measurement. `progress` is called after each step.
///
/// # Errors
/// [`FitError`] if the measurement says too little, is of another kind of machine, or of one whose
/// sensors or legs are swapped or reversed.
pub fn fit(
    machine: &Machine,
    measurement: &Measurement,
    progress: &dyn Progress,
) -> Result<Identification, FitError> {
    let lines = &measurement.lines;
    let measured = lines.first().map_or(0, |line| line.plant.len());
    let study = Study::new(machine.clone()).map_err(|_| FitError::NoModel)?;
    let model = study.plant().plant.sensors().len();
    if measured != model {
        return Err(FitError::Sensors { measured, model });
    }
    let fit = RationalFit::new(lines, machine.board.whole_delay()).ok_or_else(|| {
        let clear = lines.iter().filter(|line| line.is_clear());
        FitError::Few(clear.count())
    })?;
    let highest = fit.hertz.last().copied().unwrap_or(0.0);
    let modes = study.model().modes().hertz();
    let seen = modes.iter().filter(|hz| **hz < highest).count();
    let parameters = parameters(machine, seen);
    let search = Search {
        machine,
        parameters: &parameters,
        fit: &fit,
        progress,
    };
    let filed = Wiring::as_filed(measured);
    let found = search.best(&filed).map(|point| {
        let problem = search.exact(&filed);
        identification(&problem, &point, &study, lines, &fit)
    });
    let misfit = match &found {
        Some(Ok(found)) if found.unexplained.is_empty() => 0.0,
        Some(Ok(found)) => found.relative_misfit,
        _ => f64::INFINITY,
    };
    if misfit > 0.0
        && let Some(wiring) = search.other_wiring()
        && let Some(other) = search.best(&wiring)
        && search.exact(&wiring).relative_misfit(&other) < 0.5 * misfit
    {
        return Err(FitError::Wiring(wiring.mistakes(machine)));
    }
    found.unwrap_or(Err(FitError::NoModel))
}

/// What a point says, with what was measured at these `lines`, and the `fit` through them; `before` is
/// the machine as filed.
fn identification(
    problem: &Problem,
    point: &Point,
    before: &Study,
    lines: &[MeasuredLine],
    fit: &RationalFit,
) -> Result<Identification, FitError> {
    let parameters = problem.parameters;
    let derivatives = problem.derivatives(point).ok_or(FitError::NoModel)?;
    // The changes themselves are among the errors, so it is regular.
    let inverse = derivatives
        .tr_mul(&derivatives)
        .try_inverse()
        .ok_or(FitError::NoModel)?;
    // The weights take all errors as independent, and those of the sensors are not.
    let covariance = &inverse * problem.scatter(&derivatives, &fit.covariances) * &inverse;
    let estimate = |(k, parameter): (usize, &Parameter)| {
        let deviation = covariance[(k, k)].sqrt();
        let change = parameter.deviation * point.x[k];
        Estimate {
            name: parameter.name.clone(),
            scale: parameter.scale,
            change: match parameter.scale {
                Scale::Relative => change.exp_m1(),
                _ => change,
            },
            interval: INTERVAL * parameter.deviation * deviation,
            deviations: point.x[k],
            far: point.x[k].abs() > FAR,
            determined: deviation < UNDETERMINED,
        }
    };
    let correlation =
        |i: usize, j: usize| covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt();
    let groups = groups(parameters.len(), |i, j| correlation(i, j).abs() > ALIKE);
    let named = |group: Vec<usize>| {
        let names = group.into_iter().map(|k| parameters[k].name.clone());
        names.collect()
    };
    let fitted = problem.machine(&point.x);
    let delay = problem.delay(&point.x);
    let after = Study::new(fitted.clone()).map_err(|_| FitError::NoModel)?;
    let misfit = |line: &MeasuredLine| Misfit {
        hz: line.hz,
        error: line.distance(&(after.plant().response(line.hz).g22() * turn(line.hz, delay))),
        before: line.distance(&before.plant().response(line.hz).g22()),
        expected: line.noise(),
    };
    let misfits: Vec<_> = lines.iter().map(misfit).collect();
    let unexplained: Vec<_> = misfits
        .iter()
        .filter(|line| line.error > UNEXPLAINED * line.expected.hypot(GOOD))
        .map(|line| line.hz)
        .collect();
    let modes = after.model().modes().hertz();
    // Where the model explains what was measured around it, it is a mode that noise has shifted.
    let strange = fit.resonances.iter().filter(|resonance| {
        let away = |hz: f64| (resonance.hz / hz - 1.0).abs();
        modes.iter().all(|hz| away(*hz) > STRANGE)
            && unexplained.iter().any(|hz| away(*hz) < AROUND)
    });
    let changes = parameters.iter().zip(point.x.iter());
    Ok(Identification {
        estimates: parameters.iter().enumerate().map(estimate).collect(),
        alike: groups.into_iter().map(named).collect(),
        relative_misfit: problem.relative_misfit(point),
        strange: strange.copied().collect(),
        unexplained,
        lines: misfits,
        machine: fitted,
        changes: changes
            .map(|(parameter, x)| (parameter.clone(), parameter.deviation * x))
            .collect(),
    })
}
