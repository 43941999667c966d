//! Disk margins and Bode's integral of the sampled loop.

use nalgebra::{Complex, Matrix6};
use serde::Serialize;
use shared::LEGS;

use super::SLOWEST;
use super::bode::Bode;
use super::sampled::SampledLoop;
use crate::machine::Target;
use crate::model::design_model::DesignModel;
use crate::numeric::frequencies::grid;

/// A symmetric disk margin of a channel: the loop stays stable if the channel is multiplied by any
/// complex factor (2 + δ)/(2 − δ) with |δ| < `disk`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Margin {
    /// The disk margin α = 1/max|S − ½|, without unit, with the sensitivity S.
    pub disk: f64,
    /// Gain margin: the gain may be multiplied or divided by this factor. Infinite if any gain is
    /// stable.
    pub gain: f64,
    /// Phase margin in both directions, degrees.
    pub phase_deg: f64,
}

impl Margin {
    /// The margin for the maximum `peak` of |S − ½| over frequency.
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

/// The stability margins of a sampled loop.
#[derive(Clone, Debug, Serialize)]
pub struct Margins {
    /// Margin of each mode if only its channel varies, in the order of the modes.
    pub modes: [Margin; LEGS],
    /// Margin if the channels of all modes vary at once and independently.
    pub together: Margin,
    /// Attenuation and amplification by Bode's integral.
    pub bode: Bode,
}

/// The margins of the sampled loop `closed`, opened at the modal forces of `model`.
///
/// `target` has the target frequency, from a small part of which on the loop is evaluated, and
/// the largest allowed peak sensitivity Ms. The frequency grid is refined at `peaks` (centre and
/// half width, Hz).
pub fn margins(
    closed: &SampledLoop<'_>,
    model: &DesignModel,
    target: &Target,
    peaks: &[(f64, f64)],
) -> Margins {
    let modal_loop = closed.modal_loop(&model.modal);
    let top = 0.5 / closed.plant.period;
    let points = grid(SLOWEST * target.frequency, top, 3000, peaks);
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
    Margins {
        modes: single.map(Margin::new),
        together: Margin::new(together),
        bode: Bode::new(
            &points,
            &logarithms,
            closed.plant.seen_delay(),
            closed.plant.period,
            target.max_sensitivity,
        ),
    }
}
