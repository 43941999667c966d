//! What moves the performance outputs of a machine: the floor, and the noise of sensors and
//! converters, as its mean square counts them.

use core::f64::consts::TAU;
use core::ops::Range;

use nalgebra::{Complex, DVector, Matrix6};
use shared::LEGS;

use super::Study;
use crate::floor::Floor;
use crate::machine::Penalty;
use crate::numeric::exposure::Measure;
use crate::numeric::power_law::steeper;
use crate::numeric::six::ComplexMatrix6;
use crate::plant::noise::Noise;
use crate::plant::{Gain, SampledPlant};

/// Six independent sources of motion.
pub(super) struct Source {
    /// To the performance outputs without control.
    pub(super) direct: Gain,
    /// To the sensors without control, six rows for each kind.
    pub(super) sensed: Gain,
}

/// The sources of a machine, and what is measured of the outputs' motion.
pub(super) struct Sources<'a> {
    plant: &'a SampledPlant,
    floor: Floor,
    noise: Noise,
    measure: Measure,
    penalty: Penalty,
    /// Lower and upper end of the band, Hz.
    pub(super) band: [f64; 2],
}

impl<'a> Sources<'a> {
    /// Those of `study` with `measure`, on the floor of its machine in `simulation.floor_band`.
    pub(super) fn new(study: &'a Study, measure: Measure) -> Self {
        let machine = study.machine();
        Self {
            plant: study.plant(),
            floor: machine.floor_motion(),
            noise: Noise::new(&machine.board, true),
            measure,
            penalty: machine.target.penalty.unwrap_or_default(),
            band: machine.simulation.floor_band,
        }
    }

    /// The ends of the band, and the frequencies in it at which a density is not smooth or between
    /// which the weight may be integrated, Hz, ascending.
    pub(super) fn breaks(&self) -> Vec<f64> {
        let [low, high] = self.band;
        let mut breaks = vec![low, high];
        let given = self.floor.breaks().into_iter().chain(self.noise.breaks());
        breaks.extend(given.filter(|hz| low < *hz && *hz < high));
        breaks.extend(self.measure.breaks(self.band));
        breaks.sort_by(f64::total_cmp);
        breaks.dedup();
        breaks
    }

    /// How steep the densities are at `hz`, Hz, for a quadrature.
    pub(super) fn exponent(&self, hz: f64) -> f64 {
        steeper(self.floor.exponent(hz), self.noise.exponent(hz))
    }

    /// The weight of an acceleration's power density at `hz`, Hz, in the mean square.
    pub(super) fn weight(&self, hz: f64) -> f64 {
        self.measure.weight(hz)
    }

    /// The outputs from the leg forces at `hz`, Hz, and the sources there, with one-sided densities:
    /// the floor, the DAC, and each kind of sensors with its ADC. The outputs are those of
    /// performance, then the legs' forces and elongations times their penalties, if they have any.
    pub(super) fn at(&self, hz: f64) -> (Gain, Vec<Source>) {
        let plant = &self.plant.plant;
        let response = self.plant.response(hz);
        let Penalty { force, stroke } = self.penalty;
        // From the second time derivatives of the elongations.
        let stroke = -stroke * (TAU * hz).powi(-2);
        // Rows of performance, and those that cost, in one kind of inputs.
        let with_costs = |forces: Gain, of: &dyn Fn(Range<usize>) -> Gain| {
            let mut all = of(plant.performance());
            if force != 0.0 {
                all = below(all, &(forces * Complex::from(force)));
            }
            if stroke != 0.0 {
                all = below(all, &(of(plant.legs()) * Complex::from(stroke)));
            }
            all
        };
        let from_legs = with_costs(Gain::identity(LEGS), &|rows| response.from_legs(rows));
        let motions = self.floor.motions(hz, plant.waves).map(Complex::from);
        let base = plant.base_at(hz).map(Complex::from) * Matrix6::from_diagonal(&motions);
        let by_dac = ComplexMatrix6::identity() * Complex::from(self.noise.dac.sqrt());
        let mut sources = vec![
            Source {
                direct: with_costs(Gain::zeros(LEGS), &|rows| response.from_floor(rows)) * base,
                sensed: response.from_floor(plant.sensors()) * base,
            },
            Source {
                direct: &from_legs * by_dac,
                sensed: response.g22() * by_dac,
            },
        ];
        let powers: DVector<f64> = self.noise.sensors(hz) + &self.noise.adc;
        for first in (0..powers.len()).step_by(LEGS) {
            let mut sensed = Gain::zeros(powers.len());
            for sensor in 0..LEGS {
                sensed[(first + sensor, sensor)] = powers[first + sensor].sqrt().into();
            }
            sources.push(Source {
                direct: Gain::zeros(from_legs.nrows()),
                sensed,
            });
        }
        (from_legs, sources)
    }
}

/// The rows of `above`, then those of `more`.
fn below(above: Gain, more: &Gain) -> Gain {
    let first = above.nrows();
    let mut all = above.resize_vertically(first + more.nrows(), Complex::ZERO);
    all.rows_mut(first, more.nrows()).copy_from(more);
    all
}
