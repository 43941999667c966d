//! Noise of a sensor over frequency.

use core::f64::consts::TAU;

use super::error::EntryError;
use super::file::NoiseEntry;
use super::validate::not_negative;
use crate::numeric::power_law::{exponent, power_law};
use crate::numeric::quadrature::nodes;

/// The most points of a table.
const MOST: usize = 100;

/// Noise of a sensor: its one-sided amplitude density over frequency, in the sensor's unit per
/// √Hz, m/s²/√Hz or N/√Hz.
///
/// It is the noise at the sensor's output divided by the sensitivity, after all lags of the
/// sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseDensity(Form);

#[derive(Clone, Debug, PartialEq)]
enum Form {
    /// At least 0.
    White(f64),
    /// At least two frequencies, Hz, above 0 and ascending, with their densities, above 0.
    Table(Vec<(f64, f64)>),
}

impl NoiseDensity {
    /// The noise that the `entry` of a file describes.
    pub(super) fn new(entry: &str, spec: &NoiseEntry) -> Result<Self, EntryError> {
        match spec {
            NoiseEntry::White(density) => Ok(Self::white(not_negative(entry, *density, "")?)),
            NoiseEntry::Table(points) => {
                check(entry, points)?;
                Ok(Self(Form::Table(points.clone())))
            }
        }
    }

    /// White noise of `density`, the sensor's unit per √Hz. A density that is not a number above 0
    /// is none.
    pub fn white(density: f64) -> Self {
        let there = density.is_finite() && density > 0.0;
        Self(Form::White(if there { density } else { 0.0 }))
    }

    /// The density at `hz`, Hz: between two points of a table a straight line on logarithmic axes,
    /// beyond its ends the value there.
    pub fn at(&self, hz: f64) -> f64 {
        match &self.0 {
            Form::White(density) => *density,
            Form::Table(points) => match around(points, hz) {
                Ok(segment) => power_law(segment, hz),
                Err(density) => density,
            },
        }
    }

    /// d ln density/d ln hz at `hz`, Hz.
    pub(crate) fn slope(&self, hz: f64) -> f64 {
        match &self.0 {
            Form::White(_) => 0.0,
            Form::Table(points) => around(points, hz).map_or(0.0, exponent),
        }
    }

    /// The frequencies at which the density is not smooth, ascending, Hz: those of a table.
    pub(crate) fn breaks(&self) -> impl Iterator<Item = f64> {
        let points: &[_] = match &self.0 {
            Form::White(_) => &[],
            Form::Table(points) => points,
        };
        points.iter().map(|(hz, _)| *hz)
    }

    /// Whether the density is the same at all frequencies.
    pub fn is_white(&self) -> bool {
        matches!(self.0, Form::White(_))
    }

    /// The rms of the noise up to half the sample `rate`, Hz, in the sensor's unit.
    pub fn rms(&self, rate: f64) -> f64 {
        match &self.0 {
            Form::White(density) => density * (0.5 * rate).sqrt(),
            Form::Table(_) => self.power(rate, |_| 1.0).sqrt(),
        }
    }

    /// The density of the white noise whose samples at `rate`, Hz, differ from one to the next as
    /// much, in the sensor's unit per √Hz. Drift does not count: it moves neighbouring samples
    /// together.
    ///
    /// The difference of neighbouring samples has the power ∫S(f)·2·(1 − cos(2πf/rate))df up to
    /// half the rate, for white noise S·rate.
    pub fn between_samples(&self, rate: f64) -> f64 {
        match &self.0 {
            Form::White(density) => *density,
            Form::Table(_) => {
                let differing = |hz: f64| 2.0 * (1.0 - (TAU * hz / rate).cos());
                (self.power(rate, differing) / rate).sqrt()
            }
        }
    }

    /// The integral of `weight` times the power density up to half the `rate`, Hz.
    fn power(&self, rate: f64, weight: impl Fn(f64) -> f64) -> f64 {
        let [low, high] = [1e-9 * rate, 0.5 * rate];
        let inside = self.breaks().filter(|hz| low < *hz && *hz < high);
        let breaks: Vec<_> = [low].into_iter().chain(inside).chain([high]).collect();
        let nodes = nodes(&breaks, &[], |hz| 2.0 * self.slope(hz));
        let powers = nodes
            .iter()
            .map(|(hz, width)| width * weight(*hz) * self.at(*hz).powi(2));
        powers.sum()
    }
}

