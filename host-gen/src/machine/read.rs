//! From TOML values to the file's types, with errors in terms of the file.

use serde_path_to_error::{Path, Segment};

use super::error::EntryError;
use super::file::MachineFile;
use super::names::nearest;
use super::schema::{CONTROL, missing, summary, unit};

/// The file that a table of keys and values is; or all that is wrong with its keys and the types of
/// its values.
///
/// serde tells the first error only. What is wrong is taken out of the table, with the table around it
/// where that cannot be without, until the rest is right. A key that is misspelt is read as what was
/// meant.
pub(super) fn file(table: toml::Table) -> Result<MachineFile, EntryError> {
    let mut rest = table.clone();
    // With the keys that were meant.
    let mut given = table;
    let mut found: Option<EntryError> = None;
    let mut told_missing = false;
    loop {
        let error = match serde_path_to_error::deserialize(toml::Value::Table(rest.clone())) {
            Ok(file) => return found.map_or(Ok(file), Err),
            Err(error) => error,
        };
        let (path, message) = (error.path(), error.inner().message());
        let keys = names(path);
        let in_array = path.iter().count() > keys.len();
        let missing = message.strip_prefix("missing field ");
        let missing = missing.map(|name| name.trim_matches('`'));
        let mut is_new = true;
        let mut repaired = false;
        if let Some(meant) = meant_key(message).filter(|_| !in_array) {
            rename(&mut given, &keys, meant);
            repaired = rename(&mut rest, &keys, meant);
        }
        let mut new = None;
        if let Some(name) = missing.filter(|_| !in_array) {
            // All that are missing are told at once, and what was taken out is not missing.
            is_new = !told_missing && !has(&given, &keys, name);
            if !told_missing {
                new = all_missing(&given);
            }
            told_missing = true;
            repaired = keys.is_empty() && stand_in(&mut rest, name);
        }
        if new.is_none() && is_new {
            new = Some(refusal(entry(path), path, message));
        }
        found = match (found, new) {
            (Some(found), Some(new)) => Some(found.and(new)),
            (found, new) => found.or(new),
        };
        if !repaired && !take_out(&mut rest, &keys) {
            return Err(found.unwrap_or_else(|| refusal(entry(path), path, message)));
        }
    }
}

/// The key that was meant where serde says that one is unknown.
fn meant_key(message: &str) -> Option<&str> {
    let unknown = message.strip_prefix("unknown field ")?;
    let (name, expected) = unknown.split_once(", expected ")?;
    meant(name, expected)
}

/// The path of an entry, as errors name it; empty for the file as a whole.
fn entry(path: &Path) -> String {
    match path.to_string().as_str() {
        "." => String::new(),
        path => path.to_owned(),
    }
}

/// The keys on a path, down to the first that is not one of a table.
fn names(path: &Path) -> Vec<String> {
    let keys = path.iter().map_while(|segment| match segment {
        Segment::Map { key } => Some(key.clone()),
        _ => None,
    });
    keys.collect()
}

/// Whether a table has the key `name` in the table under `keys`.
fn has(table: &toml::Table, keys: &[String], name: &str) -> bool {
    let inner = keys.iter().try_fold(table, |table, key| {
        table.get(key).and_then(toml::Value::as_table)
    });
    inner.is_some_and(|inner| inner.contains_key(name))
}

/// The table in which the last of `keys` is, and that key.
fn innermost<'a, 'b>(
    table: &'a mut toml::Table,
    keys: &'b [String],
) -> Option<(&'a mut toml::Table, &'b str)> {
    let (last, above) = keys.split_last()?;
    let inner = above.iter().try_fold(table, |table, key| {
        table.get_mut(key).and_then(toml::Value::as_table_mut)
    })?;
    Some((inner, last))
}

/// Removes what is under `keys`; false if there is nothing.
fn take_out(table: &mut toml::Table, keys: &[String]) -> bool {
    let place = innermost(table, keys);
    place.is_some_and(|(inner, last)| inner.remove(last).is_some())
}

/// Gives what is under `keys` the last key `name`; false if there is nothing, or that key is there.
fn rename(table: &mut toml::Table, keys: &[String], name: &str) -> bool {
    let Some((inner, last)) = innermost(table, keys) else {
        return false;
    };
    if inner.contains_key(name) {
        return false;
    }
    let value = inner.remove(last);
    let there = value.is_some();
    inner.extend(value.map(|value| (name.to_owned(), value)));
    there
}

/// Puts something valid under a key of the file as a whole; false if it is no required one.
fn stand_in(table: &mut toml::Table, name: &str) -> bool {
    let value = match name {
        "format" => Some(toml::Value::Integer(1)),
        "name" => Some(toml::Value::String("unnamed".to_owned())),
        name => unread().remove(name),
    };
    let there = value.is_some();
    table.extend(value.map(|value| (name.to_owned(), value)));
    there
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

fn unread() -> toml::Table {
    UNREAD.parse().expect("it is TOML")
}

fn has_no_control(table: &toml::Table) -> bool {
    !CONTROL.iter().any(|key| table.contains_key(*key))
}

/// The file that a table without control is, of which only what vibrates may be read; `None` if the
/// table says something of control.
pub(super) fn passive(mut table: toml::Table) -> Option<Result<MachineFile, EntryError>> {
    if !has_no_control(&table) {
        return None;
    }
    table.extend(unread());
    Some(file(table))
}

/// All missing keys at once; `None` if there is none.
fn all_missing(table: &toml::Table) -> Option<EntryError> {
    let missing = missing(table);
    let first = missing.first()?;
    let (name, above) = first.split_last()?;
    let entry = above.join(".");
    if missing.len() == 1 {
        return Some(missing_key(
            entry,
            name,
            first.iter().map(|key| Some(key.as_str())),
        ));
    }
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

/// The error of one missing key, whose `path` is its own.
fn missing_key<'a>(
    entry: String,
    name: &str,
    path: impl Iterator<Item = Option<&'a str>>,
) -> EntryError {
    let error = EntryError::new(entry, format!("missing key `{name}`"));
    match summary(path) {
        Some(summary) => error.fix(format!("add it: {summary}")),
        None => error,
    }
}

/// What is `expected`, with names between back-quotes, that is nearest to a `name`.
fn meant<'a>(name: &str, expected: &'a str) -> Option<&'a str> {
    let known = expected.split('`').skip(1).step_by(2);
    nearest(name.trim_matches('`'), known)
}

/// Says what serde says for the person who wrote the file.
fn refusal(entry: String, path: &Path, message: &str) -> EntryError {
    let keys = path.iter().map(|segment| match segment {
        Segment::Map { key } => Some(key.as_str()),
        _ => None,
    });
    let (what, expected) = message.split_once(", expected ").unwrap_or((message, ""));
    let unknown = |what: &str, name: &str| {
        let near = meant(name, expected);
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
        let name = name.trim_matches('`');
        missing_key(entry, name, keys.chain([Some(name)]))
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
