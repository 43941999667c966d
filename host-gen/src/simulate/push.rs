//! The machine under loads that change over time, such as the reaction forces of a stage.

use shared::LEGS;
use shared::table::ValidTable;

use super::rig::Rig;
use super::run::{Lengths, Running};
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
    let lengths = Lengths {
        settling: 0,
        evaluated: loads.len(),
    };
    let rig = Rig::new(plant.clone(), &quiet, &Simulation::default()).driven(loads);
    let mut running = Running::new(rig, board, table, closed, lengths);
    let mut displacements =
        vec![Vec::with_capacity(lengths.evaluated); plant.plant.performance().len()];
    for _ in 0..lengths.evaluated {
        let (moved, _) = running.step();
        for (all, x) in displacements.iter_mut().zip(moved.iter()) {
            all.push(*x);
        }
    }
    let run = running.end();
    Pushed {
        displacements,
        force_peak: run.force_peak,
        clamped_steps: run.clamped_steps,
    }
}
