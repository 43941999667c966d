//! The criteria of the steps.

use serde::Serialize;

use super::{Acceptance, ClosedLoop};
use crate::board::measure::{MeasuredLine, MeasuredSensitivity, Measurement};
use crate::design::Design;
use crate::identify::Identification;

/// A step and whether it was passed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gate {
    /// What was done.
    pub step: String,
    /// What must hold.
    pub criterion: String,
    /// What was found.
    pub found: String,
    /// Whether it holds.
    pub passed: bool,
}

/// Lines that must be measured well: fewer say little about some eighty quantities.
const LINES: usize = 30;

/// Designed sensitivity from which on it is compared: where it is lower, floor and noise are most of
/// what was measured.
const HIGH: f64 = 0.7;

/// Largest expected error of a measured sensitivity that tells something, relative to that of the
/// design.
const CLEAR: f64 = 0.15;

/// Standard deviations that noise may make.
const SURE: f64 = 3.0;

/// Largest difference of a measured sensitivity from that of the design.
const OFF: f64 = 0.25;

/// Fewest lines that must tell.
const LINES_CLOSED: usize = 5;

/// Largest ratio of a measured to a designed leg force: the floor is never that of the file.
const LOUD: f64 = 2.0;

/// The name of the step in which the loop is closed at this gain.
pub fn closed_at(gain: f64) -> String {
    format!("loop closed at {:.0} % of the gain", 100.0 * gain)
}

impl Gate {
    /// A step that was passed because it came to its end.
    pub fn done(step: &str, criterion: &str, found: impl Into<String>) -> Self {
        Self {
            step: step.to_owned(),
            criterion: criterion.to_owned(),
            found: found.into(),
            passed: true,
        }
    }

    /// A step that failed with an error.
    pub fn failed(step: &str, criterion: &str, error: impl Into<String>) -> Self {
        Self {
            passed: false,
            ..Self::done(step, criterion, error)
        }
    }

    /// Whether the machine is measured well enough to be fitted.
    pub fn measured(measurement: &Measurement) -> Self {
        let clear = measurement.lines.iter().filter(|line| line.is_clear());
        let clear: Vec<&MeasuredLine> = clear.collect();
        let mut errors: Vec<_> = clear.iter().map(|line| line.noise()).collect();
        errors.sort_by(f64::total_cmp);
        let middle = errors.get(errors.len() / 2).copied().unwrap_or(1.0);
        Self {
            step: "plant measured".to_owned(),
            criterion: format!("at least {LINES} lines to better than 30 %"),
            found: format!(
                "{} of {} lines, half of them to {:.1} %; {} resonances",
                clear.len(),
                measurement.lines.len(),
                100.0 * middle,
                measurement.resonances.len()
            ),
            passed: clear.len() >= LINES,
        }
    }

    /// Whether the fitted model explains what was measured.
    pub fn fitted(fit: &Identification) -> Self {
        let mut found = format!(
            "the errors that are left are {:.2} times those of the noise",
            fit.relative_misfit
        );
        let strange: Vec<_> = fit.strange.iter().map(|resonance| resonance.hz).collect();
        for (what, all) in [
            ("not explained at", &fit.unexplained),
            ("no mode of the file at the resonances at", &strange),
        ] {
            if !all.is_empty() {
                let all: Vec<_> = all.iter().map(|hz| format!("{hz:.1}")).collect();
                found += &format!("; {what} {} Hz", all.join(", "));
            }
        }
        Self {
            step: "model fitted".to_owned(),
            criterion: "at every line the error is at most 3 times that expected from noise and in a model that is 2 % off".to_owned(),
            found,
            passed: fit.unexplained.is_empty() && strange.is_empty(),
        }
    }

    /// A controller that was found and verified.
    pub fn designed(design: &Design) -> Self {
        Self::done(
            "controller designed",
            "stable and within all limits of the file, on the fitted machine",
            format!(
                "peak sensitivity {:.2}, isolates from {:.2} Hz",
                design.peak_sensitivity.bounded(),
                design.isolation_from_hz
            ),
        )
    }

    /// Whether the closed loop is that of the design.
    pub fn closed(closed: &ClosedLoop) -> Self {
        let all = closed.lines.iter().map(|line| (line.hz, line.sensitivity));
        let told = all.filter(|(_, s)| s.designed > HIGH && s.deviation < CLEAR * s.designed);
        let told: Vec<_> = told.collect();
        // Beside what noise alone may make of it.
        let off = |s: &MeasuredSensitivity| {
            ((s.measured - s.designed).abs() - SURE * s.deviation).max(0.0) / s.designed
        };
        let worst = told.iter().max_by(|a, b| off(&a.1).total_cmp(&off(&b.1)));
        let found = match worst {
            Some((hz, s)) => {
                let highest = |of: fn(&MeasuredSensitivity) -> f64| {
                    told.iter().map(|(_, s)| of(s)).fold(0.0, f64::max)
                };
                format!(
                    "highest {:.2}, by design {:.2}; at {hz:.1} Hz {:.2} ± {:.2}, by design {:.2}; {} lines tell",
                    highest(|s| s.measured),
                    highest(|s| s.designed),
                    s.measured,
                    SURE * s.deviation,
                    s.designed,
                    told.len()
                )
            }
            None => "no line tells".to_owned(),
        };
        Self {
            step: closed_at(closed.gain),
            criterion: format!(
                "no fault; the sensitivity at the legs within {:.0} % of the design, and what noise makes of it, at {LINES_CLOSED} lines or more where it is above {HIGH}",
                100.0 * OFF
            ),
            found,
            passed: told.len() >= LINES_CLOSED && worst.is_some_and(|(_, s)| off(s) < OFF),
        }
    }

    /// Whether the machine on its floor does what the design says.
    pub fn accepted(acceptance: &Acceptance) -> Self {
        let ratio = |leg: &super::LegForce| leg.measured / leg.designed;
        let worst = acceptance
            .legs
            .iter()
            .max_by(|a, b| ratio(a).total_cmp(&ratio(b)));
        let quieter: Vec<_> = acceptance
            .sensors
            .iter()
            .filter_map(|sensor| Some(sensor.open? - sensor.closed?))
            .collect();
        let least = quieter.iter().copied().fold(f64::INFINITY, f64::min);
        let found = worst.map_or_else(String::new, |leg| {
            format!(
                "{}: {:.3} N rms, by design {:.3} N; sensors quieter by at least {least:.1} dB",
                leg.name, leg.measured, leg.designed
            )
        });
        Self {
            step: "accepted".to_owned(),
            criterion: format!(
                "leg forces at most {LOUD} times those of the design on the file's floor"
            ),
            found,
            passed: worst.is_some_and(|leg| ratio(leg) <= LOUD),
        }
    }
}
