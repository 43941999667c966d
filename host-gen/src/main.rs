//! The command line.
#![forbid(unsafe_code)]

mod command;

use std::fmt::Display;
use std::fs;
use std::io::{self, IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anstyle::{AnsiColor, Style};
use clap::{Args, CommandFactory as _, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use command::link::LinkArguments;
use command::new::NewArguments;
use command::report::ReportArguments;
use command::sil::SilArguments;
use command::watch::WatchArguments;
use host_gen::campaign::Defect;
use host_gen::export::{Generalised, matrix_market};
use host_gen::frf::FrfError;
use host_gen::link::LinkError;
use host_gen::machine::schema::schema;
use host_gen::machine::{Machine, MachineError};
use host_gen::output::analysis::{Compared, Frequencies, PlantMatrices, Poles, Zeros, both_kinds};
use host_gen::output::design::Designed;
use host_gen::output::floor::Floors;
use host_gen::output::{self, Gains, Generated, Modes, Simulated};
use host_gen::report::plots::PlotError;
use host_gen::robustness::monte_carlo;
use host_gen::shaping::{Effort, Shaped, ShapingError};
use host_gen::simulation::{Comparison, compare};
use host_gen::spectrum::{Criterion, Floor, both_budgets};
use host_gen::study::{Looped, Study, StudyError};
use host_gen::table::emit;
use indicatif::{ProgressBar, ProgressStyle};
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
    /// Writes a machine file from a few questions, or from flags.
    ///
    /// Example: host-gen new scanner --frame-mass 300 --payload-mass 120 --yes
    New(NewArguments),
    /// The JSON Schema of machine files, for editors.
    ///
    /// Example: host-gen schema > machine.schema.json
    Schema,
    /// What a shell needs to complete commands and options.
    ///
    /// Example: host-gen completions bash > ~/.local/share/bash-completion/completions/host-gen
    Completions {
        /// Which.
        shell: Shell,
    },
    /// Natural frequencies and mode shapes, and M_d, D_d, K_d, M_r, B_0.
    ///
    /// Example: host-gen modes models/metrology-frame.toml
    Modes(Common),
    /// The ideal gains with T_c, the modal matrix S and the ideal poles.
    ///
    /// Example: host-gen gains models/metrology-frame.toml --format json
    Gains(Common),
    /// Transmission zeros of G22 for both kinds of feedback.
    ///
    /// Example: host-gen zeros models/low-parasitic.toml
    Zeros(Common),
    /// Poles open, under the ideal law, and of the sampled loop.
    ///
    /// Example: host-gen poles models/metrology-frame.toml
    Poles(Common),
    /// The largest singular value of G11, open and closed, ideal and sampled,
    /// both kinds of feedback (Fig. 5).
    ///
    /// Example: host-gen sigma models/metrology-frame.toml --from 0.1 --to 300
    Sigma(Sigma),
    /// The controller on machines drawn about the file's: payload, legs.
    ///
    /// Example: host-gen robust models/metrology-frame.toml --samples 1000
    Robust(RobustArguments),
    /// Spectra on a floor, where they come from, and the criterion met.
    ///
    /// Example: host-gen floor models/metrology-frame.toml --criterion vc-c
    Floor(FloorArguments),
    /// The generalised plant G (Fig. 4) as matrices for other programs.
    ///
    /// Example: host-gen plant models/metrology-frame.toml --matrix-market out
    Plant(PlantArguments),
    /// Machines side by side.
    ///
    /// Example: host-gen compare models/low-parasitic.toml --by-feedback
    Compare(Compare),
    /// The controller for the sampled board beside the ideal one: shapes,
    /// isolation by mode, margins, delay, what another board would give.
    ///
    /// Example: host-gen design models/metrology-frame.toml --chart
    Design(DesignArguments),
    /// Everything: modes, gains, shaping, table, software in the loop.
    ///
    /// Example: host-gen generate models/metrology-frame.toml
    Generate(WithTable),
    /// A page for a design review: the machine in 3D, its modes moving, all charts,
    /// budgets, gains, assumptions. Of several machines also what differs.
    ///
    /// Example: host-gen report models/metrology-frame.toml
    Report(ReportArguments),
    /// The same page in a browser, up to date as the machine file is saved.
    ///
    /// Example: host-gen watch models/metrology-frame.toml
    Watch(WatchArguments),
    /// Whether a table is what the machine file gives.
    ///
    /// Example: host-gen check models/metrology-frame.toml
    Check(WithTable),
    /// Open and closed loop in time, with converters, noise and the real step.
    ///
    /// Example: host-gen simulate models/metrology-frame.toml --duration 60
    Simulate(Simulate),
    /// Faults, one by one, in the simulated loop: what self-test and supervisor make
    /// of each.
    ///
    /// Example: host-gen campaign models/metrology-frame.toml
    Campaign(CampaignArguments),
    /// A board that is software: the machine simulated, the controller as a board
    /// runs it, its link on TCP.
    ///
    /// Example: host-gen sil models/metrology-frame.toml --listen 127.0.0.1:7700
    Sil(SilArguments),
    /// Talks to a board: status, self-test, start, stop, inject, record, measure.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 status
    Link(LinkArguments),
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

#[derive(Args)]
struct Sigma {
    #[command(flatten)]
    common: Common,
    /// Lowest frequency, Hz.
    #[arg(long, default_value_t = 0.1)]
    from: f64,
    /// Highest frequency, Hz.
    #[arg(long, default_value_t = 300.0)]
    to: f64,
    /// Frequencies evenly in the logarithm, at least two; those about the
    /// peaks come on top.
    #[arg(long, default_value_t = 500)]
    points: usize,
    /// These frequencies alone, Hz, with commas between.
    #[arg(long, value_delimiter = ',', conflicts_with_all = ["from", "to", "points"])]
    at: Vec<f64>,
}

#[derive(Args)]
struct RobustArguments {
    #[command(flatten)]
    common: Common,
    /// How many machines to draw [default: the file's].
    #[arg(long)]
    samples: Option<usize>,
    /// Seed of the random numbers [default: the file's].
    #[arg(long)]
    seed: Option<u64>,
}

#[derive(Args)]
struct FloorArguments {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    floor: FloorChoice,
    /// Lowest frequency, Hz.
    #[arg(long, default_value_t = 0.5)]
    from: f64,
    /// Highest frequency, Hz.
    #[arg(long, default_value_t = 300.0)]
    to: f64,
}

#[derive(Args)]
#[group(required = true, multiple = false)]
struct FloorChoice {
    /// A floor as strong as a vibration criterion allows.
    #[arg(long, value_enum)]
    criterion: Option<Criterion>,
    /// White acceleration of each input, m/s²/√Hz.
    #[arg(long)]
    white: Option<f64>,
    /// A text file of frequency, Hz, and acceleration density, m/s²/√Hz, two
    /// numbers a line, frequencies ascending; # begins a comment.
    #[arg(long)]
    spectrum: Option<PathBuf>,
}

#[derive(Args)]
struct DesignArguments {
    #[command(flatten)]
    common: Common,
    /// Design for other sample rates and delays too: half a minute more.
    #[arg(long)]
    chart: bool,
}

#[derive(Args)]
struct CampaignArguments {
    #[command(flatten)]
    common: Common,
    /// Every two faults at once instead, which takes some minutes.
    #[arg(long)]
    pairs: bool,
}

#[derive(Args)]
struct PlantArguments {
    #[command(flatten)]
    common: Common,
    /// Write A, B, C and D there as Matrix Market files, by kind of feedback.
    #[arg(long)]
    matrix_market: Option<PathBuf>,
}

/// The machines that a command is about.
#[derive(Args)]
struct Several {
    /// Machine files.
    #[arg(required = true)]
    models: Vec<PathBuf>,
    /// Each machine once with accelerations fed back, once with forces, and once
    /// with both.
    #[arg(long)]
    by_feedback: bool,
}

impl Several {
    fn load(&self) -> Result<Vec<Machine>, MachineError> {
        let machines = self.models.iter().map(|model| Machine::load(model));
        let machines = machines.collect::<Result<Vec<_>, _>>()?;
        Ok(if self.by_feedback {
            machines.iter().flat_map(Machine::by_feedback).collect()
        } else {
            machines
        })
    }
}

#[derive(Args)]
struct Compare {
    #[command(flatten)]
    several: Several,
    /// What to print.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
}

#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Machine(#[from] MachineError),
    #[error("{file}: {error}")]
    Shaped { file: String, error: ShapingError },
    #[error("{path}: cannot be {what}: {error}")]
    Io {
        path: String,
        what: &'static str,
        error: io::Error,
    },
    #[error("there is no folder {0} here; run from the project's root or give --table PATH")]
    NoTables(String),
    #[error(
        "{path}:{line}: a line is a frequency, Hz, above the one before, and an acceleration density, m/s²/√Hz, not negative"
    )]
    Spectrum { path: String, line: usize },
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error(transparent)]
    Frf(FrfError),
    #[error("outputs left their limits, or the legs came to rest too late: see the table")]
    Unsafe,
    #[error("a fault is latched: {0}")]
    Fault(String),
    #[error(transparent)]
    Plot(#[from] PlotError),
    #[error("--{flag} must be finite and at least {least}")]
    Least { flag: &'static str, least: f64 },
    #[error("--leg-angle must be at most 89: upright legs do not hold the machine sideways")]
    Upright,
    #[error("{0} exists already: give --output, or another name")]
    Exists(String),
    #[error("--to must be finite and above --from")]
    Range,
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
            const ERROR: Style = AnsiColor::Red.on_default().bold();
            match &failure {
                Failure::Machine(error) if io::stderr().is_terminal() => {
                    anstream::eprintln!("{}", command::snippet::render(error, true));
                }
                failure => anstream::eprintln!("{ERROR}error:{ERROR:#} {failure}"),
            }
            ExitCode::FAILURE
        }
    }
}

fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::New(arguments) => command::new::new(arguments),
        Command::Schema => print_text(&schema()),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut Cli::command(), "host-gen", &mut script);
            print_text(&String::from_utf8_lossy(&script))
        }
        Command::Modes(common) => print(common.format, &Modes::new(&study(&common.model)?)),
        Command::Gains(common) => print(common.format, &Gains::new(&study(&common.model)?)),
        Command::Zeros(common) => {
            let zeros = Zeros::new(&Machine::load(&common.model)?)?;
            print(common.format, &zeros)
        }
        Command::Poles(common) => {
            let study = study(&common.model)?;
            let (table, _) = table(&common.model, &study)?;
            let poles = Poles::new(&study, &table).map_err(in_loop(&common.model))?;
            print(common.format, &poles)
        }
        Command::Sigma(arguments) => sigma(arguments),
        Command::Robust(arguments) => robust(arguments),
        Command::Floor(arguments) => floor(arguments),
        Command::Plant(arguments) => plant(arguments),
        Command::Compare(arguments) => {
            let machines = arguments.several.load()?;
            let bar = search_bar();
            let looped = Looped::all(machines, &|| bar.inc(1));
            bar.finish_and_clear();
            print(arguments.format, &Compared::new(&looped?)?)
        }
        Command::Design(arguments) => design(arguments),
        Command::Generate(arguments) => generate(arguments),
        Command::Report(arguments) => command::report::report(arguments),
        Command::Watch(arguments) => command::watch::watch(arguments),
        Command::Check(arguments) => check(arguments),
        Command::Simulate(arguments) => simulate(arguments),
        Command::Campaign(arguments) => campaign(arguments),
        Command::Sil(arguments) => command::sil::sil(arguments),
        Command::Link(arguments) => command::link::link(arguments),
    }
}

