//! The filter of an amplifier or a sensor, as a product of factors of first and second order.

use nalgebra::Complex;

/// A factor of first or second order, with gain 1 in its pass band.
#[derive(Clone, Copy, Debug)]
pub(super) struct Factor {
    /// Its corner a or natural frequency ω, rad/s.
    corner: f64,
    order: Order,
    /// Whether it passes what is above the corner, not what is below.
    high: bool,
}

#[derive(Clone, Copy, Debug)]
enum Order {
    /// a/(s + a) or s/(s + a).
    First,
    /// ω²/(s² + 2ζωs + ω²) or s²/(s² + 2ζωs + ω²), with this damping ratio ζ, below 1.
    Second(f64),
}

impl Factor {
    /// a/(s + a).
    pub(super) fn lag(corner: f64) -> Self {
        Self {
            corner,
            order: Order::First,
            high: false,
        }
    }

    /// s/(s + a).
    pub(super) fn high_pass(corner: f64) -> Self {
        Self {
            high: true,
            ..Self::lag(corner)
        }
    }

    /// s²/(s² + √2ωs + ω²).
    pub(super) fn butterworth_high_pass(corner: f64) -> Self {
        Self {
            corner,
            order: Order::Second(core::f64::consts::FRAC_1_SQRT_2),
            high: true,
        }
    }

    /// ω²/(s² + 2ζωs + ω²) with ζ = `damping`, below 1.
    pub(super) fn resonance(corner: f64, damping: f64) -> Self {
        Self {
            corner,
            order: Order::Second(damping),
            high: false,
        }
    }

    /// Its pole, of a pair the one above the real axis.
    pub(super) fn pole(&self) -> Complex<f64> {
        match self.order {
            Order::First => Complex::from(-self.corner),
            Order::Second(damping) => {
                let part = (1.0 - damping * damping).sqrt();
                Complex::new(-damping, part) * self.corner
            }
        }
    }

    /// Multiplies the corner, and so the pole, by `factor`.
    pub(super) fn scale(&mut self, factor: f64) {
        self.corner *= factor;
    }

    /// Its numerator at `s`.
    fn numerator(&self, s: Complex<f64>) -> Complex<f64> {
        let base = if self.high {
            s
        } else {
            Complex::from(self.corner)
        };
        match self.order {
            Order::First => base,
            Order::Second(_) => base * base,
        }
    }

    fn at(&self, s: Complex<f64>) -> Complex<f64> {
        let pole = self.pole();
        match self.order {
            Order::First => self.numerator(s) / (s - pole),
            Order::Second(_) => self.numerator(s) / ((s - pole) * (s - pole.conj())),
        }
    }

    /// Its residue at its pole.
    fn residue(&self) -> Complex<f64> {
        let pole = self.pole();
        match self.order {
            Order::First => self.numerator(pole),
            Order::Second(_) => self.numerator(pole) / (pole - pole.conj()),
        }
    }

    /// Its value and its slope at s = 0.
    fn slow(&self) -> [f64; 2] {
        match (self.high, self.order) {
            (false, Order::First) => [1.0, -1.0 / self.corner],
            (false, Order::Second(damping)) => [1.0, -2.0 * damping / self.corner],
            (true, Order::First) => [0.0, 1.0 / self.corner],
            (true, Order::Second(_)) => [0.0, 0.0],
        }
    }
}

/// A product of factors whose poles are apart from each other.
#[derive(Clone, Debug, Default)]
pub(super) struct Filter {
    pub(super) factors: Vec<Factor>,
}

/// A pole p of a filter with its residue r: r/(s − p), plus the conjugate of a pair.
pub(super) struct FilterPole {
    pub(super) at: Complex<f64>,
    pub(super) pair: bool,
    pub(super) residue: Complex<f64>,
}

impl Filter {
    /// The filter at `s`, rad/s.
    pub(super) fn at(&self, s: Complex<f64>) -> Complex<f64> {
        self.factors.iter().map(|factor| factor.at(s)).product()
    }

    /// The filter at s = ∞: 1 if it passes high frequencies, else 0.
    pub(super) fn at_infinity(&self) -> f64 {
        let all = self.factors.iter().all(|factor| factor.high);
        if all { 1.0 } else { 0.0 }
    }

    /// Its value and its slope at s = 0.
    pub(super) fn slow(&self) -> [f64; 2] {
        let slow = self.factors.iter().map(Factor::slow);
        slow.fold([1.0, 0.0], |[value, slope], [own, change]| {
            [value * own, slope * own + value * change]
        })
    }

    /// Its poles: the filter is its value at infinity plus their terms.
    pub(super) fn poles(&self) -> impl Iterator<Item = FilterPole> {
        self.factors.iter().enumerate().map(|(i, own)| {
            let at = own.pole();
            let others = self.factors.iter().enumerate().filter(|(j, _)| *j != i);
            let others: Complex<f64> = others.map(|(_, factor)| factor.at(at)).product();
            FilterPole {
                at,
                pair: matches!(own.order, Order::Second(_)),
                residue: own.residue() * others,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Partial fractions against the product, and value and slope against differences.
    #[test]
    fn partial_fractions_are_the_product() {
        let filters = [
            vec![Factor::lag(30.0)],
            vec![Factor::high_pass(2.0)],
            vec![Factor::butterworth_high_pass(2.0)],
            vec![Factor::resonance(50.0, 0.02)],
            vec![Factor::high_pass(0.1), Factor::lag(700.0)],
            vec![
                Factor::lag(700.0),
                Factor::butterworth_high_pass(0.3),
                Factor::resonance(900.0, 0.4),
            ],
        ];
        for filter in filters.map(|factors| Filter { factors }) {
            for w in [1e-3, 0.1, 2.0, 49.0, 1e3, 1e5] {
                let s = Complex::new(0.0, w);
                let terms = filter.poles().map(|pole| {
                    let own = pole.residue / (s - pole.at);
                    let other = pole.residue.conj() / (s - pole.at.conj());
                    if pole.pair { own + other } else { own }
                });
                let sum = terms.sum::<Complex<f64>>() + filter.at_infinity();
                let error = (sum - filter.at(s)).norm();
                assert!(error < 1e-12, "{filter:?} at {w}: {error:e}");
            }
            let [value, slope] = filter.slow();
            let at = |x: f64| filter.at(Complex::from(x)).re;
            let h = 1e-5;
            assert!((at(0.0) - value).abs() < 1e-15, "{filter:?}");
            let difference = (at(h) - at(-h)) / (2.0 * h);
            assert!(
                (difference - slope).abs() < 1e-4,
                "{filter:?}: {difference} {slope}"
            );
        }
    }
}
