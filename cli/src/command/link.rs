//! `host-gen link`.

mod levels;

use std::fmt::{self, Display, Formatter};
use std::io;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::{Args, Subcommand, ValueEnum};
use host_gen::board::link::{Address, Client, LinkError};
use host_gen::board::measure::{
    FrfError, MeasuredSensitivity, Measurement, MeasurementSettings, Resonance, measure,
};
use host_gen::board::units::Scales;
use host_gen::board::words::cause;
use host_gen::machine::Machine;
use serde::Serialize;
use shared::LEGS;
use shared::codes::AdcCode;
use shared::controller::{ControllerReport, Health, Identity, Refusal, Restart};
use shared::injection::{Injection, LONGEST, Signal};
use shared::link::Request;
use shared::recorder::{Record, Recorded, Recording, Trigger};
use shared::supervisor::{LatchedFault, Mode};

use crate::arguments::{Format, above_zero};
use crate::failure::Failure;
use crate::print;
use crate::search::{Bar, Searcher, study};
use crate::signals::Signals;
use crate::waiting::waiting;
use levels::LevelsArguments;

#[derive(Args)]
pub struct LinkArguments {
    /// Address of the board: HOST:PORT, or the path of a serial port.
    #[arg(long)]
    at: Address,
    /// Output format: text, or JSON as in docs/json.md.
    #[arg(long, value_enum, default_value_t = Format::Text, global = true)]
    format: Format,
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    #[command(flatten)]
    OnBoard(OnBoard),
    /// Send the table of a machine file to the board. The board validates it, stores it
    /// permanently and runs it; a self-test is then needed again. Only while the legs are
    /// at rest.
    ///
    /// Example: host-gen link --at /dev/ttyACM0 table models/yours.toml
    Table(SendTableArguments),
    /// Measure the plant on the machine, and with the loop closed also the sensitivity,
    /// and compare them with the model.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 frf models/yours.toml
    Frf(FrfArguments),
}

/// The actions that need nothing but the board.
#[derive(Subcommand)]
enum OnBoard {
    /// Show mode, gain, faults and counters.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 status
    Status,
    /// Show which table the board runs.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 identity
    Identity,
    /// Test sensors and legs: each leg pushes a little, and every sensor must respond as
    /// the model predicts. Waits for the end; interrupted, it ends the test.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 self-test
    SelfTest,
    /// Close the loop with a soft start. Waits until it is closed; interrupted, it opens the
    /// loop again.
    ///
    /// The loop stays closed after the command. Without a further message on the link it
    /// opens, with a fault, after the time `supervision.silence` of the machine file, unless
    /// that is 0.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 start
    Start {
        /// Return at once.
        #[arg(long)]
        no_wait: bool,
    },
    /// Open the loop with a soft stop, or end a self-test or a test signal. Waits for the
    /// end.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 stop
    Stop {
        /// Return at once.
        #[arg(long)]
        no_wait: bool,
    },
    /// Clear a latched fault.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 clear
    Clear,
    /// Set the loop gain, 0 to 1.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 gain 0.1
    Gain {
        /// Loop gain: above 0 and at most 1.
        #[arg(value_parser = part, allow_negative_numbers = true)]
        part: f32,
    },
    /// Add a test signal to a leg. Waits for its end; interrupted, it ends the signal.
    ///
    /// The board ends a test signal by itself if no message has come on the link for 5 s.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 inject --signal sine --leg 1 --amplitude 2 --hz 50 --samples 20000
    Inject(InjectArguments),
    /// End the test signal, and leave the loop open or closed as it is.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 end-injection
    EndInjection,
    /// Record samples at the full rate, as CSV on standard output: time from the trigger, sensors and
    /// leg forces.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 record models/yours.toml --after 2000 > record.csv
    Record(RecordArguments),
    /// Print the samples before the latched fault, as CSV on standard output: time to the last one,
    /// sensors and leg forces.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 snapshot models/yours.toml > fault.csv
    Snapshot(Units),
    /// Print one of N samples, live, as CSV on standard output: time since power-up, mode, gain, whether
    /// the clamp was active, sensors and leg forces.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 telemetry models/yours.toml --every 2000
    Telemetry {
        #[command(flatten)]
        units: Units,
        /// Send every Nth sample.
        #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..))]
        every: u32,
        /// Number of samples to print [default: until the command is stopped].
        #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
        count: Option<u64>,
    },
    /// Show the processor's load, longest step, jitter, unused stack and last restart.
    ///
    /// Example: host-gen link --at /dev/ttyACM0 health
    Health,
    /// Show rms and peak of every sensor and leg over the last quarter of a second, the largest
    /// leg force and the processor's load.
    ///
    /// Example: host-gen link --at /dev/ttyACM0 levels --watch
    Levels(LevelsArguments),
}

