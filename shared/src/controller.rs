//! The complete controller of a board: table, step, supervisor, injection and recorder.
//! [`Controller::on_sample`] runs once per sample; requests come in between.

use heapless::{Deque, HistoryBuf, Vec};
use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::{DacCode, LegForces, Samples};
use crate::injection::{Injection, Injector, Signal, UNASKED};
use crate::levels::{Levels, Meter};
use crate::monitors::{Monitors, Sight};
use crate::multisine::{LINES, Line, LineParts, Multisine, Slot};
use crate::recorder::{Record, Recorded, Recorder, Recording};
use crate::self_test::{Answer, Course, Probe, Verdict};
use crate::step::{Ahead, Demand, Latched, State, Status, follow, larger};
use crate::supervisor::{Cause, Event, GENTLE, LatchedFault, Mode, QUIET};
use crate::table::{ModelDigest, TableError, ValidTable};

/// One sample as the board read it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// The ADC codes. None if they could not be read.
    pub samples: Option<Samples>,
    /// Whether the previous sample missed its deadline, so that its outputs were latched late.
    pub late: bool,
}

impl From<Samples> for Reading {
    /// A sample that was read, after one that met its deadline.
    fn from(samples: Samples) -> Self {
        Self {
            samples: Some(samples),
            late: false,
        }
    }
}

/// Mode, gain, fault and counters of the controller.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControllerReport {
    /// Samples since power-up.
    pub at: u64,
    /// Current mode.
    pub mode: Mode,
    /// Current loop gain, as a fraction of the table's, 0 to 1.
    pub gain: f32,
    /// Target of the loop gain, as a fraction of the table's, above 0 and up to 1.
    pub target: f32,
    /// The latched fault, if any.
    pub fault: Option<LatchedFault>,
    /// Remaining samples of the injection; 0 without one.
    pub injecting: u32,
    /// First sample of the last injection, since power-up.
    pub injected: u64,
    /// Progress of the recording.
    pub recorded: Recorded,
    /// Number of samples with clamped forces while the loop was closed, since power-up.
    pub clamped: u32,
    /// Number of missed deadlines since power-up.
    pub late: u32,
    /// Number of samples that could not be read, since power-up.
    pub lost: u32,
    /// Number of telemetry samples dropped because the queue was full, since power-up.
    pub dropped: u32,
}

/// The table that runs on a board.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Version of the table's layout.
    pub format: u16,
    /// Digest of the machine description that the table was made from.
    pub model: ModelDigest,
    /// Checksum of the table, as given when it was made.
    pub checksum: u32,
    /// Sample rate, Hz.
    pub sample_rate: f32,
    /// Number of records that fit into the recorder.
    pub room: u32,
    /// Whether the table came over the link. If not, it is the one compiled into the
    /// firmware.
    pub sent: bool,
}

/// Timing and stack use of the board's processor since power-up. Times are 0 on a board
/// without a clock for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Health {
    /// Cause of the last start.
    pub restart: Restart,
    /// Sample period, ns.
    pub period: u32,
    /// Longest time from a sample's interrupt until its codes were written, ns.
    pub written: u32,
    /// Longest time that the processor was busy with a sample, ns.
    pub longest: u32,
    /// Average time that the processor is busy with a sample, ns.
    pub usual: u32,
    /// Difference between the latest and the earliest interrupt relative to the timer, ns.
    pub jitter: u32,
    /// Stack that was never used, bytes.
    pub stack: u32,
}

/// The cause of a board's start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Restart {
    /// Power-up, or an unknown cause.
    #[default]
    Power,
    /// The reset button, or a debugger.
    Pin,
    /// The watchdog: loop or link did not check in.
    Watchdog,
    /// The firmware panicked.
    Panic,
    /// A hard fault of the processor.
    HardFault,
    /// The supply voltage was too low for a time.
    BrownOut,
    /// The external clock failed.
    Clock,
}

/// One sample, sent while the controller runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Telemetry {
    /// Number of the sample since power-up.
    pub at: u64,
    /// Mode after the sample.
    pub mode: Mode,
    /// Loop gain, as a fraction of the table's, 0 to 1.
    pub gain: f32,
    /// The codes of the sample.
    pub record: Record,
    /// What the step observed.
    pub status: Status,
}

