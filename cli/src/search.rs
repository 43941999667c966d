//! Studies and their designs, with the progress of the search on a terminal.

use std::path::Path;

use host_gen::design::{Cache, Design, Effort, Search, Study};
use host_gen::machine::Machine;
use host_gen::progress::Progress;
use indicatif::{ProgressBar, ProgressStyle};

use crate::failure::{Failure, in_loop};

/// A progress bar on standard error, if that is a terminal. It is removed when dropped.
pub struct Bar(ProgressBar);

impl Bar {
    /// A bar for a known number of steps.
    pub fn of(steps: usize) -> Self {
        Self(ProgressBar::new(steps as u64))
    }

    /// A spinner for the fit of a machine, whose number of steps is not known in advance.
    pub fn fit() -> Self {
        Self::spinner("{spinner} fitting the machine, {pos} steps, {elapsed}")
    }

    /// A spinner for a search, whose number of trials is not known in advance.
    pub fn search() -> Self {
        Self::spinner("{spinner} searching for the controller, {pos} trials, {elapsed}")
    }

    fn spinner(template: &str) -> Self {
        let style = ProgressStyle::with_template(template);
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

/// The searches of the commands, with their cache.
pub struct Searcher {
    cache: Option<Cache>,
}

impl Searcher {
    /// With `keep`, results are stored as [`Cache::from_environment`] says, or else in the user's
    /// cache folder.
    pub fn new(keep: bool) -> Self {
        let of_user = || Some(Cache::at(dirs::cache_dir()?.join("host-gen")));
        let cache = || Cache::from_environment().or_else(of_user);
        Self {
            cache: keep.then(cache).flatten(),
        }
    }

    /// The cache, if results are stored.
    pub fn cache(&self) -> Option<&Cache> {
        self.cache.as_ref()
    }

    /// A full search that shows its progress on `bar`.
    pub fn full<'a>(&'a self, bar: &'a Bar) -> Search<'a> {
        Search {
            effort: Effort::Full,
            cache: self.cache(),
            progress: bar,
        }
    }

    /// The design of a study's loop.
    pub fn design(&self, model: &Path, study: &Study) -> Result<Design, Failure> {
        let design = self.full(&Bar::search()).design(study);
        design.map_err(in_loop(model))
    }
}

/// The study of a machine file.
pub fn study(model: &Path) -> Result<Study, Failure> {
    Ok(Study::new(Machine::load(model)?)?)
}
