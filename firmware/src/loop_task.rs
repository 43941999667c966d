//! The loop task: what runs once per sample, above everything else.

use core::cell::RefCell;

use critical_section::Mutex;
use shared::LEGS;
use shared::codes::DacCode;
use shared::controller::{Controller, Reading};
use shared::recorder::Record;

use crate::tables::Entry;

/// The controller of a board, between its loop and its link.
///
/// Each holds it in a critical section, never longer than one request or one
/// sample takes. So a request is answered at once by what it did, and no request
/// meets half a sample. The outputs are latched by hardware: the loop may wait
/// some microseconds for the link without the plant seeing it.
pub struct Board(Mutex<RefCell<Option<Controller<'static>>>>);

impl Board {
    /// Before there is a table.
    pub const fn new() -> Self {
        Self(Mutex::new(RefCell::new(None)))
    }

    /// Puts a machine's table in. `room` is the recorder's memory.
    pub fn begin(&self, entry: &Entry, room: &'static mut [Record]) {
        let controller = Controller::new(*entry.table, entry.checksum, room);
        critical_section::with(|cs| self.0.borrow_ref_mut(cs).replace(controller));
    }

    /// Something with the controller; none before there is one.
    pub fn with<T>(&self, act: impl FnOnce(&mut Controller<'static>) -> T) -> Option<T> {
        critical_section::with(|cs| self.0.borrow_ref_mut(cs).as_mut().map(act))
    }

    /// Takes one conversion and gives the codes to latch; none before there is a
    /// table.
    pub fn on_sample(&self, reading: Reading) -> Option<[DacCode; LEGS]> {
        self.with(|controller| controller.on_sample(reading))
    }
}

impl Default for Board {
    fn default() -> Self {
        Self::new()
    }
}