/// Why a request was refused. A refused request changes nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// Not allowed in the current mode.
    Mode,
    /// A number is outside its range.
    Range,
    /// Malformed frame: wrong length, checksum or content.
    Frame,
    /// The frame is for another version of the link.
    Version,
    /// The frame belongs to another session, or no session has begun.
    Session,
    /// The sequence number is not above the last one, or the number of `Hello` was used in
    /// one of the last sessions.
    Replayed,
    /// The table is not valid, or this board cannot run it.
    Table(TableError),
    /// The table could not be stored. The previous one stays in use.
    Memory,
}

/// Number of records kept from before a fault.
pub const SNAPSHOT: usize = 64;

/// A leg force above this fraction of its limit makes a soft start lower the gain.
const HARD: f32 = 0.5;

/// Forces that decay below this fraction of the limit are dropped: less than half a code of a DAC of
/// sixteen bits.
const NOTHING: f32 = 1e-5;

/// Number of failed pilots, with none passed in between, that is a fault. A shock can make
/// one fail, but not the next one too.
const STRIKES: u32 = 2;

/// Length of the telemetry queue.
const WAITING: usize = 8;

/// Memory that a board gives to its controller.
#[derive(Debug)]
pub struct Memory<'a> {
    /// For recordings.
    pub records: &'a mut [Record],
    /// For the lines of a multisine.
    pub lines: &'a mut [Slot],
}

impl Memory<'_> {
    /// For no recordings and no multisines.
    pub const fn none() -> Self {
        Self {
            records: &mut [],
            lines: &mut [],
        }
    }
}

/// The controller of a board.
#[derive(Debug)]
pub struct Controller<'a> {
    table: ValidTable,
    /// As given with the table.
    checksum: u32,
    /// Whether the table came over the link.
    sent: bool,
    /// Samples since power-up.
    at: u64,
    mode: Mode,
    /// None until the first sample has initialised the AC coupling.
    state: Option<State>,
    /// Whether the next outputs are `held`, whatever is read, and do not follow from `ahead`.
    holds: bool,
    /// The outputs of a fault.
    held: [DacCode; LEGS],
    /// What is known of the next sample before it is read.
    ahead: Ahead,
    /// The sample whose outputs followed from `ahead` last.
    latched: Latched,
    /// Whether the last sample was read.
    read: bool,
    /// Whether the sample before it was late.
    was_late: bool,
    /// As in [`Demand`].
    gain: f32,
    /// As in [`Demand`].
    fade: f32,
    /// Samples that a soft start has waited, and the sums of the codes it averages.
    settling: (u32, [i64; LEGS]),
    /// Target of `gain`.
    target: f32,
    /// The last samples that were read, and the last outputs.
    record: Record,
    /// Forces in addition to those of a law whose integrals were reset, N, so that the sum goes
    /// on where it was. They decay.
    parting: Option<LegForces>,
    monitors: Monitors,
    probe: Probe,
    /// Failed pilots with none passed in between.
    strikes: u32,
    injector: Option<Injector>,
    /// Whether the next sample is the first of an injection.
    injection_begins: bool,
    /// First sample of the last injection.
    injected: u64,
    fault: Option<LatchedFault>,
    /// The outputs at the time of the fault, and the samples since then.
    failing: ([DacCode; LEGS], u32),
    snapshot: HistoryBuf<Record, SNAPSHOT>,
    recorder: Recorder<'a>,
    meter: Meter,
    multisine: Multisine<'a>,
    /// Telemetry queues one sample in `every`; 0 for none.
    every: u32,
    /// Samples before the one that is queued next.
    until: u32,
    telemetry: Deque<Telemetry, WAITING>,
    clamped: u32,
    late: u32,
    lost: u32,
    dropped: u32,
    health: Health,
}

