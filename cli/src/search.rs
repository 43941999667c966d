//! Studies and their designs, with the progress of the search on a terminal.

use std::path::Path;

use host_gen::design::{Design, Effort, Search, Study};
use host_gen::machine::Machine;
use host_gen::progress::Progress;
use indicatif::{ProgressBar, ProgressStyle};

use crate::failure::{Failure, in_loop};

/// A bar on standard error, and only where that is a terminal; gone when dropped.
pub struct Bar(ProgressBar);

impl Bar {
    /// For steps of a known number.
    pub fn of(steps: usize) -> Self {
        Self(ProgressBar::new(steps as u64))
    }

    /// For a search.
    pub fn search() -> Self {
        let style = ProgressStyle::with_template("{spinner} shaping the loop, {pos} trials, {elapsed}");
        let bar = ProgressBar::new_spinner();
        Self(bar.with_style(style.expect("the template is valid")))
    }
}

impl Progress for Bar {
    fn advance(&self) {
        self.0.inc(1);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// A full search that shows its progress on `bar`.
pub fn full(bar: &Bar) -> Search<'_> {
    Search {
        effort: Effort::Full,
        progress: bar,
    }
}

/// The study of a machine file.
pub fn study(model: &Path) -> Result<Study, Failure> {
    Ok(Study::new(Machine::load(model)?)?)
}

/// The design of a study's loop.
pub fn design(model: &Path, study: &Study) -> Result<Design, Failure> {
    full(&Bar::search()).design(study).map_err(in_loop(model))
}
