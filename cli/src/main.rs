//! The command line.
#![forbid(unsafe_code)]

mod arguments;
mod command;
mod failure;
mod files;
mod floor;
mod print;
mod search;
mod signals;
mod snippet;
mod waiting;

use std::io::{self, IsTerminal as _, Write as _};
use std::process::ExitCode;

use anstyle::{AnsiColor, Style};
use clap::{CommandFactory as _, Parser, Subcommand};
use clap_complete::Shell;
use host_gen::machine::schema::schema;

use arguments::{Common, Format};
use command::campaign::CampaignArguments;
use command::commission::CommissionArguments;
use command::compare::CompareArguments;
use command::compliance::ComplianceArguments;
use command::design::DesignArguments;
use command::fit::FitArguments;
use command::floor::FloorArguments;
use command::link::LinkArguments;
use command::new::NewArguments;
use command::plant::PlantArguments;
use command::report::ReportArguments;
use command::robust::RobustArguments;
use command::sigma::SigmaArguments;
use command::sil::SilArguments;
use command::simulate::SimulateArguments;
use command::table::{GenerateArguments, TableArguments};
use command::watch::WatchArguments;
use failure::Failure;
use search::Searcher;

/// From a machine's geometry to a controller table, verified in simulation for the
/// sampled, delayed board.
#[derive(Parser)]
#[command(version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Neither use nor store results of earlier searches.
    #[arg(long, global = true)]
    no_cache: bool,
}

#[derive(Subcommand)]
enum Command {
    /// Write a machine file from a few questions, or from options.
    ///
    /// Example: host-gen new scanner --frame-mass 300 --payload-mass 120 --yes
    New(NewArguments),
    /// Print the JSON Schema of machine files, for editors.
    ///
    /// Example: host-gen schema > machine.schema.json
    Schema,
    /// List the sensors that a machine file can name, with their figures and sources.
    ///
    /// Example: host-gen parts
    Parts {
        /// Output format: text, or JSON as in docs/json.md.
        #[arg(long, value_enum, default_value_t = Format::Text)]
        format: Format,
    },
    /// Print the script with which a shell completes commands and options.
    ///
    /// Example: host-gen completions bash > ~/.local/share/bash-completion/completions/host-gen
    Completions {
        /// Shell to generate for.
        shell: Shell,
    },
    /// Show natural frequencies, mode shapes, and the matrices M_d, D_d, K_d, M_r, B_0.
    ///
    /// Example: host-gen modes models/metrology-frame.toml
    Modes(Common),
    /// Show the ideal gains, with T_c, the modal matrix S and the ideal poles.
    ///
    /// Example: host-gen gains models/metrology-frame.toml --format json
    Gains(Common),
    /// Show the transmission zeros of G22 for both kinds of feedback.
    ///
    /// Example: host-gen zeros models/low-parasitic.toml
    Zeros(Common),
    /// Show the poles without control, with the ideal law, and of the sampled loop.
    ///
    /// Example: host-gen poles models/metrology-frame.toml
    Poles(Common),
    /// Show the largest singular value of G11: without control, with the ideal law for each
    /// kind of feedback, and with the sampled law (Fig. 5).
    ///
    /// Example: host-gen sigma models/metrology-frame.toml --from 0.1 --to 300
    Sigma(SigmaArguments),
    /// Evaluate the controller on randomly perturbed machines: payload and legs vary.
    ///
    /// Example: host-gen robust models/metrology-frame.toml --samples 1000
    Robust(RobustArguments),
    /// Show the motion on a given floor, its sources, and the vibration criterion met.
    ///
    /// Example: host-gen floor models/metrology-frame.toml --criterion vc-c
    Floor(FloorArguments),
    /// Show the generalised plant G (Fig. 4), or write its matrices for other programs.
    ///
    /// Example: host-gen plant models/metrology-frame.toml --mat frame.mat
    Plant(PlantArguments),
    /// Compare machines side by side.
    ///
    /// Example: host-gen compare models/low-parasitic.toml --by-feedback
    Compare(CompareArguments),
    /// Show how far forces and moments displace the machine: over frequency, after a step, and under
    /// the reaction forces of a stage.
    ///
    /// Example: host-gen compliance models/metrology-frame.toml --step frame=10
    Compliance(ComplianceArguments),
    /// Design the controller for the sampled board: shapes, isolation by mode, margins,
    /// delay; with --chart also for other boards.
    ///
    /// Example: host-gen design models/metrology-frame.toml --chart
    Design(DesignArguments),
    /// Show what no controller can pass: certified bounds beside what the design reaches.
    ///
    /// Example: host-gen bound models/metrology-frame.toml --format json
    Bound(Common),
    /// Design the controller and write its table for the firmware, with a summary of
    /// modes, gains and simulation.
    ///
    /// Example: host-gen generate models/metrology-frame.toml
    Generate(GenerateArguments),
    /// Write a page for a design review: the machine and its modes in 3D, charts,
    /// budgets, gains, assumptions. With several machines, also a comparison. A file that says
    /// nothing of control gets a page of its parts and modes.
    ///
    /// Example: host-gen report models/metrology-frame.toml
    Report(ReportArguments),
    /// Show the page of `report` in a browser, and redraw it when the machine file
    /// changes.
    ///
    /// Example: host-gen watch models/metrology-frame.toml
    Watch(WatchArguments),
    /// Check that a table of the firmware matches the machine file.
    ///
    /// Exit codes: 0 the table matches, 1 it differs, 2 it could not be checked because of
    /// an error.
    ///
    /// Example: host-gen check models/metrology-frame.toml
    Check(TableArguments),
    /// Simulate the open and the closed loop in time, with converters, noise and the step
    /// of the firmware.
    ///
    /// Example: host-gen simulate models/metrology-frame.toml --duration 60
    Simulate(SimulateArguments),
    /// Simulate faults one by one, and show how self-test and supervisor react.
    ///
    /// Example: host-gen campaign models/metrology-frame.toml
    Campaign(CampaignArguments),
    /// Run a board in software: the simulated machine, the controller of a board, and its
    /// link on TCP.
    ///
    /// Example: host-gen sil models/metrology-frame.toml --listen 127.0.0.1:7700
    Sil(SilArguments),
    /// Fit a machine file to responses that were measured on the machine, and write the fitted file.
    ///
    /// Example: host-gen fit models/yours.toml measured.json
    Fit(FitArguments),
    /// Take a machine into service: measure it, fit the file, design the controller, send it, close
    /// the loop step by step, and compare each step with the design.
    ///
    /// Example: host-gen commission models/yours.toml --at /dev/ttyACM0
    Commission(CommissionArguments),
    /// Talk to a board: status, self-test, start, stop, test signals, recordings,
    /// measurements.
    ///
    /// Example: host-gen link --at 127.0.0.1:7700 status
    Link(LinkArguments),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    match run(&cli.command, &Searcher::new(!cli.no_cache)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            const ERROR: Style = AnsiColor::Red.on_default().bold();
            let mut out = anstream::stderr();
            // Without standard error, as after a closed terminal, there is nobody to tell.
            let _ = match &failure {
                Failure::Machine(error) if io::stderr().is_terminal() => {
                    writeln!(out, "{}", snippet::render(error, true))
                }
                // One line for each error.
                failure => failure
                    .to_string()
                    .lines()
                    .try_for_each(|line| writeln!(out, "{ERROR}error:{ERROR:#} {line}")),
            };
            match (&failure, &cli.command) {
                (Failure::Interrupted { code, .. }, _) => ExitCode::from(*code),
                (Failure::Stale { .. }, _) => ExitCode::FAILURE,
                // Not to be taken for a table that differs.
                (_, Command::Check(_)) => ExitCode::from(2),
                _ => ExitCode::FAILURE,
            }
        }
    }
}

