//! The delay of the loop and its parts.

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
}

impl DelayBudget {
    pub(crate) fn new(board: &Board) -> Self {
        let lag = |hz: Option<f64>| hz.map_or(0.0, |hz| 1.0 / (core::f64::consts::TAU * hz));
        let [amplifier, sensor] = [board.actuator_bandwidth, board.sensor.bandwidth].map(lag);
        Self {
            latch: board.latch_delay,
            hold: 0.5 * board.period(),
            amplifier,
            sensor,
            whole: board.whole_delay() + amplifier + sensor,
        }
    }
}
