//! `cargo xtask`: the whole test, processor in the loop, instruction counts.
#![forbid(unsafe_code)]

mod baseline;
mod boards;
mod dist;
mod made;
mod size;
mod steps;
mod tools;
mod virtual_board;

use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::thread::{self, ScopedJoinHandle};

use clap::{Args, Parser, Subcommand};

use baseline::Baseline;
use boards::{BOARDS, CHIP, EmulatedBoard};
use made::Made;
use steps::{Step, Times};
use tools::Tools;

/// Every task of the project that is more than one cargo command.
#[derive(Parser)]
#[command(arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Every test: host tests, the documentation's links and commands, the page in
    /// Chromium, a million bad frames, and the firmware on both emulated boards.
    Test {
        #[command(flatten)]
        setup: Setup,
        /// The long forms too: 200,000 samples on each board under the compiled-in
        /// tables, every pair of faults, ten million bad frames, the book.
        #[arg(long)]
        full: bool,
    },
    /// Before a commit, in less than a minute: format, lints, unit tests.
    Quick,
    /// Processor in the loop: the firmware on emulated boards against the plant
    /// and the host's own step, code by code.
    Pil {
        #[command(flatten)]
        setup: Setup,
        /// Samples per board with the loop closed; a session comes on top.
        #[arg(long, default_value_t = QUICK_SAMPLES)]
        samples: u32,
        /// Under the compiled-in tables with their waits, not under those of a tenth.
        #[arg(long)]
        full: bool,
    },
    /// The firmware on an emulated Cortex-M7 with the simulated plant at its
    /// converters, its link on TCP for `host-gen link`, until it is stopped.
    Emulate {
        #[command(flatten)]
        setup: Setup,
        #[command(flatten)]
        machine: Machine,
        /// Machine file of the simulated plant, if it is not that machine.
        #[arg(long, value_name = "MODEL")]
        truth: Option<String>,
        /// Address of the link.
        #[arg(long, default_value = "127.0.0.1:7700")]
        listen: String,
    },
    /// The reference board's real image on the virtual board, with the simulated plant at
    /// its converters, its link on TCP for `host-gen link`, until it is stopped.
    Virtual {
        #[command(flatten)]
        setup: Setup,
        #[command(flatten)]
        machine: Machine,
        /// Machine file of the simulated plant, if it is not that machine.
        #[arg(long, value_name = "MODEL")]
        truth: Option<String>,
        /// Address of the link.
        #[arg(long, default_value = "127.0.0.1:7700")]
        listen: String,
        /// Instead, the scenes: the image with something that goes wrong.
        #[arg(long, conflicts_with = "model")]
        scenes: bool,
        /// The scenes that take minutes too.
        #[arg(long, requires = "scenes")]
        full: bool,
    },
    /// Instructions per controller step on both emulated boards, against the
    /// baseline in firmware/instructions.txt.
    Bench {
        #[command(flatten)]
        setup: Setup,
        /// Write the baseline anew.
        #[arg(long)]
        update: bool,
    },
    /// The page of `host-gen report` and `watch` in Chromium: its charts, hover, moving
    /// modes; pictures in target/browser.
    Page(Setup),
    /// The documentation: follows its links, runs its commands, builds the book.
    Docs(Setup),
    /// Licences and sources of what the project builds on, and what is known against it
    /// (advisories), by cargo-deny.
    Deny(Setup),
    /// The MAT-files of the models in Octave. Not part of `test`, which reads them with SciPy: Octave is
    /// 266 MB in 135 packages.
    Octave(Setup),
    /// How long singular values and the closed loop take, and beside them the
    /// same in NumPy and SciPy where there is a Python with them.
    Speed,
    /// Certificates of bounds from matrices, table and certificate alone, and by ECOS, a solver
    /// from PyPI. Not part of `test`.
    Bound,
    /// Natural frequencies against Exudyn, a multibody program from PyPI.
    Exudyn(Setup),
    /// Finds, or installs, what the boards need, and builds their firmware; with --model, the
    /// reference board's image with the table of that machine.
    Build {
        #[command(flatten)]
        setup: Setup,
        #[command(flatten)]
        machine: Machine,
    },
    /// Builds the reference board's image, flashes it with probe-rs and shows its log.
    Flash {
        #[command(flatten)]
        setup: Setup,
        #[command(flatten)]
        machine: Machine,
    },
    /// The program for those without a compiler: a wheel for pip and a tarball for Linux, in
    /// target/packages, each tried where there is no cargo.
    Dist(Setup),
    /// Flash and memory that the reference board's image takes, against the baseline in
    /// firmware/size.txt.
    Size {
        #[command(flatten)]
        setup: Setup,
        /// Write the baseline anew.
        #[arg(long)]
        update: bool,
    },
}

