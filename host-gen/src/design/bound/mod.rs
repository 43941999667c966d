//! What no controller can pass, of any order, on the machine of the file.
//!
//! Let t be an entry on the diagonal of the complementary sensitivity T with the loop opened at the
//! forces along the modes. The requirements are discs in which t must lie at each frequency: S =
//! 1 − T limits it, a roll-off does, and a motion of the machine is g − m·t and a rest, with
//! functions g and m of the machine. Other entries of T, which are limited too, make the rest; it
//! is zero for a mode that couples to no other one.
//!
//! Plant and closed loop are stable, and a sample measures forces computed d samples before and
//! earlier, so t is a series in z⁻¹ that begins with z⁻ᵈ. Such a t is orthogonal to each function
//! Φ = z^(d−1)·ψ with a stable ψ: the integral of Re(Φ·t) over the unit circle is zero. So if the
//! integral of the least Re(Φ·t) over the discs is positive, no controller meets the requirements.
//!
//! Φ is the certificate: whoever has the machine can check it by one integral. A convex programme
//! proposes it, and what it proves is computed from Φ alone, on grids finer than that of the
//! programme.

mod limits;
mod mean_square;
mod programme;
mod test_function;

use nalgebra::{Complex, DVector};
use rayon::prelude::*;
use serde::Serialize;
use shared::LEGS;

pub use mean_square::{EntryFunction, MeanSquareBound};
pub use test_function::{Term, TestFunction};

use limits::{Controllers, Limit, Limits, Question};
use mean_square::{Ball, Pattern, Point, Proof, Quadratic, certified};
use programme::{Sample, solve};

use super::Study;
use super::sources::Sources;
use crate::closed_loop::SLOWEST;
use crate::control::shape::Resonance;
use crate::machine::{FeedbackKind, RollOff};
use crate::numeric::NumericError;
use crate::numeric::discs::least;
use crate::numeric::frequencies::pole_peaks;
use crate::numeric::quadrature::nodes;

/// What a test function proves.
#[derive(Clone, Debug, Serialize)]
pub struct Certificate {
    /// No controller is below this level, dB.
    pub db: f64,
    /// The difference between the levels of two grids, one twice as fine as the other, dB; `db` is
    /// the lower level.
    pub grid_db: f64,
    /// Φ.
    pub function: TestFunction,
}

/// Certificates for the controllers of a mode.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ByControllers<T> {
    /// For controllers that feed back each mode by itself, as the modal law does.
    pub modal: T,
    /// For all controllers.
    pub any: T,
}

impl ByControllers<Option<f64>> {
    /// The highest level of all `modes`, dB: what no controller can pass.
    pub fn most(modes: &[ModeBound]) -> Self {
        let level = |found: &Option<Certificate>| found.as_ref().map(|found| found.db);
        let most = |of: fn(&ModeBound) -> &Option<Certificate>| {
            modes
                .iter()
                .filter_map(|mode| level(of(mode)))
                .reduce(f64::max)
        };
        Self {
            modal: most(|mode| &mode.found.modal),
            any: most(|mode| &mode.found.any),
        }
    }
}

impl<T> ByControllers<T> {
    /// Both changed alike.
    pub fn map<U>(self, change: impl Fn(T) -> U) -> ByControllers<U> {
        ByControllers {
            modal: change(self.modal),
            any: change(self.any),
        }
    }
}

/// A bound of one mode. Modes with equal frequencies have equal ones and count once.
#[derive(Clone, Debug, Serialize)]
pub struct ModeBound {
    /// Number of the mode, from 1.
    pub mode: usize,
    /// Its natural frequency in the design model, Hz.
    pub hz: f64,
    /// None where no certificate was found.
    pub found: ByControllers<Option<Certificate>>,
}

/// What is bounded.
#[derive(Clone, Copy, Debug)]
pub enum Asked<'a> {
    /// The highest σ_max(G11) in all bands at once, as a part of these levels, dB; no level for a
    /// band that does not count.
    Bands(&'a [Option<f64>]),
    /// The factor by which all requirements must be widened: above 0 dB, no controller meets them.
    Requirements,
}

