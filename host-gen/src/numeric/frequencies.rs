//! Frequency grids that resolve every resonance.

use core::f64::consts::TAU;

use nalgebra::Complex;

/// A frequency grid from `low` to `high`, Hz, ascending and without duplicates.
///
/// `count` points, at least two, are evenly spaced in the logarithm. Each of the `peaks` (centre
/// and half width, Hz) adds eleven points, up to eight half widths from its centre.
pub fn grid(low: f64, high: f64, count: usize, peaks: &[(f64, f64)]) -> Vec<f64> {
    let steps = (count - 1) as f64;
    let mut all: Vec<f64> = (0..count)
        .map(|i| low * (high / low).powf(i as f64 / steps))
        .collect();
    for (centre, width) in peaks {
        for offset in [-8.0, -4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0] {
            let hz = centre + offset * width;
            if (low..=high).contains(&hz) {
                all.push(hz);
            }
        }
    }
    all.sort_by(f64::total_cmp);
    all.dedup();
    all
}

/// Smallest half width of a peak, as a part of its frequency. So close to an undamped pole, what
/// cancels in a closed loop still leaves six digits.
pub const NARROWEST: f64 = 1e-5;

/// The peaks that lightly damped poles make: centre and half width, Hz, for [`grid`].
///
/// `poles` are in rad/s. A pole makes a peak if its real part is below 0.3 of its imaginary
/// part; a conjugate pair makes one peak. That of an undamped pole is as wide as [`NARROWEST`]
/// says.
pub fn pole_peaks<'a>(poles: impl IntoIterator<Item = &'a Complex<f64>>) -> Vec<(f64, f64)> {
    poles
        .into_iter()
        .filter(|s| s.im > 0.0 && s.re.abs() < 0.3 * s.im)
        .map(|s| (s.im / TAU, s.re.abs().max(NARROWEST * s.im) / TAU))
        .collect()
}
