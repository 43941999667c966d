//! A session in time: at rest, tested, started gently, closed; beside it the same
//! floor with the legs at rest.

use serde::Serialize;
use shared::LEGS;
use shared::controller::{Controller, Reading};
use shared::supervisor::{Event, Mode};
use shared::table::ValidTable;

use super::rig::Rig;
use crate::design::Study;

/// Before the self-test, between it and the start, and after that, s.
const REST: f64 = 1.0;
const CLOSED: f64 = 4.0;

/// A session that is not closed by then is over, s.
const LONGEST: f64 = 60.0;

/// An envelope's points are so far apart, s.
const ENVELOPE: f64 = 0.05;

/// The end of the session is also kept as it is: so long, s, at so many points a
/// second.
const CLOSE_UP: f64 = 0.5;
const CLOSE_UP_RATE: f64 = 4000.0;

/// What was seen of a session.
#[derive(Clone, Debug, Serialize)]
pub struct History {
    /// Mode by mode, in the order in which they came.
    pub phases: Vec<Phase>,
    /// The performance outputs' rms taken together, and the legs' largest forces.
    pub envelope: Envelope,
    /// The last half second.
    pub close_up: CloseUp,
}

/// A mode and when it began.
#[derive(Clone, Debug, Serialize)]
pub struct Phase {
    /// s.
    pub from: f64,
    /// In words.
    pub mode: &'static str,
}

/// Over the whole session, one point every 50 ms.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Envelope {
    /// The end of each piece, s.
    pub time: Vec<f64>,
    /// √Σ of the performance outputs' mean squares, m/s², the legs at rest.
    pub open: Vec<f64>,
    /// The same under the controller.
    pub closed: Vec<f64>,
    /// Largest magnitude, N, by leg.
    pub force: [Vec<f64>; LEGS],
}

/// The end of the session.
#[derive(Clone, Debug, Default, Serialize)]
pub struct CloseUp {
    /// Of the session, s.
    pub time: Vec<f64>,
    /// Each performance output, m/s², the legs at rest.
    pub open: Vec<Vec<f64>>,
    /// The same with the loop closed.
    pub closed: Vec<Vec<f64>>,
}

/// One machine's way through time.
struct Track {
    rig: Rig,
    /// Of the piece under way: sum of squares of each output, and its sum.
    square: f64,
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
        Mode::Untested => "legs at rest",
        Mode::Testing => "self-test",
        Mode::Idle => "tested",
        Mode::Starting => "soft start",
        Mode::Closed => "loop closed",
        Mode::Stopping => "soft stop",
        Mode::Failing => "fault: to the safe codes",
        Mode::Failed => "fault: at the safe codes",
    }
}

/// Runs a session on the floor of the machine's `simulation`.
pub fn history(study: &Study, table: &ValidTable) -> History {
    let board = study.machine().board;
    let samples = |seconds: f64| ((seconds * board.sample_rate).round() as u64).max(1);
    let mut controller = Controller::new(*table, table.checksum(), &mut []);
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
        for (force, code) in force.iter_mut().zip(dac) {
            *force = force.max(board.dac.force(code, board.actuator_gain).abs());
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
        // A request that the mode does not have changes nothing.
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
