//! A cache of search results: a folder with one file for each search.
//!
//! An entry holds only the shaping that a search found. The shaping is verified again
//! when it is read, as if the search had just found it. An entry that is damaged, or that
//! belongs to another machine or another version of this program, is ignored.

use std::fs;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use super::outcome::{Refusal, Shaping};
use super::reach::Effort;
use crate::files::write_whole;
use crate::machine::Machine;

/// A folder with the results of searches.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
}

/// The result of a search.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum SearchOutcome {
    /// A shaping that reaches the target.
    Found(Shaping),
    /// No shaping was found that reaches the target.
    Unreachable(Refusal),
}

/// SHA-256 over everything that a search reads, hexadecimal.
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
    /// A cache in `folder`. The folder is created with the first entry.
    pub fn at(folder: impl Into<PathBuf>) -> Self {
        Self {
            folder: folder.into(),
        }
    }

    /// The cache in the folder of the environment variable `HOST_GEN_CACHE`; none if it is not set
    /// or empty.
    pub fn from_environment() -> Option<Self> {
        let folder = std::env::var_os("HOST_GEN_CACHE")?;
        (!folder.is_empty()).then(|| Self::at(folder))
    }

    fn path(&self, key: &Key) -> PathBuf {
        self.folder.join(&key.0).with_extension("json")
    }

    /// The result stored for `key`; none if there is no entry or it is damaged.
    pub(super) fn read(&self, key: &Key) -> Option<SearchOutcome> {
        let text = fs::read_to_string(self.path(key)).ok()?;
        let (checksum, json) = text.split_once('\n')?;
        if checksum != hexadecimal(json.as_bytes()) {
            return None;
        }
        let entry: CacheEntry = serde_json::from_str(json).ok()?;
        (entry.key == key.0).then_some(entry.outcome)
    }

    /// Stores a result. A failure to write is not an error: then the same search is made
    /// again the next time.
    pub(super) fn write(&self, key: &Key, outcome: SearchOutcome) {
        let entry = CacheEntry {
            key: key.0.clone(),
            outcome,
        };
        let json = serde_json::to_string(&entry).expect("numbers and strings serialise");
        let text = format!("{}\n{json}", hexadecimal(json.as_bytes()));
        // Another process that reads the entry sees all of it or nothing.
        let _ = fs::create_dir_all(&self.folder)
            .and_then(|()| write_whole(&self.path(key), text.as_bytes()));
    }
}
