//! The open and the closed loop in time, on the step that the firmware runs.

use serde::Serialize;
use shared::step::{Demand, State, step};
use shared::table::ValidTable;

use super::rig::Rig;
use crate::floor::Record;
use crate::machine::{Board, Simulation};
use crate::plant::SampledPlant;
use crate::progress::Progress;

/// The results of one simulation.
#[derive(Clone, Debug, Serialize)]
pub struct Run {
    /// Rms of each performance output, m/s².
    pub rms: Vec<f64>,
    /// Largest magnitude of each performance output, m/s².
    pub peak: Vec<f64>,
    /// Largest magnitude of the force commanded to any leg, N.
    pub force_peak: f64,
    /// Number of steps in which the clamp was active.
    pub clamped_steps: usize,
    /// Number of steps in which a sensor was at an end of the ADC's range.
    pub railed_steps: usize,
    /// Number of steps that were evaluated; settling is left out.
    pub steps: usize,
}

/// Simulates the settling time and the duration of `settings`: with the loop closed under
/// `table` if `closed`, else with the safe codes of `table` at the outputs.
pub fn run(
    plant: &SampledPlant,
    board: &Board,
    settings: &Simulation,
    table: &ValidTable,
    closed: bool,
) -> Run {
    let rig = Rig::new(plant.clone(), board, settings);
    watched(rig, board, settings, table, closed, &())
}

/// A long simulation reports after so many steps that it advances.
const REPORTED: usize = 10_000;

/// How often [`compare`] reports that it advances.
pub fn reports(settings: &Simulation, board: &Board) -> usize {
    let all = steps(settings.settling, board) + steps(settings.duration, board);
    2 * all.div_ceil(REPORTED)
}

fn watched(
    mut rig: Rig,
    board: &Board,
    settings: &Simulation,
    table: &ValidTable,
    closed: bool,
    progress: &dyn Progress,
) -> Run {
    let count = rig.plant().plant.performance().len();
    let mut run = Run {
        rms: vec![0.0; count],
        peak: vec![0.0; count],
        force_peak: 0.0,
        clamped_steps: 0,
        railed_steps: 0,
        steps: steps(settings.duration, board),
    };
    let settling = steps(settings.settling, board);
    let safe = table.safe_codes();
    let mut state = None;
    for k in 0..settling + run.steps {
        if k % REPORTED == 0 {
            progress.advance();
        }
        let adc = rig.sample();
        let mut dac = safe;
        if closed {
            let state = state.get_or_insert_with(|| State::settled_on(table, adc));
            let output = step(table, state, adc, Demand::LAW);
            dac = output.dac;
            if k >= settling {
                run.clamped_steps += usize::from(output.status.clamped);
                run.railed_steps += usize::from(output.status.at_rail());
            }
        }
        let performance = rig.advance(dac);
        if k >= settling {
            for (i, x) in performance.iter().enumerate() {
                run.rms[i] += x * x;
                run.peak[i] = run.peak[i].max(x.abs());
            }
            for (code, gain) in dac.into_iter().zip(board.gains.actuators) {
                let force = board.dac.force(code, board.actuator_gain * gain);
                run.force_peak = run.force_peak.max(force.abs());
            }
        }
    }
    for rms in &mut run.rms {
        *rms = (*rms / run.steps as f64).sqrt();
    }
    run
}

fn steps(seconds: f64, board: &Board) -> usize {
    // At least one, so that an rms is defined.
    ((seconds * board.sample_rate).round() as usize).max(1)
}

/// The same floor with and without control.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Names of the performance outputs.
    pub outputs: Vec<String>,
    /// Evaluated time, s.
    pub duration_s: f64,
    /// The floor's name, if it was recorded: then it has neither the rms nor the band below.
    pub record: Option<String>,
    /// Rms acceleration of the base along each of x, y and z, m/s².
    pub floor_rms: f64,
    /// Lower and upper end of the floor's band, Hz.
    pub floor_band_hz: [f64; 2],
    /// Seed of the random numbers.
    pub seed: u64,
    /// Results without control.
    pub open: Run,
    /// Results with the loop closed.
    pub closed: Run,
}

/// Simulates the open and the closed loop on the same floor: that of `settings`, or a `record`
/// with its name. `outputs` are the names of the performance outputs; `progress` is told as often as [`reports`] says.
pub fn compare(
    plant: &SampledPlant,
    board: &Board,
    settings: &Simulation,
    table: &ValidTable,
    outputs: Vec<String>,
    record: Option<(&Record, String)>,
    progress: &dyn Progress,
) -> Comparison {
    let one = |closed| {
        let rig = Rig::new(plant.clone(), board, settings);
        let rig = match &record {
            Some((record, _)) => rig.on(record),
            None => rig,
        };
        watched(rig, board, settings, table, closed, progress)
    };
    let (open, closed) = rayon::join(|| one(false), || one(true));
    Comparison {
        outputs,
        duration_s: settings.duration,
        record: record.map(|(_, name)| name),
        floor_rms: settings.floor_rms,
        floor_band_hz: settings.floor_band,
        seed: settings.seed,
        open,
        closed,
    }
}
