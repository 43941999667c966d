//! Noise of the board: sensors and converters.

use nalgebra::DVector;
use shared::LEGS;

use crate::machine::Board;

/// The power densities of the board's noise, white up to half the sample rate.
pub(crate) struct Noise {
    /// Of each sensor's own noise, (m/s²)²/Hz or N²/Hz.
    pub(crate) sensors: DVector<f64>,
    /// Of the ADC referred to each sensor, (m/s²)²/Hz or N²/Hz.
    pub(crate) adc: DVector<f64>,
    /// Of the DAC, N²/Hz.
    pub(crate) dac: f64,
}

impl Noise {
    /// `moving`: whether the outputs change from sample to sample. The rounding of a constant
    /// output is constant.
    pub(crate) fn new(board: &Board, moving: bool) -> Self {
        let nyquist = 0.5 * board.sample_rate;
        let rounding = |lsb: f64| lsb * lsb / 12.0;
        let adc = (board.adc_noise.powi(2) + rounding(board.adc.lsb())) / nyquist;
        let (sensors, adc): (Vec<_>, Vec<_>) = board
            .fed_back()
            .flat_map(|sensor| {
                let powers = (
                    sensor.noise_density.powi(2),
                    adc / sensor.sensitivity.powi(2),
                );
                [powers; LEGS]
            })
            .unzip();
        let rounded = if moving {
            rounding(board.dac.lsb())
        } else {
            0.0
        };
        Self {
            sensors: DVector::from_vec(sensors),
            adc: DVector::from_vec(adc),
            dac: (board.dac_noise.powi(2) + rounded) / nyquist * board.actuator_gain.powi(2),
        }
    }
}
