//! `host-gen link`.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use host_gen::board::link::{Address, Client};
use host_gen::board::measure::{FrfError, MeasuredLine, MeasurementSettings, measure, multisine};
use host_gen::board::words::cause;
use serde::Serialize;
use shared::LEGS;
use shared::codes::AdcCode;
use shared::controller::{ControllerReport, Health, Identity, Restart};
use shared::injection::{Injection, Signal};
use shared::link::Request;
use shared::recorder::{Record, Recorded, Recording, Trigger};
use shared::supervisor::{LatchedFault, Mode};

use crate::arguments::Format;
use crate::failure::Failure;
use crate::print;
use crate::search::{Bar, Searcher, study};

#[derive(Args)]
pub struct LinkArguments {
    /// HOST:PORT, or the path of a serial port.
    #[arg(long)]
    at: Address,
    /// What to print: text for people, JSON (docs/json.md) for programs.
    #[arg(long, value_enum, default_value_t = Format::Text, global = true)]
    format: Format,
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// How things stand.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 status
    Status,
    /// Table and build.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 identity
    Identity,
    /// Each leg pushes a little, every sensor is to answer as the model says; waits
    /// for the end.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 self-test
    SelfTest,
    /// Closes the loop, gently; waits until it is closed.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 start
    Start {
        /// Comes back at once.
        #[arg(long)]
        no_wait: bool,
    },
    /// Opens the loop, gently, or ends a test or an injection; waits for it.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 stop
    Stop {
        /// Comes back at once.
        #[arg(long)]
        no_wait: bool,
    },
    /// Forgets a latched fault.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 clear
    Clear,
    /// Aims at a part of the law's force.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 gain 0.1
    Gain {
        /// Above 0 and up to 1.
        part: f32,
    },
    /// Pushes the legs.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 inject --signal sine --leg 1 --amplitude 2 --hz 50 --samples 20000
    Inject(InjectArguments),
    /// Records samples at full rate, as CSV on standard output.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 record --after 2000 > record.csv
    Record(RecordArguments),
    /// The samples before the latched fault, as CSV on standard output.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 snapshot > fault.csv
    Snapshot,
    /// One sample out of many, live, as CSV on standard output.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 telemetry --every 2000
    Telemetry {
        /// Out of how many.
        #[arg(long, default_value_t = 200)]
        every: u32,
        /// How many to print; without it, until stopped.
        #[arg(long)]
        count: Option<u64>,
    },
    /// How the board's processor does: load, longest run, jitter, stack, last restart.
    ///
    /// Example: host-gen link --at /dev/ttyACM0 health
    Health,
    /// Sends the table that a machine file gives; the board checks it whole, keeps it
    /// through power failure and runs it, untested. Only while the legs are at rest.
    ///
    /// Example: host-gen link --at /dev/ttyACM0 table models/yours.toml
    Table(SendTableArguments),
    /// Measures the plant in place, and with the loop closed its sensitivity, and
    /// lays them over the model's.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 frf models/yours.toml
    Frf(FrfArguments),
}

#[derive(Args)]
struct InjectArguments {
    /// The signal.
    #[arg(long, value_enum)]
    signal: SignalKind,
    /// Leg, 1 to 6.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=6))]
    leg: u8,
    /// Its size, N; of a multisine, that of each sine.
    #[arg(long)]
    amplitude: f32,
    /// How long, samples.
    #[arg(long)]
    samples: u32,
    /// Of a sine, and where a sweep begins, Hz.
    #[arg(long, default_value_t = 50.0)]
    hz: f32,
    /// Where a sweep ends, Hz.
    #[arg(long, default_value_t = 200.0)]
    to: f32,
    /// Of a multisine: samples after which it repeats.
    #[arg(long, default_value_t = 8192)]
    period: u32,
    /// Of noise.
    #[arg(long, default_value_t = 1)]
    seed: u32,
}

#[derive(Clone, Copy, ValueEnum)]
enum SignalKind {
    Sine,
    Sweep,
    Multisine,
    Noise,
}

#[derive(Args)]
struct RecordArguments {
    /// When.
    #[arg(long, value_enum, default_value_t = TriggerKind::Now)]
    trigger: TriggerKind,
    /// Sensor, 1 to 6, or force sensor beside them, 7 to 12, whose rise is the
    /// trigger.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=12))]
    sensor: u8,
    /// Code that it rises past.
    #[arg(long, default_value_t = 0, allow_negative_numbers = true)]
    level: i16,
    /// Samples from before the trigger.
    #[arg(long, default_value_t = 0)]
    before: u32,
    /// Samples from the trigger on.
    #[arg(long, default_value_t = 1000)]
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
    /// Goes back to the table compiled into the firmware.
    #[arg(long, conflicts_with = "model")]
    forget: bool,
}

