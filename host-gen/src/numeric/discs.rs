//! Linear functions on intersections of discs in the complex plane.

use nalgebra::Complex;

/// All t with |t − centre| ≤ radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Disc {
    pub(crate) centre: Complex<f64>,
    pub(crate) radius: f64,
}

/// Rounding that a point on the edge of a disc may have, as a part of the sizes in play. A point
/// slightly outside makes the minimum lower, never higher.
const ROUNDING: f64 = 1e-12;

impl Disc {
    fn contains(&self, t: Complex<f64>) -> bool {
        let size = self.radius + self.centre.norm() + t.norm();
        (t - self.centre).norm() <= self.radius + ROUNDING * size
    }

    /// Where Re(φ·t) is least, with `direction` = φ*/|φ|.
    fn lowest(&self, direction: Complex<f64>) -> Complex<f64> {
        self.centre - direction * self.radius
    }

    /// The two points that the edges of both discs share; none if they do not cross.
    fn crossings(&self, other: &Self) -> Option<[Complex<f64>; 2]> {
        let between = other.centre - self.centre;
        let distance = between.norm();
        let along = 0.5
            * (distance + (self.radius - other.radius) * (self.radius + other.radius) / distance);
        let height = (self.radius - along) * (self.radius + along);
        // Not a number with equal centres.
        let across = Complex::new(0.0, (height >= 0.0).then(|| height.sqrt())?);
        let unit = between / distance;
        Some([along + across, along - across].map(|t| self.centre + t * unit))
    }
}

/// The least Re(φ·t) over all t in every one of `discs`; infinite if they have no point in common.
///
/// The minimum lies at the lowest point of a disc or where the edges of two cross.
pub(crate) fn least(phi: Complex<f64>, discs: &[Disc]) -> f64 {
    let size = phi.norm();
    let direction = if size > 0.0 {
        phi.conj() / size
    } else {
        Complex::ONE
    };
    let lowest = discs.iter().map(|disc| disc.lowest(direction));
    let crossings = discs.iter().enumerate().flat_map(|(i, a)| {
        let pairs = discs[..i].iter().filter_map(|b| a.crossings(b));
        pairs.flatten()
    });
    lowest
        .chain(crossings)
        .filter(|t| discs.iter().all(|disc| disc.contains(*t)))
        .map(|t| (phi * t).re)
        .fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn disc() -> impl Strategy<Value = Disc> {
        (-1.0..1.0, -1.0..1.0, 0.01..2.0).prop_map(|(re, im, radius)| Disc {
            centre: Complex::new(re, im),
            radius,
        })
    }

    proptest! {
        /// No point of a fine lattice that lies in all discs is lower, and one is nearly as low.
        #[test]
        fn the_minimum_is_that_of_a_lattice(
            discs in prop::collection::vec(disc(), 1..5),
            angle in 0.0..6.3f64,
        ) {
            let phi = Complex::from_polar(1.7, angle);
            let found = least(phi, &discs);
            let mut lowest = f64::INFINITY;
            let smallest = discs.iter().min_by(|a, b| a.radius.total_cmp(&b.radius)).unwrap();
            for i in 0..=400 {
                for turn in 0..200 {
                    let r = smallest.radius * f64::from(i) / 400.0;
                    let turn = f64::from(turn) / 200.0 * core::f64::consts::TAU;
                    let t = smallest.centre + Complex::from_polar(r, turn);
                    if discs.iter().all(|disc| (t - disc.centre).norm() <= disc.radius) {
                        lowest = lowest.min((phi * t).re);
                    }
                }
            }
            prop_assert!(found <= lowest + 1e-9);
            // The lattice's cells, seen under a sharp corner of the intersection.
            if lowest.is_finite() {
                prop_assert!(found > lowest - 0.25 * smallest.radius);
            }
        }
    }

    #[test]
    fn discs_apart_have_no_minimum() {
        let disc = |x: f64| Disc {
            centre: x.into(),
            radius: 1.0,
        };
        assert_eq!(least(Complex::ONE, &[disc(0.0), disc(2.1)]), f64::INFINITY);
        // They touch at 1.
        assert!((least(Complex::ONE, &[disc(0.0), disc(2.0)]) - 1.0).abs() < 1e-6);
        // The inner one decides.
        let inner = Disc {
            centre: 0.5.into(),
            radius: 0.1,
        };
        assert!((least(Complex::ONE, &[disc(0.0), inner]) - 0.4).abs() < 1e-12);
    }
}
