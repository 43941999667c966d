//! A fingerprint of the sources that decide what a search for a controller finds, so
//! that a result kept by another version of them is not taken for one of this.

use std::collections::hash_map::DefaultHasher;
use std::fs;
use std::hash::{Hash as _, Hasher as _};
use std::io;
use std::path::{Path, PathBuf};

/// The rooms up to the search, and what they build on.
const READ: [&str; 10] = [
    "src/numeric",
    "src/floor",
    "src/machine",
    "src/model",
    "src/plant",
    "src/control",
    "src/closed_loop",
    "src/design",
    "../shared/src",
    "../Cargo.lock",
];

fn main() -> io::Result<()> {
    let mut hasher = DefaultHasher::new();
    for place in READ {
        println!("cargo::rerun-if-changed={place}");
        let mut files = Vec::new();
        collect(Path::new(place), &mut files)?;
        files.sort();
        for file in files {
            file.hash(&mut hasher);
            fs::read(&file)?.hash(&mut hasher);
        }
    }
    println!(
        "cargo::rustc-env=HOST_GEN_SEARCH_SOURCES={:016x}",
        hasher.finish()
    );
    Ok(())
}

fn collect(place: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    if !place.is_dir() {
        files.push(place.to_owned());
        return Ok(());
    }
    for entry in fs::read_dir(place)? {
        collect(&entry?.path(), files)?;
    }
    Ok(())
}
