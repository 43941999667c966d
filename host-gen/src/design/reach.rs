//! Whether a target is reached, and by which shaping; if not, the nearest frequency found
//! that is reached.

use core::f64::consts::SQRT_2;

use nalgebra::Complex;
use rayon::prelude::*;
use shared::LEGS;
use shared::supervisor::GENTLE;
use shared::table::ValidTable;

use super::objective::Objective;
use super::outcome::{Advice, Band, Design, DesignError, PerturbedSet, Shaping};
use super::pattern_search::{PatternSearch, ROUGH_TRIALS, TRIALS};
use super::roll_off::highest_corner;
use super::study::Study;
use super::trial::{Miss, SCAN, Trial, closed, nearest_decimal};
use crate::closed_loop::isolation::{corner, highest_db, isolation_band};
use crate::closed_loop::{
    LoopGrid, PeakSensitivity, SLOWEST, SampledLoop, close_ideal, ideal_poles, stable,
};
use crate::control::{Gains, LinearLaw, table};
use crate::machine::{DESIGN_SAMPLES, FeedbackKind, LawName, Target};
use crate::numeric::NumericError;
use crate::numeric::frequencies::{grid, pole_peaks};
use crate::plant::zeros::{grow, transmission_zeros};
use crate::progress::Progress;

/// The sampled loop's corner may lie this much above the ideal loop's before
/// the target counts as missed: half an octave.
pub const CORNER_SLACK: f64 = SQRT_2;

/// How long to search for the shapes of the modal law.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Effort {
    /// The full search; the result is verified on randomly perturbed machines.
    Full,
    /// A search of a few seconds, to compare boards.
    Rough,
}

impl Effort {
    fn trials(self) -> usize {
        match self {
            Self::Full => TRIALS,
            Self::Rough => ROUGH_TRIALS,
        }
    }
}

/// The best loop for a target.
struct Found {
    target: Target,
    ideal: Ideal,
    trial: Trial,
    isolation_from_hz: f64,
    peak_sensitivity: PeakSensitivity,
}

/// Searches for the best shaping of a study's loop.
///
/// # Errors
/// [`DesignError::Unreachable`] if no shaping was found that reaches the target, with the
/// nearest frequency found that is reached.
pub(super) fn search(
    study: &Study,
    effort: Effort,
    progress: &dyn Progress,
) -> Result<Design, DesignError> {
    let reach = Reach {
        study,
        effort,
        progress,
    };
    match reach.reach(study.machine().target, None) {
        Ok(found) => Ok(reach.describe(found)),
        Err(miss) => {
            let reason = reach.reason(miss)?;
            let advice = reach.nearest()?;
            Err(unreachable(&study.machine().target, reason, advice))
        }
    }
}

/// Verifies a shaping on a study's loop as if the search had found it.
///
/// # Errors
/// [`DesignError::Unreachable`] if the loop misses the target.
pub(super) fn verify(
    study: &Study,
    effort: Effort,
    shaping: &Shaping,
) -> Result<Design, DesignError> {
    let reach = Reach {
        study,
        effort,
        progress: &(),
    };
    match reach.reach(study.machine().target, Some(shaping)) {
        Ok(found) => Ok(reach.describe(found)),
        Err(miss) => {
            let reason = reach.reason(miss)?;
            Err(unreachable(
                &study.machine().target,
                reason,
                Advice::OtherShapes,
            ))
        }
    }
}

/// The error of a `target` that is not reached.
pub(super) fn unreachable(target: &Target, reason: String, advice: Advice) -> DesignError {
    DesignError::Unreachable {
        asked: target.frequency,
        damping: target.damping,
        reason,
        advice,
    }
}

/// A study with what a search needs.
struct Reach<'a> {
    study: &'a Study,
    effort: Effort,
    progress: &'a dyn Progress,
}

/// The unsampled loop for one target.
struct Ideal {
    gains: Gains,
    poles: Vec<Complex<f64>>,
    isolation_from_hz: f64,
}

