//! What the actuators can do, and what the hysteresis of piezo stacks does to the loop.

use nalgebra::Complex;
use serde::Serialize;

use crate::closed_loop::{SLOWEST, SampledLoop};
use crate::design::Study;
use crate::machine::Piezo;
use crate::numeric::frequencies::grid;
use crate::numeric::six::ComplexMatrix6;

/// Fractions of the force limit at which the hysteresis is looked at.
const PARTS: [f64; 4] = [0.01, 0.1, 0.3, 1.0];

/// The actuators of a machine.
#[derive(Debug, Serialize)]
pub(crate) struct Actuators {
    /// Force per volt at the DAC for small signals, N/V: of the mean leg.
    pub(crate) gain: f64,
    /// Force limit of a leg in either direction, N.
    pub(crate) limit: f64,
    /// Free expansion of a leg at the limit, m; its mean over the legs. None for a leg without axial
    /// stiffness.
    pub(crate) stroke: Option<f64>,
    /// The highest frequency of a sine at the limit that the amplifier's current allows, Hz; none
    /// without a limit of the current.
    pub(crate) full_force_hz: Option<f64>,
    /// The loop with hysteresis, for sines of some amplitudes; empty without hysteresis.
    pub(crate) hysteresis: Vec<Amplitude>,
    /// Whether the loop with hysteresis is not what was asked for, in words.
    pub(crate) warning: Option<String>,
}

/// The loop for sines of one amplitude in all legs, by the describing function of their hysteresis.
#[derive(Debug, Serialize)]
pub(crate) struct Amplitude {
    /// The amplitude, N.
    pub(crate) force: f64,
    /// Factor on the gain of small signals.
    pub(crate) gain: f64,
    /// Lag of the fundamental, degrees.
    pub(crate) lag_deg: f64,
    /// Peak sensitivity with the loop opened at the modal forces, which the describing function
    /// multiplies. Infinite: the harmonic balance has a limit cycle at or below this amplitude.
    pub(crate) peak_sensitivity: f64,
}

impl Actuators {
    /// Those of `study`, in the loop `closed`, refined at `peaks` (centre and half width, Hz).
    pub(crate) fn new(study: &Study, closed: &SampledLoop<'_>, peaks: &[(f64, f64)]) -> Self {
        let machine = study.machine();
        let board = &machine.board;
        let stiffness = machine
            .actuators
            .map(|leg| machine.beams[leg].stiffness.axial);
        let mean = stiffness.iter().sum::<f64>() / stiffness.len() as f64;
        let limit = board.force_limit;
        let piezo = board.piezo.filter(|piezo| piezo.hysteresis > 0.0);
        let hysteresis = piezo
            .map(|piezo| amplitudes(study, closed, peaks, &piezo, limit))
            .unwrap_or_default();
        Self {
            gain: board.actuator_gain,
            limit,
            stroke: (mean > 0.0).then(|| limit / mean),
            full_force_hz: board
                .piezo
                .map(|piezo| piezo.fastest(limit))
                .filter(|hz| hz.is_finite()),
            warning: excess(&hysteresis, machine.target.max_sensitivity),
            hysteresis,
        }
    }
}

/// Warns of a loop that hysteresis makes unstable, or takes beyond the allowed peak sensitivity.
fn excess(hysteresis: &[Amplitude], allowed: f64) -> Option<String> {
    let worst = hysteresis.iter().find(|at| at.peak_sensitivity > allowed)?;
    let what = if worst.peak_sensitivity.is_finite() {
        format!(
            "the peak sensitivity is {:.2}, above the {allowed} that is allowed",
            worst.peak_sensitivity
        )
    } else {
        "the harmonic balance predicts a limit cycle".to_owned()
    };
    Some(format!(
        "with the hysteresis of the stacks at {:.3} N, {what}",
        worst.force
    ))
}

fn amplitudes(
    study: &Study,
    closed: &SampledLoop<'_>,
    peaks: &[(f64, f64)],
    piezo: &Piezo,
    limit: f64,
) -> Vec<Amplitude> {
    let target = &study.machine().target;
    let modal_loop = closed.modal_loop(&study.design_model().modal);
    let top = 0.5 / closed.plant.period;
    let points = grid(SLOWEST * target.frequency, top, 1500, peaks);
    let loops: Vec<_> = points.into_iter().map(modal_loop).collect();
    let differences = |factor: Complex<f64>| {
        let own = loops.iter();
        own.map(move |own| ComplexMatrix6::identity() + own * factor)
    };
    let small: Vec<_> = differences(Complex::ONE)
        .map(|difference| difference.determinant())
        .collect();
    let peak = |factor: Complex<f64>| {
        let peaks = differences(factor).map(|d| 1.0 / d.singular_values().min());
        let peak = peaks.fold(0.0, f64::max);
        // Both ends of the grid have little loop gain. A pole that crosses between small signals and
        // this amplitude turns the determinant once more, or once less, than that of small signals.
        let ratios = differences(factor)
            .zip(&small)
            .map(|(d, own)| d.determinant() / own);
        let ratios: Vec<_> = ratios.collect();
        let turned: f64 = ratios
            .windows(2)
            .map(|pair| (pair[1] / pair[0]).arg())
            .sum();
        if turned.abs() > core::f64::consts::PI {
            f64::INFINITY
        } else {
            peak
        }
    };
    PARTS
        .map(|part| {
            let force = part * limit;
            let factor = piezo.describing_function(force);
            Amplitude {
                force,
                gain: factor.norm(),
                lag_deg: -factor.arg().to_degrees(),
                peak_sensitivity: peak(factor),
            }
        })
        .into()
}
