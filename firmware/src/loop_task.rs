//! The loop task: what runs once per sample.

use shared::codes::{LegForces, Samples};
use shared::step::{Output, State, step};
use shared::table::ValidTable;

/// The controller of one machine, from the first sample on.
pub struct LoopTask {
    table: &'static ValidTable,
    /// None until the first sample has settled the AC coupling.
    state: Option<State>,
}

impl LoopTask {
    /// A loop that runs `table`.
    pub const fn new(table: &'static ValidTable) -> Self {
        Self { table, state: None }
    }

    /// Takes the codes of one conversion and gives the codes to latch.
    pub fn on_sample(&mut self, adc: Samples) -> Output {
        let state = self
            .state
            .get_or_insert_with(|| State::settled_on(self.table, adc));
        step(self.table, state, adc, LegForces::ZERO)
    }
}
