//! The search for the best controller, and the reasons why a target is not reached.

use rayon::prelude::*;

pub mod bound;
pub mod cache;
pub mod outcome;
mod perturbed;
pub mod reach;
mod roll_off;
mod sources;
pub mod study;
mod synthesis;
mod trial;

pub use cache::Cache;
pub use outcome::{Band, Design, DesignError, Shaping, StudyError};
pub use reach::Effort;
pub use study::Study;

use cache::{Key, SearchOutcome};

use crate::control::Shape;
use crate::machine::{Machine, MachineError};
use crate::progress::Progress;

/// Settings of the search for a design.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    /// How long to search.
    pub effort: Effort,
    /// Cache of results; none to search every time.
    pub cache: Option<&'a Cache>,
    /// Called after every trial.
    pub progress: &'a dyn Progress,
}

impl Search<'_> {
    /// A full search, without cache and without progress.
    pub const FULL: Self = Self {
        effort: Effort::Full,
        cache: None,
        progress: &(),
    };

    /// The best design found for a study's target. If the machine's file gives the
    /// shapes, nothing is searched: the design has these shapes, verified in the same
    /// way.
    ///
    /// # Errors
    /// [`DesignError::Unreachable`] if no shaping was found that reaches the target;
    /// other errors if the board's parameters give no valid table or a computation fails.
    pub fn design(&self, study: &Study) -> Result<Design, DesignError> {
        let machine = study.machine();
        if let Some(shapes) = &machine.shapes {
            let shapes = Box::new(shapes.each_ref().map(Shape::from));
            return reach::search(study, self.effort, &(), Some(&Shaping::Modes { shapes }));
        }
        let Some(cache) = self.cache else {
            return reach::search(study, self.effort, self.progress, None);
        };
        let key = Key::new(machine, self.effort);
        match cache.read(&key) {
            Some(SearchOutcome::Found(shaping)) => {
                if let Ok(design) = reach::search(study, self.effort, &(), Some(&shaping)) {
                    return Ok(design);
                }
            }
            Some(SearchOutcome::Unreachable(refusal)) => {
                return Err(reach::unreachable(&machine.target, refusal));
            }
            None => {}
        }
        let result = reach::search(study, self.effort, self.progress, None);
        match &result {
            Ok(design) => cache.write(&key, SearchOutcome::Found(design.shaping.clone())),
            Err(DesignError::Unreachable { refusal, .. }) => {
                cache.write(&key, SearchOutcome::Unreachable(refusal.clone()));
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
    /// The design, or why there is none.
    pub design: Result<Design, NoDesign>,
}

/// Why a study has no design.
#[derive(Clone, Debug, thiserror::Error)]
pub enum NoDesign {
    /// The search failed.
    #[error(transparent)]
    Failed(#[from] DesignError),
    /// The search has not ended.
    #[error("the search is not finished")]
    Unfinished,
    /// Only the machine's own kind of feedback is designed.
    #[error("only designed with --by-feedback")]
    OtherKind,
}

impl DesignedStudy {
    /// Designs the loop of `study`.
    pub fn new(study: Study, search: &Search<'_>) -> Self {
        Self {
            design: search.design(&study).map_err(NoDesign::Failed),
            study,
        }
    }

    /// Studies for the same kinds as [`Self::by_feedback`]. Only that with the machine's own kind
    /// of feedback is designed, with `search`; without `search`, it is [`NoDesign::Unfinished`].
    ///
    /// # Errors
    /// [`MachineError`] if a machine gives no valid model.
    pub fn own_feedback(
        machine: &Machine,
        search: Option<&Search<'_>>,
    ) -> Result<Vec<Self>, MachineError> {
        let studied = |kind: Machine| {
            let own = kind.target.feedback == machine.target.feedback;
            let study = Study::new(kind)?;
            let design = match search {
                _ if !own => Err(NoDesign::OtherKind),
                None => Err(NoDesign::Unfinished),
                Some(search) => search.design(&study).map_err(NoDesign::Failed),
            };
            Ok(Self { study, design })
        };
        machine.by_feedback().into_iter().map(studied).collect()
    }

    /// Designs for each kind of feedback that the machine has sensors for: acceleration,
    /// force and both, in the order of [`Machine::by_feedback`].
    ///
    /// # Errors
    /// [`MachineError`] if a machine gives no valid model.
    pub fn by_feedback(machine: &Machine, search: &Search<'_>) -> Result<Vec<Self>, MachineError> {
        Self::all(machine.by_feedback(), search)
    }

    /// Designs for several machines, in parallel.
    ///
    /// # Errors
    /// [`MachineError`] if a machine gives no valid model.
    pub fn all(machines: Vec<Machine>, search: &Search<'_>) -> Result<Vec<Self>, MachineError> {
        machines
            .into_par_iter()
            .map(|machine| Ok(Self::new(Study::new(machine)?, search)))
            .collect()
    }
}
