//! First-order lags of amplifiers and sensors between converters and machine.

use core::f64::consts::TAU;

use nalgebra::{Complex, DMatrix, DVector};
use shared::LEGS;

use super::generalised::Plant;
use super::partial_fractions::PlantPole;
use super::response::Terms;
use super::state_space::INPUTS;
use crate::machine::Board;

/// The plant with the lags of amplifiers and sensors, as partial fractions.
#[derive(Clone, Debug)]
pub(super) struct Lagged {
    pub(super) poles: Vec<PlantPole>,
    pub(super) terms: Terms,
    pub(super) direct: DMatrix<f64>,
    /// G(0) and dG/ds at s = 0, as in [`Plant::slow`].
    pub(super) slow: [DMatrix<f64>; 2],
}

impl Lagged {
    pub(super) fn new(plant: &Plant, board: &Board) -> Self {
        let mut lagged = Self {
            poles: plant.poles.clone(),
            terms: plant.terms.clone(),
            direct: plant.state_space.d.clone(),
            slow: plant.slow.clone(),
        };
        let mut before: Vec<_> = plant.poles.iter().map(|pole| pole.lambda).collect();
        let amplifier = board.actuator_bandwidth.map(|hz| apart(TAU * hz, &before));
        before.extend(amplifier.map(|a| Complex::from(-a)));
        let kinds = [Some(board.sensor), board.beside].into_iter().flatten();
        let bandwidths = kinds.map(|sensor| sensor.bandwidth).enumerate();
        let lags: Vec<_> = bandwidths
            .filter_map(|(kind, hz)| Some((kind * LEGS, apart(TAU * hz?, &before))))
            .collect();
        let [value, slope] = &mut lagged.slow;
        // The value and slope of a lag: a/(s + a) = 1 − s/a + ….
        if let Some(a) = amplifier {
            let mut slope = slope.columns_mut(LEGS, LEGS);
            slope -= value.columns(LEGS, LEGS) / a;
        }
        for &(first, a) in &lags {
            let mut slope = slope.rows_mut(first, LEGS);
            slope -= value.rows(first, LEGS) / a;
        }
        let real = |values: DVector<f64>| values.map(Complex::from);
        let unit = |size, i| real(DVector::from_fn(size, |j, _| f64::from(u8::from(i == j))));
        // Partial fractions of the product of G(s) and a/(s + a): each residue of G times
        // a/(λ + a), and the pole −a of the lag with the residue a·G(−a).
        if let Some(a) = amplifier {
            let residue = lagged.at(-a) * a;
            for pole in &mut lagged.poles {
                let factor = a / (pole.lambda + a);
                for input in pole.input.iter_mut().skip(LEGS) {
                    *input *= factor;
                }
            }
            lagged.direct.columns_mut(LEGS, LEGS).fill(0.0);
            lagged.poles.extend((LEGS..INPUTS).map(|j| PlantPole {
                lambda: Complex::from(-a),
                pair: false,
                input: unit(INPUTS, j),
                output: real(residue.column(j).into_owned()),
            }));
        }
        // Residues before any sensor lag is applied, because the two kinds of sensors are in
        // parallel.
        let residues: Vec<_> = lags.iter().map(|(_, a)| lagged.at(-a) * *a).collect();
        for ((first, a), residue) in lags.into_iter().zip(residues) {
            for pole in &mut lagged.poles {
                let factor = a / (pole.lambda + a);
                for output in pole.output.iter_mut().skip(first).take(LEGS) {
                    *output *= factor;
                }
            }
            lagged.direct.rows_mut(first, LEGS).fill(0.0);
            let outputs = lagged.direct.nrows();
            lagged
                .poles
                .extend((first..first + LEGS).map(|i| PlantPole {
                    lambda: Complex::from(-a),
                    pair: false,
                    input: real(residue.row(i).transpose()),
                    output: unit(outputs, i),
                }));
        }
        lagged.terms = Terms::new(&lagged.poles);
        lagged
    }

    /// G(s) at a real s, rad/s.
    fn at(&self, s: f64) -> DMatrix<f64> {
        let mut sum = self.direct.clone();
        for pole in &self.poles {
            let twice = if pole.pair { 2.0 } else { 1.0 };
            let part = &pole.output * pole.input.transpose() * (twice / (s - pole.lambda));
            sum += part.map(|z| z.re);
        }
        sum
    }
}

/// The corner `a` of a lag, rad/s, moved away from the `poles` before it as far as partial fractions
/// need.
///
/// Poles that are equal have no partial fractions, and the residues of poles that are close cancel:
/// of two, half the digits at a relative distance of 3e-8, which is also the change of the response.
fn apart(mut a: f64, poles: &[Complex<f64>]) -> f64 {
    let within = |a: f64, part: f64| {
        let near = poles.iter().filter(|pole| (*pole + a).norm() < part * a);
        near.count()
    };
    // Residues of three close poles go with the square of the distance.
    let room = if within(a, 1e-3) > 1 { 1e-5 } else { 3e-8 };
    while within(a, room) > 0 {
        a *= 1.0 + room;
    }
    a
}
