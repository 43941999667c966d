//! The shaping that the sampled loop bears.
//!
//! Above the suspension modes the ideal loop gain is a constant of several
//! hundred, which no delay allows. The direct law has one first-order low-pass,
//! common to all channels, and its highest corner for which the true sampled
//! loop is stable with the asked peak sensitivity is the nearest to the ideal.
//! The modal law has a shape for each mode ([`crate::tuning`]).

use nalgebra::Complex;
use rayon::prelude::*;
use serde::Serialize;
use shared::LEGS;
use shared::supervisor::GENTLE;
use shared::table::{TableError, ValidTable};

use crate::closed_loop::{
    LoopGrid, PeakSensitivity, SampledLoop, close_ideal, corner, grid, highest_db, stable,
};
use crate::design::{Design, Gains, ideal_poles};
use crate::law::LinearLaw;
use crate::machine::{Feedback, LawName, Machine, Target};
use crate::plant::{SampledPlant, pole_peaks};
use crate::shape::Shape;
use crate::study::Study;
use crate::table;
use crate::tuning;
use crate::zeros::{grow, transmission_zeros};

/// The sampled loop's corner may lie this much above the ideal loop's before
/// the target counts as missed: half an octave.
pub const CORNER_SLACK: f64 = core::f64::consts::SQRT_2;

/// What shapes the loop.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Shaping {
    /// The direct law.
    Common {
        /// Corner of the low-pass, Hz.
        corner_hz: f64,
    },
    /// The modal law, by mode.
    Modes {
        /// Slowest mode first.
        shapes: Vec<Shape>,
    },
}

/// The chosen shaping and what it gives.
#[derive(Clone, Debug, Serialize)]
pub struct Shaped {
    /// What shapes the loop.
    pub shaping: Shaping,
    /// Corner of the AC coupling, Hz.
    pub ac_coupling_hz: f64,
    /// Corner of the leak, Hz.
    pub leak_hz: f64,
    /// Peak sensitivity of the sampled loop.
    pub peak_sensitivity: PeakSensitivity,
    /// The same controller on machines drawn about this one; the modal law only.
    pub drawn: Option<Drawn>,
    /// Above this the machine does not follow the floor: ideal loop, Hz.
    pub isolation_from_ideal_hz: f64,
    /// The same for the sampled loop, Hz.
    pub isolation_from_hz: f64,
    /// The slowest pole of the sampled loop, 1/s; negative.
    pub slowest_decay: f64,
    /// Whether the loop is stable with every gain that it has on its way through a
    /// soft start, by its poles at 25 of them.
    pub soft_start: bool,
    /// Peaks of σ_max(G11).
    pub bands: Vec<Band>,
}

/// A controller on machines drawn about its own, as [`Machine::drawn`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Drawn {
    /// How many were drawn.
    pub samples: usize,
    /// On how many of them the loop is stable.
    pub stable: usize,
    /// Highest peak sensitivity, [`PeakSensitivity::bounded`].
    pub peak_sensitivity: f64,
}

/// So many machines are drawn to tell whether a design holds on them.
const SAMPLES: usize = 40;

/// The highest peak of σ_max(G11) in a band.
#[derive(Clone, Debug, Serialize)]
pub struct Band {
    /// Name.
    pub name: String,
    /// Hz.
    pub low_hz: f64,
    /// Hz.
    pub high_hz: f64,
    /// Without control, dB.
    pub open_db: f64,
    /// Under the unsampled, undelayed law, dB; not a number where that loop is
    /// unstable.
    pub ideal_db: f64,
    /// As sampled on the board, dB.
    pub sampled_db: f64,
}

