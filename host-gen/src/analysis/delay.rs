//! The delay of the loop and its parts, and where samples lie in the holds of the forces.

use serde::Serialize;

use crate::machine::Board;

/// The parts of the loop's delay and their sum, s.
#[derive(Debug, Serialize)]
pub(crate) struct DelayBudget {
    pub(crate) latch: f64,
    pub(crate) hold: f64,
    pub(crate) amplifier: f64,
    pub(crate) sensor: f64,
    pub(crate) whole: f64,
    /// Where a sample lies in the hold of the force that it measures, as [`in_hold`].
    pub(crate) in_hold: f64,
    /// The delay from sample to latch, at least that of the board, with which a sample lies in the
    /// middle of a hold, s.
    pub(crate) middle: f64,
}

/// Where a sample lies in the hold of the newest force that it measures: above 0 at its beginning,
/// 1 at its end.
///
/// The machine follows the mean of a held force, and a sample measures the acceleration at its
/// instant. Let the loop keep the samples at zero, and the acceleration that the forces cancel change
/// by v per second. Then the mean over a period T is (½ − x)·T·v, with x this place in the hold.
pub(crate) fn in_hold(board: &Board) -> f64 {
    let periods = board.latch_delay / board.period();
    let part = periods - (periods + WHOLE).floor();
    (1.0 - part).min(1.0)
}

/// Delays from sample to latch with which a sample lies in the middle of a hold, s: the next above
/// that of the board, or equal to it, and the one before.
pub(crate) fn middles(board: &Board) -> [f64; 2] {
    let periods = (board.latch_delay / board.period() - 0.5 - WHOLE).ceil();
    [0.5, -0.5].map(|half| (periods + half) * board.period())
}

/// Part of a period to which a delay counts as a whole number of halves.
const WHOLE: f64 = 1e-9;

impl DelayBudget {
    pub(crate) fn new(board: &Board) -> Self {
        let lag = |hz: Option<f64>| hz.map_or(0.0, |hz| 1.0 / (core::f64::consts::TAU * hz));
        let amplifier = lag(board.actuator_bandwidth);
        let sensor = board.sensor.delay();
        Self {
            latch: board.latch_delay,
            hold: 0.5 * board.period(),
            amplifier,
            sensor,
            whole: board.whole_delay() + amplifier + sensor,
            in_hold: in_hold(board),
            middle: middles(board)[0],
        }
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;
    use std::path::Path;

    use nalgebra::Complex;

    use super::*;
    use crate::control::gains::ModalTransform;
    use crate::design::Study;
    use crate::machine::Machine;

    /// The frame's vertical acceleration with all samples at zero, from the response of the sampled
    /// plant, is that of the formula.
    #[test]
    fn the_mean_with_samples_at_zero() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
        let paper = Machine::load(&folder.join("metrology-frame.toml")).unwrap();
        for (latch, place) in [
            (0.0, 1.0),
            (12.5e-6, 0.75),
            (25e-6, 0.5),
            (40e-6, 0.2),
            (50e-6, 1.0),
            (75e-6, 0.5),
        ] {
            let mut machine = paper.clone();
            machine.board.latch_delay = latch;
            let board = machine.board.clone();
            assert!((in_hold(&board) - place).abs() < 1e-9, "{latch}");
            let [above, below] = middles(&board);
            assert!(above >= latch && latch > below, "{latch}");
            for delay in [above, below] {
                let periods = delay / board.period();
                assert!((periods.fract().abs() - 0.5).abs() < 1e-9, "{delay}");
            }

            let study = Study::new(machine).unwrap();
            let sampled = study.plant();
            let plant = &sampled.plant;
            let transform = ModalTransform::new(study.design_model());
            let output = transform.output.map(Complex::from);
            // The third mode is vertical and couples to no other one.
            let vertical = |gain: crate::plant::Gain| (gain * output)[(0, 2)];
            let row = plant.frame().start + 2;
            let hz = 20.0;
            let response = sampled.response(hz);
            let to_modes = transform.input.row(2).map(Complex::from);
            let floor = plant.base.column(2).map(Complex::from);
            let sensed = (to_modes * response.from_floor(plant.sensors()) * floor)[0];
            let own = (to_modes * response.g22() * output)[2];
            let force = sensed / own;
            let left = (response.from_floor(row..row + 1) * floor)[0]
                - vertical(response.from_legs(row..row + 1)) * force;
            // What the forces change at once.
            let step = (plant.state_space.d.row(row).columns(6, 6) * transform.output)[2];
            let velocity = Complex::new(0.0, TAU * hz) * step * force;
            let expected = velocity * (0.5 - place) * board.period();
            let scale = velocity.norm() * board.period();
            // The next order in ω·T.
            let next = 2.0 * TAU * hz * board.period() * scale;
            assert!(
                (left - expected).norm() < next,
                "{latch}: {left} {expected}"
            );
        }
    }
}
