//! The highest corner of the direct law's low-pass that keeps the loop within the
//! bound.
//!
//! Above the suspension modes the ideal loop gain is a constant of several hundred,
//! which no delay allows. The direct law has one first-order low-pass for all
//! channels; the higher its corner, the nearer the loop is to the ideal one.

use super::outcome::Shaping;
use super::study::Study;
use super::trial::{Miss, SCAN, Trial, nearest_decimal, rolls_off};
use crate::closed_loop::{LoopGrid, PeakSensitivity, SampledLoop, stable};
use crate::control::{Gains, LinearLaw, table};
use crate::machine::Target;

/// Lowest corner, as a part of the target frequency: with a lower one the law has no
/// effect.
const LOWEST: f64 = 0.02;

/// The loop with a roll-off at `hz`, if it is stable and its sensitivity
/// within the bound.
fn try_corner(
    study: &Study,
    target: &Target,
    gains: &Gains,
    loops: &LoopGrid,
    hz: f64,
) -> Result<Option<Trial>, Miss> {
    let table = table::direct(study.machine(), study.plant(), target, gains, hz)?;
    let closed_loop = SampledLoop::new(study.plant(), &table);
    // The bound first: it takes much less time.
    let law = &closed_loop.law;
    if !loops.within(law, target.max_sensitivity) || !rolls_off(target, loops, law) {
        return Ok(None);
    }
    let poles = closed_loop.poles()?;
    Ok(stable(&poles).then_some(Trial {
        shaping: Shaping::Common { corner_hz: hz },
        drawn: None,
        table,
        poles,
    }))
}

/// Scans down to the first corner that keeps the loop stable within the bound, bisects up
/// from it, and rounds down.
pub(super) fn highest_corner(
    study: &Study,
    target: &Target,
    gains: &Gains,
    loops: &LoopGrid,
) -> Result<(Trial, PeakSensitivity), Miss> {
    let holds = |hz: f64| try_corner(study, target, gains, loops, hz);
    let mut above = 0.25 / study.plant().period;
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
    // The grid may miss the top of a peak; then one or two steps down follow.
    let mut corner = round_down(below);
    while corner > LOWEST * target.frequency {
        if let Some(trial) = holds(corner)? {
            let peak = loops.peak(study.plant(), &LinearLaw::new(&trial.table));
            if peak.bounded() <= target.max_sensitivity {
                return Ok((trial, peak));
            }
        }
        corner = round_down(0.999 * corner);
    }
    Err(Miss::Unstable)
}

/// Three significant digits, rounded down: then the table does not depend on the last
/// bits of the search.
fn round_down(x: f64) -> f64 {
    let unit = 10f64.powf(x.log10().floor() - 2.0);
    nearest_decimal((x / unit).floor() * unit)
}