impl Reach<'_> {
    /// Why the target is missed, unless a computation failed.
    fn reason(&self, miss: Miss) -> Result<String, DesignError> {
        let machine = self.study.machine();
        let target = machine.target;
        let delay = 1e6 * machine.board.whole_delay();
        let mut reason = match miss {
            Miss::Error(error) => return Err(error),
            Miss::Late { ideal, sampled } => format!(
                "the best loop found with {delay:.0} µs of delay isolates only from {sampled:.2} Hz, the ideal loop from {ideal:.2} Hz"
            ),
            Miss::Unstable => format!(
                "with {delay:.0} µs of delay, no shaping was found that gives a stable sampled loop with a peak sensitivity of at most {} and isolation from near the corner of the ideal loop",
                target.max_sensitivity
            ),
        };
        if target.feedback != FeedbackKind::Both {
            let plant = &self.study.plant().plant.state_space;
            if grow(&transmission_zeros(plant, target.feedback)?) {
                reason += ", and no gain can stabilise it: with the sensor outputs held at zero, the machine is unstable under gravity (see host-gen zeros); make the legs stiffer sideways";
            }
        }
        Ok(reason)
    }

    fn ideal(&self, target: &Target) -> Result<Ideal, Miss> {
        let model = self.study.design_model();
        let gains = Gains::new(model, target);
        let plant = &self.study.plant().plant;
        let poles = ideal_poles(&plant.state_space, &gains)?;
        let [low, high] = isolation_band(model, target.frequency);
        let isolation_from_hz = corner(low, high, &pole_peaks(&poles), |hz| {
            close_ideal(plant, &gains, hz, plant.whole()) * plant.rigid_floor.map(Complex::from)
        });
        Ok(Ideal {
            gains,
            poles,
            isolation_from_hz,
        })
    }

    /// The transmission zeros as peaks, frequency and half width, Hz: a fast loop moves
    /// its poles close to them.
    fn sharp(&self, target: Target) -> Result<Vec<(f64, f64)>, NumericError> {
        let state_space = &self.study.plant().plant.state_space;
        let zeros = transmission_zeros(state_space, target.feedback)?;
        Ok(pole_peaks(&zeros))
    }

    /// The search for shapes of the modes, with a sensitivity below `bound`.
    fn pattern_search(
        &self,
        target: Target,
        ideal: &Ideal,
        bound: f64,
    ) -> Result<PatternSearch<'_>, NumericError> {
        let machine = self.study.machine();
        let model = self.study.design_model();
        let holds = stable(&ideal.poles);
        let reference = machine
            .bands
            .iter()
            .map(|(_, low, high)| {
                if holds {
                    self.ideal_db(ideal, *low, *high)
                } else {
                    self.open_db(*low, *high)
                }
            })
            .collect::<Vec<_>>();
        let bounded = Target {
            max_sensitivity: bound,
            ..target
        };
        let objective = Objective::new(
            machine,
            model,
            self.study.plant(),
            bounded,
            &reference,
            CORNER_SLACK * ideal.isolation_from_hz,
            &self.sharp(target)?,
        );
        Ok(PatternSearch::new(machine, model, bounded, objective))
    }

    /// The best shapes for `target`, if there are any.
    fn best_shapes(
        &self,
        target: Target,
        ideal: &Ideal,
        loops: &LoopGrid,
    ) -> Result<(Trial, PeakSensitivity), Miss> {
        let asked = target.max_sensitivity;
        let mut bound = asked;
        let mut found = None;
        // The grid may miss the very top of a peak, and a perturbed machine may
        // have a higher one: a little more room then.
        for _ in 0..3 {
            let search = self.pattern_search(target, ideal, bound)?;
            let Some(shapes) = search.run(self.effort.trials(), self.progress) else {
                break;
            };
            let (trial, peak) = Trial::new(self.study, &target, &Shaping::Modes { shapes }, loops)?;
            let mut highest = peak.bounded();
            if let Some(mut trial) = trial {
                if self.effort == Effort::Full {
                    trial.drawn = Some(self.perturbed(&target, &LinearLaw::new(&trial.table))?);
                }
                let holds = trial
                    .drawn
                    .is_none_or(|d| d.stable == d.samples && d.peak_sensitivity <= asked);
                highest = highest.max(trial.drawn.map_or(0.0, |d| d.peak_sensitivity));
                if holds {
                    return Ok((trial, peak));
                }
                // What holds here and not on every perturbed machine is reported as
                // such if nothing better is found.
                found = Some((trial, peak));
            }
            bound *= 0.99 * (asked / highest).clamp(0.8, 1.0);
        }
        found.ok_or(Miss::Unstable)
    }

    /// `law` on randomly perturbed machines. One that makes no model counts as one
    /// on which the loop is not stable.
    fn perturbed(&self, target: &Target, law: &LinearLaw) -> Result<PerturbedSet, Miss> {
        let machine = self.study.machine();
        let samples = DESIGN_SAMPLES.min(machine.robustness.samples);
        let low = SLOWEST * target.frequency;
        let peaks = (0..samples)
            .into_par_iter()
            .map(|i| {
                let Ok(study) = Study::new(machine.drawn(i)) else {
                    return Ok(None);
                };
                let closed = SampledLoop {
                    plant: study.plant(),
                    law: *law,
                };
                let poles = closed.poles()?;
                Ok(stable(&poles).then(|| {
                    closed
                        .peak_sensitivity(&self.study.design_model().modal, low, &poles)
                        .bounded()
                }))
            })
            .collect::<Result<Vec<_>, NumericError>>()?;
        let stable = peaks.iter().flatten();
        Ok(PerturbedSet {
            samples,
            stable: stable.clone().count(),
            peak_sensitivity: stable.fold(0.0, |a, b| a.max(*b)),
        })
    }

    /// The best loop for `target`, or the one with a `given` shaping, if it reaches
    /// the target.
    fn reach(&self, target: Target, given: Option<&Shaping>) -> Result<Found, Miss> {
        let ideal = self.ideal(&target)?;
        let low = SLOWEST * target.frequency;
        let model = self.study.design_model();
        let loops = LoopGrid::new(self.study.plant(), &model.modal, low, &self.sharp(target)?);
        let (trial, peak_sensitivity) = match (given, target.law) {
            (Some(shaping), law) => {
                let (trial, peak) = Trial::new(self.study, &target, shaping, &loops)?;
                let mut trial = trial.ok_or(Miss::Unstable)?;
                if law == LawName::Modal && self.effort == Effort::Full {
                    trial.drawn = Some(self.perturbed(&target, &LinearLaw::new(&trial.table))?);
                }
                (trial, peak)
            }
            (None, LawName::Direct) => highest_corner(self.study, &target, &ideal.gains, &loops)?,
            (None, LawName::Modal) => self.best_shapes(target, &ideal, &loops)?,
        };
        let [low, high] = isolation_band(model, target.frequency);
        let sampled = closed(self.study, &trial.table);
        let isolation_from_hz = corner(low, high, &pole_peaks(&trial.poles), |hz| {
            sampled.transmissibility(hz)
        });
        let isolation_from_ideal_hz = ideal.isolation_from_hz;
        if isolation_from_hz > CORNER_SLACK * isolation_from_ideal_hz {
            return Err(Miss::Late {
                ideal: isolation_from_ideal_hz,
                sampled: isolation_from_hz,
            });
        }
        Ok(Found {
            target,
            ideal,
            trial,
            isolation_from_hz,
            peak_sensitivity,
        })
    }

    /// The lowest target frequency above the requested one that is reached.
    fn nearest(&self) -> Result<Advice, DesignError> {
        let machine = self.study.machine();
        let reaches = |frequency: f64| {
            let target = Target {
                frequency,
                ..machine.target
            };
            let reached = match target.law {
                LawName::Direct => self.reach(target, None).map(|_| true),
                // What has something to begin with has a best.
                LawName::Modal => self.ideal(&target).and_then(|ideal| {
                    let search = self.pattern_search(target, &ideal, target.max_sensitivity)?;
                    Ok(search.is_feasible())
                }),
            };
            match reached {
                Ok(reached) => Ok(reached),
                Err(Miss::Error(error)) => Err(error),
                Err(_) => Ok(false),
            }
        };
        let mut below = machine.target.frequency;
        let mut above = below;
        loop {
            above *= SCAN;
            if above > self.study.design_model().hertz()[LEGS - 1] {
                return Ok(Advice::NoFrequency);
            }
            if reaches(above)? {
                break;
            }
            below = above;
        }
        while above > 1.02 * below {
            let middle = (above * below).sqrt();
            if reaches(middle)? {
                above = middle;
            } else {
                below = middle;
            }
        }
        let rounded = round_up(above);
        Ok(Advice::Nearest(if reaches(rounded)? {
            rounded
        } else {
            above
        }))
    }

    fn describe(&self, found: Found) -> Design {
        let closed = closed(self.study, &found.trial.table);
        let poles = found.trial.poles.iter();
        Design {
            ac_coupling_hz: table::AC_COUPLING * found.target.frequency,
            leak_hz: table::LEAK * found.target.frequency,
            peak_sensitivity: found.peak_sensitivity,
            drawn: found.trial.drawn,
            isolation_from_ideal_hz: found.ideal.isolation_from_hz,
            isolation_from_hz: found.isolation_from_hz,
            slowest_decay: poles.map(|s| s.re).fold(f64::MIN, f64::max),
            soft_start: self.starts_softly(&found.trial.table),
            bands: self.bands(&found, &closed),
            shaping: found.trial.shaping,
            table: found.trial.table,
        }
    }

    fn starts_softly(&self, table: &ValidTable) -> bool {
        (0..25).into_par_iter().all(|n| {
            let gain = f64::from(GENTLE).powf(f64::from(n) / 24.0);
            let closed = SampledLoop {
                plant: self.study.plant(),
                law: LinearLaw::new(table).with_gain(gain),
            };
            closed.poles().is_ok_and(|poles| stable(&poles))
        })
    }

    fn bands(&self, found: &Found, closed: &SampledLoop<'_>) -> Vec<Band> {
        let rows = self.study.plant().plant.performance();
        self.study
            .machine()
            .bands
            .iter()
            .map(|(name, low, high)| Band {
                name: name.clone(),
                low_hz: *low,
                high_hz: *high,
                open_db: self.open_db(*low, *high),
                ideal_db: if stable(&found.ideal.poles) {
                    self.ideal_db(&found.ideal, *low, *high)
                } else {
                    f64::NAN
                },
                sampled_db: {
                    let points = grid(*low, *high, 300, &pole_peaks(&found.trial.poles));
                    highest_db(&points, |hz| closed.close(hz, rows.clone()))
                },
            })
            .collect()
    }

    /// The highest σ_max(G11) from `low` to `high` Hz without control, dB.
    fn open_db(&self, low: f64, high: f64) -> f64 {
        let plant = &self.study.plant().plant;
        highest_db(&grid(low, high, 300, &plant.peaks()), |hz| {
            plant.response(hz).from_floor(plant.performance())
        })
    }

    /// The same under the unsampled law.
    fn ideal_db(&self, ideal: &Ideal, low: f64, high: f64) -> f64 {
        let plant = &self.study.plant().plant;
        let points = grid(low, high, 300, &pole_peaks(&ideal.poles));
        highest_db(&points, |hz| {
            close_ideal(plant, &ideal.gains, hz, plant.performance())
        })
    }
}

/// Two significant digits, upward: advice that still holds after rounding.
fn round_up(x: f64) -> f64 {
    let unit = 10f64.powf(x.log10().floor() - 1.0);
    nearest_decimal((x / unit).ceil() * unit)
}
