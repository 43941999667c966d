//! A library of sensors with the figures of their makers: `parts.toml` in the sources.

use std::fmt::{self, Display, Formatter};
use std::sync::LazyLock;

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::error::EntryError;
use super::names::missing;

/// A sensor of the library.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// Maker, type and kind, in words.
    pub part: String,
    /// Where the figures are from, with the figures as they are stated there.
    pub source: String,
    /// What the source does not state.
    pub assumed: String,
    /// Values of keys of `[board.accelerometer]` or `[board.force_sensor]`, SI units.
    pub figures: Table,
}

/// The sensors of one kind by name.
pub type Parts = IndexMap<String, Part>;

/// All sensors by kind: `"accelerometer"`, as the table in `[board]` that they are for. There are
/// no force sensors.
pub type Library = IndexMap<String, Parts>;

/// The library.
pub fn all() -> &'static Library {
    static ALL: LazyLock<Library> = LazyLock::new(|| {
        toml::from_str(include_str!("parts.toml")).expect("tests read the library")
    });
    &ALL
}

/// One line with the name, one with the figures, then source and assumptions.
impl Display for Part {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.part)?;
        for (key, value) in &self.figures {
            writeln!(f, "  {key} = {value}")?;
        }
        writeln!(f, "  source: {}", self.source)?;
        writeln!(f, "  assumed: {}", self.assumed)
    }
}

/// Puts the figures of the sensors that one file's table names into it, below its own keys, and
/// takes the names out. Returns the kinds whose parts are named or given by a data sheet.
///
/// # Errors
/// If a name is no string or not in the library.
pub(super) fn fill(file: &mut Table) -> Result<Vec<&'static str>, EntryError> {
    let mut named = Vec::new();
    for kind in KINDS {
        let Some(sensor) = part(file, kind) else {
            continue;
        };
        let Some(name) = sensor.remove("sensor") else {
            continue;
        };
        let entry = format!("board.{kind}.sensor");
        let Value::String(name) = name else {
            return Err(EntryError::new(
                entry,
                "expected a string, the name of a sensor",
            ));
        };
        let Some(part) = all().get(kind).and_then(|parts| parts.get(&name)) else {
            return Err(unknown(entry, kind, &name));
        };
        for (key, value) in &part.figures {
            if !sensor.contains_key(key) {
                sensor.insert(key.clone(), value.clone());
            }
        }
        named.push(kind);
    }
    let own = part(file, ACTUATOR);
    if own.is_some_and(|own| DATA_SHEETS.iter().any(|key| own.contains_key(*key))) {
        named.push(ACTUATOR);
    }
    Ok(named)
}

/// Takes the figures of the parts of these `kinds` out of the table of a file below one that names
/// others: they are not those of the named parts.
pub(super) fn replace(below: &mut Table, kinds: &[&str]) {
    for kind in kinds {
        if let Some(part) = part(below, kind) {
            part.retain(|key, _| match *kind {
                ACTUATOR => !MADE.contains(&key) && !DATA_SHEETS.contains(&key),
                _ => !FIGURES.contains(&key),
            });
        }
    }
}

/// The table of `[board]` with the parts of a kind.
fn part<'a>(file: &'a mut Table, kind: &str) -> Option<&'a mut Table> {
    let board = file.get_mut("board")?.as_table_mut()?;
    board.get_mut(kind)?.as_table_mut()
}

/// The keys that are figures of a sensor, not of the board that it is on.
const FIGURES: [&str; 7] = [
    "sensitivity",
    "noise_density",
    "bandwidth",
    "lower_corner",
    "lower_order",
    "transverse",
    "resonance",
];

/// The table of the actuators in `[board]`, and its keys with the figures of a data sheet.
const ACTUATOR: &str = "actuator";
const DATA_SHEETS: [&str; 2] = ["piezo", "voice_coil"];

/// The keys of actuators that follow from a data sheet.
const MADE: [&str; 2] = ["gain", "limit"];

/// The tables of `[board]` that may name a sensor.
pub(super) const KINDS: [&str; 2] = ["accelerometer", "force_sensor"];

fn unknown(entry: String, kind: &str, name: &str) -> EntryError {
    let words = kind.replace('_', " ");
    let known = all().get(kind).into_iter().flatten();
    let known = known.map(|(name, _)| name.as_str());
    let fix = "give its figures as keys; host-gen parts lists the sensors that are known";
    missing(entry, &words, name, known, fix)
}
