//! Quadrature of functions whose singularities are known.

use nalgebra::Complex;

/// Gauss–Legendre rules: how far away the singularities must be, the least sum of the half axes
/// of the rule's Bernstein ellipse; and the nodes from −1 to 1 with their weights.
///
/// The relative error of n nodes is about ρ⁻²ⁿ, so each rule is good to about 1e-6, and to 1e-5
/// near poles of fourth order.
const RULES: [(f64, &[(f64, f64)]); 4] = [
    (1e3, &[(0.0, 2.0)]),
    (
        32.0,
        &[
            (-0.577_350_269_189_625_8, 1.0),
            (0.577_350_269_189_625_8, 1.0),
        ],
    ),
    (
        10.0,
        &[
            (-0.774_596_669_241_483_4, 5.0 / 9.0),
            (0.0, 8.0 / 9.0),
            (0.774_596_669_241_483_4, 5.0 / 9.0),
        ],
    ),
    (
        5.0,
        &[
            (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
            (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (0.0, 0.568_888_888_888_888_9),
            (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (0.906_179_845_938_664, 0.236_926_885_056_189_08),
        ],
    ),
];

/// A power-law e^(c·x), −1 ≤ x ≤ 1, takes as many nodes as a singularity at this sum of half
/// axes over |c|.
const POWER: f64 = 7.0;

/// The nodes of a quadrature and their weights, nodes ascending: Σ weight·f(node) is the integral
/// of f from the first of the `breaks` to the last to about 1e-5.
///
/// `breaks` are ascending and above 0. Between two of them, f has no singularity on the axis.
/// `singular` are its singularities in the complex plane, those near the axis above all; 0 need
/// not be among them. `exponent` is a bound of d ln |f|/d ln x at x for a factor of f that is
/// steeper than its singularities tell.
///
/// Between two breaks, the nodes belong to intervals that are halved until each is so short
/// against its distance from all singularities that a rule of at most five nodes is enough.
pub fn nodes(
    breaks: &[f64],
    singular: &[Complex<f64>],
    exponent: impl Fn(f64) -> f64,
) -> Vec<(f64, f64)> {
    let mut nodes = Vec::new();
    for ends in breaks.windows(2) {
        let mut left = vec![(ends[0], ends[1])];
        while let Some((low, high)) = left.pop() {
            let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
            let ellipse = |at: &Complex<f64>| {
                let z = (at - middle) / half;
                let root = (z * z - 1.0).sqrt();
                (z + root).norm().max((z - root).norm())
            };
            let reach = singular
                .iter()
                .chain([&Complex::ZERO])
                .map(ellipse)
                .fold(POWER * middle / (half * exponent(middle).abs()), f64::min);
            let rule = RULES.iter().find(|(least, _)| reach >= *least);
            // A singularity on the axis itself: an integral without a limit.
            let shortest = half <= 1e-10 * middle;
            match rule.or(shortest.then_some(&RULES[0])) {
                Some((_, rule)) => {
                    nodes.extend(rule.iter().map(|(x, w)| (middle + half * x, half * w)));
                }
                None => left.extend([(middle, high), (low, middle)]),
            }
        }
    }
    nodes
}

/// The points at which the frequency response of a system with continuous `poles`, rad/s, is
/// singular, as complex frequencies, Hz; those with a real part of at least 0.
pub fn singular_hertz<'a>(poles: impl IntoIterator<Item = &'a Complex<f64>>) -> Vec<Complex<f64>> {
    poles
        .into_iter()
        .map(|pole| Complex::new(pole.im.abs(), pole.re) / core::f64::consts::TAU)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn integral(breaks: &[f64], singular: &[Complex<f64>], f: impl Fn(f64) -> f64) -> f64 {
        let nodes = nodes(breaks, singular, |_| 0.0);
        nodes.iter().map(|(x, w)| w * f(*x)).sum()
    }

    /// ∫ dx/((x − a)² + b²) = (atan((x₁ − a)/b) − atan((x₀ − a)/b))/b, from wide peaks to one
    /// that is a millionth of its place wide.
    #[test]
    fn peaks_are_integrated() {
        for b in [3.0, 0.1, 1e-3, 1e-5] {
            let a = 10.0;
            let found = integral(&[0.5, 300.0], &[Complex::new(a, b)], |x| {
                1.0 / ((x - a) * (x - a) + b * b)
            });
            let expected = (((300.0 - a) / b).atan() - ((0.5 - a) / b).atan()) / b;
            assert!(
                (found / expected - 1.0).abs() < 1e-5,
                "{b}: {found} {expected}"
            );
        }
    }

    #[test]
    fn powers_are_integrated() {
        for n in [-4, -1, 1, 3] {
            let found = integral(&[1e-3, 0.7, 300.0], &[], |x| x.powi(n));
            let expected = if n == -1 {
                (300.0f64 / 1e-3).ln()
            } else {
                (300f64.powi(n + 1) - 1e-3f64.powi(n + 1)) / f64::from(n + 1)
            };
            assert!(
                (found / expected - 1.0).abs() < 1e-5,
                "{n}: {found} {expected}"
            );
        }
    }

    /// A flank of fourteen decades over a five thousandth of its frequency.
    #[test]
    fn steep_flanks_are_integrated() {
        let (low, high) = (49.94, 49.95);
        let steep = 1e14f64.ln() / f64::ln(high / low);
        let nodes = nodes(&[low, high], &[], |_| steep);
        let found: f64 = nodes.iter().map(|(x, w)| w * (x / low).powf(steep)).sum();
        let expected = low / (steep + 1.0) * ((high / low).powf(steep + 1.0) - 1.0);
        assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");
        assert!(nodes.len() < 200, "{}", nodes.len());
    }
}