fn study(model: &Path) -> Result<Study, Failure> {
    Ok(Study::new(Machine::load(model)?)?)
}

/// Says which file a loop's failure is about.
fn in_loop(model: &Path) -> impl Fn(ShapingError) -> Failure {
    let file = model.display().to_string();
    move |error| Failure::Shaped {
        file: file.clone(),
        error,
    }
}

/// The same for what may fail by the machine too, which says its file itself.
fn in_study(model: &Path) -> impl Fn(StudyError) -> Failure {
    let in_loop = in_loop(model);
    move |error| match error {
        StudyError::Machine(error) => error.into(),
        StudyError::Loop(error) => in_loop(error),
    }
}

fn sigma(arguments: &Sigma) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let frequencies = if arguments.at.is_empty() {
        let [low, high] = band(arguments.from, arguments.to)?;
        let count = arguments.points.max(2);
        Frequencies::Adaptive { low, high, count }
    } else {
        if !arguments.at.iter().all(|hz| hz.is_finite() && *hz > 0.0) {
            return Err(Failure::Option("at"));
        }
        Frequencies::At(arguments.at.clone())
    };
    let machine = Machine::load(model)?;
    let bar = search_bar();
    let looped = Looped::by_feedback(&machine, &|| bar.inc(1));
    bar.finish_and_clear();
    let sigma = output::analysis::Sigma::new(&machine, &looped?, frequencies);
    print(*format, &sigma.map_err(in_loop(model))?)
}