#[derive(Args)]
struct FrfArguments {
    /// Machine file that the board's table was made from.
    model: PathBuf,
    /// Of each sine, N.
    #[arg(long, default_value_t = 1.0)]
    amplitude: f64,
    /// Periods to average over.
    #[arg(long, default_value_t = 8)]
    averages: u32,
    /// Periods to wait first; the slowest swing must have died out.
    #[arg(long, default_value_t = 30)]
    settling: u32,
    /// Samples in a period.
    #[arg(long, default_value_t = 8192)]
    period: u32,
}

pub fn link(arguments: &LinkArguments, searcher: &Searcher) -> Result<(), Failure> {
    let mut client = Client::connect(&arguments.at)?;
    let format = arguments.format;
    match &arguments.action {
        Action::Status => status(&mut client, format),
        Action::Identity => print::result(format, &IdentityView(client.identity()?)),
        Action::SelfTest => {
            client.command(Request::SelfTest)?;
            client.wait_for(|report| report.mode != Mode::Testing)?;
            status(&mut client, format)
        }
        Action::Start { no_wait } => {
            client.command(Request::Start)?;
            if !no_wait {
                client.wait_for(|report| report.mode != Mode::Starting)?;
            }
            status(&mut client, format)
        }
        Action::Stop { no_wait } => {
            client.command(Request::Stop)?;
            if !no_wait {
                client.wait_for(|report| report.mode != Mode::Stopping)?;
            }
            status(&mut client, format)
        }
        Action::Clear => {
            client.command(Request::Clear)?;
            status(&mut client, format)
        }
        Action::Gain { part } => {
            client.command(Request::SetGain(*part))?;
            status(&mut client, format)
        }
        Action::Inject(inject) => {
            client.command(Request::Inject(injection(inject)))?;
            status(&mut client, format)
        }
        Action::Record(record) => {
            let trigger = match record.trigger {
                TriggerKind::Now => Trigger::Now,
                TriggerKind::Fault => Trigger::Fault,
                TriggerKind::Injection => Trigger::Injection,
                TriggerKind::Rise => Trigger::Rise {
                    sensor: record.sensor - 1,
                    level: AdcCode(record.level),
                },
            };
            let (before, after) = (record.before, record.after);
            let recording = Recording {
                trigger,
                before,
                after,
            };
            let (records, _) = client.record(recording)?;
            csv(&records)
        }
        Action::Snapshot => {
            let records = client.records(Request::Snapshot)?;
            csv(&records)
        }
        Action::Telemetry { every, count } => telemetry(&mut client, *every, *count),
        Action::Health => print::result(format, &HealthView(client.health()?)),
        Action::Table(table) => {
            match &table.model {
                Some(model) => {
                    let study = study(model)?;
                    client.send_table(&searcher.design(model, &study)?.table)?;
                }
                None => client.command(Request::Forget)?,
            }
            print::result(format, &IdentityView(client.identity()?))
        }
        Action::Frf(arguments) => measured(&mut client, arguments, format, searcher),
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
        SignalKind::Multisine => multisine(inject.period),
        SignalKind::Noise => Signal::Noise { seed: inject.seed },
    };
    Injection {
        signal,
        legs,
        samples: inject.samples,
    }
}

/// How things stand, as printed. A latched fault is an error of the command, so
/// that a script stops.
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
            "{}, {:.3} s since power came",
            match report.mode {
                Mode::Untested => "not tested",
                Mode::Testing => "testing sensors and legs",
                Mode::Idle => "idle: tested, legs at rest",
                Mode::Starting => "closing the loop",
                Mode::Closed => "loop closed",
                Mode::Stopping => "opening the loop",
                Mode::Failing => "fault, legs going to rest",
                Mode::Failed => "fault, legs at rest",
            },
            seconds(report.at)
        )?;
        if let Some(LatchedFault { cause: why, at }) = report.fault {
            writeln!(f, "  fault at {:.4} s: {}", seconds(at), cause(why))?;
        }
        writeln!(f, "  gain {} of {}", report.gain, report.target)?;
        writeln!(
            f,
            "  clamped in {}, late in {}, not read in {} samples; telemetry dropped {}",
            report.clamped, report.late, report.lost, report.dropped
        )?;
        if report.injecting > 0 {
            writeln!(f, "  injecting for another {} samples", report.injecting)?;
        }
        match report.recorded {
            Recorded::Off => Ok(()),
            Recorded::Waiting => writeln!(f, "  recorder: waits for its trigger"),
            Recorded::Running => writeln!(f, "  recorder: runs"),
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
            "table {:08x}, layout {}, {} Hz, room for {} records\n  made from model ",
            identity.checksum, identity.format, identity.sample_rate, identity.room
        )?;
        for byte in identity.model.0 {
            write!(f, "{byte:02x}")?;
        }
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
            Restart::Pin => "its reset pin",
            Restart::Watchdog => "the watchdog",
            Restart::Panic => "a panic",
            Restart::HardFault => "a hard fault",
        };
        writeln!(f, "last started by {restart}")?;
        if health.period == 0 {
            return writeln!(f, "  its time is not measured");
        }
        let us = |ns: u32| f64::from(ns) * 1e-3;
        let part = |ns: u32| 100.0 * f64::from(ns) / f64::from(health.period);
        writeln!(
            f,
            "  loop: {:.1} µs of {:.1} ({:.0} %), at the most {:.1} µs ({:.0} %); jitter {:.2} µs",
            us(health.usual),
            us(health.period),
            part(health.usual),
            us(health.longest),
            part(health.longest),
            us(health.jitter)
        )?;
        writeln!(f, "  stack never used: {} bytes", health.stack)
    }
}