#[derive(Args)]
struct InjectArguments {
    /// Type of the test signal.
    #[arg(long, value_enum)]
    signal: SignalKind,
    /// Leg, 1 to 6.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=6))]
    leg: u8,
    /// Amplitude of the test signal, N.
    #[arg(long, value_parser = above_zero, allow_negative_numbers = true)]
    amplitude: f32,
    /// Length of the test signal, samples.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=i64::from(LONGEST)))]
    samples: u32,
    /// Frequency of a sine, or start of a sweep, Hz.
    #[arg(long, default_value_t = 50.0, value_parser = above_zero, allow_negative_numbers = true)]
    hz: f32,
    /// End of a sweep, Hz.
    #[arg(long, default_value_t = 200.0, value_parser = above_zero, allow_negative_numbers = true)]
    to: f32,
    /// Seed of noise.
    #[arg(long, default_value_t = 1)]
    seed: u32,
    /// Return at once.
    #[arg(long)]
    no_wait: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum SignalKind {
    Sine,
    Sweep,
    Noise,
}

/// In what units samples are printed.
#[derive(Args)]
struct Units {
    /// Machine file that the board's table was made from, for its units.
    #[arg(required_unless_present = "raw")]
    model: Option<PathBuf>,
    /// Codes of the converters instead of units, and sample numbers instead of time.
    #[arg(long, conflicts_with = "model")]
    raw: bool,
}

#[derive(Args)]
struct RecordArguments {
    #[command(flatten)]
    units: Units,
    /// Event that starts the recording.
    #[arg(long, value_enum, default_value_t = TriggerKind::Now)]
    trigger: TriggerKind,
    /// Sensor for the trigger `rise`: 1 to 6, or 7 to 12 for the second kind of sensors.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=12))]
    sensor: u8,
    /// ADC code that the sensor must exceed for the trigger `rise`.
    #[arg(long, default_value_t = 0, allow_negative_numbers = true)]
    level: i16,
    /// Number of samples from before the trigger.
    #[arg(long, default_value_t = 0)]
    before: u32,
    /// Number of samples from the trigger on.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..))]
    after: u32,
}

#[derive(Clone, Copy, ValueEnum)]
enum TriggerKind {
    Now,
    Fault,
    Injection,
    Rise,
}

#[derive(Args)]
struct SendTableArguments {
    /// Machine file.
    #[arg(required_unless_present = "forget")]
    model: Option<PathBuf>,
    /// Return to the table that is compiled into the firmware.
    #[arg(long, conflicts_with = "model")]
    forget: bool,
}

#[derive(Args)]
struct FrfArguments {
    /// Machine file that the board's table was made from.
    model: PathBuf,
    /// Lowest frequency, Hz.
    #[arg(long, default_value_t = MeasurementSettings::USUAL.band[0], allow_negative_numbers = true)]
    from: f64,
    /// Highest frequency, Hz.
    #[arg(long, default_value_t = MeasurementSettings::USUAL.band[1], allow_negative_numbers = true)]
    to: f64,
    /// Only the first pass, with fewer lines and shorter windows, in a third of the time.
    #[arg(long)]
    coarse: bool,
    /// Largest force of the test signal, N [default: from the model, so that the forces stay
    /// within half their limits (a tenth with the loop closed), the sensors within a third of
    /// the ADC's range, and both within what the supervisor takes for a fault].
    #[arg(long, allow_negative_numbers = true)]
    amplitude: Option<f64>,
    /// Number of windows to average, at least 2.
    #[arg(long, default_value_t = MeasurementSettings::USUAL.averages)]
    averages: u32,
    /// Number of windows to wait first, until transients have died out.
    #[arg(long, default_value_t = MeasurementSettings::USUAL.settling)]
    settling: u32,
}

pub fn link(arguments: &LinkArguments, searcher: &Searcher) -> Result<(), Failure> {
    let format = arguments.format;
    let connect = || {
        let _waiting = waiting(format!("waiting for a reply from {}", arguments.at));
        Client::connect(&arguments.at)
    };
    match &arguments.action {
        // What takes long comes before the connection.
        Action::Table(SendTableArguments {
            model: Some(model), ..
        }) => {
            let table = searcher.design(model, &study(model)?)?.table;
            let mut client = connect()?;
            let sending = waiting("waiting until the board has stored the table".to_owned());
            client.send_table(&table)?;
            drop(sending);
            print::result(format, &IdentityView(client.identity()?))
        }
        Action::Table(SendTableArguments { model: None, .. }) => {
            let mut client = connect()?;
            client.command(Request::Forget)?;
            print::result(format, &IdentityView(client.identity()?))
        }
        Action::Frf(arguments) => measured(connect, arguments, format, searcher),
        Action::OnBoard(action) => with_board(&mut connect()?, action, format),
    }
}

fn with_board(client: &mut Client, action: &OnBoard, format: Format) -> Result<(), Failure> {
    match action {
        OnBoard::Status => status(client, format),
        OnBoard::Identity => print::result(format, &IdentityView(client.identity()?)),
        OnBoard::SelfTest => {
            undone(
                client,
                "waiting for the end of the self-test",
                |client| {
                    client.command(Request::SelfTest)?;
                    client.wait_for(|report| report.mode != Mode::Testing)
                },
                |client| {
                    client
                        .command(Request::Stop)
                        .map(|()| "the self-test is ended")
                },
            )?;
            status(client, format)
        }
        OnBoard::Start { no_wait: true } => {
            client.command(Request::Start)?;
            status(client, format)
        }
        OnBoard::Start { no_wait: false } => {
            undone(
                client,
                "waiting until the loop is closed",
                |client| {
                    client.command(Request::Start)?;
                    client.wait_for(|report| report.mode != Mode::Starting)
                },
                |client| {
                    client
                        .command(Request::Stop)
                        .map(|()| "the loop is opened again")
                },
            )?;
            status(client, format)
        }
        OnBoard::Stop { no_wait } => {
            client.command(Request::Stop)?;
            if !no_wait {
                let _waiting = waiting("waiting until the legs are at rest".to_owned());
                client.wait_for(|report| report.mode != Mode::Stopping)?;
            }
            status(client, format)
        }
        OnBoard::Clear => {
            client.command(Request::Clear)?;
            status(client, format)
        }
        OnBoard::Gain { part } => {
            client.command(Request::SetGain(*part))?;
            status(client, format)
        }
        OnBoard::Inject(arguments) => {
            inject(client, arguments)?;
            status(client, format)
        }
        OnBoard::EndInjection => {
            client.end_injection()?;
            status(client, format)
        }
        OnBoard::Record(arguments) => {
            let columns = Columns::new(client, &arguments.units)?;
            let records = record(client, arguments)?;
            // A trigger that comes early leaves fewer before it, but none after it are missing.
            let before = records.len().saturating_sub(arguments.after as usize);
            columns.print(&records, before)
        }
        OnBoard::Snapshot(units) => {
            let columns = Columns::new(client, units)?;
            let records = client.records(Request::Snapshot)?;
            columns.print(&records, records.len().saturating_sub(1))
        }
        OnBoard::Telemetry {
            units,
            every,
            count,
        } => telemetry(client, units, *every, *count),
        OnBoard::Health => print::result(format, &HealthView(client.health()?)),
        OnBoard::Levels(arguments) => levels::levels(client, arguments, format),
    }
}

/// Does `work`, which begins something on the board. If a signal ends the program meanwhile,
/// `undo` ends that on the board, too, and says so.
fn undone<T, E: Into<Failure>>(
    client: &mut Client,
    wait: &str,
    work: impl FnOnce(&mut Client) -> Result<T, E>,
    undo: impl FnOnce(&mut Client) -> Result<&'static str, LinkError>,
) -> Result<T, Failure> {
    let signals = Signals::catch()?;
    client.stop_when(signals.came.clone());
    let waiting = waiting(wait.to_owned());
    let outcome = work(client).map_err(Into::into);
    drop(waiting);
    match outcome {
        Err(Failure::Link(LinkError::Interrupted)) => Err(Failure::Interrupted {
            board: match client.uninterrupted(undo) {
                Ok(board) => board.to_owned(),
                Err(error) => format!("what was begun on the board could not be ended: {error}"),
            },
            code: signals.exit_code(),
        }),
        outcome => outcome,
    }
}

/// Ends the test signal, for [`undone`].
fn end_injection(client: &mut Client) -> Result<&'static str, LinkError> {
    client.end_injection().map(|_| "the test signal is ended")
}

