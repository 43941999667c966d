//! Results of searches, kept in a folder.
//!
//! An entry holds what a search found, not what follows from it: whoever takes a
//! shaping from here verifies it as if the search had just found it. An entry that is
//! damaged, or belongs to another machine or another version of this program, is
//! ignored.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use super::outcome::{Advice, Shaping};
use super::reach::Effort;
use crate::machine::Machine;

/// A folder of results.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
}

/// What a search found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum SearchOutcome {
    /// A shaping that reaches the target.
    Found(Shaping),
    /// That none does, why, and what to change.
    Unreachable { reason: String, advice: Advice },
}

/// Everything that a search reads, as a digest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Key(String);

#[derive(Serialize, Deserialize)]
struct CacheEntry {
    key: String,
    outcome: SearchOutcome,
}

impl Key {
    pub(super) fn new(machine: &Machine, effort: Effort) -> Self {
        let text = format!(
            "{} {} {effort:?} {}",
            env!("CARGO_PKG_VERSION"),
            env!("HOST_GEN_SEARCH_SOURCES"),
            machine.search_inputs(),
        );
        Self(hexadecimal(text.as_bytes()))
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    let digest = Sha256::digest(bytes);
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

impl Cache {
    /// Results in `folder`, which is made when the first one is kept.
    pub fn at(folder: impl Into<PathBuf>) -> Self {
        Self {
            folder: folder.into(),
        }
    }

    fn path(&self, key: &Key) -> PathBuf {
        self.folder.join(&key.0).with_extension("json")
    }

    /// What was found for `key`, if it is here and whole.
    pub(super) fn read(&self, key: &Key) -> Option<SearchOutcome> {
        let text = fs::read_to_string(self.path(key)).ok()?;
        let (checksum, json) = text.split_once('\n')?;
        if checksum != hexadecimal(json.as_bytes()) {
            return None;
        }
        let entry: CacheEntry = serde_json::from_str(json).ok()?;
        (entry.key == key.0).then_some(entry.outcome)
    }

    /// Keeps what was found. Where that is not possible the next search is made again:
    /// no error.
    pub(super) fn write(&self, key: &Key, outcome: SearchOutcome) {
        let entry = CacheEntry {
            key: key.0.clone(),
            outcome,
        };
        let json = serde_json::to_string(&entry).expect("numbers and strings serialise");
        let text = format!("{}\n{json}", hexadecimal(json.as_bytes()));
        let _ = write_whole(&self.folder, &self.path(key), &text);
    }
}

/// Another process may read or write the same entry: it is there whole or not at all.
fn write_whole(folder: &Path, path: &Path, text: &str) -> std::io::Result<()> {
    fs::create_dir_all(folder)?;
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    file.write_all(text.as_bytes())?;
    file.persist(path)?;
    Ok(())
}
