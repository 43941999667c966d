//! Bode's integral of the sampled loop, with the delay of its samples.

use core::f64::consts::TAU;

use serde::Serialize;

/// Attenuation and amplification by Bode's integral of the sampled loop, weighted for its delay.
///
/// A sample measures the forces computed d samples before and earlier, so the loop gain L has no
/// powers of z⁻¹ below d. Nor has ln det S, with the sensitivity S = (1 + L)⁻¹. Plant, controller
/// and closed loop are stable, so this series holds outside the unit circle. On it, for every
/// controller, the integral of ln|det S|·cos(nω) over 0 ≤ ω ≤ π is zero for n < d, where ω is the
/// angle per sample. The case n = 0 is Bode's integral.
///
/// So with every weight p(ω) = Σ pₙ·cos(nω), n < d, attenuation at some frequencies causes as much
/// amplification at others. This is the integral with Fejér's kernel,
///
/// ```text
/// p = (sin(d·ω/2) / (d·sin(ω/2)))²
/// ```
///
/// which is 1 at 0 Hz and 1/d in the mean. No other p ≥ 0 with p(0) = 1 has a smaller mean, so no
/// other leaves less room for the amplification that attenuation at low frequency needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bode {
    /// The delay d, samples: the age of the newest force that a sample measures.
    pub delay_samples: usize,
    /// Attenuation, mean over the six modes, Hz: the integral of −p·ln|det S|/6 over the
    /// frequencies at which it is positive.
    pub attenuation_hz: f64,
    /// Amplification, mean over the six modes, Hz: the integral of p·ln|det S|/6 over the
    /// frequencies at which it is positive.
    pub amplification_hz: f64,
    /// Largest amplification within the sensitivity bound Ms, Hz: the integral of p·ln Ms over the
    /// frequencies that are amplified. It is below ln Ms·f_s/(2d) with the sample rate f_s.
    pub limit_hz: f64,
}

impl Bode {
    /// The integrals over `points`, Hz, ascending to half the sample rate 1/`period`, s.
    ///
    /// `logarithms` are ln|det S|/6 at these points, `delay` is d in samples, at least one, and
    /// `max_sensitivity` is Ms.
    pub(super) fn new(
        points: &[f64],
        logarithms: &[f64],
        delay: usize,
        period: f64,
        max_sensitivity: f64,
    ) -> Self {
        let mut bode = Self {
            delay_samples: delay,
            attenuation_hz: 0.0,
            amplification_hz: 0.0,
            limit_hz: 0.0,
        };
        for (hz, log) in points.windows(2).zip(logarithms.windows(2)) {
            let weight = weight(delay, TAU * 0.5 * (hz[0] + hz[1]) * period);
            let width = weight * (hz[1] - hz[0]);
            let part = 0.5 * (log[0] + log[1]) * width;
            if part < 0.0 {
                bode.attenuation_hz -= part;
            } else {
                bode.amplification_hz += part;
                bode.limit_hz += width * max_sensitivity.ln();
            }
        }
        bode
    }
}

/// Fejér's kernel of a delay, samples, at an angle per sample, rad, above zero.
fn weight(delay: usize, angle: f64) -> f64 {
    let d = delay as f64;
    ((0.5 * d * angle).sin() / (d * (0.5 * angle).sin())).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 at 0 Hz, not negative, and no powers of cos beyond d − 1: the sum d⁻¹·(1 + 2·Σ(1 − n/d)·cos nω).
    #[test]
    fn the_weight_is_fejers_sum() {
        for delay in 1..10 {
            for i in 1..100 {
                let angle = f64::from(i) * 0.0317;
                let d = delay as f64;
                let sum: f64 = (1..delay)
                    .map(|n| 2.0 * (1.0 - n as f64 / d) * (n as f64 * angle).cos())
                    .sum();
                let found = weight(delay, angle);
                assert!(found >= 0.0 && (found - (1.0 + sum) / d).abs() < 1e-13);
            }
        }
    }
}
