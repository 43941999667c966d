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
        let amplifier = board.actuator_bandwidth.map(|hz| TAU * hz);
        let bandwidths = board.fed_back().map(|sensor| sensor.bandwidth).enumerate();
        let lags: Vec<_> = bandwidths
            .filter_map(|(kind, hz)| Some((kind * LEGS, TAU * hz?)))
            .collect();
        let (amplifier, lags) = distinct(amplifier, lags, &plant.poles);
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

/// The corners, rad/s, of the amplifier's lag and of the sensors', moved apart where partial fractions
/// need it: poles that are equal have none, and of poles that are close the residues cancel.
///
/// An amplifier and a sensor move in opposite directions, so that their product stays the same to
/// second order, 1e-10. A lag at a pole of the machine moves by a millionth.
fn distinct(
    mut amplifier: Option<f64>,
    mut lags: Vec<(usize, f64)>,
    poles: &[PlantPole],
) -> (Option<f64>, Vec<(usize, f64)>) {
    const APART: f64 = 1e-5;
    const FROM_POLES: f64 = 1e-6;
    if let Some(amplifier) = &mut amplifier {
        // Again if that brings them to the other kind of sensors.
        while lags.iter().any(|(_, a)| (a - *amplifier).abs() < APART * a) {
            *amplifier *= 1.0 - APART;
            for (_, a) in &mut lags {
                *a /= 1.0 - APART;
            }
        }
    }
    let near = |a: f64| {
        let close = |pole: &PlantPole| (pole.lambda + a).norm() < FROM_POLES * a;
        poles.iter().any(close)
    };
    for a in amplifier.iter_mut().chain(lags.iter_mut().map(|(_, a)| a)) {
        while near(*a) {
            *a *= 1.0 + FROM_POLES;
        }
    }
    (amplifier, lags)
}