#[derive(Args)]
struct Setup {
    /// Install nothing: name the missing packages and stop.
    #[arg(long)]
    no_install: bool,
}

#[derive(Args)]
struct Machine {
    /// Machine file whose table is made and compiled in, and what changed since its table before is
    /// printed; without it, the table that comes with the image.
    #[arg(long, value_name = "FILE")]
    model: Option<String>,
}

/// Ten seconds of the 20 kHz loop.
const FULL_SAMPLES: u32 = 200_000;

/// Enough for a shock that clamps, the recovery from it, and rounds of the pilot.
const QUICK_SAMPLES: u32 = 30_000;

const FULL_FRAMES: u32 = 10_000_000;

/// Searches for controllers that any step has made are kept there for all.
const CACHE: &str = "target/cache";

const MODEL: &str = "models/metrology-frame.toml";

/// The machine with accelerometers and force sensors, and its table, which is compiled in as that
/// of a user's machine is.
const BOTH: (&str, &str) = (
    "models/both-sensors.toml",
    "firmware/src/tables/both_sensors.rs",
);

/// The part of the samples that it takes.
const BOTH_PART: u32 = 4;

/// What went wrong, ready to print.
type Outcome<T> = Result<T, String>;

fn main() -> ExitCode {
    // The folder above this package is the project's root, wherever cargo was
    // called.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent();
    let moved = root.map(env::set_current_dir);
    if !matches!(moved, Some(Ok(()))) {
        eprintln!("error: the project's folder is gone");
        return ExitCode::FAILURE;
    }
    let outcome = match Cli::parse().task {
        Task::Test { setup, full } => test(&setup, full),
        Task::Quick => quick(),
        Task::Pil {
            setup,
            samples,
            full,
        } => Tools::find(!setup.no_install)
            .and_then(|tools| pil(&tools, samples, full, !setup.no_install)),
        Task::Emulate {
            setup,
            machine,
            truth,
            listen,
        } => Tools::find(!setup.no_install)
            .and_then(|tools| emulate(&tools, &machine, truth.as_deref(), &listen)),
        Task::Virtual {
            setup,
            machine,
            truth,
            listen,
            scenes,
            full,
        } => Tools::find(!setup.no_install).and_then(|tools| {
            // First, so that a machine of another board is refused at once.
            let image = machine.reference(&tools)?;
            virtual_board::build_program(!setup.no_install)?;
            if scenes {
                run(&mut virtual_board::scenes(&image, full)?)
            } else {
                let model = machine.model.as_deref().unwrap_or(virtual_board::MODEL);
                if machine.model.is_none() {
                    run(&mut building())?;
                }
                virtual_serve(&image, model, truth.as_deref(), &listen)
            }
        }),
        Task::Bench { setup, update } => {
            Tools::find(!setup.no_install).and_then(|tools| bench(&tools, update))
        }
        Task::Page(setup) => page(&setup),
        Task::Docs(setup) => docs(&setup),
        Task::Deny(setup) => deny(&setup),
        Task::Octave(setup) => octave(&setup),
        Task::Speed => speed(),
        Task::Bound => bound(),
        Task::Exudyn(setup) => exudyn(&setup),
        Task::Build { setup, machine } => {
            Tools::find(!setup.no_install).and_then(|tools| build(&tools, &machine))
        }
        Task::Flash { setup, machine } => {
            Tools::find(!setup.no_install).and_then(|tools| flash(&tools, &machine))
        }
        Task::Dist(setup) => dist::dist(!setup.no_install),
        Task::Size { setup, update } => {
            Tools::find(!setup.no_install).and_then(|tools| size::size(&tools, update))
        }
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("error: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn test(setup: &Setup, full: bool) -> Outcome<()> {
    // First, so that a missing tool is known at once.
    let tools = Tools::find(!setup.no_install)?;
    tools::chromium(!setup.no_install)?;
    tools::emulator(!setup.no_install)?;
    tools::maturin(!setup.no_install)?;
    let python = tools::python(!setup.no_install)?;
    let mut times = Times::default();
    let (reference, image) = boards::building_reference(&tools);
    let boards = building_emulated(&tools)?
        .into_iter()
        .chain([reference, virtual_board::building()]);
    let mut packages = own()?;
    packages.arg("dist");
    if setup.no_install {
        packages.arg("--no-install");
    }
    times.run([
        vec![
            Step::new("build", [building()]),
            Step::new("code's documentation", [documenting()]),
            // While nothing runs the program: cargo puts it in its place anew.
            Step::new("packages", [packages]),
        ],
        vec![Step::new("build for boards", boards)],
    ])?;
    let samples = if full { FULL_SAMPLES } else { QUICK_SAMPLES };
    let mut frames = built("frames");
    let mut host = vec![
        Step::new("unit and integration tests", [testing()]),
        Step::new("page in a browser", [page_command()]),
        Step::new("natural frequencies by Exudyn", exudyn_modes(&python)),
    ];
    if full {
        frames.args(["--frames", &FULL_FRAMES.to_string()]);
        let mut pairs = built("host-gen");
        pairs.args(["campaign", MODEL, "--pairs", "--format", "json"]);
        host.push(Step::new("pairs of faults", [pairs]));
    }
    host.push(Step::new("bad frames", [frames]));
    // The session on the host alone first: one that cannot pass is known in a second.
    let alone = sessions(samples, full, None)?;
    let boards = sessions(samples, full, Some(&tools))?;
    times.run([
        vec![
            Step::new("session without boards", alone),
            Step::new("processor in the loop", boards),
            Step::new("scenes", [virtual_board::scenes(&image, full)?]),
            Step::new("documents", [docs_command(&python, None)?]),
            Step::new("MAT-files", [mat_files(&python, "py")]),
        ],
        host,
    ])?;
    if full {
        book(setup)?;
    }
    times.print();
    Ok(())
}

fn quick() -> Outcome<()> {
    let mut format = cargo();
    format.args(["fmt", "--all", "--check"]);
    let mut lints = cargo();
    lints.args([
        "clippy",
        "--release",
        "--workspace",
        "--all-targets",
        "--locked",
    ]);
    lints.args(["--", "-D", "warnings"]);
    let mut tests = cargo();
    tests.args(["test", "--release", "--workspace", "--lib", "--locked"]);
    for mut command in [format, lints, tests] {
        run(&mut command)?;
    }
    Ok(())
}

/// Everything for the host, programs and tests: the same packages in every step, so that
/// nothing is compiled twice with other features.
fn building() -> Command {
    let mut command = testing();
    command.arg("--no-run");
    command
}

fn testing() -> Command {
    let mut command = cargo();
    command.args(["test", "--release", "--workspace", "--locked"]);
    command
}

fn documenting() -> Command {
    let mut command = cargo();
    command.args(["doc", "--release", "--workspace", "--no-deps", "--quiet"]);
    // As in .ci/run, or it would be made twice.
    command.arg("--locked").env("RUSTDOCFLAGS", "-D warnings");
    command
}

/// A program that [`building`] has built.
fn built(name: &str) -> Command {
    Command::new(Path::new("target/release").join(name))
}

/// The report's page in a browser.
fn page(setup: &Setup) -> Outcome<()> {
    tools::chromium(!setup.no_install)?;
    run(&mut building())?;
    run(&mut page_command())
}

fn page_command() -> Command {
    let [browser, driver] = tools::CHROMIUM;
    let mut command = built("browser");
    command.args(["--browser", browser, "--driver", driver]);
    command
}

/// The documentation, its links and its commands, and the book.
fn docs(setup: &Setup) -> Outcome<()> {
    run(&mut building())?;
    run(&mut documenting())?;
    book(setup)?;
    println!("target/book/index.html");
    Ok(())
}

/// Builds the book, and holds the documentation against it.
fn book(setup: &Setup) -> Outcome<()> {
    let mdbook = tools::MDBOOK.find(!setup.no_install)?;
    run(Command::new(mdbook).args(["build", "docs"]))?;
    let python = tools::python(!setup.no_install)?;
    run(&mut docs_command(&python, Some("target/book"))?)
}

/// This program.
fn own() -> Outcome<Command> {
    let own = env::current_exe().map_err(|error| format!("this program is gone: {error}"))?;
    Ok(Command::new(own))
}

fn docs_command(python: &Path, book: Option<&str>) -> Outcome<Command> {
    let mut command = built("docs");
    command.arg("--xtask").arg(own()?.get_program());
    command.arg("--python").arg(python);
    if let Some(book) = book {
        command.args(["--book", book]);
    }
    Ok(command)
}

fn pil(tools: &Tools, samples: u32, full: bool, install: bool) -> Outcome<()> {
    virtual_board::build_program(install)?;
    boards::build_reference(tools)?;
    run(&mut building())?;
    for mut command in building_emulated(tools)? {
        run(&mut command)?;
    }
    let sessions = |tools| sessions(samples, full, tools);
    for mut session in sessions(None)?.into_iter().chain(sessions(Some(tools))?) {
        run(&mut session)?;
    }
    Ok(())
}

/// The commands that build the images of the emulated boards.
fn building_emulated(tools: &Tools) -> Outcome<Vec<Command>> {
    let mut commands = Vec::new();
    for board in &BOARDS {
        commands.push(boards::building(board, tools).0);
        commands.push(building_both(board, tools)?.0);
    }
    Ok(commands)
}

/// The command that builds the image with the table of [`BOTH`], and its path then.
fn building_both(board: &EmulatedBoard, tools: &Tools) -> Outcome<(Command, PathBuf)> {
    boards::building_with("-both", Path::new(BOTH.1), board, tools)
}

/// A session of each machine, on the host alone or, with `tools`, on its boards: both
/// emulated ones, or the virtual one for the machine of its image.
fn sessions(samples: u32, full: bool, tools: Option<&Tools>) -> Outcome<Vec<Command>> {
    let mut commands = Vec::new();
    for (model, samples) in [(MODEL, samples), (BOTH.0, samples / BOTH_PART)] {
        let mut command = built("pil");
        command.args(["--model", model]);
        command.args(["--samples", &samples.to_string()]);
        if !full {
            command.arg("--quick");
        }
        for (board, tools) in BOARDS.iter().zip(tools.into_iter().cycle()) {
            let image = if model == MODEL {
                boards::building(board, tools).1.join(boards::IMAGE)
            } else {
                building_both(board, tools)?.1
            };
            command.arg("--board").arg(board.machine).arg(image);
        }
        commands.push(command);
    }
    let mut command = built("pil");
    command.args(["--model", virtual_board::MODEL]);
    command.args(["--samples", &samples.to_string()]);
    if !full {
        command.arg("--quick");
    }
    if let Some(tools) = tools {
        let (_, image) = boards::building_reference(tools);
        command.args(["--board", virtual_board::MACHINE]).arg(image);
        command.arg("--virtual-board").arg(virtual_board::program());
    }
    commands.push(command);
    Ok(commands)
}

/// The plant of a machine, or of another one instead, with the link of a board at `listen`.
fn listening(model: &str, truth: Option<&str>, listen: &str) -> Command {
    let mut command = built("pil");
    command.args(["--model", model, "--listen", listen]);
    if let Some(truth) = truth {
        command.args(["--truth", truth]);
    }
    command
}

/// The plant at the virtual board's converters, its link on TCP.
fn virtual_serve(image: &Path, model: &str, truth: Option<&str>, listen: &str) -> Outcome<()> {
    let mut command = listening(model, truth, listen);
    command.args(["--board", virtual_board::MACHINE]).arg(image);
    command.arg("--virtual-board").arg(virtual_board::program());
    run(&mut command)
}

impl Machine {
    /// The reference board's image with its table, or with the one that comes with it.
    fn reference(&self, tools: &Tools) -> Outcome<PathBuf> {
        match &self.model {
            Some(model) => Made::for_reference(model)?.reference(tools),
            None => boards::build_reference(tools),
        }
    }
}

fn build(tools: &Tools, machine: &Machine) -> Outcome<()> {
    if machine.model.is_none() {
        for board in &BOARDS {
            boards::build(board, tools)?;
        }
    }
    println!("{}", machine.reference(tools)?.display());
    Ok(())
}

fn flash(tools: &Tools, machine: &Machine) -> Outcome<()> {
    let image = machine.reference(tools)?;
    if machine.model.is_some() {
        println!(
            "a table that was sent to the board goes before this one: host-gen link --at PORT table --forget"
        );
    }
    let mut command = Command::new("probe-rs");
    command.args(["run", "--chip", CHIP]).arg(image);
    run(&mut command)
        .map_err(|problem| format!("{problem}; probe-rs: cargo install probe-rs-tools --locked"))
}

fn emulate(tools: &Tools, machine: &Machine, truth: Option<&str>, listen: &str) -> Outcome<()> {
    let [_, board] = &BOARDS;
    let image = match &machine.model {
        Some(model) => Made::for_emulated(model, board)?.emulated(board, tools)?,
        None => {
            run(&mut building())?;
            boards::build(board, tools)?.join(boards::IMAGE)
        }
    };
    let mut command = listening(machine.model.as_deref().unwrap_or(MODEL), truth, listen);
    command.arg("--board").arg(board.machine).arg(image);
    run(&mut command)
}

/// Instructions of the emulated boards.
const INSTRUCTIONS: Baseline = Baseline {
    file: "firmware/instructions.txt",
    slack: 0.03,
    update: "bench",
};

/// An instruction takes 2^N ns on the emulated board. Counts at both must agree: a counter that
/// wraps or a wrong unit shows as a difference.
const SHIFTS: [u32; 2] = [8, 6];

fn bench(tools: &Tools, update: bool) -> Outcome<()> {
    println!(
        "Instructions per sample with the loop in each mode; \"latch\" is the part from codes"
    );
    println!("to codes:");
    let mut images = Vec::new();
    for board in &BOARDS {
        images.push((board, boards::build(board, tools)?.join("mps2-bench")));
    }
    // An emulator uses one core; its count does not depend on what runs beside it.
    let runs = thread::scope(|scope| {
        let runs = images.iter().map(|(board, image)| {
            let run = |shift| scope.spawn(move || counted(board, image, shift));
            (board, SHIFTS.map(run))
        });
        let runs: Vec<_> = runs.collect();
        let ended = |run: ScopedJoinHandle<'_, Outcome<String>>| {
            run.join()
                .unwrap_or_else(|_| Err("the count panicked".to_owned()))
        };
        runs.into_iter()
            .map(|(board, counts)| (board, counts.map(ended)))
            .collect::<Vec<_>>()
    });
    let mut counts = Vec::new();
    for (board, [first, second]) in runs {
        let (first, second) = (first?, second?);
        for (line, other) in first.lines().zip(second.lines()) {
            let count = |line: &str| line.rsplit(' ').next()?.parse::<f64>().ok();
            let alike = matches!((count(line), count(other)), (Some(a), Some(b)) if (a / b - 1.0).abs() <= 0.01);
            if !alike {
                return Err(format!(
                    "{}: {line:?} at {} ns an instruction, {other:?} at {}",
                    board.machine,
                    1 << SHIFTS[0],
                    1 << SHIFTS[1]
                ));
            }
            counts.push(format!("{} {line}", board.machine));
        }
        if first.lines().count() != second.lines().count() {
            return Err(format!("{}: counts are missing", board.machine));
        }
    }
    if update {
        INSTRUCTIONS.write(&counts)
    } else {
        INSTRUCTIONS.compare(&counts)
    }
}

/// What the counting image prints.
fn counted(board: &EmulatedBoard, image: &Path, shift: u32) -> Outcome<String> {
    // The emulator's semihosting prints to standard error.
    let output = boards::emulator(board, image)
        .args(["-icount", &format!("shift={shift}"), "-serial", "null"])
        .output()
        .map_err(|error| format!("the emulator cannot be started: {error}"))?;
    let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        return Err(format!(
            "{} stopped with {}: {text}",
            board.machine, output.status
        ));
    }
    Ok(text.into_owned())
}