impl<'a> Controller<'a> {
    /// A controller for `table`. `checksum` is the table's checksum at the time it was made;
    /// if the table does not match it, the controller starts with [`Cause::Table`].
    pub fn new(table: ValidTable, checksum: u32, memory: Memory<'a>) -> Self {
        let dac = table.safe_codes();
        let mut controller = Self {
            table,
            checksum,
            sent: false,
            at: 0,
            mode: Mode::Untested,
            state: None,
            holds: true,
            held: dac,
            ahead: Ahead::NOTHING,
            latched: Latched::NOTHING,
            read: false,
            was_late: false,
            gain: 0.0,
            fade: 0.0,
            settling: (0, [0; LEGS]),
            target: 1.0,
            record: Record {
                adc: Samples::NONE,
                dac,
            },
            parting: None,
            monitors: Monitors::NEW,
            probe: Probe::NEW,
            strikes: 0,
            injector: None,
            injection_begins: false,
            injected: 0,
            fault: None,
            failing: (dac, 0),
            snapshot: HistoryBuf::new(),
            recorder: Recorder::new(memory.records),
            multisine: Multisine::new(memory.lines),
            meter: Meter::NEW,
            every: 0,
            until: 0,
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

    /// Samples since power-up.
    pub const fn at(&self) -> u64 {
        self.at
    }

    /// The table in use. The board copies it regularly and compares the copy's checksum with
    /// [`Identity::checksum`]. The checksum takes some tens of sample periods, so it must not
    /// be computed in the loop or while the loop waits.
    pub fn table(&self) -> &ValidTable {
        &self.table
    }

    /// Switches to another table. `sent` says whether it came over the link. The mode is then
    /// [`Mode::Untested`]. The checksum is not verified here, but with the board's next
    /// regular check, see [`Controller::table`].
    ///
    /// # Errors
    /// [`Refusal::Mode`] while the legs are driven or a fault is latched.
    pub fn replace(&mut self, table: ValidTable, checksum: u32, sent: bool) -> Result<(), Refusal> {
        if !self.change(Event::Replace) {
            return Err(Refusal::Mode);
        }
        (self.table, self.checksum, self.sent) = (table, checksum, sent);
        self.stop_injection();
        self.state = None;
        self.monitors = Monitors::NEW;
        self.record.dac = self.table.safe_codes();
        self.meter = Meter::NEW;
        self.prepare();
        Ok(())
    }

    /// Whether [`Controller::replace`] would accept a table now.
    pub fn is_replaceable(&self) -> bool {
        self.mode.after(Event::Replace).is_some()
    }

    /// Stores the processor's timing and stack use, measured by the board.
    pub fn set_health(&mut self, health: Health) {
        self.health = health;
    }

    /// The processor's timing and stack use, as last stored.
    pub fn health(&self) -> Health {
        self.health
    }

    /// To be called when the table no longer matches its checksum. This is a fault.
    pub fn table_changed(&mut self) {
        self.fail(Cause::Table);
        self.prepare();
    }

    /// Runs both halves of a sample and returns the codes to latch.
    pub fn on_sample(&mut self, reading: Reading) -> [DacCode; LEGS] {
        let codes = self.latch(reading);
        self.follow();
        codes
    }

    /// The first half of a sample: returns the codes to latch. [`Controller::follow`] must be
    /// called before the next one.
    // Within a caller's loop, every address would be kept on the stack and loaded from there.
    #[inline(never)]
    pub fn latch(&mut self, reading: Reading) -> [DacCode; LEGS] {
        if let Some(samples) = reading.samples {
            self.record.adc = samples;
            if !self.holds {
                self.latched
                    .latch(&self.table, &self.ahead, &mut self.record);
            }
        }
        if self.holds {
            self.record.dac = self.held;
        }
        // Else a sample that was not read leaves the outputs as they are.
        (self.read, self.was_late) = (reading.samples.is_some(), reading.late);
        self.record.dac
    }

    /// The second half of a sample: states, monitors, records, and all of the next sample that
    /// does not depend on its codes. A fault that it finds changes the outputs from the next
    /// sample on.
    pub fn follow(&mut self) {
        let was_fault = self.mode.is_fault();
        if self.was_late {
            self.late = self.late.saturating_add(1);
        }
        let status = if self.read {
            self.sampled()
        } else {
            self.lost = self.lost.saturating_add(1);
            if let Some(cause) = self.monitors.lost(&self.table) {
                self.fail(cause);
            }
            Status::NOTHING
        };
        if !was_fault {
            self.snapshot.write(self.record.copied());
        }
        let injection = core::mem::take(&mut self.injection_begins);
        if self.recorder.records() {
            let fault = self.mode.is_fault() && !was_fault;
            self.recorder.push(self.at, &self.record, fault, injection);
        }
        if self.every > 0 {
            self.tell(status);
        }
        self.at += 1;
        self.advance();
        self.prepare();
    }

    /// Queues one sample in `every` for the link.
    #[inline(never)]
    fn tell(&mut self, status: Status) {
        if self.until > 0 {
            self.until -= 1;
            return;
        }
        self.until = self.every - 1;
        let telemetry = Telemetry {
            at: self.at,
            mode: self.mode,
            gain: self.gain * self.fade,
            record: self.record,
            status,
        };
        if self.telemetry.push_back(telemetry).is_err() {
            self.dropped = self.dropped.saturating_add(1);
        }
    }

    /// The second half of a sample that was read.
    #[inline]
    fn sampled(&mut self) -> Status {
        let (table, samples) = (&self.table, &self.record.adc);
        let state = self
            .state
            .get_or_insert_with(|| State::settled_on(table, *samples));
        if self.holds {
            listen(table, state, &mut self.ahead, &mut self.latched, samples);
        }
        let status = follow(table, state, &self.ahead, &self.latched, samples);
        let sight = Sight {
            samples,
            dac: &self.record.dac,
            status,
            late: self.was_late,
            injecting: self.injector.is_some(),
        };
        let cause = self.monitors.see(table, self.mode, &sight);
        self.meter.see(table, samples, &self.record.dac);
        let cause = cause.or_else(|| self.probed());
        if self.injector.is_some() {
            self.inject();
        }
        if self.mode.is_loop() && status.clamped {
            self.clamped = self.clamped.saturating_add(1);
        }
        if let Some(cause) = cause {
            self.fail(cause);
        }
        status
    }

    /// Moves the injection on to the next sample, or ends it.
    #[inline(never)]
    fn inject(&mut self) {
        let Some(injector) = &mut self.injector else {
            return;
        };
        if injector.signal() == Signal::Multisine {
            self.multisine.see(&self.record);
        }
        if !injector.advance(&self.multisine) {
            self.stop_injection();
        }
        self.end_unasked_injection();
    }

    /// Everything that changes from one sample to the next.
    fn advance(&mut self) {
        if self.mode == Mode::Failing {
            let (_, since) = &mut self.failing;
            if *since >= self.table.get().supervision.safe_ramp {
                self.change(Event::Ramped);
            } else {
                *since += 1;
            }
        }
        if self.mode.is_loop() && !(self.mode == Mode::Closed && self.gain == self.target) {
            if self.mode == Mode::Starting && self.gain >= QUIET {
                self.settle();
            }
            self.move_gain();
        }
        if let Some(LegForces(forces)) = &mut self.parting {
            let table = self.table.get();
            let mut left = false;
            for (force, drive) in forces.iter_mut().zip(&table.actuators) {
                *force /= table.supervision.ramp;
                left |= force.abs() > NOTHING * drive.limit;
            }
            if !left {
                self.parting = None;
            }
        }
    }

    /// Computes of the next sample what does not depend on its codes. To be called after every
    /// change of mode, gain or injection too.
    fn prepare(&mut self) {
        let Some(state) = &self.state else {
            (self.holds, self.held) = (true, self.table.safe_codes());
            return;
        };
        self.holds = self.mode.is_fault();
        match self.mode {
            Mode::Starting | Mode::Closed | Mode::Stopping => {
                let mut injection = self.pilot().unwrap_or_else(|| self.injected_forces());
                if let Some(LegForces(parting)) = &self.parting {
                    for (force, parting) in injection.0.iter_mut().zip(parting) {
                        *force += parting;
                    }
                }
                let demand = Demand {
                    gain: self.gain,
                    fade: self.fade,
                    injection,
                };
                self.ahead.close(&self.table, state, &demand);
            }
            Mode::Testing => {
                let push = self.probe.push(Course::open(&self.table.get().self_test));
                self.ahead.open(state, &push);
            }
            Mode::Idle => {
                let injected = self.injected_forces();
                self.ahead.open(state, &injected);
            }
            Mode::Untested => self.ahead.open(state, &LegForces::ZERO),
            Mode::Failing | Mode::Failed => self.held = self.fallen(),
        }
    }

    /// Changes the gain towards its target by one factor per sample. A soft start lowers it
    /// while a leg force is large, until the cause has decayed. A soft stop fades the force,
    /// whatever the law's integrals hold.
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

    /// One sample of a soft start's wait for the machine to come to rest. At its end the AC
    /// coupling starts from the averages of the sensors.
    fn settle(&mut self) {
        let Some(state) = &mut self.state else { return };
        let length = self.table.get().supervision.settle;
        let (count, sums) = &mut self.settling;
        let whole = length.saturating_mul(2);
        if *count > whole {
            return;
        }
        *count += 1;
        if *count > whole {
            let bump = state.settle(&self.table, *sums, length, self.gain);
            self.parting = Some(bump);
        } else if *count > length {
            for (sum, code) in sums.iter_mut().zip(self.record.adc.sensors) {
                *sum += i64::from(code.0);
            }
        }
    }

    /// The largest ratio of a leg force to its limit.
    fn push(&self) -> f32 {
        let legs = self.table.get().actuators.iter().zip(self.record.dac);
        legs.map(|(drive, code)| (drive.force(code) / drive.limit).abs())
            .fold(0.0, larger)
    }

    /// The forces of the pilot. None unless the loop is closed and nothing else is injected.
    fn pilot(&self) -> Option<LegForces> {
        let course = Course::closed(&self.table.get().self_test)?;
        let free = self.mode == Mode::Closed && self.injector.is_none();
        free.then(|| self.probe.push(course))
    }

    /// Passes the sample and its output to the self-test or the pilot, and returns the fault it
    /// found, if any.
    fn probed(&mut self) -> Option<Cause> {
        let table = self.table.get();
        let answer = Answer {
            sensors: &self.latched.w,
            forces: &self.latched.forces,
            dac: &self.record.dac,
        };
        if self.mode == Mode::Testing {
            let course = Course::open(&table.self_test);
            match self.probe.see(table, course, answer)? {
                Verdict::Failed(cause) => return Some(cause),
                Verdict::Passed | Verdict::Noisy => self.change(Event::Passed),
            };
            return None;
        }
        if self.mode != Mode::Closed {
            return None;
        }
        let course = Course::closed(&table.self_test)?;
        if self.injector.is_some() {
            self.probe.restart();
            return None;
        }
        match self.probe.see(table, course, answer)? {
            Verdict::Passed => self.strikes = 0,
            Verdict::Noisy => {}
            Verdict::Failed(cause) => {
                self.strikes += 1;
                return (self.strikes >= STRIKES).then_some(cause);
            }
        }
        None
    }

    /// The forces of the injection in the next sample, zero without one.
    fn injected_forces(&self) -> LegForces {
        let injector = self.injector.as_ref();
        injector.map_or(LegForces::ZERO, Injector::forces)
    }

    /// The codes of the ramp from the outputs at the time of the fault to the safe codes.
    fn fallen(&self) -> [DacCode; LEGS] {
        let safe = self.table.safe_codes();
        let (from, since) = &self.failing;
        let whole = self.table.get().supervision.safe_ramp;
        if self.mode == Mode::Failed {
            return safe;
        }
        let left = i64::from(whole.saturating_sub(*since));
        let whole = i64::from(whole.max(1));
        core::array::from_fn(|i| {
            let (from, safe) = (i64::from(from[i].0), i64::from(safe[i].0));
            // Between two codes, so it fits.
            DacCode((safe + (from - safe) * left / whole) as u16)
        })
    }

    fn fail(&mut self, cause: Cause) {
        if self.change(Event::Fault) {
            self.fault = Some(LatchedFault { cause, at: self.at });
            self.failing = (self.record.dac, 0);
            self.stop_injection();
        }
    }

    fn stop_injection(&mut self) {
        self.injector = None;
    }

    /// Ends the injection if no request has come for [`UNASKED`] seconds. The loop stays as
    /// it is.
    fn end_unasked_injection(&mut self) {
        // The cast saturates; rates are positive and far below 2³².
        let patience = || (UNASKED * self.table.get().sample_rate) as u32;
        if self.injector.is_some() && self.monitors.silence() >= patience() {
            self.stop_injection();
        }
    }

    /// Applies an event. False if the mode refuses it.
    fn change(&mut self, event: Event) -> bool {
        let Some(next) = self.mode.after(event) else {
            return false;
        };
        if next == Mode::Starting {
            (self.gain, self.fade, self.parting) = (0.0, 1.0, None);
            self.settling = (0, [0; LEGS]);
            // The law starts at rest; the AC coupling keeps its state.
            if let Some(state) = &mut self.state {
                state.start(&self.table);
            }
        }
        self.probe.restart();
        self.strikes = 0;
        if !next.is_loop() {
            (self.gain, self.fade, self.parting) = (0.0, 0.0, None);
        }
        self.mode = next;
        true
    }

    /// Carries out a request for an event: self-test, start, stop or clear.
    ///
    /// # Errors
    /// [`Refusal::Mode`] if the event is another one, or the mode refuses it.
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
            self.monitors = Monitors::NEW;
        }
        self.prepare();
        Ok(())
    }

