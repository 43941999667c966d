//! The whole controller of a board: table, step, supervisor, injection, recorder.
//! One call a sample, and requests in between.

use heapless::{Deque, HistoryBuf};
use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::{DacCode, LegForces, Samples};
use crate::injection::{Injection, Injector};
use crate::recorder::{Record, Recorded, Recorder, Recording};
use crate::self_test::{Probe, Verdict};
use crate::step::{Demand, Output, State, Status, rest, step};
use crate::supervisor::{Cause, Event, Fault, GENTLE, Mode, QUIET};
use crate::table::{ModelDigest, TableError, ValidTable};
use crate::watch::Watch;

/// What a board has of one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// The codes; none if the converters' bus failed.
    pub samples: Option<Samples>,
    /// Whether the outputs of the sample before were latched late.
    pub late: bool,
}

impl From<Samples> for Reading {
    /// All is well.
    fn from(samples: Samples) -> Self {
        Self {
            samples: Some(samples),
            late: false,
        }
    }
}

/// How things stand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Samples since power came.
    pub at: u64,
    /// Mode.
    pub mode: Mode,
    /// The part of the law's force that is given.
    pub gain: f32,
    /// The part that is aimed at.
    pub target: f32,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// Samples of the injection still to come.
    pub injecting: u32,
    /// The first sample of the last injection, since power came.
    pub injected: u64,
    /// The recording.
    pub recorded: Recorded,
    /// Samples clamped while the loop had a part, since power came.
    pub clamped: u32,
    /// Deadlines missed since power came.
    pub late: u32,
    /// Samples not read since power came.
    pub lost: u32,
    /// Telemetry that found no room since power came.
    pub dropped: u32,
}

/// What a table is known by.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// The table's layout.
    pub format: u16,
    /// The machine description it was made from.
    pub model: ModelDigest,
    /// Its checksum.
    pub checksum: u32,
    /// Hz.
    pub sample_rate: f32,
    /// Records that the recorder has room for.
    pub room: u32,
    /// Whether the table came over the link; else it is the one compiled in.
    pub sent: bool,
}

/// How the board's processor does. Times in ns, since power came; 0 on a board without
/// a clock for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Health {
    /// Why the board last started.
    pub restart: Restart,
    /// From one sample to the next.
    pub period: u32,
    /// From the interrupt of a sample until its codes were written, at the most.
    pub longest: u32,
    /// The same on average.
    pub usual: u32,
    /// From the earliest to the latest interrupt, against the timer.
    pub jitter: u32,
    /// Stack that was never used, bytes.
    pub stack: u32,
}

/// Why a board started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Restart {
    /// Power came, or nobody knows.
    #[default]
    Power,
    /// The reset button, or a debugger.
    Pin,
    /// The watchdog: loop or link did not check in.
    Watchdog,
    /// The firmware panicked.
    Panic,
    /// The processor met what it cannot do.
    HardFault,
}

/// One sample out of many, live.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Telemetry {
    /// Its number since power came.
    pub at: u64,
    /// Mode.
    pub mode: Mode,
    /// Gain.
    pub gain: f32,
    /// The sample.
    pub record: Record,
    /// What the step saw.
    pub status: Status,
}

/// Why a request changes nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// Not in this mode.
    Mode,
    /// A number is outside its limits.
    Range,
    /// A frame that is none: its length, its checksum or what is in it.
    Frame,
    /// A frame of another version of the link.
    Version,
    /// A frame of another session.
    Session,
    /// A frame that is no newer than one before it.
    Replayed,
    /// A table that does not run here.
    Table(TableError),
    /// The table could not be kept; the one before runs on.
    Memory,
}

/// Samples kept from before a fault.
pub const SNAPSHOT: usize = 64;

/// A leg that pushes with more than this part of its limit turns a soft start
/// back.
const HARD: f32 = 0.5;

/// So many pilots that fail, with none that passes between, are a fault: what a
/// shock did to one it does not do to the next.
const STRIKES: u32 = 2;

