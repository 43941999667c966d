//! Whether a target is reached, and by which shaping; if not, the nearest frequency found
//! that is reached.

use core::f64::consts::{SQRT_2, TAU};
use std::sync::OnceLock;

use nalgebra::{Complex, Vector3};
use shared::LEGS;
use shared::supervisor::GENTLE;

use super::bound::{ByControllers, widening};
use super::outcome::{Advice, Band, Below, Design, DesignError, Refusal, Shaping};
use super::perturbed::{drawn, perturbed};
use super::roll_off::highest_corner;
use super::study::{Growth, Study};
use super::synthesis::Synthesis;
use super::trial::{Miss, SCAN, Trial, nearest_decimal};
use crate::closed_loop::bands::{amplification, ideal_db, open_db, sampled_db};
use crate::closed_loop::ideal::IdealLoop;
use crate::closed_loop::isolation::{corner, isolation_band};
use crate::closed_loop::{LoopGrid, PeakSensitivity, RollOffUse, SLOWEST, SampledLoop};
use crate::control::table;
use crate::machine::{FeedbackKind, LawName, RollOff, Target};
use crate::numeric::NumericError;
use crate::numeric::frequencies::pole_peaks;
use crate::progress::Progress;

/// The sampled loop's corner of isolation may lie this much above the requested one before the
/// target counts as missed: half an octave.
pub const CORNER_SLACK: f64 = SQRT_2;

/// The same for the first search; the other one follows if that finds nothing.
const STRICT: f64 = 1.05;

/// Most searches with a lower and lower sensitivity, and the least factor from one to the next.
const ROUNDS: usize = 4;
const ROUND: f64 = 0.9;

/// Where a scan below the suspension modes ends, as a part of the lowest.
const LOWEST: f64 = 0.05;

/// Ratio of successive frequencies of a scan for one that is reached.
const STRIDE: f64 = 1.6;

/// Most frequencies that are designed before one is advised.
const ADVISED: usize = 8;

/// Both kinds of sensors are worth naming if they reach this part of what one kind does.
const CLEARLY: f64 = 0.9;

/// How long to search for the shapes of the modal law.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Effort {
    /// The full search; the result is verified on randomly perturbed machines.
    Full,
    /// A search of a few seconds, to compare boards.
    Rough,
}

/// The best loop for a target.
struct Found {
    target: Target,
    ideal: IdealLoop,
    trial: Trial,
    isolation_from_hz: f64,
    peak_sensitivity: PeakSensitivity,
    roll_off: Option<RollOffUse>,
}

/// Searches for the best shaping of a study's loop; or verifies a `given` one as if the search had
/// found it.
///
/// # Errors
/// [`DesignError::Unreachable`] if no shaping was found that reaches the target, with the
/// nearest frequency found that is reached, or if the given one misses it.
pub(super) fn search(
    study: &Study,
    effort: Effort,
    progress: &dyn Progress,
    given: Option<&Shaping>,
) -> Result<Design, DesignError> {
    let reach = Reach::new(study, effort, progress)?;
    let miss = match reach.reach(study.machine().target, given) {
        Ok(found) => return Ok(reach.describe(found)),
        Err(Miss::Error(error)) => return Err(error),
        Err(miss) => miss,
    };
    let reason = reach.reason(&miss)? + &reach.certified()?;
    let (advice, both) = match given {
        Some(_) => (Advice::OtherShapes, None),
        None => {
            let advice = reach.nearest()?;
            (advice, reach.nearest_with_both(advice)?)
        }
    };
    let refusal = Refusal {
        reason,
        advice,
        both,
    };
    Err(unreachable(&study.machine().target, refusal))
}

fn ideal(study: &Study, target: &Target) -> Result<IdealLoop, NumericError> {
    IdealLoop::new(&study.plant().plant, study.design_model(), target)
}

/// The target of a study's machine with another `frequency`, Hz.
fn target_at(study: &Study, frequency: f64) -> Target {
    Target {
        frequency,
        ..study.machine().target
    }
}

