//! From TOML values to the file's types, with errors in terms of the file.

use serde_path_to_error::{Path, Segment};

use super::error::EntryError;
use super::file::MachineFile;
use super::names::nearest;
use super::schema::{CONTROL, missing, summary, unit};

/// The file that a table of keys and values is.
pub(super) fn file(table: toml::Table) -> Result<MachineFile, EntryError> {
    serde_path_to_error::deserialize(toml::Value::Table(table.clone())).map_err(|error| {
        let entry = match error.path().to_string().as_str() {
            // The file as a whole.
            "." => String::new(),
            path => path.to_owned(),
        };
        let message = error.inner().message();
        if message.starts_with("missing field ")
            && let Some(all) = all_missing(&table)
        {
            return all;
        }
        refusal(entry, error.path(), message)
    })
}

/// What stands for the tables of control where nothing reads them.
const UNREAD: &str = r#"
coordinates = { deformations = [] }
actuators = { beams = [] }
sensors = {}
floor = { inputs = {} }
performance = {}
control = { feedback = "acceleration", frequency = 1.0, damping = 1.0 }
[board]
sample_rate = 1.0
conversion_delay = 0.0
output_delay = 0.0
adc = { bits = 16, range = 1.0 }
dac = { bits = 16, range = [0.0, 1.0] }
actuator = { gain = 1.0, limit = 1.0 }
"#;

fn has_no_control(table: &toml::Table) -> bool {
    !CONTROL.iter().any(|key| table.contains_key(*key))
}

/// The file that a table without control is, of which only what vibrates may be read; `None` if the
/// table says something of control.
pub(super) fn passive(mut table: toml::Table) -> Option<Result<MachineFile, EntryError>> {
    if !has_no_control(&table) {
        return None;
    }
    let unread: toml::Table = UNREAD.parse().expect("it is TOML");
    table.extend(unread);
    Some(file(table))
}

/// All missing keys at once; `None` if there is one.
fn all_missing(table: &toml::Table) -> Option<EntryError> {
    let missing = missing(table);
    let [first, _, ..] = &missing[..] else {
        return None;
    };
    let entry = first[..first.len() - 1].join(".");
    let named = missing.iter().map(|path| format!("`{}`", path.join(".")));
    let keys = named.clone().collect::<Vec<_>>().join(", ");
    let fixes = named.zip(&missing).map(|(name, path)| {
        match summary(path.iter().map(|key| Some(key.as_str()))) {
            Some(summary) => format!("{name}, {summary}"),
            None => name,
        }
    });
    let fixes = fixes.collect::<Vec<_>>().join("; ");
    let alone = match has_no_control(table) {
        true => "host-gen modes and report work without control; for all else ",
        false => "",
    };
    let error = EntryError::new(entry, format!("missing keys {keys}"));
    Some(error.fix(format!("{alone}add them: {fixes}")))
}

/// Says what serde says for the person who wrote the file.
fn refusal(entry: String, path: &Path, message: &str) -> EntryError {
    let keys = path.iter().map(|segment| match segment {
        Segment::Map { key } => Some(key.as_str()),
        _ => None,
    });
    let (what, expected) = message.split_once(", expected ").unwrap_or((message, ""));
    let unknown = |what: &str, name: &str| {
        // Names are between back-quotes.
        let known = expected.split('`').skip(1).step_by(2);
        let near = nearest(name.trim_matches('`'), known);
        let meant = near.map(|near| format!("did you mean `{near}`? Otherwise "));
        let meant = meant.unwrap_or_default();
        EntryError::new(entry.clone(), format!("unknown {what} {name}"))
            .fix(format!("{meant}use {expected}"))
    };
    if let Some(name) = what.strip_prefix("unknown field ") {
        unknown("key", name)
    } else if let Some(name) = what.strip_prefix("unknown variant ") {
        unknown("value", name)
    } else if let Some(name) = what.strip_prefix("missing field ") {
        let error = EntryError::new(entry, format!("missing key {name}"));
        match summary(keys.chain([Some(name.trim_matches('`'))])) {
            Some(summary) => error.fix(format!("add it: {summary}")),
            None => error,
        }
    } else if let Some(found) = what.strip_prefix("invalid ") {
        let found = found.trim_start_matches("type: ");
        let found = found.trim_start_matches("value: ");
        let summary = summary(keys).unwrap_or_default();
        let unit = unit(&summary).map(|unit| format!(", in {unit}"));
        let unit = unit.unwrap_or_default();
        let expected = match expected {
            // What toml says of a name that is no string.
            "string only" => return EntryError::new(entry, "expected a string").fix(summary),
            "f64" => format!("a number{unit}"),
            "u16" => format!("a whole number from 0 to {}", u16::MAX),
            "u32" => format!("a whole number from 0 to {}", u32::MAX),
            "u64" | "usize" => "a whole number, at least 0".to_owned(),
            "a map" => "a table".to_owned(),
            "a sequence" => "an array".to_owned(),
            table if table.starts_with("struct ") => "a table".to_owned(),
            other => other.to_owned(),
        };
        EntryError::new(entry, format!("expected {expected}, found {found}"))
    } else {
        EntryError::new(entry, message)
    }
}
