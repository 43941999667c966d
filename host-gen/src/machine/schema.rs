//! The JSON Schema of machine files, for editors that complete and check them.
//!
//! It comes from [`super::file`], so it cannot say other keys than the file has.

use schemars::schema_for;
use serde_json::{Map, Value, json};

use super::file::File;

/// Of a file that is based on another no key is required; of one that is not, all
/// that have no default.
pub fn schema() -> String {
    let mut whole = schema_for!(File).to_value();
    let based_on = json!({
        "type": "string",
        "description": "Another machine file, its path from this one; this file then holds only what differs.",
    });
    walk(&mut whole, &|table| {
        drop_null(table);
        qualify(table);
    });
    if let Some(properties) = whole.get_mut("properties").and_then(Value::as_object_mut) {
        properties.insert("based_on".to_owned(), based_on);
    }
    let mut part = whole.clone();
    walk(&mut part, &|table| {
        if matches!(table.get("required"), Some(Value::Array(_))) {
            table.remove("required");
        }
    });
    // The definitions of both, those of the whole under names of their own.
    let mut definitions = Map::new();
    for (prefix, schema) in [("", &mut part), ("whole-", &mut whole)] {
        let Some(table) = schema.as_object_mut() else {
            continue;
        };
        if let Some(Value::Object(own)) = table.remove("$defs") {
            for (name, mut definition) in own {
                walk(&mut definition, &|table| refer(table, prefix));
                definitions.insert(format!("{prefix}{name}"), definition);
            }
        }
        walk(schema, &|table| refer(table, prefix));
    }
    if let Some(table) = whole.as_object_mut() {
        table.remove("$schema");
    }
    definitions.insert("whole".to_owned(), whole);
    if let Some(table) = part.as_object_mut() {
        table.insert("title".to_owned(), json!("hardmount machine file"));
        table.insert("if".to_owned(), json!({ "required": ["based_on"] }));
        table.insert("else".to_owned(), json!({ "$ref": "#/$defs/whole" }));
        table.insert("$defs".to_owned(), Value::Object(definitions));
    }
    serde_json::to_string_pretty(&part).expect("numbers and strings serialise") + "\n"
}

/// Does `change` to every table, the outer before the inner.
fn walk(value: &mut Value, change: &dyn Fn(&mut Map<String, Value>)) {
    match value {
        Value::Object(table) => {
            change(table);
            table.values_mut().for_each(|value| walk(value, change));
        }
        Value::Array(list) => list.iter_mut().for_each(|value| walk(value, change)),
        _ => {}
    }
}

/// TOML has no null: a key that may be left out is left out.
fn drop_null(table: &mut Map<String, Value>) {
    if let Some(Value::Array(types)) = table.get_mut("type") {
        types.retain(|kind| kind != "null");
        if let [one] = &types[..] {
            let one = one.clone();
            table.insert("type".to_owned(), one);
        }
    }
    if let Some(Value::Array(choices)) = table.get_mut("anyOf") {
        choices.retain(|choice| choice != &json!({ "type": "null" }));
    }
    table.retain(|key, value| key != "default" || !value.is_null());
}

/// Rust's names of number formats say nothing to editors.
fn qualify(table: &mut Map<String, Value>) {
    let of_rust = |format: &Value| {
        let format = format.as_str().unwrap_or_default();
        ["double", "uint", "uint16", "uint32", "uint64"].contains(&format)
    };
    table.retain(|key, value| key != "format" || !of_rust(value));
}

fn refer(table: &mut Map<String, Value>, prefix: &str) {
    if let Some(Value::String(target)) = table.get_mut("$ref") {
        *target = target.replacen("#/$defs/", &format!("#/$defs/{prefix}"), 1);
    }
}
