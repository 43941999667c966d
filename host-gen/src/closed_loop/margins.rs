//! How far the sampled loop is from its limits: disk margins and Bode's
//! integral.

use core::f64::consts::LN_2;

use nalgebra::{Complex, Matrix6};
use serde::Serialize;
use shared::LEGS;

use super::SLOWEST;
use super::sampled::SampledLoop;
use crate::model::design_model::DesignModel;
use crate::numeric::frequencies::grid;

/// A symmetric disk margin: the loop stays stable with any factor
/// (2 + δ)/(2 − δ), |δ| < `disk`, in the channel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Margin {
    /// α = 1/max |S − ½|.
    pub disk: f64,
    /// Factor by which the gain may grow, or fall; infinite if any may.
    pub gain: f64,
    /// Phase either way, degrees.
    pub phase_deg: f64,
}

impl Margin {
    fn new(peak: f64) -> Self {
        let disk = 1.0 / peak;
        Self {
            disk,
            gain: if disk < 2.0 {
                (2.0 + disk) / (2.0 - disk)
            } else {
                f64::INFINITY
            },
            phase_deg: 2.0 * (0.5 * disk).atan().to_degrees(),
        }
    }
}

/// What the loop has left.
#[derive(Clone, Debug, Serialize)]
pub struct Margins {
    /// One mode changes, the others do not.
    pub modes: [Margin; LEGS],
    /// All modes change at once and each as it likes.
    pub together: Margin,
    /// Bode's integral.
    pub bode: Bode,
}

/// Bode's integral of the sampled loop: ∫ ln|det S| over all frequencies to
/// half the sample rate is zero, whatever the controller, since plant and
/// controller are stable and a sample of delay is in the loop. What is taken
/// away in one place comes back in another.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bode {
    /// Attenuation, mean over the modes: ∫ −ln|det S|/6 where that is positive,
    /// Hz.
    pub attenuation_hz: f64,
    /// Amplification, the same where it is negative, Hz.
    pub amplification_hz: f64,
    /// What the amplification could be at most within the bound: all modes at
    /// ln Ms from the crossover to 1/(2τ), where the delay alone turns the loop
    /// by half a turn and hardly any gain may be left, Hz.
    pub limit_hz: f64,
    /// Up to here the modes are, on the mean, attenuated by half or more, Hz.
    pub crossover_hz: f64,
}

/// Of the loop with modes of `model`, whole `delay`, s, and bound `bound`.
pub fn margins(
    closed: &SampledLoop<'_>,
    model: &DesignModel,
    delay: f64,
    bound: f64,
    peaks: &[(f64, f64)],
) -> Margins {
    let modal_loop = closed.modal_loop(&model.modal);
    let top = 0.5 / closed.plant.period;
    let points = grid(SLOWEST, top, 3000, peaks);
    let mut single = [0.0_f64; LEGS];
    let mut together = 0.0_f64;
    let mut logarithms = Vec::with_capacity(points.len());
    let half = Matrix6::from_diagonal_element(Complex::from(0.5));
    for &hz in &points {
        let difference = Matrix6::identity() + modal_loop(hz);
        let Some(sensitivity) = difference.try_inverse() else {
            logarithms.push(f64::INFINITY);
            together = f64::INFINITY;
            continue;
        };
        logarithms.push(-difference.determinant().norm().ln() / LEGS as f64);
        for (k, peak) in single.iter_mut().enumerate() {
            *peak = peak.max((sensitivity[(k, k)] - 0.5).norm());
        }
        together = together.max((sensitivity - half).singular_values().max());
    }
    let mut bode = Bode {
        attenuation_hz: 0.0,
        amplification_hz: 0.0,
        limit_hz: 0.0,
        crossover_hz: top,
    };
    for (hz, log) in points.windows(2).zip(logarithms.windows(2)) {
        let part = 0.5 * (log[0] + log[1]) * (hz[1] - hz[0]);
        if part < 0.0 {
            bode.attenuation_hz -= part;
        } else {
            bode.amplification_hz += part;
        }
    }
    if let Some(last) = logarithms.iter().rposition(|log| *log < -LN_2) {
        bode.crossover_hz = points[last];
    }
    bode.limit_hz = (0.5 / delay - bode.crossover_hz).max(0.0) * bound.ln();
    Margins {
        modes: single.map(Margin::new),
        together: Margin::new(together),
        bode,
    }
}
