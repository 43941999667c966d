//! The open and the closed loop in time, on the step that the firmware runs.

use nalgebra::DVectorView;
use serde::Serialize;
use shared::LEGS;
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
    rig: Rig,
    board: &Board,
    settings: &Simulation,
    table: &ValidTable,
    closed: bool,
    progress: &dyn Progress,
) -> Run {
    let mut running = Running::new(rig, board, table, closed, Lengths::of(settings, board));
    for k in 0..running.all() {
        if k % REPORTED == 0 {
            progress.advance();
        }
        running.step();
    }
    running.end()
}

/// Steps of a simulation.
#[derive(Clone, Copy)]
pub(super) struct Lengths {
    /// Until the loop counts as settled.
    pub(super) settling: usize,
    /// After that, which are evaluated.
    pub(super) evaluated: usize,
}

impl Lengths {
    fn of(settings: &Simulation, board: &Board) -> Self {
        Self {
            settling: steps(settings.settling, board),
            evaluated: steps(settings.duration, board),
        }
    }
}

/// A simulation between two steps.
pub(super) struct Running<'a> {
    rig: Rig,
    board: &'a Board,
    table: &'a ValidTable,
    closed: bool,
    /// None until the first sample.
    state: Option<State>,
    /// Steps left until the loop counts as settled.
    settling: usize,
    /// Sums of squares in place of the rms.
    run: Run,
}

impl<'a> Running<'a> {
    pub(super) fn new(
        rig: Rig,
        board: &'a Board,
        table: &'a ValidTable,
        closed: bool,
        lengths: Lengths,
    ) -> Self {
        let count = rig.plant().plant.performance().len();
        Self {
            rig,
            board,
            table,
            closed,
            state: None,
            settling: lengths.settling,
            run: Run {
                rms: vec![0.0; count],
                peak: vec![0.0; count],
                force_peak: 0.0,
                clamped_steps: 0,
                railed_steps: 0,
                steps: lengths.evaluated,
            },
        }
    }

    /// The number of all steps, before the first one.
    fn all(&self) -> usize {
        self.settling + self.run.steps
    }

    /// One step: the performance outputs, m/s², and the forces commanded, N.
    pub(super) fn step(&mut self) -> (DVectorView<'_, f64>, [f64; LEGS]) {
        let Self {
            table, board, run, ..
        } = self;
        let settled = self.settling == 0;
        self.settling = self.settling.saturating_sub(1);
        let adc = self.rig.sample();
        let mut dac = table.safe_codes();
        if self.closed {
            let state = self
                .state
                .get_or_insert_with(|| State::settled_on(table, adc));
            let output = step(table, state, adc, Demand::LAW);
            dac = output.dac;
            if settled {
                run.clamped_steps += usize::from(output.status.clamped);
                run.railed_steps += usize::from(output.status.at_rail());
            }
        }
        let performance = self.rig.advance(dac);
        let forces = board.forces(dac);
        if settled {
            for (i, x) in performance.iter().enumerate() {
                run.rms[i] += x * x;
                run.peak[i] = run.peak[i].max(x.abs());
            }
            for force in forces {
                run.force_peak = run.force_peak.max(force.abs());
            }
        }
        (performance, forces)
    }

    /// The results after the last step.
    pub(super) fn end(self) -> Run {
        let mut run = self.run;
        for rms in &mut run.rms {
            *rms = (*rms / run.steps as f64).sqrt();
        }
        run
    }
}

/// One sample of the open and the closed loop on the same floor.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// Time after settling, s.
    pub time: f64,
    /// Performance outputs without control, m/s²: the mean of each over the period.
    pub open: DVectorView<'a, f64>,
    /// The same with the loop closed.
    pub closed: DVectorView<'a, f64>,
    /// Forces commanded to the legs with the loop closed, N.
    pub forces: [f64; LEGS],
}

/// Gives each evaluated sample of the runs of [`compare`] to `each`, until that fails.
///
/// # Errors
/// What `each` gives.
pub fn histories<E>(
    plant: &SampledPlant,
    board: &Board,
    settings: &Simulation,
    table: &ValidTable,
    record: Option<&Record>,
    mut each: impl FnMut(Moment<'_>) -> Result<(), E>,
) -> Result<(), E> {
    let running = |closed| {
        let rig = on_floor(plant, board, settings, record);
        Running::new(rig, board, table, closed, Lengths::of(settings, board))
    };
    let [mut open, mut closed] = [running(false), running(true)];
    for _ in 0..open.settling {
        open.step();
        closed.step();
    }
    for k in 0..open.run.steps {
        let (open, _) = open.step();
        let (closed, forces) = closed.step();
        each(Moment {
            time: k as f64 * plant.period,
            open,
            closed,
            forces,
        })?;
    }
    Ok(())
}

/// The machine at rest on the floor of `settings` or on a record.
fn on_floor(
    plant: &SampledPlant,
    board: &Board,
    settings: &Simulation,
    record: Option<&Record>,
) -> Rig {
    let rig = Rig::new(plant.clone(), board, settings);
    match record {
        Some(record) => rig.on(record),
        None => rig,
    }
}

/// The number of evaluated steps of a simulation.
pub fn evaluated(settings: &Simulation, board: &Board) -> usize {
    steps(settings.duration, board)
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
        let record = record.as_ref().map(|(record, _)| *record);
        let rig = on_floor(plant, board, settings, record);
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