/// Advisories only where their database can be fetched; whether it was is said.
fn deny(setup: &Setup) -> Outcome<()> {
    let program = tools::CARGO_DENY.find(!setup.no_install)?;
    let deny = || Command::new(&program);
    run(deny().args(["--locked", "check", "licenses", "bans", "sources"]))?;
    let fetched = deny().args(["fetch", "db"]).stderr(Stdio::null()).status();
    if fetched.is_ok_and(|status| status.success()) {
        return run(deny().args(["--locked", "check", "advisories"]));
    }
    println!("advisories NOT checked: their database cannot be fetched from here");
    Ok(())
}

/// The models whose MAT-files are read: each kind of feedback, and a board whose delay is no whole
/// number of periods.
const MAT_MODELS: [&str; 4] = [
    MODEL,
    "models/low-parasitic.toml",
    BOTH.0,
    virtual_board::MODEL,
];

/// Checks the MAT-files of the models with a script in the language of `interpreter`, from what
/// [`building`] has built.
fn mat_files(interpreter: impl AsRef<OsStr>, language: &str) -> Command {
    let mut command = Command::new(interpreter);
    command.arg(format!("tests/external/mat_file.{language}"));
    command.args(["target/release/host-gen", "target/mat"]);
    command.args(MAT_MODELS);
    command
}

