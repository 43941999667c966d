//! Printing of results to standard output.

use std::fmt::Display;
use std::io::{self, Write as _};

use serde::Serialize;

use crate::arguments::Format;
use crate::failure::Failure;

/// Prints a result as text or as JSON.
pub fn result<T: Display + Serialize>(format: Format, result: &T) -> Result<(), Failure> {
    let text = match format {
        Format::Text => result.to_string(),
        Format::Json => {
            serde_json::to_string_pretty(result).expect("numbers and strings serialise") + "\n"
        }
    };
    self::text(&text)
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
