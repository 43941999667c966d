//! The text of a machine: a file, and the files it is based on.

use std::fs;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

use super::error::{Fault, MachineError};

/// A file may be based on one that is based on one, and so on, this often.
const DEPTH: usize = 8;

/// One file's text.
#[derive(Clone, Debug)]
struct Part {
    file: PathBuf,
    text: String,
}

/// A machine's files, the one asked for first, then what it is based on.
#[derive(Clone, Debug)]
pub(crate) struct Source {
    parts: Vec<Part>,
}

impl Source {
    /// Reads `path` and what it is based on; gives the keys of all, those of a
    /// file over those of its base.
    pub fn read(path: &Path) -> Result<(Self, Table), MachineError> {
        let text =
            fs::read_to_string(path).map_err(|error| MachineError::unreadable(path, &error))?;
        Self::parse(path, &text)
    }

    /// The same for a text; `path` says where its base is looked for.
    pub fn parse(path: &Path, text: &str) -> Result<(Self, Table), MachineError> {
        let mut source = Self { parts: Vec::new() };
        let mut merged = source.add(path, text)?;
        while let Some(base) = merged.remove("based_on") {
            let Value::String(base) = base else {
                let fault = Fault::new("based_on", "is the path of a machine file");
                return Err(source.locate(fault));
            };
            if source.parts.len() >= DEPTH {
                let problem = format!("more than {DEPTH} files, each based on the next");
                return Err(source.locate(Fault::new("based_on", problem)));
            }
            let folder = source.parts.last().and_then(|part| part.file.parent());
            let file = folder.unwrap_or(Path::new("")).join(base);
            let text = fs::read_to_string(&file).map_err(|error| {
                let problem = format!("{} cannot be read: {error}", file.display());
                source.locate(Fault::new("based_on", problem))
            })?;
            let mut below = source.add(&file, &text)?;
            merge(&mut below, merged);
            merged = below;
        }
        Ok((source, merged))
    }

    /// The files and their texts, the one asked for first.
    pub fn files(&self) -> impl Iterator<Item = (&Path, &str)> {
        let parts = self.parts.iter();
        parts.map(|part| (&*part.file, &*part.text))
    }

    fn add(&mut self, path: &Path, text: &str) -> Result<Table, MachineError> {
        let table = text
            .parse()
            .map_err(|error| MachineError::syntax(path, text, &error))?;
        self.parts.push(Part {
            file: path.to_owned(),
            text: text.to_owned(),
        });
        Ok(table)
    }

    /// `fault` with the file, line and column of its entry: in the first file
    /// that has the whole key, else in the one that has most of it.
    pub fn locate(&self, fault: Fault) -> MachineError {
        let mut best: Option<(usize, &Part, usize)> = None;
        for part in &self.parts {
            if let Some((depth, offset)) = position(&part.text, &fault.entry)
                && best.is_none_or(|(deepest, ..)| depth > deepest)
            {
                best = Some((depth, part, offset));
            }
        }
        match best {
            Some((_, part, offset)) => {
                let place = line_and_column(&part.text, offset);
                MachineError::new(&part.file, Some(place), fault)
            }
            None => MachineError::new(&self.parts[0].file, None, fault),
        }
    }
}

/// Lays `over` over `below`: tables key by key, statements of provenance one
/// after the other, all else in place of what was there.
fn merge(below: &mut Table, over: Table) {
    for (key, value) in over {
        match (below.get_mut(&key), value) {
            (Some(Value::Table(inner)), Value::Table(value)) => merge(inner, value),
            (Some(Value::Array(list)), Value::Array(more)) if key == "provenance" => {
                list.extend(more);
            }
            (_, value) => {
                below.insert(key, value);
            }
        }
    }
}

/// Line and column, from 1, of a byte in a text.
pub(super) fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
    (line, column)
}

/// How many parts of the key `entry` a text has, and where the last of them
/// stands.
fn position(text: &str, entry: &str) -> Option<(usize, usize)> {
    let document = DeTable::parse(text).ok()?;
    let mut table = document.get_ref();
    let mut found = None;
    for (depth, part) in entry.split('.').enumerate() {
        let Some((key, value)) = table.get_key_value(part) else {
            break;
        };
        found = Some((depth, key.span().start));
        match value.get_ref() {
            DeValue::Table(next) => table = next,
            _ => break,
        }
    }
    found
}

/// Whether a table has the key `entry`.
pub(crate) fn has(table: &Table, entry: &str) -> bool {
    let mut table = Some(table);
    entry.split('.').all(|part| {
        let value = table.and_then(|t| t.get(part));
        table = value.and_then(Value::as_table);
        value.is_some()
    })
}
