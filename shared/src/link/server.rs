//! The board's end of the link.

use heapless::{HistoryBuf, Vec};

use super::upload::Upload;
use super::{CHUNK, FrameError, Packet, Reply, Request, VERSION};
use crate::controller::{Controller, Refusal};
use crate::recorder::Record;
use crate::supervisor::Event;
use crate::table::{Limits, ValidTable};

/// What comes of a frame.
#[derive(Clone, Debug, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "one at a time, and nothing to allocate a box from"
)]
pub enum Answer {
    /// Send this.
    Reply(Packet<Reply>),
    /// A table is to be kept or forgotten, which takes too long to hold the controller
    /// for: see [`Server::table`], do it, then call [`Server::run`].
    Table(Job),
}

/// What is asked about a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Job {
    /// Keep the one that came.
    Keep {
        /// Bytes.
        length: u32,
        /// CRC-32.
        checksum: u32,
    },
    /// Forget what was kept.
    Forget,
}

/// Sessions and sequence numbers.
#[derive(Debug, Default)]
pub struct Server {
    /// 0 before the first.
    session: u32,
    /// Of the last request that was carried out.
    sequence: u32,
    /// What the last sessions were begun with.
    nonces: HistoryBuf<u32, 8>,
    upload: Upload,
}

impl Server {
    /// Before any session.
    pub const fn new() -> Self {
        Self {
            session: 0,
            sequence: 0,
            nonces: HistoryBuf::new(),
            upload: Upload::new(),
        }
    }

    /// Carries out a request, or says why not. A frame that is malformed, of
    /// another session or not newer than the last changes nothing.
    pub fn answer(
        &mut self,
        incoming: Result<Packet<Request>, FrameError>,
        controller: &mut Controller<'_>,
    ) -> Answer {
        let (sequence, outcome) = match incoming {
            Ok(packet) => match self.job(&packet, controller) {
                Some(Ok(job)) => return Answer::Table(job),
                Some(Err(refusal)) => (packet.sequence, Err(refusal)),
                None => (packet.sequence, self.carry_out(&packet, controller)),
            },
            Err(FrameError::Version) => (0, Err(Refusal::Version)),
            Err(_) => (0, Err(Refusal::Frame)),
        };
        Answer::Reply(self.packet(sequence, outcome))
    }

    /// The table to run after a job, with its checksum and whether it was sent, for a
    /// board with these `limits`; `compiled` is the one that a board goes back to, with
    /// its checksum.
    ///
    /// # Errors
    /// Where what came is no table that runs there.
    pub fn table(
        &self,
        job: Job,
        limits: &Limits,
        compiled: (ValidTable, u32),
    ) -> Result<(ValidTable, u32, bool), Refusal> {
        match job {
            Job::Keep { length, checksum } => {
                let table = self.upload.table(length, checksum, limits)?;
                Ok((table, checksum, true))
            }
            Job::Forget => Ok((compiled.0, compiled.1, false)),
        }
    }

    /// The end of a job: the answer to it. `outcome` is the table to run from here on,
    /// with its checksum and whether it was `sent`, or why there is none.
    pub fn run(
        &mut self,
        outcome: Result<(ValidTable, u32, bool), Refusal>,
        controller: &mut Controller<'_>,
    ) -> Packet<Reply> {
        let outcome = outcome
            .and_then(|(table, checksum, sent)| controller.replace(table, checksum, sent))
            .map(|()| Reply::Done);
        self.packet(self.sequence, outcome)
    }

    fn packet(&self, sequence: u32, outcome: Result<Reply, Refusal>) -> Packet<Reply> {
        Packet {
            version: VERSION,
            session: self.session,
            sequence,
            body: outcome.unwrap_or_else(Reply::Refused),
        }
    }

