//! The machine under loads that change over time, such as the reaction forces of a stage.

use shared::LEGS;
use shared::step::{Demand, State, step};
use shared::table::ValidTable;

use super::rig::Rig;
use crate::machine::{Board, NoiseDensity, Simulation};
use crate::plant::SampledPlant;

/// What a load does.
#[derive(Clone, Debug)]
pub struct Pushed {
    /// Mean of each displacement of the loaded plant in each sample period, m or rad.
    pub displacements: Vec<Vec<f64>>,
    /// Largest magnitude of the force commanded to any leg, N.
    pub force_peak: f64,
    /// Number of steps in which the clamp was active.
    pub clamped_steps: usize,
}

/// Moves the plant of [`Study::loaded_plant`](crate::design::Study::loaded_plant) from rest by
/// `loads`, N or N m, one for each sample: with the loop closed under `table` if `closed`.
///
/// Sensors and converters have no noise here and the floor is at rest; codes are rounded as on the
/// board.
pub fn push(
    plant: &SampledPlant,
    board: &Board,
    table: &ValidTable,
    loads: Vec<[f64; LEGS]>,
    closed: bool,
) -> Pushed {
    let mut quiet = board.clone();
    quiet.adc_noise = 0.0;
    quiet.dac_noise = 0.0;
    quiet.sensor.noise_density = NoiseDensity::white(0.0);
    if let Some(sensor) = &mut quiet.beside {
        sensor.noise_density = NoiseDensity::white(0.0);
    }
    let steps = loads.len();
    let mut rig = Rig::new(plant.clone(), &quiet, &Simulation::default()).driven(loads);
    let count = rig.plant().plant.performance().len();
    let mut pushed = Pushed {
        displacements: vec![Vec::with_capacity(steps); count],
        force_peak: 0.0,
        clamped_steps: 0,
    };
    let mut state = None;
    for _ in 0..steps {
        let adc = rig.sample();
        let mut dac = table.safe_codes();
        if closed {
            let state = state.get_or_insert_with(|| State::settled_on(table, adc));
            let output = step(table, state, adc, Demand::LAW);
            dac = output.dac;
            pushed.clamped_steps += usize::from(output.status.clamped);
        }
        for (all, x) in pushed.displacements.iter_mut().zip(rig.advance(dac).iter()) {
            all.push(*x);
        }
        for (code, gain) in dac.into_iter().zip(board.gains.actuators) {
            let force = board.dac.force(code, board.actuator_gain * gain);
            pushed.force_peak = pushed.force_peak.max(force.abs());
        }
    }
    pushed
}
