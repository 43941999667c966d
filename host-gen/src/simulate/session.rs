//! A whole session in time: rest, self-test, soft start, loop closed. The same floor is
//! also simulated with control off.

use serde::Serialize;
use shared::LEGS;
use shared::controller::{Controller, Memory, Reading};
use shared::supervisor::{Event, Mode};
use shared::table::ValidTable;

use super::rig::Rig;
use crate::design::Study;

/// Wait before the self-test, and between it and the start, s.
const REST: f64 = 1.0;
/// Time with the loop closed, s.
const CLOSED: f64 = 4.0;

/// Maximum length of a session, s.
const LONGEST: f64 = 60.0;

/// Distance between the points of the envelope, s.
const ENVELOPE: f64 = 0.05;

/// Length of the close-up at the end of the session, s.
const CLOSE_UP: f64 = 0.5;
/// Points of the close-up per second.
const CLOSE_UP_RATE: f64 = 4000.0;

/// The signals of a session.
#[derive(Clone, Debug, Serialize)]
pub struct History {
    /// The supervisor's modes, in the order in which they occurred.
    pub phases: Vec<Phase>,
    /// Rms of all performance outputs together, and the largest forces of the legs.
    pub envelope: Envelope,
    /// The last half second in detail.
    pub close_up: CloseUp,
}

/// A mode of the supervisor and its start.
#[derive(Clone, Debug, Serialize)]
pub struct Phase {
    /// Time from the start of the session to the start of the mode, s.
    pub from: f64,
    /// Name of the mode.
    pub mode: &'static str,
}

/// Signals of the whole session, one point for each piece of 50 ms.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Envelope {
    /// Time at the end of each piece, from the start of the session, s.
    pub time: Vec<f64>,
    /// Root of the sum of the performance outputs' mean squares in each piece with
    /// control off, m/s².
    pub open: Vec<f64>,
    /// Root of the sum of the performance outputs' mean squares in each piece with the
    /// controller running, m/s².
    pub closed: Vec<f64>,
    /// By leg: largest magnitude of the force in each piece, N.
    pub force: [Vec<f64>; LEGS],
}

/// Signals at the end of the session.
#[derive(Clone, Debug, Default, Serialize)]
pub struct CloseUp {
    /// Time from the start of the session, s.
    pub time: Vec<f64>,
    /// By performance output: acceleration with control off, m/s².
    pub open: Vec<Vec<f64>>,
    /// By performance output: acceleration with the loop closed, m/s².
    pub closed: Vec<Vec<f64>>,
}

/// One of the two simulations, with control off or on.
struct Track {
    rig: Rig,
    /// Sum of the squares of all outputs over the current piece.
    square: f64,
    /// Sum of each output since the last point of the close-up.
    mean: Vec<f64>,
}

impl Track {
    fn new(study: &Study) -> Self {
        let machine = study.machine();
        let rig = Rig::new(study.plant().clone(), &machine.board, &machine.simulation);
        let mean = vec![0.0; study.plant().plant.performance().len()];
        Self {
            rig,
            square: 0.0,
            mean,
        }
    }

    fn advance(&mut self, dac: [shared::codes::DacCode; LEGS]) {
        let performance = self.rig.advance(dac);
        self.square += performance.norm_squared();
        for (mean, x) in self.mean.iter_mut().zip(performance.iter()) {
            *mean += x;
        }
    }

    fn take_rms(&mut self, count: usize) -> f64 {
        (core::mem::take(&mut self.square) / count as f64).sqrt()
    }

    fn take_means(&mut self, count: usize) -> Vec<f64> {
        let means = self.mean.iter_mut();
        means.map(|x| core::mem::take(x) / count as f64).collect()
    }
}

fn name(mode: Mode) -> &'static str {
    match mode {
        Mode::Untested => "not tested",
        Mode::Testing => "self-test",
        Mode::Idle => "idle",
        Mode::Starting => "soft start",
        Mode::Closed => "loop closed",
        Mode::Stopping => "soft stop",
        Mode::Failing => "fault: ramp to the safe codes",
        Mode::Failed => "fault: at the safe codes",
    }
}

/// Simulates a session with `table`, on the floor of the machine's simulation settings.
pub fn history(study: &Study, table: &ValidTable) -> History {
    let board = &study.machine().board;
    let samples = |seconds: f64| ((seconds * board.sample_rate).round() as u64).max(1);
    let mut controller = Controller::new(*table, table.checksum(), Memory::none());
    let safe = table.safe_codes();
    let [mut open, mut closed] = [Track::new(study), Track::new(study)];
    let mut phases = vec![Phase {
        from: 0.0,
        mode: name(Mode::Untested),
    }];
    let mut envelope = Envelope::default();
    let mut force = [0.0_f64; LEGS];
    // The close-up's points, of which the last are kept.
    let mut points = Vec::new();
    let (piece, point) = (samples(ENVELOPE), samples(1.0 / CLOSE_UP_RATE));
    let (mut mode, mut since) = (Mode::Untested, 0);
    for k in 1..=samples(LONGEST) {
        let reading = Reading::from(closed.rig.sample());
        let dac = controller.on_sample(reading);
        closed.advance(dac);
        open.rig.sample();
        open.advance(safe);
        for (force, now) in force.iter_mut().zip(board.forces(dac)) {
            *force = force.max(now.abs());
        }
        let time = k as f64 / board.sample_rate;
        if k.is_multiple_of(point) {
            let [open, closed] = [&mut open, &mut closed].map(|t| t.take_means(point as usize));
            points.push((time, open, closed));
        }
        if k.is_multiple_of(piece) {
            let count = piece as usize;
            envelope.time.push(time);
            envelope.open.push(open.take_rms(count));
            envelope.closed.push(closed.take_rms(count));
            for (all, force) in envelope.force.iter_mut().zip(&mut force) {
                all.push(core::mem::take(force));
            }
        }
        // A request that the mode does not allow changes nothing.
        let waited = k - since >= samples(REST);
        let event = match mode {
            Mode::Untested if waited => Some(Event::SelfTest),
            Mode::Idle if waited => Some(Event::Start),
            _ => None,
        };
        if let Some(event) = event {
            controller.ask(event).unwrap_or_default();
        }
        let now = controller.report().mode;
        if now != mode {
            (mode, since) = (now, k);
            phases.push(Phase {
                from: time,
                mode: name(now),
            });
        }
        let over = match mode {
            Mode::Closed => k - since >= samples(CLOSED),
            Mode::Failed => waited,
            _ => false,
        };
        if over {
            break;
        }
    }
    let from = points
        .len()
        .saturating_sub((CLOSE_UP * CLOSE_UP_RATE) as usize);
    let mut close_up = CloseUp::default();
    for (time, open, closed) in points.drain(from..) {
        close_up.time.push(time);
        close_up.open.resize(open.len(), Vec::new());
        close_up.closed.resize(closed.len(), Vec::new());
        for (all, x) in close_up.open.iter_mut().zip(open) {
            all.push(x);
        }
        for (all, x) in close_up.closed.iter_mut().zip(closed) {
            all.push(x);
        }
    }
    History {
        phases,
        envelope,
        close_up,
    }
}