/// Telemetry that waits to be sent.
const WAITING: usize = 8;

/// A controller with memory for its recorder.
#[derive(Debug)]
pub struct Controller<'a> {
    table: ValidTable,
    checksum: u32,
    sent: bool,
    at: u64,
    mode: Mode,
    /// None until the first sample has settled the AC coupling.
    state: Option<State>,
    gain: f32,
    fade: f32,
    /// Samples that a soft start has waited, and the sums of their codes.
    settling: (u32, [i64; LEGS]),
    target: f32,
    dac: [DacCode; LEGS],
    samples: Samples,
    watch: Watch,
    probe: Probe,
    /// Pilots in a row that failed.
    strikes: u32,
    injector: Option<Injector>,
    injection_begins: bool,
    injected: u64,
    fault: Option<Fault>,
    /// The outputs at the fault, and samples since.
    failing: ([DacCode; LEGS], u32),
    snapshot: HistoryBuf<Record, SNAPSHOT>,
    recorder: Recorder<'a>,
    every: u32,
    telemetry: Deque<Telemetry, WAITING>,
    clamped: u32,
    late: u32,
    lost: u32,
    dropped: u32,
    health: Health,
}

impl<'a> Controller<'a> {
    /// For `table`, whose checksum was `checksum` when it was made: if it is not
    /// now, the controller begins with that fault. `room` is the recorder's.
    pub fn new(table: ValidTable, checksum: u32, room: &'a mut [Record]) -> Self {
        let dac = table.safe_codes();
        let mut controller = Self {
            table,
            checksum,
            sent: false,
            at: 0,
            mode: Mode::Untested,
            state: None,
            gain: 0.0,
            fade: 0.0,
            settling: (0, [0; LEGS]),
            target: 1.0,
            dac,
            samples: Samples::NONE,
            watch: Watch::NEW,
            probe: Probe::NEW,
            strikes: 0,
            injector: None,
            injection_begins: false,
            injected: 0,
            fault: None,
            failing: (dac, 0),
            snapshot: HistoryBuf::new(),
            recorder: Recorder::new(room),
            every: 0,
            telemetry: Deque::new(),
            clamped: 0,
            late: 0,
            lost: 0,
            dropped: 0,
            health: Health::default(),
        };
        if table.checksum() != checksum {
            controller.table_changed();
        }
        controller
    }

    /// The table that runs. A board copies it now and then and compares its
    /// checksum with [`Identity::checksum`]; that takes as long as some tens of
    /// samples, so neither in the loop nor while the loop waits.
    pub fn table(&self) -> &ValidTable {
        &self.table
    }

    /// Runs another table from here on, `sent` over the link or compiled in. Nothing
    /// has been tested under it. Its checksum is looked at with the next
    /// [`Controller::table`].
    ///
    /// # Errors
    /// Where legs are driven or a fault is latched.
    pub fn replace(&mut self, table: ValidTable, checksum: u32, sent: bool) -> Result<(), Refusal> {
        if !self.change(Event::Replace) {
            return Err(Refusal::Mode);
        }
        (self.table, self.checksum, self.sent) = (table, checksum, sent);
        self.stop_injection();
        self.state = None;
        self.watch = Watch::NEW;
        self.dac = table.safe_codes();
        Ok(())
    }

    /// Whether [`Controller::replace`] would do so now.
    pub fn is_replaceable(&self) -> bool {
        self.mode.after(Event::Replace).is_some()
    }

    /// What the board found out about its processor.
    pub fn set_health(&mut self, health: Health) {
        self.health = health;
    }

    /// How the processor does.
    pub fn health(&self) -> Health {
        self.health
    }

    /// The table is not what it was when it was made.
    pub fn table_changed(&mut self) {
        self.fail(Cause::Table);
    }

