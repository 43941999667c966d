//! `cargo xtask`: the whole test, processor in the loop, instruction counts.
#![forbid(unsafe_code)]

mod baseline;
mod boards;
mod size;
mod tools;

use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use clap::{Args, Parser, Subcommand};

use baseline::Baseline;
use boards::{BOARDS, CHIP};
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
    /// Every test: host tests, checked-in tables, ten million bad frames, and the
    /// firmware on both emulated boards.
    Test(Setup),
    /// Processor in the loop: the firmware on emulated boards against the plant
    /// and the host's own step, code by code.
    Pil {
        #[command(flatten)]
        setup: Setup,
        /// Samples per board with the loop closed; a session comes on top.
        #[arg(long, default_value_t = SAMPLES)]
        samples: u32,
    },
    /// The firmware on an emulated Cortex-M7 with the simulated plant at its
    /// converters, its link on TCP for `host-gen link`, until it is stopped.
    Emulate {
        #[command(flatten)]
        setup: Setup,
        /// A machine with a table in the firmware.
        #[arg(default_value = MODEL)]
        model: String,
        /// Address of the link.
        #[arg(long, default_value = "127.0.0.1:7700")]
        listen: String,
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
    /// The book: builds it, follows its links, runs its commands.
    Docs(Setup),
    /// How long singular values and the closed loop take, and beside them the
    /// same in NumPy and SciPy where there is a Python with them.
    Speed,
    /// Natural frequencies against Exudyn, a multibody program from PyPI, for
    /// whoever has a Python with it.
    Exudyn,
    /// Finds, or installs, what the boards need, and builds their firmware.
    Build(Setup),
    /// Builds the reference board's image, flashes it with probe-rs and shows its log.
    Flash(Setup),
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

/// Ten seconds of the 20 kHz loop.
const SAMPLES: u32 = 200_000;

const MODEL: &str = "models/metrology-frame.toml";

/// Machines with a table in the firmware, each with the image that runs it
/// and for how much of the samples.
const CONTROLLED: [(&str, &str, u32); 2] = [
    (MODEL, "mps2", 1),
    ("models/both-sensors.toml", "mps2-both", 4),
];

/// The reference board's machine, whose table is in the firmware too.
const REFERENCE_MODEL: &str = "models/nucleo-h743.toml";

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
        Task::Test(setup) => test(&setup),
        Task::Pil { setup, samples } => {
            Tools::find(!setup.no_install).and_then(|tools| pil(&tools, samples))
        }
        Task::Emulate {
            setup,
            model,
            listen,
        } => Tools::find(!setup.no_install).and_then(|tools| emulate(&tools, &model, &listen)),
        Task::Bench { setup, update } => {
            Tools::find(!setup.no_install).and_then(|tools| bench(&tools, update))
        }
        Task::Page(setup) => page(&setup),
        Task::Docs(setup) => docs(&setup),
        Task::Speed => speed(),
        Task::Exudyn => exudyn(),
        Task::Build(setup) => Tools::find(!setup.no_install).and_then(|tools| {
            for board in &BOARDS {
                boards::build(board, &tools)?;
            }
            println!("{}", boards::build_reference(&tools)?.display());
            Ok(())
        }),
        Task::Flash(setup) => Tools::find(!setup.no_install).and_then(|tools| flash(&tools)),
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

fn test(setup: &Setup) -> Outcome<()> {
    // First, so that a missing tool is known at once.
    let tools = Tools::find(!setup.no_install)?;
    run(cargo().args(["test", "--workspace"]))?;
    let emulated = CONTROLLED.map(|(model, ..)| model);
    for model in emulated.into_iter().chain([REFERENCE_MODEL]) {
        run(&mut host_gen(&["check", model]))?;
    }
    run(cargo().args(["run", "--release", "--package", "tests", "--bin", "frames"]))?;
    page(setup)?;
    docs(setup)?;
    pil(&tools, SAMPLES)
}

/// The report's page in a browser.
fn page(setup: &Setup) -> Outcome<()> {
    tools::chromium(!setup.no_install)?;
    run(cargo().args(["build", "--release", "--package", "host-gen"]))?;
    let mut command = cargo();
    command.args(["run", "--release", "--package", "tests", "--bin", "browser"]);
    run(command.args(["--", "--browser", tools::CHROMIUM]))
}

/// The book, its links and its commands.
fn docs(setup: &Setup) -> Outcome<()> {
    let mdbook = tools::mdbook(!setup.no_install)?;
    run(cargo().args(["doc", "--workspace", "--no-deps", "--quiet"]))?;
    run(Command::new(mdbook).args(["build", "docs"]))?;
    run(cargo().args(["build", "--release", "--package", "host-gen"]))?;
    let own = env::current_exe().map_err(|error| format!("this program is gone: {error}"))?;
    let mut command = cargo();
    command.args(["run", "--release", "--package", "tests", "--bin", "docs"]);
    run(command.arg("--").arg("--xtask").arg(own))?;
    println!("target/book/index.html");
    Ok(())
}

fn pil(tools: &Tools, samples: u32) -> Outcome<()> {
    let session = |model: &str, part: u32| {
        let mut command = cargo();
        command.args(["run", "--release", "--package", "tests", "--bin", "pil"]);
        command.args(["--", "--model", model]);
        command.args(["--samples", &(samples / part).to_string()]);
        command
    };
    // Without boards first: a session that cannot pass is known in a second.
    for (model, _, part) in CONTROLLED {
        run(&mut session(model, part))?;
    }
    for (model, image, part) in CONTROLLED {
        let mut command = session(model, part);
        for board in &BOARDS {
            let image = boards::build(board, tools)?.join(image);
            command.arg("--board").arg(board.machine).arg(image);
        }
        run(&mut command)?;
    }
    Ok(())
}

fn flash(tools: &Tools) -> Outcome<()> {
    let image = boards::build_reference(tools)?;
    let mut command = Command::new("probe-rs");
    command.args(["run", "--chip", CHIP]).arg(image);
    run(&mut command)
        .map_err(|problem| format!("{problem}; probe-rs: cargo install probe-rs-tools --locked"))
}

fn emulate(tools: &Tools, model: &str, listen: &str) -> Outcome<()> {
    let [_, board] = &BOARDS;
    let Some((_, image, _)) = CONTROLLED.iter().find(|(name, ..)| *name == model) else {
        let names = CONTROLLED.map(|(name, ..)| name).join(", ");
        return Err(format!(
            "{model} has no table in the firmware; {names} have"
        ));
    };
    let image = boards::build(board, tools)?.join(image);
    let mut command = cargo();
    command.args(["run", "--release", "--package", "tests", "--bin", "pil"]);
    command.args(["--", "--model", model, "--listen", listen]);
    command.arg("--board").arg(board.machine).arg(image);
    run(&mut command)
}

/// Instructions of the emulated boards.
const INSTRUCTIONS: Baseline = Baseline {
    file: "firmware/instructions.txt",
    slack: 0.03,
    update: "bench",
};

fn bench(tools: &Tools, update: bool) -> Outcome<()> {
    println!("Instructions per call, an empty call taken off; \"law\" from AC-coupled sensors");
    println!("to clamped forces, \"step\" from codes to codes:");
    let mut counts = Vec::new();
    for board in &BOARDS {
        let image = boards::build(board, tools)?.join("mps2-bench");
        // The emulator's semihosting prints to standard error.
        let output = boards::emulator(board, &image)
            .args(["-icount", "shift=8", "-serial", "null"])
            .output()
            .map_err(|error| format!("the emulator cannot be started: {error}"))?;
        let text =
            String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
        if !output.status.success() {
            return Err(format!(
                "{} stopped with {}: {text}",
                board.machine, output.status
            ));
        }
        for line in text.lines() {
            counts.push(format!("{} {line}", board.machine));
        }
    }
    if update {
        INSTRUCTIONS.write(&counts)
    } else {
        INSTRUCTIONS.compare(&counts)
    }
}

fn speed() -> Outcome<()> {
    run(cargo().args(["bench", "--package", "tests", "--bench", "speed"]))?;
    if !python_has("numpy, scipy") {
        println!("no python3 with NumPy and SciPy here: nothing beside it");
        return Ok(());
    }
    let folder = "target/speed";
    run(&mut host_gen(&["plant", MODEL, "--matrix-market", folder]))?;
    run(python().args(["tests/benches/speed.py", folder]))
}

/// The models, and a machine with nothing alike.
const MACHINES: [&str; 4] = [
    MODEL,
    "models/low-parasitic.toml",
    "models/smaller-basis.toml",
    "tests/external/skew.toml",
];

fn exudyn() -> Outcome<()> {
    if !python_has("exudyn, numpy") {
        return Err("no python3 with Exudyn here; pip install exudyn numpy".to_owned());
    }
    for machine in MACHINES {
        println!("{machine}");
        let modes = host_gen(&["modes", machine, "--format", "json"])
            .stderr(Stdio::inherit())
            .output()
            .map_err(|error| format!("cargo cannot be started: {error}"))?;
        if !modes.status.success() {
            return Err(format!("host-gen modes {machine} failed"));
        }
        let file = "target/modes.json";
        std::fs::write(file, modes.stdout).map_err(|error| format!("{file}: {error}"))?;
        run(python().args(["tests/external/exudyn_modes.py", machine, file]))?;
    }
    Ok(())
}

fn host_gen(arguments: &[&str]) -> Command {
    let mut command = cargo();
    command.args(["run", "--quiet", "--release", "--package", "host-gen", "--"]);
    command.args(arguments);
    command
}

fn python() -> Command {
    Command::new("python3")
}

fn python_has(modules: &str) -> bool {
    python()
        .args(["-c", &format!("import {modules}")])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// The cargo that runs this.
fn cargo() -> Command {
    Command::new(env::var_os("CARGO").map_or_else(|| PathBuf::from("cargo"), PathBuf::from))
}

/// Runs a command to its end.
fn run(command: &mut Command) -> Outcome<()> {
    let program = command.get_program().to_string_lossy().into_owned();
    let status = command
        .status()
        .map_err(|error| format!("{program} cannot be started: {error}"))?;
    if status.success() {
        Ok(())
    } else {
        Err(format!("{command:?} failed ({status})"))
    }
}