/// By how much all requirements of a study's target must be widened before a controller can meet
/// them, a factor above 1: with modal controllers, and with any. None where no certificate says so.
///
/// # Errors
/// [`NumericError`] if an eigenvalue iteration does not converge.
pub(super) fn widening(study: &Study) -> Result<ByControllers<Option<f64>>, NumericError> {
    let bounds = Bounds::new(study, study.machine().target.roll_off)?;
    Ok(
        ByControllers::most(&bounds.of(Asked::Requirements)).map(|db| {
            let factor = db.map(factor);
            factor.filter(|factor| *factor > 1.0)
        }),
    )
}

/// The bounds of a study.
pub struct Bounds<'a> {
    limits: Limits<'a>,
    study: &'a Study,
    modes: Vec<Prepared>,
}

/// A mode with what all its certificates share.
struct Prepared {
    index: usize,
    poles: Vec<Resonance>,
    /// The grid of the programme.
    coarse: Grid,
    /// Those on which a certificate is verified.
    fine: [Grid; 2],
}

/// A grid of a quadrature: z, weight, and what is seen of the mode.
type Grid = Vec<(Complex<f64>, f64, limits::Seen)>;

/// Ratios of the poles' dampings at the edges of limits and at resonances, and their number.
const RUNG: f64 = 4.0;
const RUNGS: i32 = 2;

/// Real poles of test functions in a decade, from this part of the frequency of isolation on.
const PER_DECADE: f64 = 3.0;
const FROM: f64 = 0.3;

/// A resonance or a zero is the mode's own if its response changes by this factor there.
const OWN: f64 = 1.5;

/// Intervals in a decade of the grids on which a certificate is verified.
const FINE: [f64; 2] = [100.0, 200.0];

/// Levels between which a certificate's is found, dB.
const LEVELS: [f64; 2] = [-140.0, 80.0];

/// The factor of a level, dB.
fn factor(db: f64) -> f64 {
    10f64.powf(0.05 * db)
}