fn robust(arguments: &RobustArguments) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let mut study = study(model)?;
    let settings = &mut study.machine.robustness;
    if let Some(samples) = arguments.samples {
        if samples == 0 {
            return Err(Failure::Option("samples"));
        }
        settings.samples = samples;
    }
    if let Some(seed) = arguments.seed {
        settings.seed = seed;
    }
    // On standard error, and only where that is a terminal.
    let bar = ProgressBar::new(settings.samples as u64);
    let (table, shaped) = table(model, &study)?;
    let result = monte_carlo(&study, &table, &shaped.bands, || bar.inc(1));
    bar.finish_and_clear();
    let result = result.map_err(in_study(model))?;
    print(
        *format,
        &output::analysis::Robustness::new(&study.machine, result),
    )
}

fn floor(arguments: &FloorArguments) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let band = band(arguments.from, arguments.to)?;
    let (floor, name) = match &arguments.floor {
        FloorChoice {
            criterion: Some(criterion),
            ..
        } => (Floor::Criterion(*criterion), criterion.name().to_owned()),
        FloorChoice {
            spectrum: Some(path),
            ..
        } => (spectrum(path)?, path.display().to_string()),
        FloorChoice { white, .. } => {
            let density = white.unwrap_or(f64::NAN);
            if !(density.is_finite() && density >= 0.0) {
                return Err(Failure::Option("white"));
            }
            (
                Floor::White(density),
                format!("white, {density:e} m/s²/√Hz"),
            )
        }
    };
    let study = study(model)?;
    let (table, _) = table(model, &study)?;
    let board = &study.machine.board;
    let budgets = both_budgets(&study.plant, board, &table, &floor, band);
    let [open, closed] = budgets.map_err(in_loop(model))?;
    print(*format, &Floors::new(&study, name, band, open, closed))
}

fn band(from: f64, to: f64) -> Result<[f64; 2], Failure> {
    if !(from.is_finite() && from > 0.0) {
        return Err(Failure::Option("from"));
    }
    if !(to.is_finite() && to > from) {
        return Err(Failure::Range);
    }
    Ok([from, to])
}

fn spectrum(path: &Path) -> Result<Floor, Failure> {
    let text = fs::read_to_string(path).map_err(|error| Failure::Io {
        path: path.display().to_string(),
        what: "read",
        error,
    })?;
    let mut points: Vec<(f64, f64)> = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        let numbers: Vec<Option<f64>> = line
            .split_whitespace()
            .map(|word| word.parse().ok())
            .collect();
        let last = points.last().map_or(0.0, |(hz, _)| *hz);
        match numbers[..] {
            [] => {}
            [Some(hz), Some(density)]
                if hz.is_finite() && hz > last && density.is_finite() && density >= 0.0 =>
            {
                points.push((hz, density));
            }
            _ => {
                return Err(Failure::Spectrum {
                    path: path.display().to_string(),
                    line: i + 1,
                });
            }
        }
    }
    Ok(Floor::Table(points))
}

