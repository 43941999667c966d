//! Software in the loop: the simulated machine with its converters, and the whole
//! controller that a board runs, supervisor and link included.

use shared::LEGS;
use shared::codes::{DacCode, Samples};
use shared::controller::{Controller, Reading};
use shared::link::{Answer, Cutter, Server, encode};
use shared::recorder::Record;
use shared::table::{Limits, ValidTable};

use super::rig::Rig;
use crate::design::Study;

/// A board that is software.
pub struct SoftwareBoard<'a> {
    /// The machine with its converters.
    pub rig: Rig,
    /// What the board runs.
    pub controller: Controller<'a>,
    cutter: Cutter,
    server: Server,
    /// The table it began with.
    table: ValidTable,
}

impl<'a> SoftwareBoard<'a> {
    /// Before the first sample. `room` is the recorder's memory.
    pub fn new(study: &Study, table: &ValidTable, room: &'a mut [Record]) -> Self {
        let machine = study.machine();
        Self {
            rig: Rig::new(study.plant().clone(), &machine.board, &machine.simulation),
            controller: Controller::new(*table, table.checksum(), room),
            cutter: Cutter::new(),
            server: Server::new(),
            table: *table,
        }
    }

    /// One sample; gives the codes that were latched.
    pub fn sample(&mut self) -> [DacCode; LEGS] {
        self.sample_through(Reading::from, |dac| dac)
    }

    /// The same with converters that do something else to what they read and to
    /// what they give.
    pub fn sample_through(
        &mut self,
        read: impl FnOnce(Samples) -> Reading,
        give: impl FnOnce([DacCode; LEGS]) -> [DacCode; LEGS],
    ) -> [DacCode; LEGS] {
        let samples = self.rig.sample();
        let dac = self.controller.on_sample(read(samples));
        self.rig.advance(give(dac));
        dac
    }

    /// A byte from the host; the frame to send where one is due.
    pub fn on_byte(&mut self, byte: u8) -> Option<Vec<u8>> {
        let incoming = self.cutter.push(byte)?;
        let controller = &mut self.controller;
        let reply = match self.server.answer(incoming, controller) {
            Answer::Reply(reply) => reply,
            // Kept as long as this runs.
            Answer::Table(job) => {
                let compiled = (self.table, self.table.checksum());
                let outcome = self.server.table(job, &Limits::NONE, compiled);
                self.server.run(outcome, controller)
            }
        };
        encode(&reply).map(|frame| frame.to_vec())
    }

    /// Telemetry to send next, if any.
    pub fn telemetry(&mut self) -> Option<Vec<u8>> {
        let packet = self.server.telemetry(&mut self.controller)?;
        encode(&packet).map(|frame| frame.to_vec())
    }
}
