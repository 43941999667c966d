//! Errors in a machine file, with the place and the mend.

use std::fmt;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};

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

    /// `fault` found in `text`, with its line and column looked up.
    pub(super) fn locate(file: &Path, text: &str, fault: Fault) -> Self {
        Self {
            file: file.to_owned(),
            place: position(text, &fault.entry),
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

fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
    (line, column)
}

/// Where the key `entry` stands, or the nearest key above it that exists.
fn position(text: &str, entry: &str) -> Option<(usize, usize)> {
    let document = DeTable::parse(text).ok()?;
    let mut table = document.get_ref();
    let mut offset = None;
    for part in entry.split('.') {
        let Some((key, value)) = table.get_key_value(part) else {
            break;
        };
        offset = Some(key.span().start);
        match value.get_ref() {
            DeValue::Table(next) => table = next,
            _ => break,
        }
    }
    offset.map(|offset| line_and_column(text, offset))
}

/// Whether the key `entry` exists in `text`.
pub(crate) fn exists(text: &str, entry: &str) -> bool {
    let Ok(document) = DeTable::parse(text) else {
        return false;
    };
    let mut table = Some(document.get_ref());
    entry.split('.').all(|part| {
        let Some(value) = table.and_then(|t| t.get(part)) else {
            return false;
        };
        table = match value.get_ref() {
            DeValue::Table(next) => Some(next),
            _ => None,
        };
        true
    })
}