    /// One sample: the codes to latch.
    pub fn on_sample(&mut self, reading: Reading) -> [DacCode; LEGS] {
        let was_fault = self.mode.is_fault();
        self.late = self.late.saturating_add(u32::from(reading.late));
        let status = match reading.samples {
            Some(samples) => {
                self.samples = samples;
                self.sampled(samples, reading.late)
            }
            // The outputs stay where they are; a fault goes on.
            None => {
                self.lost = self.lost.saturating_add(1);
                if let Some(cause) = self.watch.lost(&self.table) {
                    self.fail(cause);
                }
                Status::NOTHING
            }
        };
        if self.mode.is_fault() {
            self.dac = self.fall();
        }
        let record = Record {
            adc: self.samples,
            dac: self.dac,
        };
        let fault = self.mode.is_fault() && !was_fault;
        if !was_fault {
            self.snapshot.write(record);
        }
        let injection = core::mem::take(&mut self.injection_begins);
        self.recorder.push(self.at, record, fault, injection);
        if self.every > 0 && self.at.is_multiple_of(self.every.into()) {
            let telemetry = Telemetry {
                at: self.at,
                mode: self.mode,
                gain: self.gain * self.fade,
                record,
                status,
            };
            if self.telemetry.push_back(telemetry).is_err() {
                self.dropped = self.dropped.saturating_add(1);
            }
        }
        self.at += 1;
        self.dac
    }

    /// A sample that was read.
    fn sampled(&mut self, samples: Samples, late: bool) -> Status {
        let mut state = *self
            .state
            .get_or_insert_with(|| State::settled_on(&self.table, samples));
        let output = self.drive(&mut state, samples);
        self.state = Some(state);
        let seen = (output.dac, output.status);
        let calm = self.injector.is_none();
        let cause = self
            .watch
            .see(&self.table, self.mode, samples, seen, late, calm);
        let cause = cause.or_else(|| self.probed(samples, output));
        if self.mode.is_loop() && output.status.clamped {
            self.clamped = self.clamped.saturating_add(1);
        }
        match cause {
            // What the step gave is not given.
            Some(cause) => self.fail(cause),
            None if !self.mode.is_fault() => self.dac = output.dac,
            None => {}
        }
        output.status
    }

    /// What the mode has the legs do.
    fn drive(&mut self, state: &mut State, samples: Samples) -> Output {
        match self.mode {
            Mode::Starting | Mode::Closed | Mode::Stopping => {
                if self.mode == Mode::Starting && self.gain >= QUIET {
                    self.settle(state);
                }
                self.move_gain();
                let demand = Demand {
                    gain: self.gain,
                    fade: self.fade,
                    injection: self.pilot().unwrap_or_else(|| self.inject()),
                };
                step(&self.table, state, samples, demand)
            }
            Mode::Testing => {
                let push = self.probe.push(self.table.get().self_test.open());
                rest(&self.table, state, samples, push)
            }
            Mode::Idle => {
                let injection = self.inject();
                rest(&self.table, state, samples, injection)
            }
            Mode::Untested | Mode::Failing | Mode::Failed => {
                rest(&self.table, state, samples, LegForces::ZERO)
            }
        }
    }

    /// The gain goes towards its target by a factor a sample; on a soft start it
    /// goes back while the legs push hard, until what makes them do so has died
    /// out. A soft stop takes the force away, whatever the law's integrals hold.
    fn move_gain(&mut self) {
        let ramp = self.table.get().supervision.ramp;
        if self.mode == Mode::Stopping {
            self.fade /= ramp;
            if self.fade < GENTLE {
                self.fade = 0.0;
                self.change(Event::Ramped);
            }
            return;
        }
        let target = self.target;
        let settled = self.settling.0 > self.table.get().supervision.settle.saturating_mul(2);
        if self.mode == Mode::Starting && self.gain >= QUIET && !settled {
            return;
        }
        if self.gain > target {
            self.gain = (self.gain / ramp).max(target);
        } else if self.mode == Mode::Starting && self.push() > HARD {
            self.gain = (self.gain / ramp).max(GENTLE);
        } else {
            self.gain = (self.gain * ramp).max(GENTLE).min(target);
        }
        if self.gain == target && self.mode == Mode::Starting {
            self.change(Event::Ramped);
        }
    }