fn inject(client: &mut Client, arguments: &InjectArguments) -> Result<(), Failure> {
    let highest = 0.5 * client.identity()?.sample_rate;
    let sines: &[(&str, f32)] = match arguments.signal {
        SignalKind::Sine => &[("--hz", arguments.hz)],
        SignalKind::Sweep => &[("--hz", arguments.hz), ("--to", arguments.to)],
        SignalKind::Noise => &[],
    };
    for &(option, hz) in sines {
        if hz > highest {
            let must = format!("be at most {highest} Hz, half the board's sample rate");
            return Err(Failure::Setting { option, must });
        }
    }
    let begin = |client: &mut Client| match client.command(Request::Inject(injection(arguments))) {
        // The host has checked all other numbers.
        Err(LinkError::Refused(Refusal::Range)) => Err(Failure::Setting {
            option: "--amplitude",
            must: format!(
                "be lower: the test signal could exceed the force limit of leg {}",
                arguments.leg
            ),
        }),
        other => Ok(other?),
    };
    if arguments.no_wait {
        return begin(client);
    }
    let wait = "waiting for the end of the test signal";
    let work = |client: &mut Client| {
        begin(client)?;
        client.wait_for(|report| report.injecting == 0)?;
        Ok::<_, Failure>(())
    };
    undone(client, wait, work, end_injection)
}

