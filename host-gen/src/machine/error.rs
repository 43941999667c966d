//! Errors in a machine: the place, the entry, the cause and the fix.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::files::without_byte_order_mark;

/// What is wrong with a machine, where, and how to fix it.
///
/// Displayed, it is one line: `FILE:LINE:COLUMN: ENTRY: MESSAGE; FIX`, each part where it
/// is known. A machine that was built in code has no file and no line. What else is wrong with the
/// same machine follows, a line for each; all else is about the first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MachineError {
    file: Option<PathBuf>,
    place: Option<Box<Place>>,
    error: Box<EntryError>,
    more: Vec<MachineError>,
}

/// Bytes of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Place {
    text: String,
    span: Range<usize>,
}

impl fmt::Display for MachineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}", file.display())?;
            if let Some((line, column)) = self.place() {
                write!(f, ":{line}:{column}")?;
            }
            f.write_str(": ")?;
        }
        if !self.error.entry.is_empty() {
            write!(f, "{}: ", self.error.entry)?;
        }
        f.write_str(&self.error.message)?;
        if let Some(fix) = &self.error.fix {
            write!(f, "; {fix}")?;
        }
        for other in &self.more {
            write!(f, "\n{other}")?;
        }
        Ok(())
    }
}

impl std::error::Error for MachineError {}

impl MachineError {
    /// The file that the error is in; none for a machine that was built in code.
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// The text of that file, if it could be read and the entry is in it.
    pub fn text(&self) -> Option<&str> {
        self.place.as_ref().map(|place| &*place.text)
    }

    /// The bytes of [`text`](Self::text) that are wrong: within one line, and empty where
    /// something is missing.
    pub fn span(&self) -> Option<Range<usize>> {
        self.place.as_ref().map(|place| place.span.clone())
    }

    /// Line and column at which the span begins, from 1. Columns count characters.
    pub fn place(&self) -> Option<(usize, usize)> {
        let Place { text, span } = &**self.place.as_ref()?;
        let before = text.get(..span.start).unwrap_or(text);
        let before = without_byte_order_mark(before);
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
        Some((line, column))
    }

    /// The line at which the span begins, from 1.
    pub(super) fn line(&self) -> Option<usize> {
        self.place().map(|(line, _)| line)
    }

    /// The entry, such as `beams.leg4`; empty for the file as a whole.
    pub fn entry(&self) -> &str {
        &self.error.entry
    }

    /// The cause.
    pub fn message(&self) -> &str {
        &self.error.message
    }

    /// How to fix it, if the message does not say so already.
    pub fn fix(&self) -> Option<&str> {
        self.error.fix.as_deref()
    }

    /// This error, and then the others of the same machine.
    pub fn all(&self) -> impl Iterator<Item = &Self> {
        [self].into_iter().chain(&self.more)
    }

    /// Adds `others` of the same machine.
    pub(super) fn and(mut self, others: impl IntoIterator<Item = Self>) -> Self {
        self.more.extend(others);
        self
    }

    pub(super) fn in_code(error: EntryError) -> Self {
        Self {
            file: None,
            place: None,
            error: Box::new(error),
            more: Vec::new(),
        }
    }

    pub(super) fn in_file(file: &Path, error: EntryError) -> Self {
        Self {
            file: Some(file.to_owned()),
            place: None,
            error: Box::new(error),
            more: Vec::new(),
        }
    }

    /// An error at `span` of the `text` of a file.
    pub(super) fn at(file: &Path, text: &str, span: Range<usize>, error: EntryError) -> Self {
        let start = span.start.min(text.len());
        let line = text[start..].find(['\r', '\n']);
        let end_of_line = line.map_or(text.len(), |length| start + length);
        Self {
            file: Some(file.to_owned()),
            place: Some(Box::new(Place {
                text: text.to_owned(),
                span: start..span.end.clamp(start, end_of_line),
            })),
            error: Box::new(error),
            more: Vec::new(),
        }
    }
}

/// An error before its place is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct EntryError {
    pub entry: String,
    pub message: String,
    pub fix: Option<String>,
    /// What else is wrong, each without more.
    pub more: Vec<EntryError>,
}

impl EntryError {
    pub fn new(entry: impl Into<String>, message: impl Into<String>) -> Self {
        Self {
            entry: entry.into(),
            message: message.into(),
            fix: None,
            more: Vec::new(),
        }
    }

    /// Adds another error and its own others, but none that says the same, or that is about an array of
    /// which an element is wrong already.
    pub fn and(mut self, mut other: Self) -> Self {
        let more = core::mem::take(&mut other.more);
        for other in [other].into_iter().chain(more) {
            let same = |known: &Self| match known.entry.strip_prefix(&other.entry) {
                Some("") => known.message == other.message,
                Some(rest) => rest.starts_with('['),
                None => false,
            };
            if !same(&self) && !self.more.iter().any(same) {
                self.more.push(other);
            }
        }
        self
    }

    /// Says how to fix it.
    pub fn fix(mut self, fix: impl Into<String>) -> Self {
        self.fix = Some(fix.into());
        self
    }
}

/// All values, or all errors.
pub(super) fn all<T>(
    results: impl IntoIterator<Item = Result<T, EntryError>>,
) -> Result<Vec<T>, EntryError> {
    let mut values = Vec::new();
    let mut found: Option<EntryError> = None;
    for result in results {
        match result {
            Ok(value) => values.push(value),
            Err(error) => {
                found = Some(match found {
                    Some(found) => found.and(error),
                    None => error,
                });
            }
        }
    }
    found.map_or(Ok(values), Err)
}

/// Both values, or the errors of both.
pub(super) fn both<A, B>(
    a: Result<A, EntryError>,
    b: Result<B, EntryError>,
) -> Result<(A, B), EntryError> {
    match (a, b) {
        (Ok(a), Ok(b)) => Ok((a, b)),
        (Err(a), Err(b)) => Err(a.and(b)),
        (Err(error), Ok(_)) | (Ok(_), Err(error)) => Err(error),
    }
}
