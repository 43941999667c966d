//! The metrology frame's file and edits of it.
#![allow(dead_code, reason = "each test program uses its part")]

use std::path::{Path, PathBuf};

use toml::{Table, Value};

pub fn model_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/metrology-frame.toml")
}

pub fn model_text() -> String {
    std::fs::read_to_string(model_path()).unwrap()
}

/// The metrology frame under the direct law with values replaced:
/// `("bodies.frame.mass", "700.0")`, the value in TOML.
pub fn edited(edits: &[(&str, &str)]) -> String {
    let mut table: Table = model_text().parse().unwrap();
    // It names entries that an edit may take away.
    table.remove("provenance");
    set(
        &mut table,
        "control.law",
        Value::String("direct".to_owned()),
    );
    for (key, value) in edits {
        let value: Table = format!("x = {value}").parse().unwrap();
        set(&mut table, key, value["x"].clone());
    }
    table.to_string()
}

pub fn set(table: &mut Table, key: &str, value: Value) {
    match key.split_once('.') {
        None => {
            table.insert(key.to_owned(), value);
        }
        Some((first, rest)) => {
            let inner = table
                .entry(first)
                .or_insert_with(|| Value::Table(Table::new()));
            set(inner.as_table_mut().unwrap(), rest, value);
        }
    }
}
