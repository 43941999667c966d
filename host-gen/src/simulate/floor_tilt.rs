//! The tilt of the floor, sample by sample.

use core::ops::Range;

use nalgebra::{DVector, MatrixXx6, Vector6};

use crate::plant::tilt::FloorTilt;

/// The floor accelerations, m/s², that are equivalent to the tilt of a floor that was level and at
/// rest in the beginning: the [`FloorTilt`] of its motion.
///
/// The accelerations that make the tilt are straight between samples and integrated twice. What
/// follows from them is taken as straight, too: over a period, a tilt hardly changes.
pub(super) struct Tilt {
    plant: FloorTilt,
    /// The part of the performance outputs that moves with the floor.
    ride: MatrixXx6<f64>,
    /// Acceleration at the last sample, m/s², and rate and motion then, m/s and m.
    acceleration: Vector6<f64>,
    rate: Vector6<f64>,
    motion: Vector6<f64>,
    /// The equivalent accelerations at the last two samples, m/s².
    equivalent: [Vector6<f64>; 2],
}

impl Tilt {
    /// That of a `plant` with these rows of `performance` outputs.
    pub(super) fn new(plant: &FloorTilt, performance: Range<usize>) -> Self {
        Self {
            ride: plant.ride(performance),
            plant: plant.clone(),
            acceleration: Vector6::zeros(),
            rate: Vector6::zeros(),
            motion: Vector6::zeros(),
            equivalent: [Vector6::zeros(); 2],
        }
    }

    /// Moves to the next sample after a `period`, s, where the floor inputs have the
    /// `acceleration`, m/s². Returns the equivalent of the tilt there, `gain` times, m/s².
    ///
    /// The gain is that on the motion itself: a factor on the accelerations that changes would
    /// leave the floor rotating.
    pub(super) fn sample(
        &mut self,
        acceleration: &Vector6<f64>,
        period: f64,
        gain: f64,
    ) -> Vector6<f64> {
        let before = self.acceleration;
        self.motion += (self.rate + (before / 3.0 + acceleration / 6.0) * period) * period;
        self.rate += (before + acceleration) * (0.5 * period);
        self.acceleration = *acceleration;
        let now = self.plant.equivalent(self.motion) * gain;
        self.equivalent = [self.equivalent[1], now];
        now
    }

    /// What the performance outputs, which are accelerations in space, do not have of the
    /// equivalent, as mean over the last period, m/s².
    pub(super) fn weight(&self) -> DVector<f64> {
        let [before, now] = self.equivalent;
        &self.ride * (before + now) * 0.5
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;
    use std::path::Path;

    use nalgebra::{Complex, Vector6};
    use shared::LEGS;
    use shared::codes::DacCode;

    use crate::design::Study;
    use crate::machine::Machine;
    use crate::simulate::Rig;

    /// Without control, on a floor that turns in a cosine: the ADC's codes have the amplitude of the
    /// response over frequency, and so has the motion.
    #[test]
    fn a_turning_floor_in_time_is_that_over_frequency() {
        const FRAME: &str = include_str!("../../../models/metrology-frame.toml");
        let text = FRAME.replace("format = 1", "format = 1\ngravity = [0.0, 0.0, -9.81]");
        let machine = Machine::parse(Path::new("frame.toml"), &text).unwrap();
        let study = Study::new(machine).unwrap();
        let machine = study.machine();
        let mut plant = study.plant().clone();
        // Rotations that go with the translations, so that tilts are driven.
        plant.plant.base = study.model().floor;
        let mut board = machine.board.clone();
        board.dac_noise = 0.0;
        let hz = 0.5;
        let period = (board.sample_rate / hz) as usize;
        let moved = [0.0, 0.0, 0.0, 0.02, 0.03, 0.0];
        let response = plant.response(hz);
        let input = plant.plant.base * Vector6::from(moved);
        let input = input.map(Complex::from);
        let all = plant.plant.sensors().end.max(plant.plant.performance().end);
        let expected = response.from_floor(0..all) * input;
        let wave = |k: usize| (TAU * k as f64 / period as f64).cos();
        let inputs = (0..period).map(|k| moved.map(|x| x * wave(k))).collect();
        let performance = plant.plant.performance();
        let mut rig = Rig::new(plant, &board, &machine.simulation).driven(inputs);
        // The middle of 16 bits: no force.
        let zero = [DacCode(1 << 15); LEGS];
        let (scales, _) = board.calibrations();
        let mut sums = vec![Complex::ZERO; all];
        let (settling, evaluated) = (10, 10);
        for k in 0..(settling + evaluated) * period {
            let samples = rig.sample();
            let mean: Vec<f64> = rig.advance(zero).iter().copied().collect();
            if k < settling * period {
                continue;
            }
            // The first sample is that of the floor before it moves.
            let turn = Complex::cis(-TAU * (k as f64 - 1.0) / period as f64);
            let half = Complex::cis(-TAU * (k as f64 - 0.5) / period as f64);
            for leg in 0..LEGS {
                sums[leg] += turn * f64::from(scales[leg].value(samples.sensors[leg]));
            }
            for (sum, x) in sums[performance.clone()].iter_mut().zip(mean) {
                *sum += half * x;
            }
        }
        let scale = 2.0 / (evaluated * period) as f64;
        for rows in [0..LEGS, performance] {
            let largest = expected.rows_range(rows.clone()).camax();
            for i in rows {
                let error = (sums[i] * scale - expected[i]).norm() / largest;
                assert!(
                    error < 1e-3,
                    "{i}: {error:e} {} {}",
                    sums[i] * scale,
                    expected[i]
                );
            }
        }
    }
}
