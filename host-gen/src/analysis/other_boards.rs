//! Rough designs for boards with other sample rates and delays.

use rayon::prelude::*;
use serde::Serialize;

use crate::design::{Cache, DesignError, Effort, Search, Study, StudyError};
use crate::machine::Machine;
use crate::progress::Progress;

/// The result of a rough design for another board.
#[derive(Debug, Serialize)]
pub(crate) struct OtherBoard {
    pub(crate) sample_rate: f64,
    pub(crate) whole_delay: f64,
    /// Highest σ_max(G11) in each band, dB; empty if no controller was found that reaches
    /// the target.
    pub(crate) sampled_db: Vec<f64>,
}

/// Rough designs at the sample rate of the file and at twice that rate, each with the
/// outputs latched as in the file, 10 µs and 20 µs earlier, and 10 µs later. A board
/// whose outputs would be latched before the sample is left out.
pub(crate) fn other_boards(
    machine: &Machine,
    cache: Option<&Cache>,
    progress: &dyn Progress,
) -> Result<Vec<OtherBoard>, StudyError> {
    let mut boards = Vec::new();
    for rate in [1.0, 2.0] {
        for later in [10e-6, 0.0, -10e-6, -20e-6] {
            let mut machine = machine.clone();
            let board = &mut machine.board;
            board.sample_rate *= rate;
            board.latch_delay += later;
            if board.latch_delay >= 0.0 {
                boards.push(machine);
            }
        }
    }
    boards
        .into_par_iter()
        .map(|machine| {
            let board = machine.board;
            let study = Study::new(machine)?;
            let search = Search {
                effort: Effort::Rough,
                cache,
                progress,
            };
            let sampled_db = match search.design(&study) {
                Ok(design) => design.bands.iter().map(|band| band.sampled_db).collect(),
                Err(DesignError::Unreachable { .. }) => Vec::new(),
                Err(error) => return Err(error.into()),
            };
            Ok(OtherBoard {
                sample_rate: board.sample_rate,
                whole_delay: board.whole_delay(),
                sampled_db,
            })
        })
        .collect()
}