/// Why there is no shaping.
#[derive(Debug, thiserror::Error)]
pub enum ShapingError {
    /// The board's numbers make no table.
    #[error("the board's numbers make no table: {0}")]
    Table(#[from] TableError),
    /// No corner does it.
    #[error(
        "the target of {asked:.3} Hz with damping {damping} cannot be reached on this board: {reason}. {nearest}"
    )]
    Unreachable {
        /// ω_n/2π, Hz.
        asked: f64,
        /// ζ_n.
        damping: f64,
        /// What stands against it.
        reason: String,
        /// The nearest frequency that can be reached, as advice.
        nearest: Nearest,
    },
    /// The eigenvalue iteration did not end.
    #[error(
        "the closed loop's eigenvalues could not be found; the machine's numbers lie too far apart"
    )]
    Eigenvalues,
}

/// The nearest target frequency that can be reached.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Nearest {
    /// Hz.
    At(f64),
    /// There is none below the highest suspension mode.
    None,
}

impl core::fmt::Display for Nearest {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::At(hz) => write!(
                f,
                "Nearest that can, with the same damping: control.frequency = {hz}. A shorter delay (board.sample_rate, conversion_delay, output_delay) or a higher control.max_sensitivity also helps"
            ),
            Self::None => f.write_str(
                "No frequency below the suspension modes can be reached with this damping: shorten the delay (board.sample_rate, conversion_delay, output_delay) or raise control.max_sensitivity",
            ),
        }
    }
}

/// A loop with one roll-off that is stable within the bound.
struct Trial {
    shaping: Shaping,
    drawn: Option<Drawn>,
    table: ValidTable,
    poles: Vec<Complex<f64>>,
}

/// What one target comes to.
struct Found {
    target: Target,
    ideal: Ideal,
    trial: Trial,
    isolation_from_hz: f64,
    peak_sensitivity: PeakSensitivity,
}

/// Why one target comes to nothing.
enum Miss {
    Error(ShapingError),
    /// No corner is stable with the asked sensitivity.
    Unstable,
    /// The highest corner isolates only from `sampled` Hz, the ideal loop from
    /// `ideal` Hz.
    Late {
        ideal: f64,
        sampled: f64,
    },
}

impl From<TableError> for Miss {
    fn from(error: TableError) -> Self {
        Self::Error(error.into())
    }
}

/// How long to look for the shapes of the modal law.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// To the end, and held against machines drawn about this one.
    Full,
    /// A few seconds, to compare boards.
    Rough,
}

impl Effort {
    fn trials(self) -> usize {
        match self {
            Self::Full => tuning::TRIALS,
            Self::Rough => tuning::ROUGH_TRIALS,
        }
    }
}

/// Chooses the shaping for the machine's target and gives the table. `progress`
/// is called after every trial.
///
/// # Errors
/// Where no shaping reaches the target, with the nearest that one reaches.
pub fn choose(
    machine: &Machine,
    design: &Design,
    plant: &SampledPlant,
    effort: Effort,
    progress: &dyn Fn(),
) -> Result<(ValidTable, Shaped), ShapingError> {
    let search = Search {
        effort,
        machine,
        design,
        plant,
        progress,
    };
    let target = machine.target;
    let delay = 1e6 * machine.board.whole_delay();
    let mut reason = match search.reach(target) {
        Ok(found) => return Ok((found.trial.table, search.describe(&found))),
        Err(Miss::Error(error)) => return Err(error),
        Err(Miss::Late { ideal, sampled }) => format!(
            "the best loop that {delay:.0} µs of delay allows isolates only from {sampled:.2} Hz, the ideal loop from {ideal:.2} Hz"
        ),
        Err(Miss::Unstable) => format!(
            "with {delay:.0} µs of delay no shaping keeps the sampled loop stable with a peak sensitivity of {} and isolating from near its corner",
            target.max_sensitivity
        ),
    };
    if target.feedback != Feedback::Both
        && transmission_zeros(&plant.plant.state_space, target.feedback)
            .is_some_and(|zeros| grow(&zeros))
    {
        reason += ", and no gain can: what its sensors leave free is unstable under gravity (host-gen zeros); stiffen the legs sideways";
    }
    Err(ShapingError::Unreachable {
        asked: target.frequency,
        damping: target.damping,
        reason,
        nearest: search.nearest()?,
    })
}