fn design(arguments: &DesignArguments) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let study = study(model)?;
    let bar = search_bar();
    let outcome = study
        .table_with(Effort::Full, &|| bar.inc(1))
        .map_err(StudyError::from)
        .and_then(|(table, shaped)| {
            Designed::new(&study, &table, shaped, arguments.chart, &|| bar.inc(1))
        });
    bar.finish_and_clear();
    print(*format, &outcome.map_err(in_study(model))?)
}

/// For a search: on standard error, and only where that is a terminal.
fn search_bar() -> ProgressBar {
    let bar = ProgressBar::new_spinner();
    let style = ProgressStyle::with_template("{spinner} shaping the loop, {pos} trials, {elapsed}");
    bar.with_style(style.expect("the template is right"))
}

fn campaign(arguments: &CampaignArguments) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let study = study(model)?;
    let (table, _) = table(model, &study)?;
    let single = Defect::all();
    let mut cases: Vec<Vec<Defect>> = single.iter().map(|defect| vec![*defect]).collect();
    if arguments.pairs {
        let pairs = |(i, a): (usize, &Defect)| {
            let others = single[i + 1..].iter();
            others.map(|b| vec![*a, *b]).collect::<Vec<_>>()
        };
        cases = single.iter().enumerate().flat_map(pairs).collect();
    }
    let bar = ProgressBar::new(cases.len() as u64);
    let outcomes = host_gen::campaign::campaign(&study, &table, &cases, || bar.inc(1));
    bar.finish_and_clear();
    let campaign = output::campaign::Campaign::new(&study, outcomes);
    print(*format, &campaign)?;
    if campaign.is_safe() {
        Ok(())
    } else {
        Err(Failure::Unsafe)
    }
}

fn plant(arguments: &PlantArguments) -> Result<(), Failure> {
    let machine = Machine::load(&arguments.common.model)?;
    let report = PlantMatrices::new(&machine)?;
    if let Some(folder) = &arguments.matrix_market {
        fs::create_dir_all(folder).map_err(|error| Failure::Io {
            path: folder.display().to_string(),
            what: "created",
            error,
        })?;
        for study in both_kinds(&machine)? {
            let Generalised { a, b, c, d } = Generalised::new(&study.plant.plant);
            let kind = study.design.feedback.name();
            for (name, matrix) in [("A", a), ("B", b), ("C", c), ("D", d)] {
                let path = folder.join(format!("{kind}-{name}.mtx"));
                write_whole(&path, matrix_market(&matrix).as_bytes())?;
            }
        }
    }
    print(arguments.common.format, &report)
}

fn generate(arguments: &WithTable) -> Result<(), Failure> {
    let model = &arguments.common.model;
    let study = study(model)?;
    let path = table_path(arguments, &study.machine)?;
    let (table, shaped) = table(model, &study)?;
    let simulation = simulation(&study, &table);
    write_whole(&path, emit(&study.machine, &table).as_bytes())?;
    let report = Generated::new(&study, shaped, path.display().to_string(), simulation);
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
    let (table, shaped) = table(model, &study)?;
    let simulation = simulation(&study, &table);
    print(
        arguments.common.format,
        &Simulated::new(&study, shaped, simulation),
    )
}

fn table(model: &Path, study: &Study) -> Result<(ValidTable, Shaped), Failure> {
    let bar = search_bar();
    let outcome = study.table_with(Effort::Full, &|| bar.inc(1));
    bar.finish_and_clear();
    outcome.map_err(in_loop(model))
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
fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
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
    file.write_all(bytes).map_err(failed)?;
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
    print_text(&text)
}

fn print_text(text: &str) -> Result<(), Failure> {
    // Colours go on to a terminal only.
    match anstream::stdout().write_all(text.as_bytes()) {
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
