//! The text of a machine: a file, and the files it is based on.

use std::borrow::Cow;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

use super::error::{EntryError, MachineError};
use super::parts;

/// The longest chain of files that are each based on the next.
const DEPTH: usize = 8;

/// One file's text.
#[derive(Clone, Debug)]
struct Part {
    file: PathBuf,
    text: String,
    /// How many statements of provenance it has.
    statements: usize,
}

/// A machine's files: the one asked for first, then what it is based on. None for a
/// machine that was built in code.
#[derive(Clone, Debug, Default)]
pub(crate) struct Source {
    parts: Vec<Part>,
}

/// A machine is the same machine wherever it was read from, so that machines can be
/// compared field by field.
impl PartialEq for Source {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Source {
    /// Reads `path` and what it is based on; gives the keys of all, those of a
    /// file over those of its base, with the figures of the sensors that are named.
    pub fn read(path: &Path) -> Result<(Self, Table), MachineError> {
        let text = fs::read_to_string(path).map_err(|error| {
            let message = format!("cannot be read: {error}");
            MachineError::in_file(path, EntryError::new("", message))
        })?;
        Self::parse(path, &text)
    }

    /// The same for a text; `path` says where its base is looked for.
    pub fn parse(path: &Path, text: &str) -> Result<(Self, Table), MachineError> {
        let mut source = Self::default();
        let mut merged = source.add(path, text)?;
        let mut named = parts::fill(&mut merged).map_err(|error| source.locate(error))?;
        while let Some(base) = merged.remove("based_on") {
            let Value::String(base) = base else {
                return Err(source.unfounded("must be the path of a machine file"));
            };
            let folder = source.parts.last().and_then(|part| part.file.parent());
            let file = folder.unwrap_or(Path::new("")).join(base);
            if let Some(circle) = source.circle(&file) {
                return Err(source.unfounded(circle));
            }
            if source.parts.len() >= DEPTH {
                let message = format!("more than {DEPTH} files, each based on the next");
                return Err(source.unfounded(message));
            }
            let text = fs::read_to_string(&file).map_err(|error| {
                let message = format!("{} cannot be read: {error}", file.display());
                source.unfounded(message)
            })?;
            let mut below = source.add(&file, &text)?;
            let own = parts::fill(&mut below).map_err(|error| source.locate(error))?;
            parts::replace(&mut below, &named);
            named.extend(own);
            merge(&mut below, merged);
            merged = below;
        }
        Ok((source, merged))
    }

    /// If `file` is already one of the files: the circle in words.
    fn circle(&self, file: &Path) -> Option<String> {
        // Whatever its path looks like, and through links.
        let same = |file: &Path| fs::canonicalize(file).unwrap_or_else(|_| file.to_owned());
        let again = same(file);
        let first = self.parts.iter().position(|p| same(&p.file) == again)?;
        let circle = self.parts.get(first..)?;
        if circle.len() == 1 {
            return Some("the file is based on itself".to_owned());
        }
        let names = circle.iter().map(|part| part.file.display().to_string());
        let names: Vec<_> = names.chain([file.display().to_string()]).collect();
        let names = names.join(", which is based on ");
        Some(format!(
            "the files are based on each other in a circle: {names}"
        ))
    }

    /// An error of the last file's `based_on`.
    fn unfounded(&self, message: impl Into<String>) -> MachineError {
        let error = EntryError::new("based_on", message);
        match self.parts.last() {
            Some(part) => match find(&part.text, &error.entry) {
                Some((_, span)) => MachineError::at(&part.file, &part.text, span, error),
                None => MachineError::in_file(&part.file, error),
            },
            None => MachineError::in_code(error),
        }
    }

    /// The files and their texts, the one asked for first.
    pub fn files(&self) -> impl Iterator<Item = (&Path, &str)> {
        let parts = self.parts.iter();
        parts.map(|part| (&*part.file, &*part.text))
    }

    /// The folder of the first file that has the whole `entry`: paths in it are relative to that.
    /// Empty for a machine that was built in code.
    pub fn folder(&self, entry: &str) -> &Path {
        let whole =
            |part: &&Part| find(&part.text, entry).is_some_and(|(length, _)| length == entry.len());
        let part = self.parts.iter().find(whole);
        let folder = part.and_then(|part| part.file.parent());
        folder.unwrap_or(Path::new(""))
    }

    fn add(&mut self, path: &Path, text: &str) -> Result<Table, MachineError> {
        let table: Table = text.parse().map_err(|first| {
            let of = |error: toml::de::Error| {
                let message = error.message().trim().replace('\n', "; ");
                let message = EntryError::new("", message);
                match error.span() {
                    Some(span) => MachineError::at(path, text, span, message),
                    None => MachineError::in_file(path, message),
                }
            };
            // One error in each line: what follows in it may follow from the first.
            let first = of(first);
            let mut lines = vec![first.line()];
            let (_, found) = DeTable::parse_recoverable(text);
            let others = found.into_iter().map(of).filter(|other| {
                let new = !lines.contains(&other.line());
                lines.push(other.line());
                new
            });
            let others: Vec<_> = others.collect();
            first.and(others)
        })?;
        let statements = table.get(PROVENANCE).and_then(Value::as_array);
        self.parts.push(Part {
            file: path.to_owned(),
            text: text.to_owned(),
            statements: statements.map_or(0, Vec::len),
        });
        Ok(table)
    }

