//! Noise of the board: sensors and converters.

use nalgebra::DVector;
use shared::LEGS;

use crate::machine::{Board, Sensor};
use crate::numeric::power_law::steeper;

/// The power densities of the board's noise up to half the sample rate; those of the converters
/// are white.
pub(crate) struct Noise {
    /// The kinds of sensors that are fed back.
    kinds: Vec<Sensor>,
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
        let adc = board
            .fed_back()
            .flat_map(|sensor| [adc / sensor.sensitivity.powi(2); LEGS])
            .collect();
        let rounded = if moving {
            rounding(board.dac.lsb())
        } else {
            0.0
        };
        Self {
            kinds: board.fed_back().cloned().collect(),
            adc: DVector::from_vec(adc),
            dac: (board.dac_noise.powi(2) + rounded) / nyquist * board.actuator_gain.powi(2),
        }
    }

    /// The power density of each sensor's own noise at `hz`, Hz, in (m/s²)²/Hz or N²/Hz.
    pub(crate) fn sensors(&self, hz: f64) -> DVector<f64> {
        let of_kind = |sensor: &Sensor| [sensor.noise_density.at(hz).powi(2); LEGS];
        DVector::from_vec(self.kinds.iter().flat_map(of_kind).collect())
    }

    /// The frequencies at which a density is not smooth, Hz.
    pub(crate) fn breaks(&self) -> impl Iterator<Item = f64> {
        let of_kind = |sensor: &'_ Sensor| sensor.noise_density.breaks().collect::<Vec<_>>();
        self.kinds.iter().flat_map(of_kind)
    }

    /// d ln density²/d ln hz at `hz`, Hz, of the sensor where it is steepest.
    pub(crate) fn exponent(&self, hz: f64) -> f64 {
        let slopes = self.kinds.iter();
        let slopes = slopes.map(|sensor| 2.0 * sensor.noise_density.slope(hz));
        slopes.fold(0.0, steeper)
    }
}
