//! The loop task: it runs once per sample, at the highest priority.

use core::cell::RefCell;

use critical_section::Mutex;
use shared::LEGS;
use shared::codes::DacCode;
use shared::controller::{Controller, Memory, Reading};

use crate::tables::Entry;

/// The controller of a board, shared by its loop and its link.
///
/// Each uses it in a critical section, for no longer than one sample or one request takes. So
/// a request takes effect before it is answered, and never in the middle of a sample. The
/// outputs are latched by hardware: the loop may wait some microseconds for the link without
/// an effect on the plant.
pub struct BoardController(Mutex<RefCell<Option<Controller<'static>>>>);

impl BoardController {
    /// A board without a controller yet.
    pub const fn new() -> Self {
        Self(Mutex::new(RefCell::new(None)))
    }

    /// Creates the controller for the table of `entry`.
    pub fn begin(&self, entry: &Entry, memory: Memory<'static>) {
        let controller = Controller::new(*entry.table, entry.checksum, memory);
        critical_section::with(|cs| self.0.borrow_ref_mut(cs).replace(controller));
    }

    /// Calls `act` with the controller in a critical section. None before
    /// [`BoardController::begin`].
    pub fn with<T>(&self, act: impl FnOnce(&mut Controller<'static>) -> T) -> Option<T> {
        critical_section::with(|cs| self.0.borrow_ref_mut(cs).as_mut().map(act))
    }

    /// Runs both halves of a sample and returns the codes to latch. None before
    /// [`BoardController::begin`].
    pub fn on_sample(&self, reading: Reading) -> Option<[DacCode; LEGS]> {
        self.with(|controller| controller.on_sample(reading))
    }

    /// Runs the first half of a sample and returns the codes to latch. None before
    /// [`BoardController::begin`].
    pub fn latch(&self, reading: Reading) -> Option<[DacCode; LEGS]> {
        self.with(|controller| controller.latch(reading))
    }

    /// Runs the second half of a sample.
    pub fn follow(&self) {
        self.with(Controller::follow);
    }
}

impl Default for BoardController {
    fn default() -> Self {
        Self::new()
    }
}
