//! Frequency grids that resolve every resonance.

use core::f64::consts::TAU;

use nalgebra::Complex;

/// Points around a peak, half widths from its centre.
const AROUND: [f64; 11] = [-8.0, -4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0];

/// The distance from one point to the next, half widths of a peak, below which that peak looks the
/// same from both: its height to 0.13 %. Equal legs have many modes at nearly one frequency.
const CLOSE: f64 = 0.05;

/// A frequency grid from `low` to `high`, Hz, ascending and without duplicates.
///
/// `count` points, at least two, are evenly spaced in the logarithm. Each of the `peaks` (centre
/// and half width, Hz) adds eleven points, up to eight half widths from its centre, but none where
/// another point is closer than a twentieth of its half width.
pub fn grid(low: f64, high: f64, count: usize, peaks: &[(f64, f64)]) -> Vec<f64> {
    let steps = (count - 1) as f64;
    // Frequencies, and how far the point before must be.
    let mut all: Vec<(f64, f64)> = (0..count)
        .map(|i| (low * (high / low).powf(i as f64 / steps), 0.0))
        .collect();
    for (centre, width) in peaks {
        let own = AROUND.map(|offset| (centre + offset * width, CLOSE * width));
        all.extend(own.iter().filter(|(hz, _)| (low..=high).contains(hz)));
    }
    all.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let mut last = f64::NEG_INFINITY;
    all.retain(|(hz, apart)| {
        let new = hz - last > *apart;
        if new {
            last = *hz;
        }
        new
    });
    all.into_iter().map(|(hz, _)| hz).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The highest value on the grid of peaks that coincide, nearly coincide and stand alone is
    /// that of the sum of their resonances on a grid a thousand times as dense, and what coincides
    /// takes no points twice.
    #[test]
    fn a_grid_misses_no_peak() {
        let apart = [0.0, 1e-9, 1e-5, 3e-4, 1e-3, 4e-3, 0.3];
        for damping in [1e-4, 5e-3, 0.05] {
            for shift in apart {
                let peaks: Vec<_> = (0..6)
                    .map(|k| 100.0 * (1.0 + shift * f64::from(k)))
                    .map(|hz| (hz, damping * hz))
                    .collect();
                let value = |hz: f64| -> f64 {
                    let one = |(centre, width): &(f64, f64)| {
                        Complex::new(1.0, (hz - centre) / width).inv()
                    };
                    peaks.iter().map(one).sum::<Complex<f64>>().norm()
                };
                let points = grid(1.0, 1e4, 100, &peaks);
                assert!(points.is_sorted_by(|a, b| a < b));
                let found = points.iter().map(|hz| value(*hz)).fold(0.0, f64::max);
                let highest = (0..200_000)
                    .map(|i| value(90.0 * (3.0_f64).powf(f64::from(i) / 2e5)))
                    .fold(0.0, f64::max);
                assert!(
                    found > 0.94 * highest,
                    "{damping} {shift}: {found} {highest}"
                );
                if shift < 1e-6 {
                    assert!(
                        found > 0.998 * highest,
                        "{damping} {shift}: {found} {highest}"
                    );
                    assert!(points.len() <= 100 + AROUND.len(), "{}", points.len());
                }
            }
        }
    }
}