fn record(client: &mut Client, arguments: &RecordArguments) -> Result<Vec<Record>, Failure> {
    let room = client.identity()?.room;
    let (before, after) = (arguments.before, arguments.after);
    if u64::from(before) + u64::from(after) > u64::from(room) {
        return Err(Failure::Setting {
            option: "--before and --after",
            must: format!("be at most {room} together, the records in the board's recorder"),
        });
    }
    let trigger = match arguments.trigger {
        TriggerKind::Now => Trigger::Now,
        TriggerKind::Fault => Trigger::Fault,
        TriggerKind::Injection => Trigger::Injection,
        TriggerKind::Rise => Trigger::Rise {
            sensor: arguments.sensor - 1,
            level: AdcCode(arguments.level),
        },
    };
    let _waiting = waiting("waiting for the trigger and the recording".to_owned());
    let recording = Recording {
        trigger,
        before,
        after,
    };
    Ok(client.record(recording)?.0)
}

/// Parses a loop gain.
fn part(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(part) if part > 0.0 && part <= 1.0 => Ok(part),
        _ => Err("must be above 0 and at most 1".to_owned()),
    }
}

fn injection(inject: &InjectArguments) -> Injection {
    let mut legs = [0.0; LEGS];
    legs[usize::from(inject.leg) - 1] = inject.amplitude;
    let signal = match inject.signal {
        SignalKind::Sine => Signal::Sine { hz: inject.hz },
        SignalKind::Sweep => Signal::Sweep {
            from: inject.hz,
            to: inject.to,
        },
        SignalKind::Noise => Signal::Noise { seed: inject.seed },
    };
    Injection {
        signal,
        legs,
        samples: inject.samples,
    }
}

/// Prints the status. A latched fault is an error of the command, so that a script stops.
fn status(client: &mut Client, format: Format) -> Result<(), Failure> {
    let report = client.report()?;
    let rate = f64::from(client.identity()?.sample_rate);
    print::result(format, &StatusView { report, rate })?;
    match report.fault {
        Some(fault) => Err(Failure::Fault(cause(fault.cause))),
        None => Ok(()),
    }
}

#[derive(Serialize)]
struct StatusView {
    #[serde(flatten)]
    report: ControllerReport,
    #[serde(skip)]
    rate: f64,
}

impl Display for StatusView {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let report = &self.report;
        let seconds = |samples: u64| samples as f64 / self.rate;
        writeln!(
            f,
            "{}, {:.3} s since power-up",
            match report.mode {
                Mode::Untested => "not tested",
                Mode::Testing => "self-test running",
                Mode::Idle => "idle: tested, legs at rest",
                Mode::Starting => "soft start: closing the loop",
                Mode::Closed => "loop closed",
                Mode::Stopping => "soft stop: opening the loop",
                Mode::Failing => "fault: legs are brought to rest",
                Mode::Failed => "fault: legs at rest",
            },
            seconds(report.at)
        )?;
        if let Some(LatchedFault { cause: why, at }) = report.fault {
            writeln!(f, "  fault at {:.4} s: {}", seconds(at), cause(why))?;
        }
        writeln!(f, "  gain {}, target {}", report.gain, report.target)?;
        writeln!(
            f,
            "  {} samples clamped, {} samples late, {} samples lost; {} telemetry packets dropped",
            report.clamped, report.late, report.lost, report.dropped
        )?;
        if report.injecting > 0 {
            writeln!(f, "  test signal: another {} samples", report.injecting)?;
        }
        match report.recorded {
            Recorded::Off => Ok(()),
            Recorded::Waiting => writeln!(f, "  recorder: waiting for the trigger"),
            Recorded::Running => writeln!(f, "  recorder: running"),
            Recorded::Done { length, before, .. } => writeln!(
                f,
                "  recorder: {length} samples, {before} of them from before the trigger"
            ),
        }
    }
}