/// The corner of the ideal loop, Hz, if the transmission zeros keep it above the requested
/// one: the ideal loop for a tenth of the target, whose gains are a hundred times as high and
/// whose poles are at the zeros by then, does not get there either. `None` with both kinds of
/// sensors.
///
/// # Errors
/// If a computation fails.
pub fn limited_by_zeros(study: &Study) -> Result<Option<f64>, NumericError> {
    let target = study.machine().target;
    let asked = CORNER_SLACK * target.isolation_hz();
    if target.feedback == FeedbackKind::Both {
        return Ok(None);
    }
    let corner = |frequency: f64| {
        let ideal = ideal(study, &target_at(study, frequency))?;
        Ok(ideal.isolation_from_hz)
    };
    let own = corner(target.frequency)?;
    let limited = own > asked && corner(0.1 * target.frequency)? > asked;
    Ok(limited.then_some(own))
}

/// The error of a `target` that is not reached.
pub(super) fn unreachable(target: &Target, refusal: Refusal) -> DesignError {
    DesignError::Unreachable {
        asked: target.frequency,
        damping: target.damping,
        refusal,
    }
}

/// A study with what a search needs.
struct Reach<'a> {
    study: &'a Study,
    /// The transmission zeros, rad/s.
    zeros: Vec<Complex<f64>>,
    /// The transmission zeros as peaks, frequency and half width, Hz: a fast loop moves its
    /// poles close to them.
    sharp: Vec<(f64, f64)>,
    /// The perturbed machines on which a design must hold, once they are needed.
    drawn: OnceLock<Vec<Option<Study>>>,
    effort: Effort,
    progress: &'a dyn Progress,
}

impl<'a> Reach<'a> {
    fn new(
        study: &'a Study,
        effort: Effort,
        progress: &'a dyn Progress,
    ) -> Result<Self, DesignError> {
        if let Some(hz) = study.falls() {
            return Err(DesignError::Falls { hz });
        }
        let zeros = study.zeros()?;
        Ok(Self {
            study,
            sharp: pole_peaks(&zeros),
            zeros,
            drawn: OnceLock::new(),
            effort,
            progress,
        })
    }

    fn drawn(&self) -> &[Option<Study>] {
        self.drawn.get_or_init(|| drawn(self.study.machine()))
    }

    fn ideal(&self, target: &Target) -> Result<IdealLoop, NumericError> {
        ideal(self.study, target)
    }

    /// Why the target is missed.
    fn reason(&self, miss: &Miss) -> Result<String, DesignError> {
        let machine = self.study.machine();
        let target = machine.target;
        let modes = self.study.design_model().hertz();
        if target.frequency > modes[0] {
            let which = if target.frequency > modes[LEGS - 1] {
                "the suspension modes"
            } else {
                "the lowest suspension mode"
            };
            return Ok(format!(
                "the target lies above {which}, {:.2} to {:.2} Hz, and soft mounts have a lower one",
                modes[0],
                modes[LEGS - 1]
            ));
        }
        let delay = 1e6 * machine.board.whole_delay();
        let slowest = self.zeros.iter().filter(|s| s.im > 0.0);
        let slowest = slowest.map(|s| s.norm() / TAU);
        let slowest = slowest.fold(f64::INFINITY, f64::min);
        let zero = if slowest < modes[LEGS - 1] {
            format!(
                "; with its sensors held at zero, the machine still moves, from {slowest:.2} Hz on (host-gen zeros)"
            )
        } else {
            String::new()
        };
        let mut reason = match (miss, limited_by_zeros(self.study)?) {
            (_, Some(ideal)) => format!(
                "even without sampling and delay, {} feedback isolates only from {ideal:.2} Hz, and more gain does not help: with its sensors held at zero, the machine still moves, from {slowest:.2} Hz on (host-gen zeros)",
                target.feedback.name()
            ),
            (Miss::Late { ideal, sampled }, None) => format!(
                "the best loop found with {delay:.0} µs of delay isolates only from {sampled:.2} Hz, the ideal loop from {ideal:.2} Hz{zero}"
            ),
            (_, None) => format!(
                "with {delay:.0} µs of delay, no shaping was found that gives a stable sampled loop with a peak sensitivity of at most {} and isolation from {:.2} Hz{}{zero}",
                target.max_sensitivity,
                CORNER_SLACK * target.isolation_hz(),
                match target.roll_off {
                    Some(RollOff { hz, .. }) =>
                        format!(", within control.roll_off from {hz} Hz on"),
                    None => String::new(),
                }
            ),
        };
        if target.feedback != FeedbackKind::Force && self.is_reached_without_weight()? {
            reason += "; without gravity it is reached: as the machine tilts on its legs, horizontal accelerometers read its weight";
        }
        // With both kinds, what one cannot stabilise the other may.
        if target.feedback != FeedbackKind::Both {
            reason += match self.study.growth(&self.zeros)? {
                None => "",
                Some(Growth::Weight) => {
                    "; with the sensor outputs held at zero, the machine is unstable under gravity (see host-gen zeros): make the legs stiffer sideways"
                }
                Some(Growth::Springs) => {
                    "; with the sensor outputs held at zero, the machine is unstable by its springs of negative stiffness (see host-gen zeros): make them weaker"
                }
                Some(Growth::Placement) => {
                    "; from leg forces to sensors there is an unstable zero (see host-gen zeros): put the sensors nearer to the legs"
                }
            };
        }
        Ok(reason)
    }