/// A machine with what a trial needs.
struct Search<'a> {
    machine: &'a Machine,
    design: &'a Design,
    plant: &'a SampledPlant,
    effort: Effort,
    progress: &'a dyn Fn(),
}

/// The unsampled loop for one target.
struct Ideal {
    gains: Gains,
    poles: Vec<Complex<f64>>,
    isolation_from_hz: f64,
}

impl Search<'_> {
    fn ideal(&self, target: &Target) -> Result<Ideal, Miss> {
        let gains = self.design.gains(target);
        let plant = &self.plant.plant;
        let poles = ideal_poles(&plant.state_space, &gains)
            .ok_or(Miss::Error(ShapingError::Eigenvalues))?;
        let [low, high] = isolation_band(self.design, target.frequency);
        let isolation_from_hz = corner(low, high, &pole_peaks(&poles), |hz| {
            close_ideal(plant, &gains, hz, plant.whole()) * plant.rigid_floor.map(Complex::from)
        });
        Ok(Ideal {
            gains,
            poles,
            isolation_from_hz,
        })
    }

    /// The zeros as peaks: a fast loop moves its poles near them.
    fn sharp(&self, target: Target) -> Vec<(f64, f64)> {
        let state_space = &self.plant.plant.state_space;
        pole_peaks(&transmission_zeros(state_space, target.feedback).unwrap_or_default())
    }

    /// The search for shapes of the modes.
    fn tuning(&self, target: Target, ideal: &Ideal, bound: f64) -> tuning::Search<'_> {
        let holds = stable(&ideal.poles);
        let reference = self
            .machine
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
        tuning::Search::new(
            self.machine,
            self.design,
            self.plant,
            Target {
                max_sensitivity: bound,
                ..target
            },
            &reference,
            CORNER_SLACK * ideal.isolation_from_hz,
            &self.sharp(target),
        )
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
        // The grid may miss the very top of a peak, and another machine than
        // this one may have a higher one: a little more room then.
        for _ in 0..3 {
            let tuning = self.tuning(target, ideal, bound);
            let Some(shapes) = tuning.run(self.effort.trials(), self.progress) else {
                break;
            };
            let table = table::modal(self.machine, self.plant, self.design, &target, &shapes)?;
            let closed = self.closed(&table);
            let poles = closed
                .poles()
                .ok_or(Miss::Error(ShapingError::Eigenvalues))?;
            let peak = loops.peak(self.plant, &closed.law);
            let mut highest = peak.bounded();
            if stable(&poles) && peak.bounded() <= asked {
                let drawn = match self.effort {
                    Effort::Full => Some(self.drawn(&target, &closed.law)?),
                    Effort::Rough => None,
                };
                let holds =
                    drawn.is_none_or(|d| d.stable == d.samples && d.peak_sensitivity <= asked);
                highest = highest.max(drawn.map_or(0.0, |d| d.peak_sensitivity));
                let trial = Trial {
                    shaping: Shaping::Modes {
                        shapes: shapes.to_vec(),
                    },
                    drawn,
                    table,
                    poles,
                };
                if holds {
                    return Ok((trial, peak));
                }
                // What holds here and not everywhere is told as such if nothing
                // better comes.
                found = Some((trial, peak));
            }
            bound *= 0.99 * (asked / highest).clamp(0.8, 1.0);
        }
        found.ok_or(Miss::Unstable)
    }

    /// `law` on machines drawn about this one. One that cannot be modelled
    /// counts as one on which the loop is not stable.
    fn drawn(&self, target: &Target, law: &LinearLaw) -> Result<Drawn, Miss> {
        let samples = SAMPLES.min(self.machine.robustness.samples);
        let low = SLOWEST * target.frequency;
        let peaks = (0..samples)
            .into_par_iter()
            .map(|i| {
                let Ok(study) = Study::new(self.machine.drawn(i)) else {
                    return Ok(None);
                };
                let plant = &study.plant;
                let closed = SampledLoop { plant, law: *law };
                let poles = closed
                    .poles()
                    .ok_or(Miss::Error(ShapingError::Eigenvalues))?;
                Ok(stable(&poles).then(|| {
                    closed
                        .peak_sensitivity(&self.design.modal, low, &poles)
                        .bounded()
                }))
            })
            .collect::<Result<Vec<_>, Miss>>()?;
        let stable = peaks.iter().flatten();
        Ok(Drawn {
            samples,
            stable: stable.clone().count(),
            peak_sensitivity: stable.fold(0.0, |a, b| a.max(*b)),
        })
    }

    /// The best loop for `target`, if the target can be reached.
    fn reach(&self, target: Target) -> Result<Found, Miss> {
        let ideal = self.ideal(&target)?;
        let low = SLOWEST * target.frequency;
        let loops = LoopGrid::new(self.plant, &self.design.modal, low, &self.sharp(target));
        let (trial, peak_sensitivity) = match target.law {
            LawName::Direct => self.highest_corner(&target, &ideal.gains, &loops)?,
            LawName::Modal => self.best_shapes(target, &ideal, &loops)?,
        };
        let [low, high] = isolation_band(self.design, target.frequency);
        let sampled = self.closed(&trial.table);
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

    fn closed(&self, table: &ValidTable) -> SampledLoop<'_> {
        SampledLoop {
            plant: self.plant,
            law: LinearLaw::new(table),
        }
    }

    /// The loop with a roll-off at `hz`, if it is stable and its sensitivity
    /// within the bound.
    fn try_corner(
        &self,
        target: &Target,
        gains: &Gains,
        loops: &LoopGrid,
        hz: f64,
    ) -> Result<Option<Trial>, Miss> {
        let table = table::direct(self.machine, self.plant, target, gains, hz)?;
        let closed = self.closed(&table);
        // The bound first: it is much the cheaper.
        if !loops.within(&closed.law, target.max_sensitivity) {
            return Ok(None);
        }
        let poles = closed
            .poles()
            .ok_or(Miss::Error(ShapingError::Eigenvalues))?;
        Ok(stable(&poles).then_some(Trial {
            shaping: Shaping::Common { corner_hz: hz },
            drawn: None,
            table,
            poles,
        }))
    }

    /// Scans down for the first corner that holds, bisects up from it, and
    /// rounds.
    fn highest_corner(
        &self,
        target: &Target,
        gains: &Gains,
        loops: &LoopGrid,
    ) -> Result<(Trial, PeakSensitivity), Miss> {
        let holds = |hz: f64| self.try_corner(target, gains, loops, hz);
        let mut above = 0.25 / self.plant.period;
        let mut below = above;
        while holds(below)?.is_none() {
            above = below;
            below /= SCAN;
            if below < LOWEST * target.frequency {
                return Err(Miss::Unstable);
            }
        }
        while above > 1.001 * below {
            let middle = (above * below).sqrt();
            if holds(middle)?.is_some() {
                below = middle;
            } else {
                above = middle;
            }
        }
        // The grid may miss the very top of a peak; one or two steps down
        // make up for that.
        let mut corner = round_down(below);
        while corner > LOWEST * target.frequency {
            if let Some(trial) = holds(corner)? {
                let peak = loops.peak(self.plant, &LinearLaw::new(&trial.table));
                if peak.bounded() <= target.max_sensitivity {
                    return Ok((trial, peak));
                }
            }
            corner = round_down(0.999 * corner);
        }
        Err(Miss::Unstable)
    }

    /// The lowest target frequency above the asked one that can be reached.
    fn nearest(&self) -> Result<Nearest, ShapingError> {
        let reaches = |frequency: f64| {
            let target = Target {
                frequency,
                ..self.machine.target
            };
            let reached = match target.law {
                LawName::Direct => self.reach(target).map(|_| true),
                // What has something to begin with has a best.
                LawName::Modal => self.ideal(&target).map(|ideal| {
                    self.tuning(target, &ideal, target.max_sensitivity)
                        .is_feasible()
                }),
            };
            match reached {
                Ok(reached) => Ok(reached),
                Err(Miss::Error(error)) => Err(error),
                Err(_) => Ok(false),
            }
        };
        let mut below = self.machine.target.frequency;
        let mut above = below;
        loop {
            above *= SCAN;
            if above > self.design.hertz()[LEGS - 1] {
                return Ok(Nearest::None);
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
        Ok(Nearest::At(if reaches(rounded)? { rounded } else { above }))
    }

    fn describe(&self, found: &Found) -> Shaped {
        let closed = self.closed(&found.trial.table);
        let slowest = found
            .trial
            .poles
            .iter()
            .map(|s| s.re)
            .fold(f64::MIN, f64::max);
        Shaped {
            shaping: found.trial.shaping.clone(),
            ac_coupling_hz: table::AC_COUPLING * found.target.frequency,
            leak_hz: table::LEAK * found.target.frequency,
            peak_sensitivity: found.peak_sensitivity,
            drawn: found.trial.drawn,
            isolation_from_ideal_hz: found.ideal.isolation_from_hz,
            isolation_from_hz: found.isolation_from_hz,
            slowest_decay: slowest,
            soft_start: self.starts_softly(&found.trial.table),
            bands: self.bands(found, &closed),
        }
    }

    fn starts_softly(&self, table: &ValidTable) -> bool {
        (0..25).into_par_iter().all(|n| {
            let gain = f64::from(GENTLE).powf(f64::from(n) / 24.0);
            let closed = SampledLoop {
                plant: self.plant,
                law: LinearLaw::new(table).with_gain(gain),
            };
            closed.poles().is_some_and(|poles| stable(&poles))
        })
    }

    fn bands(&self, found: &Found, closed: &SampledLoop<'_>) -> Vec<Band> {
        let rows = self.plant.plant.performance();
        self.machine
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

    /// The highest σ_max(G11) from `low` to `high` Hz without control.
    fn open_db(&self, low: f64, high: f64) -> f64 {
        let plant = &self.plant.plant;
        highest_db(&grid(low, high, 300, &plant.peaks()), |hz| {
            plant.response(hz).from_floor(plant.performance())
        })
    }

    /// The same under the unsampled law.
    fn ideal_db(&self, ideal: &Ideal, low: f64, high: f64) -> f64 {
        let plant = &self.plant.plant;
        let points = grid(low, high, 300, &pole_peaks(&ideal.poles));
        highest_db(&points, |hz| {
            close_ideal(plant, &ideal.gains, hz, plant.performance())
        })
    }
}

/// The search's step in frequency.
const SCAN: f64 = 1.25;

/// A roll-off below this part of the target frequency leaves nothing of the
/// law.
const LOWEST: f64 = 0.02;

/// The loop is looked at from this part of the target frequency on: far below
/// AC coupling and leak.
pub(crate) const SLOWEST: f64 = 1e-3;

/// Where the corner is looked for, Hz: from well below the target `frequency`
/// to well above the suspension.
pub(crate) fn isolation_band(design: &Design, frequency: f64) -> [f64; 2] {
    let highest = design.hertz()[LEGS - 1].max(frequency);
    [0.1 * frequency, 3.0 * highest]
}

/// Two significant digits, upward: advice that still holds after rounding.
fn round_up(x: f64) -> f64 {
    let unit = 10f64.powf(x.log10().floor() - 1.0);
    nearest_decimal((x / unit).ceil() * unit)
}

/// Three significant digits, downward: the table then does not hang on the
/// last bits of a search.
fn round_down(x: f64) -> f64 {
    let unit = 10f64.powf(x.log10().floor() - 2.0);
    nearest_decimal((x / unit).floor() * unit)
}

/// 1.3 for 1.3000000000000003.
fn nearest_decimal(x: f64) -> f64 {
    format!("{x:.6e}").parse().unwrap_or(x)
}