    /// A sample that waits to be sent, if there is a session for it.
    pub fn telemetry(&self, controller: &mut Controller<'_>) -> Option<Packet<Reply>> {
        let telemetry = controller.telemetry()?;
        (self.session != 0).then_some(Packet {
            version: VERSION,
            session: self.session,
            sequence: 0,
            body: Reply::Telemetry(telemetry),
        })
    }

    fn carry_out(
        &mut self,
        packet: &Packet<Request>,
        controller: &mut Controller<'_>,
    ) -> Result<Reply, Refusal> {
        if let Request::Hello(nonce) = packet.body {
            if self.nonces.as_slices().0.contains(&nonce)
                || self.nonces.as_slices().1.contains(&nonce)
            {
                return Err(Refusal::Replayed);
            }
            self.nonces.write(nonce);
            // With the time in it a session that is played again is another one.
            let at = controller.report().at;
            self.session = mix(nonce ^ mix(at as u32 ^ self.session)) | 1;
            self.sequence = packet.sequence;
            controller.set_telemetry(0);
            controller.heard();
            return Ok(Reply::Hello);
        }
        self.accept(packet, controller)?;
        let done = |()| Reply::Done;
        match packet.body {
            // Above, and in `job`.
            Request::Hello(_) => Ok(Reply::Hello),
            Request::Keep(..) | Request::Forget => Err(Refusal::Frame),
            Request::Report => Ok(Reply::Report(controller.report())),
            Request::Identity => Ok(Reply::Identity(controller.identity())),
            Request::SelfTest => controller.ask(Event::SelfTest).map(done),
            Request::Start => controller.ask(Event::Start).map(done),
            Request::Stop => controller.ask(Event::Stop).map(done),
            Request::Clear => controller.ask(Event::Clear).map(done),
            Request::SetGain(gain) => controller.set_gain(gain).map(done),
            Request::Inject(injection) => controller.start_injection(injection).map(done),
            Request::Record(recording) => controller.arm(recording).map(done),
            Request::Recording(from) => Ok(records(from, |i| controller.recording(i))),
            Request::Snapshot(from) => Ok(records(from, |i| controller.snapshot(i))),
            Request::Telemetry(every) => {
                controller.set_telemetry(every);
                Ok(Reply::Done)
            }
            Request::Piece(at, ref piece) => self.upload.put(at, piece).map(done),
            Request::Health => Ok(Reply::Health(controller.health())),
        }
    }

    /// What a request asks about a table; none if it is about something else.
    fn job(
        &mut self,
        packet: &Packet<Request>,
        controller: &mut Controller<'_>,
    ) -> Option<Result<Job, Refusal>> {
        let job = match packet.body {
            Request::Keep(length, checksum) => Job::Keep { length, checksum },
            Request::Forget => Job::Forget,
            _ => return None,
        };
        let accepted = self.accept(packet, controller).and_then(|()| {
            if controller.is_replaceable() {
                Ok(job)
            } else {
                Err(Refusal::Mode)
            }
        });
        Some(accepted)
    }

    /// Whether a request belongs to the session and is new; it then counts.
    fn accept(
        &mut self,
        packet: &Packet<Request>,
        controller: &mut Controller<'_>,
    ) -> Result<(), Refusal> {
        if packet.session != self.session || self.session == 0 {
            return Err(Refusal::Session);
        }
        if packet.sequence <= self.sequence {
            return Err(Refusal::Replayed);
        }
        self.sequence = packet.sequence;
        controller.heard();
        Ok(())
    }
}

fn records<'a>(from: u32, get: impl Fn(usize) -> Option<&'a Record>) -> Reply {
    let mut records = Vec::new();
    for i in 0..CHUNK {
        let index = (from as usize).saturating_add(i);
        match get(index) {
            Some(record) if records.push(*record).is_ok() => {}
            _ => break,
        }
    }
    Reply::Records(records)
}

/// A hash (lowbias32's constants): equal numbers apart, close ones far apart.
fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7FEB_352D);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846C_A68B);
    x ^ x >> 16
}