fn run(command: &Command, searcher: &Searcher) -> Result<(), Failure> {
    match command {
        Command::New(arguments) => command::new::new(arguments, searcher),
        Command::Schema => print::text(&schema()),
        Command::Parts { format } => command::parts::parts(*format),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut Cli::command(), "host-gen", &mut script);
            print::text(&String::from_utf8_lossy(&script))
        }
        Command::Modes(common) => command::model::modes(common),
        Command::Gains(common) => command::model::gains(common),
        Command::Zeros(common) => command::model::zeros(common),
        Command::Poles(common) => command::poles::poles(common, searcher),
        Command::Sigma(arguments) => command::sigma::sigma(arguments, searcher),
        Command::Robust(arguments) => command::robust::robust(arguments, searcher),
        Command::Floor(arguments) => command::floor::floor(arguments, searcher),
        Command::Plant(arguments) => command::plant::plant(arguments, searcher),
        Command::Compare(arguments) => command::compare::compare(arguments, searcher),
        Command::Compliance(arguments) => command::compliance::compliance(arguments, searcher),
        Command::Design(arguments) => command::design::design(arguments, searcher),
        Command::Bound(common) => command::bound::bound(common, searcher),
        Command::Generate(arguments) => command::table::generate(arguments, searcher),
        Command::Report(arguments) => command::report::report(arguments, searcher),
        Command::Watch(arguments) => command::watch::watch(arguments, searcher),
        Command::Check(arguments) => command::table::check(arguments, searcher),
        Command::Simulate(arguments) => command::simulate::simulate(arguments, searcher),
        Command::Campaign(arguments) => command::campaign::campaign(arguments, searcher),
        Command::Sil(arguments) => command::sil::sil(arguments, searcher),
        Command::Fit(arguments) => command::fit::fit(arguments),
        Command::Commission(arguments) => command::commission::commission(arguments, searcher),
        Command::Link(arguments) => command::link::link(arguments, searcher),
    }
}