/// The two points on either side of `hz`, Hz; beyond the ends, the density there.
fn around(points: &[(f64, f64)], hz: f64) -> Result<[(f64, f64); 2], f64> {
    let above = points.partition_point(|(f, _)| *f <= hz);
    match (points.get(above.wrapping_sub(1)), points.get(above)) {
        (Some(&low), Some(&high)) => Ok([low, high]),
        (Some(&(_, density)), None) | (None, Some(&(_, density))) => Err(density),
        (None, None) => Err(0.0),
    }
}

fn check(entry: &str, points: &[(f64, f64)]) -> Result<(), EntryError> {
    let refuse =
        |at: String, message: String| Err(EntryError::new(entry.to_owned() + &at, message));
    if points.len() < 2 {
        let message = "a table has at least two points [hz, density]";
        return Err(EntryError::new(entry, message).fix("write one number for white noise"));
    }
    if points.len() > MOST {
        let message = format!("a table has at most {MOST} points, not {}", points.len());
        return refuse(String::new(), message);
    }
    let mut last = 0.0;
    for (i, &(hz, density)) in points.iter().enumerate() {
        if !(hz.is_finite() && hz > 0.0) {
            let message = format!("a frequency must be above 0 Hz, not {hz}");
            return refuse(format!("[{i}][0]"), message);
        }
        if hz <= last {
            let message = format!("frequencies must ascend, but {hz} Hz comes after {last} Hz");
            return refuse(format!("[{i}][0]"), message);
        }
        if !(density.is_finite() && density > 0.0) {
            let message = format!("a density must be above 0 on logarithmic axes, not {density}");
            return refuse(format!("[{i}][1]"), message);
        }
        last = hz;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(points: &[(f64, f64)]) -> NoiseDensity {
        NoiseDensity::new("", &NoiseEntry::Table(points.to_vec())).unwrap()
    }

    /// Density ∝ 1/√f from 1 Hz to 100 Hz: its power is ln 100, and 1 Hz of the first value.
    #[test]
    fn flicker_noise_has_the_power_of_a_logarithm() {
        let noise = table(&[(1.0, 3.0), (100.0, 0.3)]);
        assert!((noise.at(10.0) - 3.0 / 10f64.sqrt()).abs() < 1e-12);
        assert_eq!(
            [0.0, 1e-3, 100.0, 5e3].map(|hz| noise.at(hz)),
            [3.0, 3.0, 0.3, 0.3]
        );
        let expected = 9.0 + 9.0 * 100f64.ln() + 0.09 * 900.0;
        let found = noise.rms(2000.0).powi(2);
        assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");
    }

    /// As the sum over a fine grid; and what only drifts differs less than it moves.
    #[test]
    fn differences_of_samples() {
        let flat = table(&[(1.0, 2.0), (10.0, 2.0)]);
        assert!((flat.between_samples(1e3) - 2.0).abs() < 1e-5);
        assert!((flat.rms(1e3) - 2.0 * 500f64.sqrt()).abs() < 1e-3);
        let drift = table(&[(0.1, 10.0), (100.0, 0.01)]);
        let step = 0.01;
        let sum: f64 = (0..50_000)
            .map(|i| (f64::from(i) + 0.5) * step)
            .map(|hz| {
                let differ = 2.0 - 2.0 * (TAU * hz / 1e3).cos();
                step * differ * drift.at(hz).powi(2)
            })
            .sum();
        let found = drift.between_samples(1e3);
        assert!((found / (sum / 1e3).sqrt() - 1.0).abs() < 1e-3, "{found}");
        // Hardly more than the constant density above 100 Hz makes alone, 0.01: what drifts slowly
        // adds less than 2 %.
        assert!((1.0..1.02).contains(&(found / 0.01)), "{found}");
    }
}