    /// `error` with the file and the bytes of its entry: in the first file that has the
    /// whole key, else in the one that has most of it.
    /// Its others likewise, in the order of the files.
    pub fn locate(&self, mut error: EntryError) -> MachineError {
        let more = core::mem::take(&mut error.more);
        let all = [error].into_iter().chain(more);
        let mut all: Vec<_> = all.map(|error| self.locate_one(error)).collect();
        let part = |error: &MachineError| {
            let of = |part: &Part| Some(&*part.file) == error.file();
            self.parts.iter().position(of)
        };
        all.sort_by_key(|error| (part(error), error.span().map(|span| span.start)));
        let first = all.remove(0);
        first.and(all)
    }

    fn locate_one(&self, error: EntryError) -> MachineError {
        let mut best: Option<(usize, &Part, Range<usize>)> = None;
        for (i, part) in self.parts.iter().enumerate() {
            if let Some(entry) = self.within(i, &error.entry)
                && let Some((length, span)) = find(&part.text, &entry)
                && best.as_ref().is_none_or(|(longest, ..)| length > *longest)
            {
                best = Some((length, part, span));
            }
        }
        match (best, self.parts.first()) {
            (Some((_, part, span)), _) => MachineError::at(&part.file, &part.text, span, error),
            (None, Some(part)) => MachineError::in_file(&part.file, error),
            (None, None) => MachineError::in_code(error),
        }
    }

    /// `entry` as it is called within part `i`; none if it is in another part. Statements
    /// of provenance are counted through all files, those of the last base first.
    fn within<'a>(&self, i: usize, entry: &'a str) -> Option<Cow<'a, str>> {
        let Some((index, rest)) = entry.strip_prefix(PROVENANCE).and_then(index) else {
            return Some(entry.into());
        };
        let before: usize = self.parts[i + 1..].iter().map(|p| p.statements).sum();
        let own = index
            .checked_sub(before)
            .filter(|&own| own < self.parts[i].statements)?;
        Some(format!("{PROVENANCE}[{own}]{rest}").into())
    }
}

const PROVENANCE: &str = "provenance";

/// Lays `over` over `below`: tables key by key, statements of provenance one
/// after the other, all else in place of what was there.
fn merge(below: &mut Table, over: Table) {
    for (key, value) in over {
        match (below.get_mut(&key), value) {
            (Some(Value::Table(inner)), Value::Table(value)) => merge(inner, value),
            (Some(Value::Array(list)), Value::Array(more)) if key == PROVENANCE => {
                list.extend(more);
            }
            (_, value) => {
                below.insert(key, value);
            }
        }
    }
}

/// How many bytes of the key `entry` name something in a text, and where that is.
fn find(text: &str, entry: &str) -> Option<(usize, Range<usize>)> {
    let document = DeTable::parse(text).ok()?;
    let mut table = document.get_ref();
    let mut rest = entry;
    let mut found = None;
    loop {
        // Names may have dots in them: the longest that fits.
        let fits = |(key, value)| Some((key, value, below(rest, key)?));
        let keys = table.iter().filter_map(fits);
        let Some((key, mut value, after)) = keys.max_by_key(|(key, ..)| key.get_ref().len()) else {
            return found;
        };
        rest = after;
        let mut span = with_value(text, key.span(), value);
        while let Some((i, after)) = index(rest)
            && let Some(element) = value.get_ref().as_array().and_then(|list| list.get(i))
        {
            (value, rest, span) = (element, after, element.span());
        }
        rest = rest.strip_prefix('.').unwrap_or(rest);
        found = Some((entry.len() - rest.len(), span));
        let DeValue::Table(next) = value.get_ref() else {
            return found;
        };
        table = next;
    }
}

/// What is left of `entry` below `key`, if it begins with it.
fn below<'a>(entry: &'a str, key: &Spanned<Cow<'_, str>>) -> Option<&'a str> {
    let rest = entry.strip_prefix(&**key.get_ref())?;
    (rest.is_empty() || rest.starts_with(['.', '['])).then_some(rest)
}

/// `[3].from` as 3 and `.from`.
fn index(entry: &str) -> Option<(usize, &str)> {
    let (index, rest) = entry.strip_prefix('[')?.split_once(']')?;
    Some((index.parse().ok()?, rest))
}

/// A key with its value, or the key alone where the value is a table or has many lines.
fn with_value(text: &str, key: Range<usize>, value: &Spanned<DeValue<'_>>) -> Range<usize> {
    let whole = key.start..value.span().end.max(key.end);
    let short = text.get(whole.clone()).is_some_and(|t| !t.contains('\n'));
    if short && !value.get_ref().is_table() {
        whole
    } else {
        key
    }
}

/// Whether a table has the key `entry`.
pub(super) fn has(table: &Table, entry: &str) -> bool {
    let mut table = Some(table);
    entry.split('.').all(|part| {
        let value = table.and_then(|t| t.get(part));
        table = value.and_then(Value::as_table);
        value.is_some()
    })
}