impl<'a> Bounds<'a> {
    /// Prepares the bounds of the modes of `study` with the peak sensitivity and the corner of
    /// isolation of its target, and with `roll_off`.
    ///
    /// There are none with both kinds of sensors: they tell the floor's motion from the machine's,
    /// so that neither S nor T limits the isolation of a machine that is known exactly.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn new(study: &'a Study, roll_off: Option<RollOff>) -> Result<Self, NumericError> {
        let machine = study.machine();
        let limits = Limits::new(study, roll_off);
        let mut peaks = study.plant().plant.peaks();
        peaks.extend(pole_peaks(&study.zeros()?));
        let lowest = SLOWEST * machine.target.frequency;
        let highest = 0.5 / study.plant().period;
        let mut edges = limits.edges();
        edges.extend([lowest, highest]);
        edges.retain(|hz| (lowest..=highest).contains(hz));
        edges.sort_by(f64::total_cmp);
        edges.dedup();
        let groups = match machine.target.feedback {
            FeedbackKind::Both => Vec::new(),
            FeedbackKind::Acceleration | FeedbackKind::Force => study.design_model().groups(),
        };
        let prepare = |index: usize| {
            let poles = poles(&limits, index, &edges, &peaks);
            let sharp = poles.iter().filter(|pole| pole.damping < 1.0);
            let singular = sharp.map(|pole| Complex::new(pole.hz, pole.hz * pole.damping));
            let singular: Vec<_> = singular.collect();
            let grid = |breaks: &[f64]| grid(study, &limits, index, breaks, &singular);
            Prepared {
                index,
                poles,
                coarse: grid(&edges),
                fine: FINE.map(|per_decade| grid(&divided(&edges, per_decade))),
            }
        };
        let modes = groups.into_par_iter().map(|modes| prepare(modes.start));
        Ok(Self {
            modes: modes.collect(),
            limits,
            study,
        })
    }

    /// From where to where the machine as a whole must be isolated from the floor, Hz.
    pub fn isolated(&self) -> [f64; 2] {
        self.limits.isolated()
    }

    /// The best certificates found for each mode.
    pub fn of(&self, asked: Asked<'_>) -> Vec<ModeBound> {
        let level = |db: &Option<f64>| db.map(factor);
        let levels: Vec<_>;
        let question = match asked {
            Asked::Bands(db) => {
                levels = db.iter().map(level).collect::<Vec<_>>();
                Question::Bands(&levels)
            }
            Asked::Requirements => Question::Requirements,
        };
        let hertz = self.study.design_model().hertz();
        let modes = self.modes.par_iter().map(|mode| {
            let certify = |controllers| {
                let sampled = self.study.plant();
                let delay = sampled.seen_delay();
                let function = TestFunction::with_poles(delay - 1, &mode.poles, sampled.period);
                let limited = |grid: &Grid| -> Vec<Sample> {
                    let samples = grid.iter().map(|(z, weight, seen)| Sample {
                        z: *z,
                        weight: *weight,
                        limits: self.limits.limits(seen, controllers, question),
                    });
                    samples.collect()
                };
                let fine = mode.fine.each_ref().map(limited);
                certificate(function, &limited(&mode.coarse), &fine)
            };
            let any = certify(Controllers::Any);
            let modal = certify(Controllers::Modal);
            // What holds for all controllers holds for modal ones.
            let level = |found: &Option<Certificate>| found.as_ref().map_or(f64::MIN, |c| c.db);
            let modal = if level(&any) > level(&modal) {
                any.clone()
            } else {
                modal
            };
            ModeBound {
                mode: mode.index + 1,
                hz: hertz[mode.index],
                found: ByControllers { modal, any },
            }
        });
        modes.collect()
    }

    /// The best bounds found of the rms that the machine's file asks to be least: for controllers
    /// that feed back the modes, or blocks of modes that couple, each by itself; and for any. None
    /// if the file asks for peaks, and with both kinds of sensors.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn mean_square(
        &self,
    ) -> Result<Option<ByControllers<Option<MeanSquareBound>>>, NumericError> {
        let (Some(measure), false) = (self.study.machine().measure(), self.modes.is_empty()) else {
            return Ok(None);
        };
        let sources = Sources::new(self.study, measure);
        let programme = MeanSquares::new(self, &sources)?;
        let any = programme.bound(vec![(0..LEGS).collect()]);
        let blocks = self.limits.coupled(programme.inside());
        let alone = (blocks.len() > 1).then(|| programme.bound(blocks));
        let rms = |found: &Option<MeanSquareBound>| found.as_ref().map_or(0.0, |bound| bound.rms);
        // What holds for all controllers holds for modal ones.
        let modal = match alone {
            Some(alone) if rms(&alone) > rms(&any) => alone,
            _ => any.clone(),
        };
        Ok(Some(ByControllers { modal, any }))
    }
}

/// What the bounds of a mean square share.
struct MeanSquares<'a> {
    bounds: &'a Bounds<'a>,
    sources: &'a Sources<'a>,
    /// Frequencies at which something is not smooth, Hz.
    edges: Vec<f64>,
    /// Singularities of what is integrated, Hz.
    singular: Vec<Complex<f64>>,
    /// Poles of test functions, the most useful first.
    poles: Vec<Resonance>,
}

impl<'a> MeanSquares<'a> {
    fn new(bounds: &'a Bounds<'a>, sources: &'a Sources<'a>) -> Result<Self, NumericError> {
        let Bounds { limits, study, .. } = bounds;
        let highest = 0.5 / study.plant().period;
        let lowest = SLOWEST * study.machine().target.frequency;
        let lowest = sources.band[0].min(lowest);
        let mut edges = sources.breaks();
        edges.extend(limits.roll_off_hz());
        edges.extend([lowest, highest]);
        edges.retain(|hz| (lowest..=highest).contains(hz));
        edges.sort_by(f64::total_cmp);
        edges.dedup();
        let mut peaks = study.plant().peaks();
        peaks.extend(pole_peaks(&study.zeros()?));
        let mut poles: Vec<Resonance> = lags(FROM * limits.isolated()[0], highest).collect();
        let [low, high] = sources.band;
        for (hz, width) in peaks.iter().filter(|(hz, _)| low < *hz && *hz < high) {
            let damping = width / hz;
            let same = |other: &Resonance| {
                (hz / other.hz - 1.0).abs() < SAME * damping
                    && (damping / other.damping - 1.0).abs() < SAME
            };
            if !poles.iter().any(same) {
                poles.push(Resonance { hz: *hz, damping });
            }
        }
        poles.extend(edges[1..edges.len() - 1].iter().map(|hz| Resonance {
            hz: *hz,
            damping: 1.0 / RUNG,
        }));
        let singular = peaks.iter().map(|(hz, width)| Complex::new(*hz, *width));
        Ok(Self {
            singular: singular.collect(),
            bounds,
            sources,
            edges,
            poles,
        })
    }

