//! Printing of results to standard output.

use std::fmt::Display;
use std::io::{self, Write as _};

use anstyle::{AnsiColor, Style};
use serde::Serialize;

use crate::arguments::Format;
use crate::failure::Failure;

const WARNING: Style = AnsiColor::Yellow.on_default().bold();

/// Prints a result as text or as JSON.
pub fn result<T: Display + Serialize>(format: Format, result: &T) -> Result<(), Failure> {
    text(&rendered(format, result))
}

/// A result as text or as JSON.
pub fn rendered<T: Display + Serialize>(format: Format, result: &T) -> String {
    match format {
        Format::Text => result.to_string(),
        Format::Json => json(result),
    }
}

/// A result with what is suspicious about its machine.
#[derive(Serialize)]
struct Warned<'a, T> {
    #[serde(flatten)]
    result: &'a T,
    warnings: &'a [String],
}

/// Prints the result of a machine: as text, with its `warnings` on standard error, or as JSON, with
/// the warnings in it.
pub fn warned<T: Display + Serialize>(
    format: Format,
    result: &T,
    warnings: &[String],
) -> Result<(), Failure> {
    match format {
        Format::Text => {
            self::result(format, result)?;
            warn(warnings);
            Ok(())
        }
        Format::Json => {
            let whole = Warned { result, warnings };
            text(&json(&whole))
        }
    }
}

/// Prints warnings on standard error.
pub fn warn(warnings: &[String]) {
    for warning in warnings {
        anstream::eprintln!("{WARNING}warning:{WARNING:#} {warning}");
    }
}

fn json(result: &impl Serialize) -> String {
    serde_json::to_string_pretty(result).expect("numbers and strings serialise") + "\n"
}

/// A time in s, to the nanosecond: few sample rates have a period that is a round number.
pub fn seconds(time: f64) -> String {
    format!("{time:.9}")
}

/// Prints text; colours only on a terminal.
pub fn text(text: &str) -> Result<(), Failure> {
    written(anstream::stdout().write_all(text.as_bytes()))
}

/// The outcome of writing to standard output.
pub fn written(outcome: io::Result<()>) -> Result<(), Failure> {
    match outcome {
        // The reader has closed the pipe: not an error.
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        Err(error) => Err(Failure::Io {
            path: "standard output".to_owned(),
            what: "written",
            error,
        }),
        Ok(()) => Ok(()),
    }
}
