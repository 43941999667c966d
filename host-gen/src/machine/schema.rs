//! The JSON Schema of machine files, for editors that complete and check them.
//!
//! It comes from [`super::file`], so it has the same keys and texts.

use core::slice;
use std::collections::VecDeque;

use schemars::Schema;
use schemars::generate::SchemaSettings;
use schemars::transform::{RecursiveTransform, RestrictFormats, Transform as _};
use serde_json::{Value, json};

use super::file::MachineFile;
use super::parts;

/// The tables that a file without control does not have.
pub(super) const CONTROL: [&str; 7] = [
    "coordinates",
    "actuators",
    "sensors",
    "floor",
    "performance",
    "control",
    "board",
];

/// The JSON Schema of machine files, as text.
///
/// A file that is based on another may leave out any key. Any other file must have every
/// key that has no default, or none of those of control.
pub fn schema() -> String {
    let mut whole = file_schema("/$defs/whole/$defs");
    let definitions = whole.pointer_mut("/$defs/whole/$defs").map(Value::take);
    whole.insert("$defs".to_owned(), definitions.into());
    whole.remove("$schema");
    // A file has either all of these or none: without control it is for `modes` alone.
    let of_control = |key: &Value| CONTROL.iter().any(|own| key == own);
    if let Some(Value::Array(required)) = whole.get_mut("required") {
        required.retain(|key| !of_control(key));
    }
    let others = |key: &&str| CONTROL.into_iter().filter(|other| other != key).collect();
    let all = CONTROL.iter().map(|key| ((*key).to_owned(), others(key)));
    let all: serde_json::Map<String, Value> = all.collect();
    whole.insert("dependentRequired".to_owned(), all.into());

    let mut part = file_schema("/$defs");
    let mut optional = RecursiveTransform(|schema: &mut Schema| {
        schema.remove("required");
    });
    optional.transform(&mut part);
    part.insert("title".to_owned(), json!("hardmount machine file"));
    part.insert("if".to_owned(), json!({ "required": ["based_on"] }));
    part.insert("else".to_owned(), json!({ "$ref": "#/$defs/whole" }));
    if let Some(Value::Object(definitions)) = part.get_mut("$defs") {
        definitions.insert("whole".to_owned(), whole.into());
    }
    // Of a table that allows no other keys, editors mark all keys; of a key that no value is right
    // for, that one.
    let mut unknown = RecursiveTransform(|schema: &mut Schema| {
        if schema.get("additionalProperties") == Some(&json!(false)) {
            let never = json!({ "not": { "title": "unknown key" } });
            schema.insert("additionalProperties".to_owned(), never);
        }
    });
    unknown.transform(&mut part);
    serde_json::to_string_pretty(&part).expect("numbers and strings serialise") + "\n"
}

/// The schema of a file, with its definitions at a path.
fn file_schema(definitions: &'static str) -> Schema {
    let settings = SchemaSettings::draft2020_12()
        .with(|settings| settings.definitions_path = definitions.into())
        // Editors do not know Rust's number formats.
        .with_transform(RestrictFormats::default())
        .with_transform(RecursiveTransform(without_null));
    let mut schema = settings
        .into_generator()
        .into_root_schema_for::<MachineFile>();
    if let Some(Value::Object(properties)) = schema.get_mut("properties") {
        let based_on = json!({
            "type": "string",
            "description": "Path of another machine file, relative to this one. This file then has only the keys that differ.",
        });
        properties.insert("based_on".to_owned(), based_on);
    }
    // The name of a sensor stands for figures of the library.
    if let Some(sensor) = schema.pointer_mut(&format!("{definitions}/SensorEntry")) {
        let names = parts::all().values().flat_map(|parts| parts.keys());
        sensor["properties"]["sensor"] = json!({
            "type": "string",
            "enum": names.collect::<Vec<_>>(),
            "description": "Name of a sensor whose figures stand for the keys that are not given. `host-gen parts` lists them.",
        });
        if let Some(sensor) = sensor.as_object_mut() {
            sensor.remove("required");
        }
        sensor["anyOf"] = json!([{ "required": ["sensitivity"] }, { "required": ["sensor"] }]);
    }
    schema
}

/// TOML has no null: an optional key is left out.
fn without_null(schema: &mut Schema) {
    if let Some(Value::Array(types)) = schema.get_mut("type") {
        types.retain(|kind| kind != "null");
        if let [one] = &mut types[..] {
            let one = one.take();
            schema.insert("type".to_owned(), one);
        }
    }
    if let Some(Value::Array(choices)) = schema.get_mut("anyOf") {
        choices.retain(|choice| choice != &json!({ "type": "null" }));
    }
    if schema.get("default").is_some_and(Value::is_null) {
        schema.remove("default");
    }
}