    /// A soft start's wait for the machine to come to rest. At its end the AC coupling
    /// is settled on what the sensors then showed.
    fn settle(&mut self, state: &mut State) {
        let length = self.table.get().supervision.settle;
        let (count, sums) = &mut self.settling;
        let whole = length.saturating_mul(2);
        if *count > whole {
            return;
        }
        *count += 1;
        if *count > whole {
            state.settle(&self.table, *sums, length);
        } else if *count > length {
            for (sum, code) in sums.iter_mut().zip(self.samples.sensors) {
                *sum += i64::from(code.0);
            }
        }
    }

    /// The largest force of any leg, of its limit.
    fn push(&self) -> f32 {
        let legs = self.table.get().actuators.iter().zip(self.dac);
        legs.map(|(drive, code)| (drive.force(code) / drive.limit).abs())
            .fold(0.0, f32::max)
    }

    /// The pilot's push: with the loop closed, and nothing else injected.
    fn pilot(&self) -> Option<LegForces> {
        let course = self.table.get().self_test.closed()?;
        let free = self.mode == Mode::Closed && self.injector.is_none();
        free.then(|| self.probe.push(course))
    }

    /// What self-test or pilot make of a sample and the output to it.
    fn probed(&mut self, samples: Samples, output: Output) -> Option<Cause> {
        let table = self.table.get();
        if self.mode == Mode::Testing {
            let course = table.self_test.open();
            match self.probe.see(table, course, samples, output.dac)? {
                Verdict::Failed(cause) => return Some(cause),
                Verdict::Passed | Verdict::Noisy => self.change(Event::Passed),
            };
            return None;
        }
        let course = table.self_test.closed()?;
        if self.mode != Mode::Closed {
            return None;
        }
        if self.injector.is_some() {
            self.probe = Probe::NEW;
            return None;
        }
        match self.probe.see(table, course, samples, output.dac)? {
            Verdict::Passed => self.strikes = 0,
            Verdict::Noisy => {}
            Verdict::Failed(cause) => {
                self.strikes += 1;
                return (self.strikes >= STRIKES).then_some(cause);
            }
        }
        None
    }

    fn inject(&mut self) -> LegForces {
        let Some(injector) = &mut self.injector else {
            return LegForces::ZERO;
        };
        match injector.advance() {
            Some(forces) => forces,
            None => {
                self.injector = None;
                LegForces::ZERO
            }
        }
    }

    /// The codes on the way from where they were at the fault to safe.
    fn fall(&mut self) -> [DacCode; LEGS] {
        let safe = self.table.safe_codes();
        let (from, since) = &mut self.failing;
        let whole = self.table.get().supervision.safe_ramp;
        if self.mode == Mode::Failed {
            return safe;
        }
        *since = since.saturating_add(1);
        let left = i64::from(whole.saturating_sub(*since));
        let whole = i64::from(whole.max(1));
        let codes = core::array::from_fn(|i| {
            let (from, safe) = (i64::from(from[i].0), i64::from(safe[i].0));
            // Between two codes: fits.
            DacCode((safe + (from - safe) * left / whole) as u16)
        });
        if left == 0 {
            self.change(Event::Ramped);
        }
        codes
    }

    fn fail(&mut self, cause: Cause) {
        if self.change(Event::Fault) {
            self.fault = Some(Fault { cause, at: self.at });
            self.failing = (self.dac, 0);
            self.stop_injection();
        }
    }

    fn stop_injection(&mut self) {
        self.injector = None;
    }