    /// A quadrature with these breaks: frequencies, Hz, and weights, Hz.
    fn grid(&self, breaks: &[f64]) -> Vec<(f64, f64)> {
        let mut at = nodes(breaks, &self.singular, |hz| self.sources.exponent(hz));
        // The rest down to 0 Hz.
        at.push((0.5 * breaks[0], breaks[0]));
        at
    }

    /// Frequencies in the band, Hz.
    fn inside(&self) -> impl Iterator<Item = f64> {
        let [low, high] = self.sources.band;
        let grid = self.grid(&self.edges).into_iter().map(|(hz, _)| hz);
        grid.filter(move |hz| low < *hz && *hz < high)
    }

    fn points(&self, pattern: &Pattern, grid: &[(f64, f64)]) -> Vec<Point> {
        let Bounds { limits, study, .. } = self.bounds;
        let [low, high] = self.sources.band;
        let motion = |hz: f64| {
            let (a, m, r) = limits.moved(hz, self.sources)?;
            Some(Quadratic::new(pattern, self.sources.weight(hz), &a, &m, &r))
        };
        let points = grid.par_iter().map(|(hz, weight)| Point {
            z: study.plant().z(*hz),
            weight: *weight,
            ball: Ball::new(study.machine().target.max_sensitivity, limits.roll_off(*hz)),
            motion: if low < *hz && *hz < high {
                motion(*hz)
            } else {
                None
            },
        });
        points.collect()
    }

    /// The best bound found for controllers that feed back these `blocks` of modes by themselves.
    fn bound(&self, blocks: Vec<Vec<usize>>) -> Option<MeanSquareBound> {
        let plant = self.bounds.study.plant();
        let pattern = Pattern::new(&blocks);
        let coarse = self.points(&pattern, &self.grid(&self.edges));
        let power = plant.seen_delay() - 1;
        let mut function = TestFunction::with_poles(power, &self.poles, plant.period);
        function.shorten(MOST / pattern.len());
        let [coarser, finer] = MEAN_SQUARE_FINE
            .map(|per_decade| self.points(&pattern, &self.grid(&divided(&self.edges, per_decade))));
        let found = certified(&pattern, function, &coarse, &[coarser, finer])?;
        let Proof {
            functions,
            squares: [coarser, finer],
        } = found;
        let least = coarser.min(finer);
        (least > 0.0).then(|| MeanSquareBound {
            rms: least.sqrt(),
            grid_db: 10.0 * (coarser / finer).log10().abs(),
            blocks: blocks
                .iter()
                .map(|block| block.iter().map(|mode| mode + 1).collect())
                .collect(),
            certificate: pattern.certificate(functions),
        })
    }
}

/// Coefficients in the programme for the mean square; more take too long.
const MOST: usize = 1100;

/// Part of its width by which a resonance differs from another one.
const SAME: f64 = 0.1;

/// Intervals in a decade of the grids on which the bound of the mean square is verified.
const MEAN_SQUARE_FINE: [f64; 2] = [50.0, 100.0];

/// The best coefficients found for `function` on the samples of the programme, `coarse`, and what it
/// proves on two finer grids.
fn certificate(
    mut function: TestFunction,
    coarse: &[Sample],
    fine: &[Vec<Sample>; 2],
) -> Option<Certificate> {
    let points = coarse.iter().map(|sample| (sample.z, sample.weight));
    let (basis, triangle) = function.orthonormal(&points.collect::<Vec<_>>());
    let found = solve(coarse, &basis)?;
    let found = triangle.solve_upper_triangular(&DVector::from_vec(found))?;
    function.coefficients = found.iter().copied().collect();
    let [coarser, finer] = fine
        .each_ref()
        .map(|samples| highest_level(&function, samples));
    let (coarser, finer) = (coarser?, finer?);
    Some(Certificate {
        db: coarser.min(finer),
        grid_db: (coarser - finer).abs(),
        function,
    })
}