    /// Sets the target of the loop gain, as a fraction of the table's, above 0 and up to 1.
    ///
    /// # Errors
    /// [`Refusal::Range`] if it is outside this range.
    pub fn set_gain(&mut self, gain: f32) -> Result<(), Refusal> {
        if !(gain > 0.0 && gain <= 1.0) {
            return Err(Refusal::Range);
        }
        self.target = gain;
        Ok(())
    }

    /// Starts an injection and ends a running one. It ends after its duration, with a fault,
    /// or when no request has come for [`UNASKED`] seconds.
    ///
    /// # Errors
    /// [`Refusal::Mode`] unless the mode is [`Mode::Idle`] or [`Mode::Closed`],
    /// [`Refusal::Range`] if the injection exceeds the table's limits, or is a multisine without
    /// lines.
    pub fn start_injection(&mut self, injection: Injection) -> Result<(), Refusal> {
        if !matches!(self.mode, Mode::Idle | Mode::Closed) {
            return Err(Refusal::Mode);
        }
        if !injection.is_within(&self.table, &self.multisine) {
            return Err(Refusal::Range);
        }
        if injection.signal == Signal::Multisine {
            self.multisine.begin();
        }
        let injector = Injector::new(&self.table, injection, &self.multisine);
        self.monitors.heard();
        self.injected = self.at;
        self.injection_begins = true;
        self.injector = Some(injector);
        self.prepare();
        Ok(())
    }

