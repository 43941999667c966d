//! The corner frequency above which the machine no longer follows the floor.

use shared::LEGS;

use crate::model::design_model::DesignModel;
use crate::numeric::frequencies::grid;
use crate::numeric::singular::largest_singular_value;
use crate::plant::Gain;

/// The lower and upper frequency, Hz, between which the corner is searched: from a tenth of the
/// target `frequency`, Hz, to three times the highest natural frequency of `model`, or three times
/// the target if that is higher.
pub fn isolation_band(model: &DesignModel, frequency: f64) -> [f64; 2] {
    let highest = model.hertz()[LEGS - 1].max(frequency);
    [0.1 * frequency, 3.0 * highest]
}

/// The corner frequency of isolation, Hz: above it the machine as one rigid body no longer follows
/// the floor.
///
/// `closed` is the transfer function from rigid floor motion to the rigid body, as
/// [`SampledLoop::transmissibility`](super::SampledLoop::transmissibility) gives it. Above the
/// corner its σ_max stays below 1/√2. The search covers `low` to `high`, Hz, on a grid refined at
/// `peaks` (centre and half width, Hz). The result is `low` if the machine follows nowhere, and
/// `high` if it follows up to there.
pub fn corner(low: f64, high: f64, peaks: &[(f64, f64)], closed: impl Fn(f64) -> Gain) -> f64 {
    let level = core::f64::consts::FRAC_1_SQRT_2;
    let follows = |hz: f64| largest_singular_value(&closed(hz)) > level;
    let points = grid(low, high, 300, peaks);
    let Some(last) = points.iter().rposition(|&hz| follows(hz)) else {
        return low;
    };
    let Some(&beyond) = points.get(last + 1) else {
        return high;
    };
    let (mut inside, mut outside) = (points[last], beyond);
    for _ in 0..30 {
        let middle = 0.5 * (inside + outside);
        if follows(middle) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    outside
}