    /// Whether the machine has weight, and reaches its target without.
    fn is_reached_without_weight(&self) -> Result<bool, DesignError> {
        let machine = self.study.machine();
        if machine.gravity.norm() == 0.0 {
            return Ok(false);
        }
        let mut other = machine.clone();
        other.gravity = Vector3::zeros();
        // Without weight a spring of negative stiffness may be all that is left.
        let Ok(study) = Study::new(other) else {
            return Ok(false);
        };
        if study.falls().is_some() {
            return Ok(false);
        }
        Reach::new(&study, self.effort, self.progress)?.reaches(machine.target.frequency)
    }

    /// What no controller can do, if a certificate was found for it: the continuation of a reason.
    fn certified(&self) -> Result<String, NumericError> {
        let needed = |who: &str, factor: f64| {
            format!(
                "; {who} of any order meets these requirements: peak sensitivity, roll-off and isolation would all have to be at least {factor:.2} times as wide (host-gen bound)"
            )
        };
        let ByControllers { modal, any } = widening(self.study)?;
        Ok(match (modal, any) {
            (_, Some(factor)) => needed("no controller", factor),
            (Some(factor), None) => {
                needed("no controller that feeds back each mode by itself", factor)
            }
            (None, None) => String::new(),
        })
    }

    /// The lowest frequency found that is reached with both kinds of sensors, Hz, if the machine
    /// has them and they reach clearly less than the one kind, whose nearest is `own`.
    fn nearest_with_both(&self, own: Advice) -> Result<Option<f64>, DesignError> {
        let machine = self.study.machine();
        let modes = self.study.design_model().hertz();
        let asked = machine.target.frequency;
        // The direct law feeds back one kind.
        let only_one = machine.target.law == LawName::Direct;
        if only_one || machine.target.feedback == FeedbackKind::Both || asked > modes[0] {
            return Ok(None);
        }
        let Some(both) = machine.with_feedback(FeedbackKind::Both) else {
            return Ok(None);
        };
        // Its model is the same, so it has one.
        let Ok(study) = Study::new(both) else {
            return Ok(None);
        };
        let both = Reach::new(&study, self.effort, self.progress)?;
        let most = match own {
            Advice::Nearest(hz) => CLEARLY * hz,
            Advice::NoFrequency | Advice::OtherShapes => modes[LEGS - 1],
        };
        let mut hz = asked;
        while hz < most {
            if both.reaches(hz)? && both.holds(hz)? {
                return Ok(Some(hz));
            }
            hz = round_up(STRIDE * hz);
        }
        Ok(None)
    }

    /// The references of the bands: the levels of the ideal loop, dB.
    fn references(&self, ideal: &IdealLoop) -> Vec<f64> {
        let plant = &self.study.plant().plant;
        let bands = self.study.machine().bands.iter();
        let reference = bands.map(|(_, low, high)| {
            let ideal = ideal_db(plant, ideal, *low, *high);
            ideal.unwrap_or_else(|| open_db(plant, *low, *high))
        });
        reference.collect()
    }

