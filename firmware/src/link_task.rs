//! The link task: frames in, frames out, and work that can wait. It runs at a lower
//! priority than the loop.

use embedded_storage_async::nor_flash::NorFlash;
use heapless::Vec;
use shared::controller::{Memory, Refusal};
use shared::link::{Answer, Cutter, FRAME, FrameError, Job, Server, encode};
use shared::table::{Limits, ValidTable};

use crate::loop_task::BoardController;
use crate::store::{Store, StoreError};
use crate::tables::Entry;

/// Shortest time between two answers to frames whose content is lost, s. Noise on the line
/// holds many such frames, and answering each would fill the line.
const PAUSE: f32 = 0.02;

/// The board's end of the link, and its memory for a table.
pub struct LinkTask<F: NorFlash> {
    cutter: Cutter,
    server: Server,
    limits: Limits,
    entry: &'static Entry,
    /// None if the board's memory cannot be used.
    store: Option<Store<F>>,
    /// Time of the last check of the table, samples since power-up.
    checked: u64,
    /// Time from which a frame whose content is lost is answered, samples since power-up.
    tolerant: u64,
}

impl<F: NorFlash> LinkTask<F> {
    /// Starts `board` with the stored table, or with the one compiled in, `entry`, if there is
    /// no stored table that this board can run.
    pub fn begin(
        board: &BoardController,
        entry: &'static Entry,
        limits: Limits,
        mut store: Option<Store<F>>,
        memory: Memory<'static>,
    ) -> Self {
        board.begin(entry, memory);
        let kept = store.as_mut().and_then(Store::table);
        if let Some((table, checksum)) = kept
            && limits.admit(&table).is_ok()
        {
            // No loop runs yet, so it is not refused.
            let _ = board.with(|controller| controller.replace(table, checksum, true));
        }
        Self {
            cutter: Cutter::new(),
            server: Server::new(),
            limits,
            entry,
            store,
            checked: 0,
            tolerant: 0,
        }
    }

    /// Takes one byte from the host. Returns the frame to send, if there is one: none for a
    /// frame whose content is lost, if the answer to another one was sent less than 20 ms
    /// before.
    pub fn on_byte(&mut self, byte: u8, board: &BoardController) -> Option<Vec<u8, FRAME>> {
        let incoming = self.cutter.push(byte)?;
        if let Err(FrameError::Length | FrameError::Encoding | FrameError::Checksum) = incoming {
            let (at, rate) = board.with(|c| (c.at(), c.table().get().sample_rate))?;
            if at < self.tolerant {
                return None;
            }
            // Rates are positive and far below 2³².
            self.tolerant = at + (PAUSE * rate) as u64 + 1;
        }
        let answer = board.with(|controller| self.server.answer(incoming, controller))?;
        let reply = match answer {
            Answer::Reply(reply) => reply,
            Answer::Table(job) => {
                // Without holding the controller: the loop keeps running meanwhile, with
                // the legs at rest.
                let outcome = self.shelve(job);
                board.with(|controller| self.server.run(outcome, controller))?
            }
        };
        encode(&reply)
    }

    /// Stores or deletes a table. Returns the one to run from now on, with its checksum and
    /// whether it came over the link.
    fn shelve(&mut self, job: Job) -> Result<(ValidTable, u32, bool), Refusal> {
        let store = self.store.as_mut().ok_or(Refusal::Memory)?;
        let compiled = (*self.entry.table, self.entry.checksum);
        let next = self.server.table(job, &self.limits, compiled)?;
        let done = match (job, &next) {
            (Job::Keep { .. }, (table, ..)) => store.keep(table),
            (Job::Forget, _) => store.forget(),
        };
        done.map_err(|StoreError| Refusal::Memory)?;
        Ok(next)
    }

    /// Work that no request asks for: verifies the table's checksum once a second, and returns
    /// the telemetry frame to send, if there is one.
    pub fn idle(&mut self, board: &BoardController) -> Option<Vec<u8, FRAME>> {
        self.check(board);
        let telemetry = board.with(|controller| self.server.telemetry(controller))??;
        encode(&telemetry)
    }

    fn check(&mut self, board: &BoardController) {
        let copy = board.with(|controller| {
            let at = controller.at();
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