    /// Sets the lines of the multisine, and its windows of 2^`window` samples.
    ///
    /// # Errors
    /// [`Refusal::Mode`] while a multisine is injected, [`Refusal::Range`] if a number is outside
    /// its range or there is not enough memory.
    pub fn set_multisine(&mut self, window: u8, lines: &Vec<Line, LINES>) -> Result<(), Refusal> {
        let signal = self.injector.as_ref().map(Injector::signal);
        if signal == Some(Signal::Multisine) {
            return Err(Refusal::Mode);
        }
        if !self.multisine.set(window, lines) {
            return Err(Refusal::Range);
        }
        Ok(())
    }

    /// The answers at line `index` of the multisine in the last whole window.
    ///
    /// # Errors
    /// [`Refusal::Range`] without such a line.
    pub fn line(&self, index: usize) -> Result<LineParts, Refusal> {
        self.multisine.answer(index).ok_or(Refusal::Range)
    }

    /// Starts a recording and drops the last one.
    ///
    /// # Errors
    /// [`Refusal::Range`] if the recording is too long for the memory, has no sample after the
    /// trigger, or names a sensor that does not exist.
    pub fn arm(&mut self, recording: Recording) -> Result<(), Refusal> {
        if self.recorder.arm(recording) {
            Ok(())
        } else {
            Err(Refusal::Range)
        }
    }

