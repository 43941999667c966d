//! The command line.
#![forbid(unsafe_code)]

use std::fmt::Display;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand, ValueEnum};
use host_gen::machine::{Machine, MachineError};
use host_gen::output::{Gains, Generated, Modes, Simulated};
use host_gen::roll_off::RollOffError;
use host_gen::simulation::{Comparison, compare};
use host_gen::study::Study;
use host_gen::table::emit;
use serde::Serialize;
use shared::table::ValidTable;

/// From a machine's geometry to a controller table that is proven on the
/// sampled, delayed loop.
#[derive(Parser)]
#[command(version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Natural frequencies and mode shapes, and M_d, D_d, K_d, M_r, B_0.
    ///
    /// Example: host-gen modes models/metrology-frame.toml
    Modes(Common),
    /// The ideal gains with T_c, the modal matrix S and the ideal poles.
    ///
    /// Example: host-gen gains models/metrology-frame.toml --format json
    Gains(Common),
    /// Everything: modes, gains, roll-off, table, software in the loop.
    ///
    /// Example: host-gen generate models/metrology-frame.toml
    Generate(WithTable),
    /// Whether a table is what the machine file gives.
    ///
    /// Example: host-gen check models/metrology-frame.toml
    Check(WithTable),
    /// Open and closed loop in time, with converters, noise and the real step.
    ///
    /// Example: host-gen simulate models/metrology-frame.toml --duration 60
    Simulate(Simulate),
}

#[derive(Args)]
struct Common {
    /// Machine file, see docs/machine-file.md.
    model: PathBuf,
    /// What to print: text for people, JSON (docs/json.md) for programs.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    Text,
    Json,
}

#[derive(Args)]
struct WithTable {
    #[command(flatten)]
    common: Common,
    /// The table's file [default: firmware/src/tables/NAME.rs].
    #[arg(long)]
    table: Option<PathBuf>,
}

#[derive(Args)]
struct Simulate {
    #[command(flatten)]
    common: Common,
    /// Measured time, s [default: the file's].
    #[arg(long)]
    duration: Option<f64>,
    /// Seed of the random numbers [default: the file's].
    #[arg(long)]
    seed: Option<u64>,
    /// Floor acceleration, rms of each input, m/s² [default: the file's].
    #[arg(long)]
    floor_rms: Option<f64>,
}

#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Machine(#[from] MachineError),
    #[error("{file}: {error}")]
    RollOff { file: String, error: RollOffError },
    #[error("{path}: cannot be {what}: {error}")]
    Io {
        path: String,
        what: &'static str,
        error: io::Error,
    },
    #[error("there is no folder {0} here; run from the project's root or give --table PATH")]
    NoTables(String),
    #[error("--{0} must be positive and finite")]
    Option(&'static str),
    #[error("{table} is not what {model} gives: {difference}. Run host-gen generate {model}")]
    Stale {
        table: String,
        model: String,
        difference: String,
    },
}

fn main() -> ExitCode {
    match run(&Cli::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Modes(common) => print(common.format, &Modes::new(&study(&common.model)?)),
        Command::Gains(common) => print(common.format, &Gains::new(&study(&common.model)?)),
        Command::Generate(arguments) => generate(arguments),
        Command::Check(arguments) => check(arguments),
        Command::Simulate(arguments) => simulate(arguments),
    }
}

fn study(model: &Path) -> Result<Study, Failure> {
    Ok(Study::new(Machine::load(model)?)?)
}

fn generate(arguments: &WithTable) -> Result<(), Failure> {
    let model = &arguments.common.model;
    let study = study(model)?;
    let path = table_path(arguments, &study.machine)?;
    let (table, roll_off) = table(model, &study)?;
    let simulation = simulation(&study, &table);
    write_whole(&path, &emit(&study.machine, &table))?;
    let report = Generated::new(&study, roll_off, path.display().to_string(), simulation);
    print(arguments.common.format, &report)
}

/// What `check` found.
#[derive(Serialize)]
struct Checked {
    table: String,
    up_to_date: bool,
    /// The first line that differs, or nothing.
    difference: Option<String>,
}

impl Display for Checked {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{} is what the machine file gives", self.table)
    }
}