/// The highest level, dB, at which the mean of the least Re(Φ·t) over the limits is positive; none
/// if there is none.
fn highest_level(function: &TestFunction, samples: &[Sample]) -> Option<f64> {
    let parts: Vec<_> = samples
        .iter()
        .map(|sample| (function.at(sample.z) * sample.weight, &sample.limits))
        .collect();
    let positive = |db: f64| {
        let factor = factor(db);
        let least = |(phi, limits): &(Complex<f64>, &Vec<Limit>)| {
            let discs: Vec<_> = limits.iter().map(|limit| limit.at(factor)).collect();
            least(*phi, &discs)
        };
        parts.iter().map(least).sum::<f64>() > 0.0
    };
    let [mut low, mut high] = LEVELS;
    if !positive(low) {
        return None;
    }
    while high - low > 1e-4 {
        let middle = 0.5 * (low + high);
        if positive(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(low)
}

/// Poles of test functions for a mode: lags over all frequencies, and resonances at the edges of
/// limits and where the mode's own response has a resonance or a zero.
fn poles(limits: &Limits<'_>, mode: usize, edges: &[f64], peaks: &[(f64, f64)]) -> Vec<Resonance> {
    let highest = edges[edges.len() - 1];
    let lowest = FROM * limits.isolated()[0];
    let lags = lags(lowest, highest);
    let rungs = || (1..=RUNGS).map(|k| RUNG.powi(-k));
    let at = |hz: f64| move |damping: f64| Resonance { hz, damping };
    let inner = &edges[1..edges.len() - 1];
    let edges = inner.iter().flat_map(|hz| rungs().map(at(*hz)));
    let own = peaks.iter().filter(|(hz, width)| {
        let size = |hz: f64| limits.see(hz, mode).own.norm();
        let beside = [hz - 10.0 * width, hz + 10.0 * width].map(size);
        let ratio = size(*hz) / (beside[0] * beside[1]).sqrt();
        !(1.0 / OWN..=OWN).contains(&ratio)
    });
    let resonances = own.flat_map(|(hz, width)| {
        let own = width / hz;
        let wider = rungs().filter(move |damping| *damping > 2.0 * own);
        wider.chain([own]).map(at(*hz))
    });
    lags.chain(edges).chain(resonances).collect()
}

/// Poles of lags from `lowest` to below `highest`, Hz.
fn lags(lowest: f64, highest: f64) -> impl Iterator<Item = Resonance> {
    let count = (PER_DECADE * (highest / lowest).log10()).ceil();
    (0..count as u32).map(move |k| Resonance {
        hz: lowest * (highest / lowest).powf(f64::from(k) / count),
        damping: 1.0,
    })
}

/// The `edges` with so many intervals in a decade between them.
fn divided(edges: &[f64], per_decade: f64) -> Vec<f64> {
    let mut breaks = vec![edges[0]];
    for ends in edges.windows(2) {
        let ratio = ends[1] / ends[0];
        let count = (per_decade * ratio.log10()).ceil();
        breaks.extend((1..count as u32).map(|k| ends[0] * ratio.powf(f64::from(k) / count)));
        breaks.push(ends[1]);
    }
    breaks
}

/// The quadrature of a mean over the unit circle.
fn grid(
    study: &Study,
    limits: &Limits<'_>,
    mode: usize,
    breaks: &[f64],
    singular: &[Complex<f64>],
) -> Grid {
    let (lowest, highest) = (breaks[0], breaks[breaks.len() - 1]);
    let mut at = nodes(breaks, singular, |_| 0.0);
    // The rest down to 0 Hz.
    at.push((0.5 * lowest, lowest));
    let seen = at
        .into_par_iter()
        .map(|(hz, weight)| (study.plant().z(hz), weight / highest, limits.see(hz, mode)));
    seen.collect()
}

#[cfg(test)]
mod tests;