    /// Queues one sample in `every` for the link; 0 for none. Empties the queue.
    pub fn set_telemetry(&mut self, every: u32) {
        self.every = every;
        // A multiple of `every` since power-up; below 2³².
        self.until = match self.at.checked_rem(every.into()) {
            None | Some(0) => 0,
            Some(over) => every - over as u32,
        };
        self.telemetry.clear();
    }

    /// Takes the oldest sample from the telemetry queue.
    pub fn telemetry(&mut self) -> Option<Telemetry> {
        self.telemetry.pop_front()
    }

    /// To be called when a valid frame arrived on the link.
    pub fn heard(&mut self) {
        self.monitors.heard();
    }

    /// Record `index` of a complete recording, the oldest first.
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

    /// Mode, gain, fault and counters.
    pub fn report(&self) -> ControllerReport {
        ControllerReport {
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

    /// Levels of the last whole window, and the processor's load.
    pub fn levels(&self) -> Levels {
        self.meter.levels(self.health.usual, self.health.period)
    }

    /// The table in use.
    pub fn identity(&self) -> Identity {
        let table = self.table.get();
        Identity {
            format: table.version,
            model: table.model,
            checksum: self.checksum,
            sample_rate: table.sample_rate,
            // Fits: memory is far smaller.
            room: self.recorder.room() as u32,
            sent: self.sent,
        }
    }
}

/// A sample whose outputs do not depend on it: the AC coupling follows the sensors all the same.
#[inline(never)]
fn listen(
    table: &ValidTable,
    state: &State,
    ahead: &mut Ahead,
    latched: &mut Latched,
    samples: &Samples,
) {
    ahead.open(state, &LegForces::ZERO);
    let mut unused = Record {
        adc: *samples,
        ..Record::NONE
    };
    latched.latch(table, ahead, &mut unused);
}
