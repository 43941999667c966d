//! Rough designs for boards with other sample rates and delays.

use rayon::prelude::*;
use serde::Serialize;

use super::delay::{in_hold, middles};
use crate::design::{Cache, DesignError, Effort, Search, Study, StudyError};
use crate::machine::{Board, Machine};
use crate::progress::Progress;

/// The result of a rough design for another board.
#[derive(Debug, Serialize)]
pub(crate) struct OtherBoard {
    pub(crate) sample_rate: f64,
    pub(crate) whole_delay: f64,
    /// Where a sample lies in a hold, as [`in_hold`].
    pub(crate) in_hold: f64,
    /// Highest σ_max(G11) in each band, dB; empty if no controller was found that reaches
    /// the target.
    pub(crate) sampled_db: Vec<f64>,
}

/// Rough designs at the sample rate of the file and at twice that rate: with the outputs latched
/// as in the file, and with the two delays next to it with which a sample lies in the middle of a
/// hold, the longest first. A board whose outputs would be latched before the sample is left out.
pub(crate) fn other_boards(
    machine: &Machine,
    cache: Option<&Cache>,
    progress: &dyn Progress,
) -> Result<Vec<OtherBoard>, StudyError> {
    let mut boards = Vec::new();
    for rate in [1.0, 2.0] {
        let mut board = machine.board.clone();
        board.sample_rate *= rate;
        let [above, below] = middles(&board);
        let mut delays = vec![above, board.latch_delay, below];
        delays.retain(|delay| *delay >= 0.0);
        delays.dedup();
        for latch_delay in delays {
            let mut machine = machine.clone();
            machine.board = Board {
                latch_delay,
                ..board.clone()
            };
            boards.push(machine);
        }
    }
    boards
        .into_par_iter()
        .map(|machine| {
            let board = machine.board.clone();
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
                in_hold: in_hold(&board),
                sampled_db,
            })
        })
        .collect()
}