fn check(arguments: &WithTable) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let study = study(model)?;
    let path = table_path(arguments, &study.machine)?;
    let (table, _) = table(model, &study)?;
    let found = fs::read_to_string(&path).map_err(|error| Failure::Io {
        path: path.display().to_string(),
        what: "read",
        error,
    })?;
    let difference = difference(&found, &emit(&study.machine, &table));
    let report = Checked {
        table: path.display().to_string(),
        up_to_date: difference.is_none(),
        difference: difference.clone(),
    };
    if *format == Format::Json || report.up_to_date {
        print(*format, &report)?;
    }
    match difference {
        None => Ok(()),
        Some(difference) => Err(Failure::Stale {
            table: report.table,
            model: model.display().to_string(),
            difference,
        }),
    }
}

/// The first line in which two texts differ.
fn difference(found: &str, expected: &str) -> Option<String> {
    if found == expected {
        return None;
    }
    let mut pairs = found.split('\n').zip(expected.split('\n'));
    Some(match pairs.by_ref().position(|(a, b)| a != b) {
        Some(i) => format!(
            "line {} is \"{}\", should be \"{}\"",
            i + 1,
            found.split('\n').nth(i).unwrap_or_default().trim(),
            expected.split('\n').nth(i).unwrap_or_default().trim()
        ),
        None => "one ends before the other".to_owned(),
    })
}

fn simulate(arguments: &Simulate) -> Result<(), Failure> {
    let model = &arguments.common.model;
    let mut study = study(model)?;
    let settings = &mut study.machine.simulation;
    let positive = |name, value: f64| {
        if value.is_finite() && value > 0.0 {
            Ok(value)
        } else {
            Err(Failure::Option(name))
        }
    };
    if let Some(duration) = arguments.duration {
        settings.duration = positive("duration", duration)?;
    }
    if let Some(floor_rms) = arguments.floor_rms {
        settings.floor_rms = positive("floor-rms", floor_rms)?;
    }
    if let Some(seed) = arguments.seed {
        settings.seed = seed;
    }
    let (table, roll_off) = table(model, &study)?;
    let simulation = simulation(&study, &table);
    print(
        arguments.common.format,
        &Simulated::new(&study, roll_off, simulation),
    )
}

fn table(
    model: &Path,
    study: &Study,
) -> Result<(ValidTable, host_gen::roll_off::RollOff), Failure> {
    study.table().map_err(|error| Failure::RollOff {
        file: model.display().to_string(),
        error,
    })
}

fn simulation(study: &Study, table: &ValidTable) -> Comparison {
    let machine = &study.machine;
    compare(
        &study.plant,
        &machine.board,
        &machine.simulation,
        table,
        machine.performance_names(),
    )
}

fn table_path(arguments: &WithTable, machine: &Machine) -> Result<PathBuf, Failure> {
    if let Some(path) = &arguments.table {
        return Ok(path.clone());
    }
    let folder = Path::new("firmware/src/tables");
    if !folder.is_dir() {
        return Err(Failure::NoTables(folder.display().to_string()));
    }
    Ok(folder
        .join(machine.name.replace('-', "_"))
        .with_extension("rs"))
}

/// Writes beside the target and renames, so that there is never half a file.
fn write_whole(path: &Path, text: &str) -> Result<(), Failure> {
    let failed = |error| Failure::Io {
        path: path.display().to_string(),
        what: "written",
        error,
    };
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let mut file = tempfile::Builder::new();
    // As a new file gets, not as a secret one.
    #[cfg(unix)]
    file.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o644));
    let mut file = file.tempfile_in(folder).map_err(failed)?;
    file.write_all(text.as_bytes()).map_err(failed)?;
    file.persist(path).map_err(|error| failed(error.error))?;
    Ok(())
}

fn print<T: Display + Serialize>(format: Format, result: &T) -> Result<(), Failure> {
    let text = match format {
        Format::Text => result.to_string(),
        Format::Json => {
            serde_json::to_string_pretty(result).expect("numbers and strings serialise") + "\n"
        }
    };
    match io::stdout().write_all(text.as_bytes()) {
        // Whoever reads has seen enough.
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        Err(error) => Err(Failure::Io {
            path: "standard output".to_owned(),
            what: "written",
            error,
        }),
        Ok(()) => Ok(()),
    }
}