#[derive(Serialize)]
struct IdentityView(Identity);

impl Display for IdentityView {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let identity = &self.0;
        write!(
            f,
            "table {:08x}, format {}, {} Hz, recorder for {} records\n  made from the model {}",
            identity.checksum, identity.format, identity.sample_rate, identity.room, identity.model
        )?;
        let sent = if identity.sent {
            "sent over the link"
        } else {
            "compiled in"
        };
        writeln!(f, "\n  {sent}")
    }
}

#[derive(Serialize)]
struct HealthView(Health);

impl Display for HealthView {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let health = &self.0;
        let restart = match health.restart {
            Restart::Power => "power",
            Restart::Pin => "reset pin",
            Restart::Watchdog => "watchdog",
            Restart::Panic => "panic",
            Restart::HardFault => "hard fault",
            Restart::BrownOut => "supply voltage too low",
            Restart::Clock => "external clock failed",
        };
        writeln!(f, "last restart: {restart}")?;
        if health.period == 0 {
            return writeln!(f, "  processing time: not measured");
        }
        let us = |ns: u32| f64::from(ns) * 1e-3;
        let part = |ns: u32| 100.0 * f64::from(ns) / f64::from(health.period);
        writeln!(
            f,
            "  sample: {:.1} µs of {:.1} ({:.0} %), at most {:.1} µs ({:.0} %); codes written after {:.1} µs; jitter {:.2} µs",
            us(health.usual),
            us(health.period),
            part(health.usual),
            us(health.longest),
            part(health.longest),
            us(health.written),
            us(health.jitter)
        )?;
        writeln!(f, "  stack never used: {} bytes", health.stack)
    }
}

/// Time between two questions whether the board is still there, while it sends telemetry.
const ALIVE: Duration = Duration::from_secs(1);

fn telemetry(
    client: &mut Client,
    units: &Units,
    every: u32,
    count: Option<u64>,
) -> Result<(), Failure> {
    let columns = Columns::new(client, units)?;
    let off = |client: &mut Client| client.command(Request::Telemetry(0));
    let work = |client: &mut Client| {
        client.command(Request::Telemetry(every))?;
        let mut table = csv::Writer::from_writer(io::stdout());
        let mut printed = 0;
        let mut asked = Instant::now();
        while count.is_none_or(|count| printed < count) {
            if asked.elapsed() > ALIVE {
                client.report()?;
                asked = Instant::now();
            }
            let Some(telemetry) = client.telemetry()? else {
                continue;
            };
            let front = [
                columns.time(telemetry.at as i64),
                format!("{:?}", telemetry.mode),
                telemetry.gain.to_string(),
                telemetry.status.clamped.to_string(),
            ];
            let mut shown = Ok(());
            if printed == 0 {
                let head = [columns.clock(), "mode", "gain", "clamped"];
                shown = row(&mut table, head, columns.names());
            }
            shown = shown.and_then(|()| row(&mut table, front, columns.values(&telemetry.record)));
            if shown.is_err() {
                off(client)?;
                return print::written(shown);
            }
            printed += 1;
        }
        Ok::<_, Failure>(off(client)?)
    };
    let wait = "waiting for telemetry";
    undone(client, wait, work, |client| {
        off(client).map(|()| "telemetry is off")
    })
}

/// The columns in which samples are printed.
struct Columns {
    /// None for the codes of the converters.
    scales: Option<Scales>,
    /// Sample rate, Hz.
    rate: f64,
}

impl Columns {
    fn new(client: &mut Client, units: &Units) -> Result<Self, Failure> {
        let board = client.identity()?;
        let scales = match &units.model {
            None => None,
            Some(model) => {
                let machine = Machine::load(model)?;
                if board.model != machine.digest {
                    return Err(FrfError::OtherTable.into());
                }
                Some(Scales::new(&machine))
            }
        };
        let rate = board.sample_rate.into();
        Ok(Self { scales, rate })
    }

