//! Filters of amplifiers and sensors between converters and machine.

use core::f64::consts::TAU;

use nalgebra::{Complex, DMatrix, DVector};
use shared::LEGS;

use super::filter::{Factor, Filter};
use super::generalised::Plant;
use super::partial_fractions::PlantPole;
use super::response::Terms;
use super::state_space::INPUTS;
use crate::machine::{Board, LowerCorner, Sensor};

/// The plant with the filters of amplifiers and sensors, as partial fractions.
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
        let [amplifier, sensors @ ..] = filters(board, &plant.poles);
        let outputs = lagged.direct.nrows();
        let pass = |[value, slope]: &mut [DMatrix<f64>; 2], filter: &Filter, at, size| {
            let [gain, change] = filter.slow();
            let (mut value, mut slope) = (value.view_mut(at, size), slope.view_mut(at, size));
            slope *= gain;
            slope += &value * change;
            value *= gain;
        };
        let kinds = || sensors.iter().zip([0, LEGS]);
        let unit = |size, i| {
            let one = DVector::from_fn(size, |j, _| f64::from(u8::from(i == j)));
            one.map(Complex::from)
        };
        // Partial fractions of the product of G(s) and a filter H(s): each residue of G times
        // H(λ), and each pole p of the filter with its residue times G(p).
        let mut own = Vec::new();
        for pole in amplifier.poles() {
            let residue = lagged.at(pole.at) * pole.residue;
            own.extend((LEGS..INPUTS).map(|j| PlantPole {
                lambda: pole.at,
                pair: pole.pair,
                input: unit(INPUTS, j),
                output: residue.column(j).into_owned(),
            }));
        }
        for pole in &mut lagged.poles {
            let factor = amplifier.at(pole.lambda);
            for input in pole.input.iter_mut().skip(LEGS) {
                *input *= factor;
            }
        }
        lagged.poles.append(&mut own);
        pass(&mut lagged.slow, &amplifier, (0, LEGS), (outputs, LEGS));
        if amplifier.at_infinity() == 0.0 {
            lagged.direct.columns_mut(LEGS, LEGS).fill(0.0);
        }
        // Residues before any sensor's filter is applied, because the two kinds of sensors are in
        // parallel.
        for (filter, first) in kinds() {
            for pole in filter.poles() {
                let residue = lagged.at(pole.at) * pole.residue;
                own.extend((first..first + LEGS).map(|i| PlantPole {
                    lambda: pole.at,
                    pair: pole.pair,
                    input: residue.row(i).transpose(),
                    output: unit(outputs, i),
                }));
            }
        }
        for (filter, first) in kinds().filter(|(filter, _)| !filter.factors.is_empty()) {
            for pole in &mut lagged.poles {
                let factor = filter.at(pole.lambda);
                for output in pole.output.iter_mut().skip(first).take(LEGS) {
                    *output *= factor;
                }
            }
            pass(&mut lagged.slow, filter, (first, 0), (LEGS, INPUTS));
            if filter.at_infinity() == 0.0 {
                lagged.direct.rows_mut(first, LEGS).fill(0.0);
            }
        }
        lagged.poles.append(&mut own);
        lagged.terms = Terms::new(&lagged.poles);
        lagged
    }

    /// G(s) at `s`, rad/s. Below all poles it is counted from s = 0: then the residue of a slow
    /// filter agrees with its slope there to the last digits, which cancel far above its corner.
    fn at(&self, s: Complex<f64>) -> DMatrix<Complex<f64>> {
        let slow = self.poles.iter().all(|pole| s.norm() < pole.lambda.norm());
        let mut sum = if slow {
            let [value, slope] = &self.slow;
            value.map(Complex::from) + slope.map(|x| x * s)
        } else {
            self.direct.map(Complex::from)
        };
        let gain = |lambda: Complex<f64>| {
            let own = (s - lambda).inv();
            let ratio = s / lambda;
            if slow { ratio * ratio * own } else { own }
        };
        for pole in &self.poles {
            sum += &pole.output * pole.input.transpose() * gain(pole.lambda);
            if pole.pair {
                let conjugate = |v: &DVector<Complex<f64>>| v.map(|z| z.conj());
                let (output, input) = (conjugate(&pole.output), conjugate(&pole.input));
                sum += output * input.transpose() * gain(pole.lambda.conj());
            }
        }
        sum
    }
}

/// The filter of a sensor.
fn of_sensor(sensor: &Sensor) -> Filter {
    let lag = sensor.bandwidth.map(|hz| Factor::lag(TAU * hz));
    let lower = sensor.lower_corner.map(|corner| match corner {
        LowerCorner::First(hz) => Factor::high_pass(TAU * hz),
        LowerCorner::Second(hz) => Factor::butterworth_high_pass(TAU * hz),
    });
    let resonance = sensor.resonance;
    let resonance = resonance.map(|peak| Factor::resonance(TAU * peak.hz, peak.damping));
    Filter {
        factors: [lag, lower, resonance].into_iter().flatten().collect(),
    }
}

/// The filters of the amplifiers and of both kinds of sensors, their poles moved apart where
/// partial fractions need it: poles that are equal have none, and of poles that are close the
/// residues cancel.
///
/// Of an amplifier and a sensor with equal lags, one moves up and the other down, so that their
/// product stays the same to second order, 1e-10. A pole at one of the machine moves by a
/// millionth.
fn filters(board: &Board, poles: &[PlantPole]) -> [Filter; 3] {
    const APART: f64 = 1e-5;
    const FROM_POLES: f64 = 1e-6;
    let amplifier = board.actuator_bandwidth.map(|hz| Factor::lag(TAU * hz));
    let mut amplifier = Filter {
        factors: amplifier.into_iter().collect(),
    };
    let mut kinds = [Filter::default(), Filter::default()];
    for (kind, sensor) in kinds.iter_mut().zip(board.fed_back()) {
        *kind = of_sensor(sensor);
    }
    let close = |a: &Factor, b: &Factor| {
        let (a, b) = (a.pole(), b.pole());
        (a - b).norm() < APART * b.norm()
    };
    for lag in &mut amplifier.factors {
        // Again if that brings them to the other kind of sensors.
        loop {
            let own = kinds.iter_mut().flat_map(|kind| &mut kind.factors);
            let equal: Vec<_> = own.filter(|own| close(lag, own)).collect();
            if equal.is_empty() {
                break;
            }
            lag.scale(1.0 - APART);
            for own in equal {
                own.scale(1.0 / (1.0 - APART));
            }
        }
    }
    let near = |factor: &Factor| {
        let at = factor.pole();
        let close = |pole: &PlantPole| (pole.lambda - at).norm() < FROM_POLES * at.norm();
        poles.iter().any(close)
    };
    let all = [&mut amplifier].into_iter().chain(&mut kinds);
    for factor in all.flat_map(|filter| &mut filter.factors) {
        while near(factor) {
            factor.scale(1.0 + FROM_POLES);
        }
    }
    let [accelerometer, force_sensor] = kinds;
    [amplifier, accelerometer, force_sensor]
}
