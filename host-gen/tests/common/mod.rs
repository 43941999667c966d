//! Machines for the tests: the metrology frame and edits of it.
#![allow(dead_code, reason = "each test file uses its part")]

use core::f64::consts::TAU;
use std::path::{Path, PathBuf};

use host_gen::law::LinearLaw;
use host_gen::machine::{Machine, MachineError};
use host_gen::study::Study;
use nalgebra::Matrix6;
use toml::{Table, Value};

pub fn model_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/metrology-frame.toml")
}

pub fn model_text() -> String {
    std::fs::read_to_string(model_path()).unwrap()
}

pub fn parse(text: &str) -> Result<Machine, MachineError> {
    Machine::parse(Path::new("test.toml"), text)
}

pub fn study(text: &str) -> Study {
    Study::new(parse(text).unwrap()).unwrap()
}

/// The metrology frame under the direct law, whose roll-off is found in a
/// fraction of the time that shapes for the modes take.
pub fn frame() -> Study {
    study(&edited(&[]))
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

/// Asserts that `found` is `expected` to as many digits as the latter is
/// printed with.
#[track_caller]
pub fn assert_digits(found: f64, expected: &str) {
    let decimals = expected.split_once('.').map_or(0, |(_, d)| d.len());
    assert_eq!(format!("{found:.decimals$}"), expected);
}

/// How often det(1 + L) goes round the origin as z goes round the unit circle,
/// which is the number of unstable closed-loop poles: the open loop has none.
pub fn encirclements(study: &Study, law: &LinearLaw) -> i32 {
    let plant = &study.plant;
    let at = |hz: f64| {
        let g22 = plant.response(hz).g22();
        (Matrix6::identity() - law.response(plant.z(hz)) * g22).determinant()
    };
    // The upper half of the circle, refined until no step turns far.
    let mut turns = 0.0;
    let top = 0.5 / plant.period;
    let mut points: Vec<f64> = (0..4000)
        .map(|i| 1e-4 * (top / 1e-4_f64).powf(f64::from(i) / 3999.0))
        .rev()
        .collect();
    let mut low = points.pop().unwrap();
    let mut value = at(low);
    while let Some(high) = points.pop() {
        let next = at(high);
        let turn = (next / value).arg();
        if turn.abs() > 0.3 && high - low > 1e-9 * high {
            points.push(high);
            points.push(0.5 * (low + high));
            continue;
        }
        turns += turn;
        (low, value) = (high, next);
    }
    // Twice, for the lower half.
    -(2.0 * turns / TAU).round() as i32
}