/// What the schema says about a key: the first sentence of its description. The path to
/// the key is by names, and None for an element of an array.
pub(super) fn summary<'a>(path: impl Iterator<Item = Option<&'a str>>) -> Option<String> {
    let schema = file_schema("/$defs").to_value();
    let mut here = &schema;
    let mut description = None;
    for step in path {
        // An optional table is a choice of one.
        if let Some(choice) = here.pointer("/anyOf/0") {
            here = choice;
        }
        if let Some(reference) = here.get("$ref").and_then(Value::as_str) {
            here = schema.pointer(reference.trim_start_matches('#'))?;
        }
        here = match step {
            Some(key) => {
                let own = here.get("properties").and_then(|keys| keys.get(key));
                own.or_else(|| here.get("additionalProperties"))?
            }
            None => here.get("items")?,
        };
        // What has none is an element of what was described before.
        description = here.get("description").or(description);
    }
    let text = description?.as_str()?.replace('\n', " ");
    let mut stops = text.match_indices(". ").map(|(i, _)| i);
    let end = stops.find(|&i| !text[..i].ends_with("Eq"));
    let end = end.unwrap_or(text.len());
    Some(text[..end].trim_end_matches('.').to_owned())
}

/// The keys without a default that a file does not have, each by its path from the top. Those of a
/// table that is itself missing are not listed.
pub(super) fn missing(file: &toml::Table) -> Vec<Vec<String>> {
    let schema = file_schema("/$defs").to_value();
    let mut all = Vec::new();
    // Tables nearer to the top come first.
    let mut next = VecDeque::from([(&schema, file, Vec::new())]);
    while let Some((mut here, table, path)) = next.pop_front() {
        // An optional table is a choice of one.
        if let Some([choice]) = here["anyOf"].as_array().map(Vec::as_slice) {
            here = choice;
        }
        let reference = here["$ref"].as_str();
        let place = reference.map(|reference| reference.trim_start_matches('#'));
        here = place
            .and_then(|place| schema.pointer(place))
            .unwrap_or(here);
        for key in here["required"].as_array().into_iter().flatten() {
            if let Some(key) = key.as_str().filter(|key| !table.contains_key(*key)) {
                all.push([&path[..], &[key.to_owned()]].concat());
            }
        }
        for (key, value) in table {
            let own = here["properties"].get(key);
            let of_key = own.or_else(|| here.get("additionalProperties"));
            if let (Some(of_key), Some(table)) = (of_key, value.as_table()) {
                next.push_back((of_key, table, [&path[..], slice::from_ref(key)].concat()));
            }
        }
    }
    all
}

/// The unit of a number, the end of its [`summary`]; none if it has no unit.
pub(super) fn unit(summary: &str) -> Option<&str> {
    let (_, unit) = summary.rsplit_once(", ")?;
    (!summary.contains("(no unit)")).then_some(unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every number in the schema states its unit, or that it has none: hover texts and
    /// messages depend on it.
    #[test]
    fn every_number_states_its_unit() {
        const UNITS: [&str; 29] = [
            "m",
            "m²",
            "m⁴",
            "kg",
            "kg m²",
            "kg/m³",
            "s",
            "Hz",
            "N",
            "N m",
            "N/m",
            "N s/m",
            "N m s",
            "Pa",
            "V",
            "N/V",
            "V/(m/s²) or V/N",
            "m/s²",
            "m/s²/√Hz or N/√Hz",
            "rad/m",
            "m/s",
            "F",
            "A",
            "N/A",
            "A/V",
            "m/s²/N",
            "1/s²",
            "1/s and s",
            "°",
        ];
        let mut schema = file_schema("/$defs");
        let mut numbers = 0;
        let mut check = RecursiveTransform(|schema: &mut Schema| {
            let Some(Value::Object(properties)) = schema.get("properties") else {
                return;
            };
            for (key, property) in properties {
                let holds = |value: &Value| value.get("type") == Some(&json!("number"));
                let mut inner = property;
                while let Some(next) = inner.get("items").or(inner.get("additionalProperties")) {
                    inner = next;
                }
                if !holds(inner) {
                    continue;
                }
                numbers += 1;
                let text = property["description"].as_str().unwrap().replace('\n', " ");
                let text = text.split(". ").next().unwrap().trim_end_matches('.');
                let unit = unit(text);
                assert!(
                    text.contains("(no unit)") || unit.is_some_and(|unit| UNITS.contains(&unit)),
                    "{key}: {text}"
                );
            }
        });
        check.transform(&mut schema);
        assert!(numbers > 50, "{numbers}");
    }
}