fn octave(setup: &Setup) -> Outcome<()> {
    let octave = tools::octave(!setup.no_install)?;
    run(&mut building())?;
    run(&mut mat_files(octave, "m"))
}

fn speed() -> Outcome<()> {
    // Not the profile of the tests, which checks its arithmetic.
    let mut bench = cargo();
    bench.args(["bench", "--package", "tests", "--bench", "speed"]);
    for check in ["DEBUG_ASSERTIONS", "OVERFLOW_CHECKS"] {
        bench.env(format!("CARGO_PROFILE_BENCH_{check}"), "false");
    }
    run(&mut bench)?;
    if !python_has("numpy, scipy") {
        println!("no python3 with NumPy and SciPy here: nothing beside it");
        return Ok(());
    }
    let folder = "target/speed";
    run(&mut host_gen(&["plant", MODEL, "--matrix-market", folder]))?;
    run(python().args(["tests/benches/speed.py", folder]))
}

/// What tests/external/exudyn_modes.py compares: the models, and machines with nothing alike; the last
/// has a flexible body, and beside it the parts that this is made of, which Exudyn reads.
const MACHINES: [&[&str]; 7] = [
    &[MODEL],
    &["models/low-parasitic.toml"],
    &["models/smaller-basis.toml"],
    &["tests/external/skew.toml"],
    &["tests/external/springs.toml"],
    &["tests/external/frame.toml"],
    &["tests/external/flexible.toml", "tests/external/frame.toml"],
];

