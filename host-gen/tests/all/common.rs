//! Machines for the tests: the metrology frame and edits of it.
#![allow(dead_code, reason = "each test program uses its part")]

use core::f64::consts::TAU;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{LazyLock, Mutex, OnceLock};

use host_gen::control::LinearLaw;
use host_gen::design::{Cache, Design, DesignError, Effort, Search, Study};
use host_gen::machine::{Machine, MachineError};
use nalgebra::Matrix6;
use shared::table::ValidTable;

pub use crate::edits::{edited, model_path, model_text, set};

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

/// A search that uses what other steps of the whole test have found, where that keeps it.
pub fn search() -> Search<'static> {
    static KEPT: LazyLock<Option<Cache>> = LazyLock::new(Cache::from_environment);
    Search {
        cache: KEPT.as_ref(),
        ..Search::FULL
    }
}

/// The same with a search of a few seconds, where the claim is the same for any search.
pub fn rough() -> Search<'static> {
    Search {
        effort: Effort::Rough,
        ..search()
    }
}

/// A study and what its search comes to.
pub type Searched = (Study, Result<Design, DesignError>);

/// Searches once for every text, however many tests ask.
pub fn searched(text: &str) -> &'static Searched {
    static ALL: Made<Searched> = Made::new();
    ALL.get(text, || {
        let study = study(text);
        let found = search().design(&study);
        (study, found)
    })
}

/// A study, its table and what is known of its loop.
pub type Looped = (&'static Study, &'static ValidTable, &'static Design);

/// The same where there is a table.
pub fn looped(text: &str) -> Looped {
    let (study, found) = searched(text);
    let design = found.as_ref().unwrap();
    (study, &design.table, design)
}

/// The metrology frame under the direct law with its table.
pub fn looped_frame() -> Looped {
    looped(&edited(&[]))
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
    let plant = study.plant();
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