fn telemetry(client: &mut Client, every: u32, count: Option<u64>) -> Result<(), Failure> {
    client.command(Request::Telemetry(every))?;
    let mut table = csv::Writer::from_writer(std::io::stdout());
    let mut printed = 0;
    while count.is_none_or(|count| printed < count) {
        if let Some(telemetry) = client.telemetry()? {
            if printed == 0 {
                row(&mut table, ["at", "mode", "gain", "clamped"], columns())?;
            }
            let front = [
                telemetry.at.to_string(),
                format!("{:?}", telemetry.mode),
                telemetry.gain.to_string(),
                telemetry.status.clamped.to_string(),
            ];
            row(&mut table, front, codes(&telemetry.record))?;
            printed += 1;
        }
    }
    Ok(client.command(Request::Telemetry(0))?)
}

fn csv(records: &[Record]) -> Result<(), Failure> {
    let mut table = csv::Writer::from_writer(std::io::stdout());
    row(&mut table, [] as [&str; 0], columns())?;
    for record in records {
        row(&mut table, [] as [&str; 0], codes(record))?;
    }
    Ok(())
}

/// What the columns of a record's codes are called.
fn columns() -> impl Iterator<Item = String> {
    let names = ["sensor", "force", "dac"].into_iter();
    names.flat_map(|name| (1..=LEGS).map(move |i| format!("{name}{i}")))
}

fn codes(record: &Record) -> impl Iterator<Item = String> {
    let adc = record.adc.sensors.iter().chain(&record.adc.forces);
    let dac = record.dac.iter().map(|code| code.0.to_string());
    adc.map(|code| code.0.to_string()).chain(dac)
}

/// A row, at once: whoever reads live waits for it.
fn row<const N: usize, T: Into<String>>(
    table: &mut csv::Writer<std::io::Stdout>,
    front: [T; N],
    codes: impl Iterator<Item = String>,
) -> Result<(), Failure> {
    let row = front.into_iter().map(T::into).chain(codes);
    let written = table.write_record(row).map_err(std::io::Error::from);
    written
        .and_then(|()| table.flush())
        .map_err(|error| Failure::Io {
            path: "standard output".to_owned(),
            what: "written",
            error,
        })
}

#[derive(Serialize)]
struct FrfView {
    lines: Vec<MeasuredLine>,
}

fn measured(
    client: &mut Client,
    arguments: &FrfArguments,
    format: Format,
    searcher: &Searcher,
) -> Result<(), Failure> {
    let study = study(&arguments.model)?;
    let table = searcher.design(&arguments.model, &study)?.table;
    let settings = MeasurementSettings {
        period: arguments.period,
        averages: arguments.averages.max(1),
        settling: arguments.settling,
        amplitude: arguments.amplitude,
    };
    if !arguments.period.is_power_of_two() || arguments.period < 512 {
        return Err(Failure::Option("period"));
    }
    let bar = Bar::of(LEGS * settings.averages as usize);
    let lines = measure(client, &study, &table, &settings, &bar);
    drop(bar);
    let lines = lines.map_err(|error| match error {
        FrfError::Link(error) => Failure::Link(error),
        error => Failure::Frf(error),
    })?;
    print::result(format, &FrfView { lines })
}

impl Display for FrfView {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let closed = self.lines.iter().any(|line| line.sensitivity.is_some());
        writeln!(
            f,
            "Plant measured with the loop {}: off the model by, and by noise at that\n      Hz    off, %   noise, %   coherence{}",
            if closed { "closed" } else { "open" },
            if closed {
                "   sensitivity   the model's"
            } else {
                ""
            }
        )?;
        for line in &self.lines {
            write!(
                f,
                "  {:>6.1}  {:>8.3}   {:>8.3}   {:>9.6}",
                line.hz,
                100.0 * line.error,
                100.0 * line.expected_error,
                line.coherence
            )?;
            if let Some([measured, predicted]) = line.sensitivity {
                write!(f, "   {measured:>11.4}   {predicted:>11.4}")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
