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
    /// Show mode, gain, faults and counters.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 status
    Status,
    /// Show which table the board runs.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 identity
    Identity,
    /// Test sensors and legs: each leg pushes a little, and every sensor must respond as
    /// the model predicts. Waits for the end.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 self-test
    SelfTest,
    /// Close the loop with a soft start. Waits until it is closed.
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
        part: f32,
    },
    /// Add a test signal to a leg.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 inject --signal sine --leg 1 --amplitude 2 --hz 50 --samples 20000
    Inject(InjectArguments),
    /// Record samples at the full rate, as CSV on standard output.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 record --after 2000 > record.csv
    Record(RecordArguments),
    /// Print the samples before the latched fault, as CSV on standard output.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 snapshot > fault.csv
    Snapshot,
    /// Print one of N samples, live, as CSV on standard output.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 telemetry --every 2000
    Telemetry {
        /// Send every Nth sample.
        #[arg(long, default_value_t = 200)]
        every: u32,
        /// Number of samples to print [default: until the command is stopped].
        #[arg(long)]
        count: Option<u64>,
    },
    /// Show the processor's load, longest step, jitter, unused stack and last restart.
    ///
    /// Example: host-gen link --at /dev/ttyACM0 health
    Health,
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

#[derive(Args)]
struct InjectArguments {
    /// Type of the test signal.
    #[arg(long, value_enum)]
    signal: SignalKind,
    /// Leg, 1 to 6.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=6))]
    leg: u8,
    /// Amplitude of the test signal, N; of a multisine, the amplitude of each sine.
    #[arg(long)]
    amplitude: f32,
    /// Length of the test signal, samples.
    #[arg(long)]
    samples: u32,
    /// Frequency of a sine, or start of a sweep, Hz.
    #[arg(long, default_value_t = 50.0)]
    hz: f32,
    /// End of a sweep, Hz.
    #[arg(long, default_value_t = 200.0)]
    to: f32,
    /// Period of a multisine, samples.
    #[arg(long, default_value_t = 8192)]
    period: u32,
    /// Seed of noise.
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
    /// Return to the table that is compiled into the firmware.
    #[arg(long, conflicts_with = "model")]
    forget: bool,
}

#[derive(Args)]
struct FrfArguments {
    /// Machine file that the board's table was made from.
    model: PathBuf,
    /// Amplitude of each sine, N.
    #[arg(long, default_value_t = 1.0)]
    amplitude: f64,
    /// Number of periods to average.
    #[arg(long, default_value_t = 8)]
    averages: u32,
    /// Number of periods to wait first, until transients have died out.
    #[arg(long, default_value_t = 30)]
    settling: u32,
    /// Samples in a period: a power of two, at least 512.
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
            "table {:08x}, format {}, {} Hz, recorder for {} records\n  made from the model ",
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
            Restart::Pin => "reset pin",
            Restart::Watchdog => "watchdog",
            Restart::Panic => "panic",
            Restart::HardFault => "hard fault",
        };
        writeln!(f, "last restart: {restart}")?;
        if health.period == 0 {
            return writeln!(f, "  processing time: not measured");
        }
        let us = |ns: u32| f64::from(ns) * 1e-3;
        let part = |ns: u32| 100.0 * f64::from(ns) / f64::from(health.period);
        writeln!(
            f,
            "  step: {:.1} µs of {:.1} ({:.0} %), at most {:.1} µs ({:.0} %); jitter {:.2} µs",
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

/// The names of the columns with a record's codes.
fn columns() -> impl Iterator<Item = String> {
    let names = ["sensor", "force", "dac"].into_iter();
    names.flat_map(|name| (1..=LEGS).map(move |i| format!("{name}{i}")))
}

fn codes(record: &Record) -> impl Iterator<Item = String> {
    let adc = record.adc.sensors.iter().chain(&record.adc.forces);
    let dac = record.dac.iter().map(|code| code.0.to_string());
    adc.map(|code| code.0.to_string()).chain(dac)
}

/// Writes a row and flushes it: a reader may wait for it.
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

/// Shortest period of a measurement, samples: the multisine's lines lie below half of it.
const SHORTEST: u32 = 512;

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
    if !arguments.period.is_power_of_two() || arguments.period < SHORTEST {
        return Err(Failure::Period(SHORTEST));
    }
    let study = study(&arguments.model)?;
    let table = searcher.design(&arguments.model, &study)?.table;
    let settings = MeasurementSettings {
        period: arguments.period,
        averages: arguments.averages.max(1),
        settling: arguments.settling,
        amplitude: arguments.amplitude,
    };
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
            "Plant measured with the loop {}: difference from the model, and the difference expected from noise\n      Hz  diff., %   noise, %   coherence{}",
            if closed { "closed" } else { "open" },
            if closed {
                "   sensitivity      of model"
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
