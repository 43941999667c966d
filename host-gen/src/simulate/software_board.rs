//! Software in the loop: the simulated machine with its converters, and the whole
//! controller of a board, with supervisor and link.

use shared::LEGS;
use shared::codes::{DacCode, Samples};
use shared::controller::{Controller, Memory, Reading};
use shared::link::{Answer, Cutter, Server, encode};
use shared::table::{Limits, ValidTable};

use super::rig::Rig;
use crate::design::Study;

/// A board in software: the simulated machine, the controller and the link.
pub struct SoftwareBoard<'a> {
    /// The simulated machine with its converters.
    pub rig: Rig,
    /// The controller that a board runs.
    pub controller: Controller<'a>,
    cutter: Cutter,
    server: Server,
    /// The table of the start, which stands for the one compiled into a firmware.
    table: ValidTable,
}

impl<'a> SoftwareBoard<'a> {
    /// A board with `table`, before its first sample.
    pub fn new(study: &Study, table: &ValidTable, memory: Memory<'a>) -> Self {
        let machine = study.machine();
        Self {
            rig: Rig::new(study.plant().clone(), &machine.board, &machine.simulation),
            controller: Controller::new(*table, table.checksum(), memory),
            cutter: Cutter::new(),
            server: Server::new(),
            table: *table,
        }
    }

    /// Runs one sample and returns the DAC codes.
    pub fn sample(&mut self) -> [DacCode; LEGS] {
        self.sample_through(Reading::from, |dac| dac)
    }

    /// Runs one sample with altered converters: `read` makes the reading from the true
    /// ADC codes, `give` makes the latched codes from those of the controller. Returns
    /// the codes of the controller.
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

    /// Takes a byte from the host. Returns the reply to send, if the byte completes a
    /// frame.
    pub fn on_byte(&mut self, byte: u8) -> Option<Vec<u8>> {
        let incoming = self.cutter.push(byte)?;
        let controller = &mut self.controller;
        let reply = match self.server.answer(incoming, controller) {
            Answer::Reply(reply) => reply,
            // A table is kept only as long as this board runs.
            Answer::Table(job) => {
                let compiled = (self.table, self.table.checksum());
                let outcome = self.server.table(job, &Limits::NONE, compiled);
                self.server.run(outcome, controller)
            }
        };
        encode(&reply).map(|frame| frame.to_vec())
    }

    /// The next telemetry frame to send; none if none is due.
    pub fn telemetry(&mut self) -> Option<Vec<u8>> {
        let packet = self.server.telemetry(&mut self.controller)?;
        encode(&packet).map(|frame| frame.to_vec())
    }
}