    /// The synthesis of shapes of the modes, with a sensitivity below `bound` and isolation from
    /// `slack` times the requested corner on; if `perturbed`, also on perturbed machines.
    fn synthesis<'b>(
        &'b self,
        target: Target,
        reference_db: &'b [f64],
        bound: f64,
        slack: f64,
        perturbed: bool,
    ) -> Synthesis<'b> {
        Synthesis {
            study: self.study,
            target: Target {
                max_sensitivity: bound,
                ..target
            },
            reference_db,
            isolation: slack * target.isolation_hz(),
            sharp: &self.sharp,
            drawn: if perturbed { self.drawn() } else { &[] },
            progress: self.progress,
        }
    }

    /// The best shapes for `target`, if there are any.
    fn best_shapes(
        &self,
        target: Target,
        ideal: &IdealLoop,
        loops: &LoopGrid,
    ) -> Result<(Trial, PeakSensitivity), Miss> {
        let asked = target.max_sensitivity;
        let references = self.references(ideal);
        let full = self.effort == Effort::Full;
        // None if there are no shapes, and no trial if they miss a limit.
        let attempt = |bound: f64, perturbed_too: bool| -> Result<_, Miss> {
            // As near to the requested corner as the ideal loop, if that can be had.
            let shapes = [STRICT, CORNER_SLACK].into_iter().find_map(|slack| {
                self.synthesis(target, &references, bound, slack, perturbed_too)
                    .run()
            });
            let Some(shapes) = shapes.map(Box::new) else {
                return Ok(None);
            };
            let shaping = Shaping::Modes { shapes };
            let (mut trial, peak) = Trial::new(self.study, &target, &shaping, loops)?;
            if let (Some(trial), true) = (&mut trial, full) {
                trial.drawn = Some(perturbed(self.study, self.drawn(), &target, &trial.table)?);
            }
            Ok(Some((trial, peak)))
        };
        let mut bound = asked;
        let mut found = None;
        let mut missed = false;
        // The grid may miss the very top of a peak, and a perturbed machine may
        // have a higher one: a little more room then.
        for _ in 0..ROUNDS {
            let Some((trial, peak)) = attempt(bound, full)? else {
                break;
            };
            let mut highest = peak.bounded();
            if let Some(trial) = trial {
                let drawn = trial.drawn;
                highest = highest.max(drawn.map_or(0.0, |d| d.peak_sensitivity));
                if drawn.is_none_or(|d| d.stable == d.samples && d.peak_sensitivity <= asked) {
                    return Ok((trial, peak));
                }
                // What holds here and not on every perturbed machine is reported as
                // such if nothing better is found.
                found = Some((trial, peak));
            } else {
                missed = true;
            }
            bound *= (0.99 * asked / highest).clamp(ROUND, 0.99);
        }
        if full && missed && found.is_none() {
            // As if there were no others.
            if let Some((Some(trial), peak)) = attempt(asked, false)? {
                found = Some((trial, peak));
            }
        }
        found.ok_or(Miss::Unstable)
    }

    /// The best loop for `target`, or the one with a `given` shaping, if it reaches
    /// the target.
    fn reach(&self, target: Target, given: Option<&Shaping>) -> Result<Found, Miss> {
        let ideal = self.ideal(&target)?;
        let low = SLOWEST * target.frequency;
        let model = self.study.design_model();
        let loops = LoopGrid::new(self.study.plant(), &model.modal, low, &self.sharp);
        let (trial, peak_sensitivity) = match (given, target.law) {
            (Some(shaping), law) => {
                let (trial, peak) = Trial::new(self.study, &target, shaping, &loops)?;
                let mut trial = trial.ok_or(Miss::Unstable)?;
                if law == LawName::Modal && self.effort == Effort::Full {
                    trial.drawn = Some(perturbed(self.study, self.drawn(), &target, &trial.table)?);
                }
                (trial, peak)
            }
            (None, LawName::Direct) => highest_corner(self.study, &target, &ideal.gains, &loops)?,
            (None, LawName::Modal) => self.best_shapes(target, &ideal, &loops)?,
        };
        let [low, high] = isolation_band(model, target.frequency);
        let sampled = SampledLoop::new(self.study.plant(), &trial.table);
        let isolation_from_hz = corner(low, high, &pole_peaks(&trial.poles), |hz| {
            sampled.transmissibility(hz)
        });
        if isolation_from_hz > CORNER_SLACK * target.isolation_hz() {
            return Err(Miss::Late {
                ideal: ideal.isolation_from_hz,
                sampled: isolation_from_hz,
            });
        }
        Ok(Found {
            target,
            ideal,
            trial,
            isolation_from_hz,
            peak_sensitivity,
            roll_off: target
                .roll_off
                .map(|limit| loops.roll_off(&sampled.law, &limit)),
        })
    }

    /// The machine's target with another `frequency`, Hz.
    fn target_at(&self, frequency: f64) -> Target {
        target_at(self.study, frequency)
    }

    /// Whether a target at `frequency`, Hz, is reached.
    fn reaches(&self, frequency: f64) -> Result<bool, DesignError> {
        let target = self.target_at(frequency);
        match target.law {
            LawName::Direct => self.holds(frequency),
            // What has something to begin with has a best.
            LawName::Modal => {
                let references = self.references(&self.ideal(&target)?);
                let bound = target.max_sensitivity;
                let synthesis = self.synthesis(target, &references, bound, CORNER_SLACK, false);
                Ok(synthesis.is_feasible())
            }
        }
    }

    /// The target frequency nearest to the requested one that is reached: above it, or below
    /// the suspension modes if it lies above them.
    fn nearest(&self) -> Result<Advice, DesignError> {
        let modes = self.study.design_model().hertz();
        let mut missed = self.study.machine().target.frequency;
        let downward = missed > modes[0];
        if downward {
            missed = modes[0];
        }
        let mut reached = missed;
        loop {
            if downward {
                reached /= STRIDE;
            } else {
                reached *= STRIDE;
            }
            if reached > modes[LEGS - 1] || downward && reached < LOWEST * modes[0] {
                return Ok(Advice::NoFrequency);
            }
            if self.reaches(reached)? {
                break;
            }
            missed = reached;
        }
        while (missed / reached).ln().abs() > 0.02 {
            let middle = (missed * reached).sqrt();
            if self.reaches(middle)? {
                reached = middle;
            } else {
                missed = middle;
            }
        }
        let rounded = |hz: f64| {
            if downward {
                round_down(hz)
            } else {
                round_up(hz)
            }
        };
        // A coarse search said so. What is advised is designed, and verified like any design.
        let mut hz = rounded(reached);
        for _ in 0..ADVISED {
            if self.holds(hz)? {
                return Ok(Advice::Nearest(hz));
            }
            hz = rounded(if downward { hz / SCAN } else { hz * SCAN });
        }
        Ok(Advice::NoFrequency)
    }

    /// Whether a target at `frequency`, Hz, is reached by a design that is verified.
    fn holds(&self, frequency: f64) -> Result<bool, DesignError> {
        match self.reach(self.target_at(frequency), None) {
            Ok(_) => Ok(true),
            Err(Miss::Error(error)) => Err(error),
            Err(_) => Ok(false),
        }
    }

    fn describe(&self, found: Found) -> Design {
        let Trial {
            shaping,
            drawn,
            table,
            poles,
        } = found.trial;
        let closed_loop = SampledLoop::new(self.study.plant(), &table);
        let starting = (0..25).map(|n| f64::from(GENTLE).powf(f64::from(n) / 24.0));
        let plant = &self.study.plant().plant;
        let bands = self.study.machine().bands.iter();
        let bands = bands.map(|(name, low, high)| Band {
            name: name.clone(),
            low_hz: *low,
            high_hz: *high,
            open_db: open_db(plant, *low, *high),
            ideal_db: ideal_db(plant, &found.ideal, *low, *high).unwrap_or(f64::NAN),
            sampled_db: sampled_db(&closed_loop, &poles, *low, *high),
        });
        let low = 0.1 * found.target.frequency;
        let bands_from = self.study.machine().bands.iter();
        let bands_from = bands_from.map(|(_, low, _)| *low).reduce(f64::min);
        let below = bands_from.filter(|from| *from > low).map(|high_hz| {
            let (db, hz) = amplification(&closed_loop, &poles, low, high_hz);
            Below { high_hz, db, hz }
        });
        Design {
            below,
            ac_coupling_hz: table::AC_COUPLING * found.target.frequency,
            leak_hz: table::LEAK * found.target.frequency,
            peak_sensitivity: found.peak_sensitivity,
            roll_off: found.roll_off,
            drawn,
            isolation_from_ideal_hz: found.ideal.isolation_from_hz,
            isolation_from_hz: found.isolation_from_hz,
            slowest_decay: poles.iter().map(|s| s.re).fold(f64::MIN, f64::max),
            soft_start: closed_loop.is_stable_with(&starting.collect::<Vec<_>>()),
            bands: bands.collect(),
            shaping,
            table,
        }
    }
}

/// Two significant digits, upward: advice that still holds after rounding.
fn round_up(x: f64) -> f64 {
    let unit = 10f64.powf(x.log10().floor() - 1.0);
    nearest_decimal((x / unit).ceil() * unit)
}

/// Two significant digits, downward.
fn round_down(x: f64) -> f64 {
    let unit = 10f64.powf(x.log10().floor() - 1.0);
    nearest_decimal((x / unit).floor() * unit)
}
