//! From which frequency on the machine no longer follows the floor.

use shared::LEGS;

use crate::model::design_model::DesignModel;
use crate::numeric::frequencies::grid;
use crate::numeric::singular::largest_singular_value;
use crate::plant::Gain;

/// Where the corner is looked for, Hz: from well below the target `frequency`
/// to well above the suspension.
pub fn isolation_band(model: &DesignModel, frequency: f64) -> [f64; 2] {
    let highest = model.hertz()[LEGS - 1].max(frequency);
    [0.1 * frequency, 3.0 * highest]
}

/// The highest σ_max of a transfer function at some frequencies, dB.
pub fn highest_db(hz: &[f64], gain: impl Fn(f64) -> Gain) -> f64 {
    let highest = hz
        .iter()
        .map(|&hz| largest_singular_value(&gain(hz)))
        .fold(0.0, f64::max);
    20.0 * highest.log10()
}

/// The frequency above which the whole no longer follows the floor: σ_max of
/// rigid floor motion → rigid whole stays under 1/√2. Searched upward to
/// `high` Hz, `closed` giving that transfer function.
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
