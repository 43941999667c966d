//! The link task: frames in, frames out, and what can wait, below the loop.

use embedded_storage_async::nor_flash::NorFlash;
use heapless::Vec;
use shared::link::{Answer, Cutter, FRAME, Server, Shelf, encode};
use shared::recorder::Record;
use shared::table::Limits;

use crate::loop_task::Board;
use crate::store::Store;
use crate::tables::Entry;

/// The board's end of the link, with its memory for a table.
pub struct LinkTask<F: NorFlash> {
    cutter: Cutter,
    server: Server,
    limits: Limits,
    entry: &'static Entry,
    /// None on a board whose memory cannot be used.
    store: Option<Store<F>>,
    /// When the table was last checked, samples.
    checked: u64,
}

impl<F: NorFlash> LinkTask<F> {
    /// Puts a table into `board`, the kept one if there is one that runs here, else the
    /// one compiled in, `entry`'s. `room` is the recorder's memory.
    pub fn begin(
        board: &Board,
        entry: &'static Entry,
        limits: Limits,
        mut store: Option<Store<F>>,
        room: &'static mut [Record],
    ) -> Self {
        board.begin(entry, room);
        let kept = store.as_mut().and_then(Store::table);
        if let Some((table, checksum)) = kept
            && limits.admit(&table).is_ok()
        {
            // Nothing runs yet that could refuse it.
            let _ = board.with(|controller| controller.replace(table, checksum, true));
        }
        Self {
            cutter: Cutter::new(),
            server: Server::new(),
            limits,
            entry,
            store,
            checked: 0,
        }
    }

    /// One byte from the host; the frame to send where one is due.
    pub fn on_byte(&mut self, byte: u8, board: &Board) -> Option<Vec<u8, FRAME>> {
        let incoming = self.cutter.push(byte)?;
        let limits = &self.limits;
        let answer = board.with(|controller| self.server.answer(incoming, controller, limits))?;
        let reply = match answer {
            Answer::Reply(reply) => reply,
            // Between two holds of the controller: the loop goes on, its legs at rest.
            Answer::Shelve(shelf) => {
                let kept = match (&mut self.store, &shelf) {
                    (Some(store), Shelf::Keep(table)) => store.keep(table).is_ok(),
                    (Some(store), Shelf::Forget) => store.forget().is_ok(),
                    (None, _) => false,
                };
                let compiled = (*self.entry.table, self.entry.checksum);
                board.with(|controller| self.server.shelved(kept, shelf, compiled, controller))?
            }
        };
        encode(&reply)
    }

    /// What goes on without being asked: the telemetry to send next, if any, and
    /// once a second a look at the table.
    pub fn idle(&mut self, board: &Board) -> Option<Vec<u8, FRAME>> {
        self.check(board);
        let telemetry = board.with(|controller| self.server.telemetry(controller))??;
        encode(&telemetry)
    }

    fn check(&mut self, board: &Board) {
        let copy = board.with(|controller| {
            let at = controller.report().at;
            let table = controller.table();
            // Rates are positive and far below 2³².
            let due = at >= self.checked + table.get().sample_rate as u64;
            due.then(|| (at, *table, controller.identity().checksum))
        });
        if let Some(Some((at, table, checksum))) = copy {
            self.checked = at;
            if table.checksum() != checksum {
                board.with(|controller| controller.table_changed());
            }
        }
    }
}
