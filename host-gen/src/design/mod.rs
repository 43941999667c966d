//! Which controller is best, and why a target cannot be reached.

use rayon::prelude::*;

pub mod cache;
mod objective;
pub mod outcome;
mod pattern_search;
pub mod reach;
mod roll_off;
pub mod study;
mod trial;

pub use cache::Cache;
pub use outcome::{Band, Design, DesignError, Shaping, StudyError};
pub use reach::Effort;
pub use study::Study;

use cache::{Key, SearchOutcome};

use crate::control::Shape;
use crate::machine::{Machine, MachineError};
use crate::progress::Progress;

/// How to find a design.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    /// How long to search.
    pub effort: Effort,
    /// Where results are kept, if they are.
    pub cache: Option<&'a Cache>,
    /// Told of every trial.
    pub progress: &'a dyn Progress,
}

impl Search<'_> {
    /// To the end, keeping nothing, silently.
    pub const FULL: Self = Self {
        effort: Effort::Full,
        cache: None,
        progress: &(),
    };

    /// The best design for a study's target; with shapes in the machine's file, the
    /// design that these make.
    ///
    /// # Errors
    /// Where no shaping reaches the target, with the nearest frequency that one does.
    pub fn design(&self, study: &Study) -> Result<Design, DesignError> {
        let machine = study.machine();
        if let Some(shapes) = &machine.shapes {
            let shapes = shapes.each_ref().map(Shape::from);
            return reach::verify(study, self.effort, &Shaping::Modes { shapes });
        }
        let Some(cache) = self.cache else {
            return reach::search(study, self.effort, self.progress);
        };
        let key = Key::new(machine, self.effort);
        match cache.read(&key) {
            Some(SearchOutcome::Found(shaping)) => {
                if let Ok(design) = reach::verify(study, self.effort, &shaping) {
                    return Ok(design);
                }
            }
            Some(SearchOutcome::Unreachable { reason, advice }) => {
                return Err(reach::unreachable(&machine.target, reason, advice));
            }
            None => {}
        }
        let result = reach::search(study, self.effort, self.progress);
        match &result {
            Ok(design) => cache.write(&key, SearchOutcome::Found(design.shaping.clone())),
            Err(DesignError::Unreachable { reason, advice, .. }) => {
                let (reason, advice) = (reason.clone(), *advice);
                cache.write(&key, SearchOutcome::Unreachable { reason, advice });
            }
            Err(_) => {}
        }
        result
    }
}

/// A study and the design of its loop.
#[derive(Clone, Debug)]
pub struct DesignedStudy {
    /// The study.
    pub study: Study,
    /// Its design, or why there is none.
    pub design: Result<Design, String>,
}

impl DesignedStudy {
    /// Designs the loop of `study`.
    pub fn new(study: Study, search: &Search<'_>) -> Self {
        let design = search.design(&study);
        Self {
            design: design.map_err(|error| error.to_string()),
            study,
        }
    }

    /// A machine once with each kind of feedback that it has sensors for, and with
    /// both at once, as [`Machine::by_feedback`].
    ///
    /// # Errors
    /// As [`Study::new`].
    pub fn by_feedback(machine: &Machine, search: &Search<'_>) -> Result<Vec<Self>, MachineError> {
        Self::all(machine.by_feedback(), search)
    }

    /// Designs for several machines, in parallel.
    ///
    /// # Errors
    /// As [`Study::new`].
    pub fn all(machines: Vec<Machine>, search: &Search<'_>) -> Result<Vec<Self>, MachineError> {
        machines
            .into_par_iter()
            .map(|machine| Ok(Self::new(Study::new(machine)?, search)))
            .collect()
    }
}
