//! Arguments that several commands take.

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use host_gen::floor::Criterion;
use host_gen::machine::limits::Limits;
use host_gen::machine::{Machine, MachineError};

use crate::failure::Failure;

#[derive(Args)]
pub struct Common {
    /// Machine file, see docs/machine-file.md.
    pub model: PathBuf,
    /// Output format: text, or JSON as in docs/json.md.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub format: Format,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    Text,
    Json,
}

/// The machine files of a command.
#[derive(Args)]
pub struct Several {
    /// Machine files.
    #[arg(required = true)]
    pub models: Vec<PathBuf>,
    /// Use each machine with acceleration feedback, with force feedback and with both.
    #[arg(long)]
    pub by_feedback: bool,
}

impl Several {
    /// The machines of the files, each with the feedback of its file.
    pub fn load(&self) -> Result<Vec<Machine>, MachineError> {
        let machines = self.models.iter().map(|model| Machine::load(model));
        machines.collect()
    }
}

/// Parses a criterion from its name in lower case.
pub fn criterion() -> impl TypedValueParser<Value = Criterion> {
    PossibleValuesParser::new(Criterion::ALL.map(Criterion::key)).try_map(|key| key.parse())
}

/// Parses a count from `least` to `most`.
pub fn count(least: u64, most: u64) -> impl TypedValueParser<Value = usize> {
    clap::value_parser!(u64)
        .range(least..=most)
        .map(|count| count as usize)
}

/// Parses a number above 0.
pub fn above_zero(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(number) if number > 0.0 && f32::is_finite(number) => Ok(number),
        _ => Err("must be a number above 0".to_owned()),
    }
}

/// Checks a band of frequencies, Hz.
pub fn band(from: f64, to: f64) -> Result<[f64; 2], Failure> {
    let from = positive("from", from, "performance.bands.*")?;
    if !(to.is_finite() && to > from) {
        return Err(Failure::Range);
    }
    Ok([from, as_in_file("to", to, "performance.bands.*")?])
}

/// Checks a number above 0 that has the limits of `entry` in a machine file.
pub fn positive(flag: &'static str, value: f64, entry: &str) -> Result<f64, Failure> {
    if !(value.is_finite() && value > 0.0) {
        return Err(Failure::Option(flag));
    }
    as_in_file(flag, value, entry)
}

/// Checks a number from `least` to `most`; `unit` begins with a space.
pub fn between(
    flag: &'static str,
    value: f64,
    [least, most]: [f64; 2],
    unit: &'static str,
) -> Result<f64, Failure> {
    if (least..=most).contains(&value) {
        return Ok(value);
    }
    Err(Failure::Between {
        flag,
        least,
        most,
        unit,
    })
}

/// Checks a finite number that has the limits of `entry` in a machine file.
fn as_in_file(flag: &'static str, value: f64, entry: &str) -> Result<f64, Failure> {
    match Limits::of(entry) {
        Some(limits) if !limits.hold(value) => Err(Failure::Limits {
            flag,
            limits: limits.to_string(),
            value,
        }),
        _ => Ok(value),
    }
}
