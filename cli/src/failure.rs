//! Errors of commands, and their messages.

use std::io;
use std::path::Path;

use host_gen::board::link::LinkError;
use host_gen::board::measure::FrfError;
use host_gen::design::{DesignError, StudyError};
use host_gen::files::columns::TextError;
use host_gen::files::mat::TooLarge;
use host_gen::identify::FitError;
use host_gen::machine::MachineError;
use host_gen::report::plots::PlotError;
use host_gen::simulate::OtherBoard;

/// The error of a command.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    #[error(transparent)]
    Machine(#[from] MachineError),
    #[error("{file}: {error}")]
    Design { file: String, error: DesignError },
    #[error("{path}: cannot be {what}: {error}")]
    Io {
        path: String,
        what: &'static str,
        error: io::Error,
    },
    #[error(
        "there is no folder {0} here; run the command in the project's root folder, or use --table PATH"
    )]
    NoTables(String),
    #[error("{}{}: {error}", path, error.line.map(|line| format!(":{line}")).unwrap_or_default())]
    Spectrum { path: String, error: TextError },
    #[error(
        "{path}: the spectrum gives {low} to {high} Hz only, nothing from {from} to {to} Hz; change --from and --to"
    )]
    Unseen {
        path: String,
        low: f64,
        high: f64,
        from: f64,
        to: f64,
    },
    #[error(
        "{}: the file has no floor.spectrum; give it, or one of --criterion, --white, --spectrum and --record", .0.display()
    )]
    NoFloor(std::path::PathBuf),
    #[error("{path}: {error}")]
    Fit { path: String, error: FitError },
    #[error("{path}: not a measurement of host-gen link frf --format json: {error}")]
    Measurement {
        path: String,
        error: serde_json::Error,
    },
    #[error(
        "{0} is not written: the model does not explain the measurement, so the numbers are not those of the machine"
    )]
    Unexplained(String),
    #[error("{step}: not passed; see above, and record.html")]
    Gate { step: String },
    #[error("{why}; and the legs could not be brought to rest: {error}")]
    NotAtRest { why: String, error: LinkError },
    #[error("nothing was moved")]
    Declined,
    #[error("--truth {path}: {error}")]
    Truth { path: String, error: OtherBoard },
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error(transparent)]
    Frf(FrfError),
    #[error("{option} must {must}")]
    Setting { option: &'static str, must: String },
    #[error("interrupted; {board}")]
    Interrupted { board: String, code: u8 },
    #[error("outputs exceeded their limits, or the legs came to rest too late: see the table")]
    Unsafe,
    #[error("a fault is latched: {0}")]
    Fault(String),
    #[error("{path}: {error}")]
    Mat { path: String, error: TooLarge },
    #[error(transparent)]
    Plot(#[from] PlotError),
    #[error("--{flag} must be from {least} to {}{unit}", short(*most))]
    Between {
        flag: &'static str,
        least: f64,
        most: f64,
        /// After a space; empty without one.
        unit: &'static str,
    },
    #[error("--leg-angle must be at most 89: vertical legs do not hold the machine sideways")]
    Upright,
    #[error(
        "{path}: not the figures of a table of this version: {error}. Remove the file: the next table counts as the first one"
    )]
    Figures {
        path: String,
        error: serde_json::Error,
    },
    #[error(
        "--payload-z must be at least {least} above or below 0: the blocks between payload and frame have this length"
    )]
    InPlane { least: f64 },
    #[error("answer {line}, to \"{question}\": expected {expected}, not \"{answer}\"")]
    Answer {
        line: usize,
        question: String,
        answer: String,
        expected: String,
    },
    #[error(
        "line {line} of the answers, \"{answer}\", answers no question: there is a line for each question whose option is not given; nothing is written. Use --yes to read none"
    )]
    Unasked { line: usize, answer: String },
    #[error("{0} already exists: use --output or another name")]
    Exists(String),
    #[error("--to must be finite and above --from")]
    Range,
    #[error("--{0} must be positive and finite")]
    Option(&'static str),
    #[error("--{flag} must be {limits}, not {value}")]
    Limits {
        flag: &'static str,
        limits: String,
        value: f64,
    },
    #[error(
        "{table} differs from the table of {model}: {difference}. Run host-gen generate {model}"
    )]
    Stale {
        table: String,
        model: String,
        difference: String,
    },
}

impl From<FrfError> for Failure {
    fn from(error: FrfError) -> Self {
        match error {
            FrfError::Link(error) => error.into(),
            error => Self::Frf(error),
        }
    }
}

/// Adds the machine file to the error of a design.
pub fn in_loop<E: Into<DesignError>>(model: &Path) -> impl Fn(E) -> Failure {
    let file = model.display().to_string();
    move |error| Failure::Design {
        file: file.clone(),
        error: error.into(),
    }
}

/// Adds the machine file to the error of a design; an error of the machine already names
/// its file.
pub fn in_study(model: &Path) -> impl Fn(StudyError) -> Failure {
    let in_loop = in_loop(model);
    move |error| match error {
        StudyError::Machine(error) => error.into(),
        StudyError::Design(error) => in_loop(error),
    }
}

/// A limit as text: a large one as a power of ten, not as a row of zeros.
pub fn short(limit: f64) -> String {
    if limit < 1e7 {
        limit.to_string()
    } else {
        format!("{limit:e}")
    }
}
