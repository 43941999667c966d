//! Errors in a machine file, with the place and the mend.

use std::fmt;
use std::path::{Path, PathBuf};

use super::source::line_and_column;

/// What is wrong with a machine file, where, and what mends it.
#[derive(Debug, PartialEq, Eq)]
pub struct MachineError {
    file: PathBuf,
    /// Line and column, from 1.
    place: Option<(usize, usize)>,
    /// The entry, such as `beams.leg4`; empty where it is the file itself.
    entry: String,
    problem: String,
}

impl fmt::Display for MachineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some((line, column)) = self.place {
            write!(f, ":{line}:{column}")?;
        }
        if !self.entry.is_empty() {
            write!(f, ": {}", self.entry)?;
        }
        write!(f, ": {}", self.problem)
    }
}

impl std::error::Error for MachineError {}

impl MachineError {
    /// The entry the error names.
    pub fn entry(&self) -> &str {
        &self.entry
    }

    /// Line and column of that entry, from 1.
    pub fn place(&self) -> Option<(usize, usize)> {
        self.place
    }

    pub(super) fn unreadable(file: &Path, error: &std::io::Error) -> Self {
        Self {
            file: file.to_owned(),
            place: None,
            entry: String::new(),
            problem: format!("cannot be read: {error}"),
        }
    }

    pub(super) fn syntax(file: &Path, text: &str, error: &toml::de::Error) -> Self {
        Self {
            file: file.to_owned(),
            place: error.span().map(|span| line_and_column(text, span.start)),
            entry: String::new(),
            problem: error.message().to_owned(),
        }
    }

    pub(super) fn new(file: &Path, place: Option<(usize, usize)>, fault: Fault) -> Self {
        Self {
            file: file.to_owned(),
            place,
            entry: fault.entry,
            problem: fault.problem,
        }
    }
}

/// An error before its place is known.
#[derive(Debug)]
pub(crate) struct Fault {
    pub entry: String,
    pub problem: String,
}

impl Fault {
    pub fn new(entry: impl Into<String>, problem: impl Into<String>) -> Self {
        Self {
            entry: entry.into(),
            problem: problem.into(),
        }
    }
}