/// Compares the natural frequencies of each machine with Exudyn's, from what [`building`] has built.
fn exudyn_modes(python: &Path) -> impl Iterator<Item = Command> {
    MACHINES.into_iter().map(move |files| {
        let mut command = Command::new(python);
        command.args(["tests/external/exudyn_modes.py", "target/release/host-gen"]);
        command.args(files);
        command
    })
}

fn exudyn(setup: &Setup) -> Outcome<()> {
    let python = tools::python(!setup.no_install)?;
    run(&mut building())?;
    exudyn_modes(&python).try_for_each(|mut command| run(&mut command))
}

/// What tests/external/bound.py checks: the paper's machine with a roll-off, and with the least rms
/// as its objective.
fn bound() -> Outcome<()> {
    if !python_has("ecos, numpy, scipy") {
        return Err("no python3 with ECOS here; pip install ecos numpy scipy".to_owned());
    }
    bound_with("roll_off = { hz = 1000, order = 2 }")?;
    bound_with("minimise = \"rms\"\nroll_off = { hz = 6000, order = 2 }")
}

/// Checks the bounds of the paper's machine with these lines in `[control]`.
fn bound_with(lines: &str) -> Outcome<()> {
    let folder = "target/bound";
    let failed = |error: std::io::Error| format!("{folder}: {error}");
    std::fs::create_dir_all(folder).map_err(failed)?;
    let paper = "models/metrology-frame.toml";
    let text = std::fs::read_to_string(paper).map_err(failed)?;
    let asked = format!("[control]\n{lines}");
    let machine = &format!("{folder}/machine.toml");
    let [json, table] = ["bound.json", "table.rs"].map(|name| format!("{folder}/{name}"));
    std::fs::write(machine, text.replace("[control]", &asked)).map_err(failed)?;
    run(&mut host_gen(&["generate", machine, "--table", &table]))?;
    run(&mut host_gen(&[
        "plant",
        machine,
        "--matrix-market",
        folder,
    ]))?;
    let file = std::fs::File::create(&json).map_err(failed)?;
    run(host_gen(&["bound", machine, "--format", "json"]).stdout(file))?;
    run(python().args(["tests/external/bound.py", &json, &table, folder]))
}

fn host_gen(arguments: &[&str]) -> Command {
    let mut command = cargo();
    command.args(["run", "--quiet", "--release", "--package", "cli", "--"]);
    command.args(arguments);
    command
}

fn python() -> Command {
    Command::new("python3")
}

fn python_has(modules: &str) -> bool {
    tools::imports("python3", modules)
}

/// The cargo that runs this.
fn cargo() -> Command {
    Command::new(env::var_os("CARGO").map_or_else(|| PathBuf::from("cargo"), PathBuf::from))
}

/// A command whose searches are kept for all.
fn cached(command: &mut Command) -> &mut Command {
    let folder = env::current_dir().map_or_else(|_| PathBuf::from(CACHE), |root| root.join(CACHE));
    command.env("HOST_GEN_CACHE", folder)
}

/// Runs a command to its end.
fn run(command: &mut Command) -> Outcome<()> {
    let program = command.get_program().to_string_lossy().into_owned();
    let status = cached(command)
        .status()
        .map_err(|error| format!("{program} cannot be started: {error}"))?;
    if status.success() {
        Ok(())
    } else {
        Err(format!("{command:?} failed ({status})"))
    }
}
