//! Machines for the tests: the metrology frame and edits of it.
#![allow(dead_code, reason = "each test program uses its part")]

use core::f64::consts::TAU;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};

use host_gen::law::LinearLaw;
use host_gen::machine::{Machine, MachineError};
use host_gen::shaping::{Shaped, ShapingError};
use host_gen::study::Study;
use nalgebra::Matrix6;
use shared::table::ValidTable;
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

/// What is made of a machine's text, made once.
pub struct Made<T: 'static>(OnceLock<Mutex<HashMap<String, &'static OnceLock<T>>>>);

impl<T> Made<T> {
    pub const fn new() -> Self {
        Self(OnceLock::new())
    }

    pub fn get(&self, text: &str, make: impl FnOnce() -> T) -> &'static T {
        let all = self.0.get_or_init(Mutex::default);
        let own = *all
            .lock()
            .unwrap()
            .entry(text.to_owned())
            .or_insert_with(|| Box::leak(Box::new(OnceLock::new())));
        own.get_or_init(make)
    }
}

/// A study and what its search comes to.
pub type Searched = (Study, Result<(ValidTable, Shaped), ShapingError>);

/// Searches once for every text, however many tests ask.
pub fn searched(text: &str) -> &'static Searched {
    static ALL: Made<Searched> = Made::new();
    ALL.get(text, || {
        let study = study(text);
        let found = study.table();
        (study, found)
    })
}

/// A study, its table and what is known of its loop.
pub type Looped = (&'static Study, &'static ValidTable, &'static Shaped);

/// The same where there is a table.
pub fn looped(text: &str) -> Looped {
    let (study, found) = searched(text);
    let (table, shaped) = found.as_ref().unwrap();
    (study, table, shaped)
}

/// The metrology frame under the direct law with its table.
pub fn looped_frame() -> Looped {
    looped(&edited(&[]))
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