    /// The name of the column with the time.
    fn clock(&self) -> &'static str {
        match self.scales {
            Some(_) => "time [s]",
            None => "at",
        }
    }

    /// The time of a sample.
    fn time(&self, sample: i64) -> String {
        match self.scales {
            Some(_) => print::seconds(sample as f64 / self.rate),
            None => sample.to_string(),
        }
    }

    /// The names of the columns with what a record has.
    fn names(&self) -> Vec<String> {
        match &self.scales {
            Some(scales) => scales.columns().to_vec(),
            None => {
                let names = ["sensor", "force", "dac"].into_iter();
                let each = |name| (1..=LEGS).map(move |i| format!("{name}{i}"));
                names.flat_map(each).collect()
            }
        }
    }

    fn values(&self, record: &Record) -> Vec<String> {
        match &self.scales {
            Some(scales) => scales.values(record).map(|x| x.to_string()).collect(),
            None => {
                let adc = record.adc.sensors.iter().chain(&record.adc.forces);
                let dac = record.dac.iter().map(|code| code.0.to_string());
                adc.map(|code| code.0.to_string()).chain(dac).collect()
            }
        }
    }

    /// Prints records; time 0 is that of the one with the index `zero`.
    fn print(&self, records: &[Record], zero: usize) -> Result<(), Failure> {
        let mut table = csv::Writer::from_writer(io::stdout());
        let mut written = row(&mut table, [self.clock()], self.names());
        for (i, record) in records.iter().enumerate() {
            let time = self.time(i as i64 - zero as i64);
            written = written.and_then(|()| row(&mut table, [time], self.values(record)));
        }
        print::written(written)
    }
}

/// Writes a row and flushes it: a reader may wait for it.
fn row<const N: usize, T: Into<String>>(
    table: &mut csv::Writer<io::Stdout>,
    front: [T; N],
    values: Vec<String>,
) -> io::Result<()> {
    table.write_record(front.into_iter().map(T::into).chain(values))?;
    table.flush()
}

#[derive(Serialize)]
struct FrfView(Measurement);

fn measured(
    connect: impl FnOnce() -> Result<Client, LinkError>,
    arguments: &FrfArguments,
    format: Format,
    searcher: &Searcher,
) -> Result<(), Failure> {
    let settings = MeasurementSettings {
        band: [arguments.from, arguments.to],
        averages: arguments.averages,
        settling: arguments.settling,
        coarse: arguments.coarse,
        amplitude: arguments.amplitude,
    };
    settings.check()?;
    let study = study(&arguments.model)?;
    let table = searcher.design(&arguments.model, &study)?.table;
    let rate = table.get().sample_rate.into();
    let seconds = settings.duration(rate)?;
    let mut client = connect()?;
    let bar = Bar::of(settings.windows());
    let wait = format!("measuring leg by leg: {seconds:.0} s of signals, and the time of the link");
    let work = |client: &mut Client| measure(client, &study, &table, &settings, &bar);
    let measurement = undone(&mut client, &wait, work, end_injection);
    drop(bar);
    print::result(format, &FrfView(measurement?))
}

impl Display for FrfView {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Measurement { resonances, lines } = &self.0;
        let closed = lines.iter().any(|line| line.sensitivity.is_some());
        writeln!(
            f,
            "Plant measured with the loop {}: difference from the model, and the difference expected from noise\n      Hz      N   diff., %   noise, %{}",
            if closed { "closed" } else { "open" },
            if closed {
                "   sensitivity      of model"
            } else {
                ""
            }
        )?;
        for line in lines {
            write!(
                f,
                "  {:>6.2}  {:>5.2}   {:>8.3}   {:>8.3}",
                line.hz,
                line.amplitude,
                100.0 * line.error,
                100.0 * line.expected_error,
            )?;
            if let Some(MeasuredSensitivity {
                measured, designed, ..
            }) = line.sensitivity
            {
                write!(f, "   {measured:>11.4}   {designed:>11.4}")?;
            }
            writeln!(f)?;
        }
        if !resonances.is_empty() {
            writeln!(f, "Resonances in these responses\n      Hz   damping, %")?;
        }
        for resonance in resonances {
            let Resonance { hz, damping } = resonance;
            writeln!(f, "  {hz:>6.2}   {:>10.2}", 100.0 * damping)?;
        }
        Ok(())
    }
}
