//! The link task: frames in, frames out, and what can wait, below the loop.

use heapless::Vec;
use shared::link::{Cutter, FRAME, Server, encode};

use crate::loop_task::Board;

/// The board's end of the link.
#[derive(Debug, Default)]
pub struct LinkTask {
    cutter: Cutter,
    server: Server,
    /// When the table was last checked, samples.
    checked: u64,
}

impl LinkTask {
    /// Before anything came.
    pub const fn new() -> Self {
        Self {
            cutter: Cutter::new(),
            server: Server::new(),
            checked: 0,
        }
    }

    /// One byte from the host; the frame to send where one is due.
    pub fn on_byte(&mut self, byte: u8, board: &Board) -> Option<Vec<u8, FRAME>> {
        let incoming = self.cutter.push(byte)?;
        let reply = board.with(|controller| self.server.answer(incoming, controller))?;
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
