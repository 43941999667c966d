//! What is made of a vibration: its displacement, and what an exposure makes of that, its moving
//! average and the moving standard deviation about it.

use core::f64::consts::{PI, TAU};

/// What is made of an acceleration, as a power per power of the acceleration at each frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measure {
    /// The acceleration itself.
    Acceleration,
    /// The displacement.
    Displacement,
    /// The mean of the displacement over an exposure of so many seconds.
    Average(f64),
    /// The standard deviation of the displacement about its mean over such an exposure.
    Deviation(f64),
}

impl Measure {
    /// Power per power of the acceleration at `hz`, Hz, above 0: no unit, or s⁴.
    ///
    /// The mean over T of a sine of the frequency f has sin(π·f·T)/(π·f·T) of its amplitude; what
    /// is left of the mean square is that of the deviation.
    pub fn weight(self, hz: f64) -> f64 {
        let displacement = (TAU * hz).powi(-4);
        match self {
            Self::Acceleration => 1.0,
            Self::Displacement => displacement,
            Self::Average(exposure) => in_mean(PI * hz * exposure) * displacement,
            Self::Deviation(exposure) => about_mean(hz, exposure) * displacement,
        }
    }

    /// The frequencies between `low` and `high`, Hz, between which [`weight`](Self::weight) may be
    /// integrated by a rule of any order.
    ///
    /// Eighths of a period, until nothing of the weight is left that changes.
    pub fn breaks(self, [low, high]: [f64; 2]) -> Vec<f64> {
        let (Self::Average(exposure) | Self::Deviation(exposure)) = self else {
            return Vec::new();
        };
        let step = 0.125 / exposure;
        let count = (high / step).min(EIGHTHS) as usize;
        let all = (1..=count).map(|n| n as f64 * step);
        all.filter(|hz| low < *hz && *hz < high).collect()
    }
}

/// Part of a sine's power in its mean over x/π periods.
fn in_mean(x: f64) -> f64 {
    (x.sin() / x).powi(2)
}

/// Part of a sine's power at `hz`, Hz, that is left about its mean over `time`, s.
pub fn about_mean(hz: f64, time: f64) -> f64 {
    let x = PI * hz * time;
    // The difference of two numbers near 1, as a series.
    if x < 0.02 {
        let square = x * x;
        square * (1.0 / 3.0 - square * (2.0 / 45.0 - square / 315.0))
    } else {
        1.0 - in_mean(x)
    }
}

/// After a hundred periods, the mean of a sine is a hundred-thousandth of its power.
const EIGHTHS: f64 = 800.0;

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and deviation of a sine of unit acceleration over an exposure, by sums over many
    /// phases.
    #[test]
    fn of_a_sine() {
        let exposure = 0.03;
        for hz in [0.01, 0.2, 5.0, 33.4, 170.0] {
            let omega = TAU * hz;
            let (mut average, mut deviation) = (0.0, 0.0);
            let phases = 16;
            for phase in 0..phases {
                let start = TAU * f64::from(phase) / f64::from(phases);
                let count = 4000;
                let at = |n: i32| {
                    let t = (f64::from(n) + 0.5) / f64::from(count) * exposure;
                    (start + omega * t).sin() * 2f64.sqrt() / (omega * omega)
                };
                let mean = (0..count).map(at).sum::<f64>() / f64::from(count);
                let around = (0..count).map(|n| (at(n) - mean).powi(2)).sum::<f64>();
                average += mean * mean / f64::from(phases);
                deviation += around / f64::from(count) / f64::from(phases);
            }
            for (measure, expected) in [
                // The squares of mean and deviation are that of the whole.
                (Measure::Displacement, average + deviation),
                (Measure::Average(exposure), average),
                (Measure::Deviation(exposure), deviation),
            ] {
                let found = measure.weight(hz);
                assert!(
                    (found / expected - 1.0).abs() < 1e-5,
                    "{measure:?} at {hz} Hz: {found:e} {expected:e}"
                );
            }
        }
    }
}