    /// Whether the event changed, or may be repeated in, the mode.
    fn change(&mut self, event: Event) -> bool {
        let Some(next) = self.mode.after(event) else {
            return false;
        };
        if next == Mode::Starting {
            (self.gain, self.fade) = (0.0, 1.0);
            self.settling = (0, [0; LEGS]);
            // The law begins at rest; AC coupling goes on.
            if let Some(state) = &mut self.state {
                state.start();
            }
        }
        (self.probe, self.strikes) = (Probe::NEW, 0);
        if !next.is_loop() {
            (self.gain, self.fade) = (0.0, 0.0);
        }
        self.mode = next;
        true
    }

    /// A request for an event of the supervisor.
    ///
    /// # Errors
    /// Where the mode does not have it.
    pub fn ask(&mut self, event: Event) -> Result<(), Refusal> {
        let asked = matches!(
            event,
            Event::SelfTest | Event::Start | Event::Stop | Event::Clear
        );
        if !asked || !self.change(event) {
            return Err(Refusal::Mode);
        }
        self.stop_injection();
        if event == Event::Clear {
            self.fault = None;
            self.snapshot.clear();
            self.watch = Watch::NEW;
        }
        Ok(())
    }

    /// Sets the gain that is aimed at, above 0 and up to 1.
    ///
    /// # Errors
    /// Where it is not.
    pub fn set_gain(&mut self, gain: f32) -> Result<(), Refusal> {
        if !(gain > 0.0 && gain <= 1.0) {
            return Err(Refusal::Range);
        }
        self.target = gain;
        Ok(())
    }

    /// Begins an injection, in place of one under way: with the loop closed or
    /// open, not on the way between.
    ///
    /// # Errors
    /// Where the mode does not have it or it is not within the table's limits.
    pub fn start_injection(&mut self, injection: Injection) -> Result<(), Refusal> {
        if !matches!(self.mode, Mode::Idle | Mode::Closed) {
            return Err(Refusal::Mode);
        }
        if !injection.is_within(&self.table) {
            return Err(Refusal::Range);
        }
        self.injector = Some(Injector::new(&self.table, injection));
        self.injected = self.at;
        self.injection_begins = true;
        Ok(())
    }

    /// Arms the recorder.
    ///
    /// # Errors
    /// Where there is no room or no such sensor.
    pub fn arm(&mut self, recording: Recording) -> Result<(), Refusal> {
        if self.recorder.arm(recording) {
            Ok(())
        } else {
            Err(Refusal::Range)
        }
    }

    /// Every so many samples one is put by for the link; 0 for none.
    pub fn set_telemetry(&mut self, every: u32) {
        self.every = every;
        self.telemetry.clear();
    }

    /// The oldest telemetry that waits.
    pub fn telemetry(&mut self) -> Option<Telemetry> {
        self.telemetry.pop_front()
    }

    /// A good frame came over the link.
    pub fn heard(&mut self) {
        self.watch.heard();
    }

    /// Record `index` of a finished recording.
    pub fn recording(&self, index: usize) -> Option<&Record> {
        self.recorder.get(index)
    }

    /// Record `index` of the samples before the latched fault, the oldest first.
    pub fn snapshot(&self, index: usize) -> Option<&Record> {
        self.fault?;
        let (old, new) = self.snapshot.as_slices();
        old.get(index)
            .or_else(|| new.get(index.checked_sub(old.len())?))
    }

    /// How things stand.
    pub fn report(&self) -> Report {
        Report {
            at: self.at,
            mode: self.mode,
            gain: self.gain * self.fade,
            target: self.target,
            fault: self.fault,
            injecting: self.injector.as_ref().map_or(0, Injector::left),
            injected: self.injected,
            recorded: self.recorder.recorded(),
            clamped: self.clamped,
            late: self.late,
            lost: self.lost,
            dropped: self.dropped,
        }
    }

    /// What runs here.
    pub fn identity(&self) -> Identity {
        let table = self.table.get();
        Identity {
            format: table.version,
            model: table.model,
            checksum: self.checksum,
            sample_rate: table.sample_rate,
            // Memory is far smaller.
            room: self.recorder.room() as u32,
            sent: self.sent,
        }
    }
}
