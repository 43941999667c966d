//! The board's end of the link.

use heapless::{HistoryBuf, Vec};

use super::upload::Upload;
use super::{CHUNK, FrameError, Packet, Reply, Request, VERSION};
use crate::controller::{Controller, Refusal};
use crate::recorder::Record;
use crate::supervisor::Event;
use crate::table::{Limits, ValidTable};

/// The answer to a frame.
#[derive(Clone, Debug, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "one at a time, and no allocator for a box"
)]
pub enum Answer {
    /// A packet to send.
    Reply(Packet<Reply>),
    /// A table must be stored or deleted. This takes too long to hold the controller
    /// meanwhile: get the table from [`Server::table`], carry out the job, then call
    /// [`Server::run`].
    Table(Job),
}

/// A request that changes the stored table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Job {
    /// Store the uploaded table.
    Keep {
        /// Length of the encoded table, bytes.
        length: u32,
        /// Checksum of the table, CRC-32.
        checksum: u32,
    },
    /// Delete the stored table.
    Forget,
}

/// The board's end of the link: sessions, sequence numbers and uploads.
#[derive(Debug, Default)]
pub struct Server {
    /// Number of the session; 0 before the first.
    session: u32,
    /// Sequence number of the last accepted request.
    sequence: u32,
    /// Numbers in the `Hello` of the last sessions.
    nonces: HistoryBuf<u32, 8>,
    upload: Upload,
}

impl Server {
    /// Before the first session.
    pub const fn new() -> Self {
        Self {
            session: 0,
            sequence: 0,
            nonces: HistoryBuf::new(),
            upload: Upload::new(),
        }
    }

    /// Carries out a request or refuses it. A frame that is malformed, of another session or
    /// without a new sequence number changes nothing.
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

    /// The table to run after a job, with its checksum and whether it came over the link.
    /// `limits` are the board's; `compiled` is the table compiled into the firmware, with its
    /// checksum.
    ///
    /// # Errors
    /// If the uploaded bytes are not a valid table that the board can run.
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

    /// Ends a job and returns the reply to its request. `outcome` is the table to run from now
    /// on, with its checksum and whether it came over the link, or the reason why the job
    /// failed.
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

    /// The next telemetry sample to send, if there is one and a session has begun.
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
            // The time makes the number of a replayed session differ.
            let at = controller.at();
            self.session = mix(nonce ^ mix(at as u32 ^ self.session)) | 1;
            self.sequence = packet.sequence;
            controller.set_telemetry(0);
            controller.heard();
            return Ok(Reply::Hello);
        }
        self.accept(packet, controller)?;
        let done = |()| Reply::Done;
        match packet.body {
            // Handled above and in `job`.
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
            Request::Levels => Ok(Reply::Levels(controller.levels())),
            Request::Multisine(window, ref lines) => {
                controller.set_multisine(window, lines).map(done)
            }
            Request::Line(index) => controller.line(index.into()).map(Reply::Line),
        }
    }

    /// The job that a request asks for. None if it is another request.
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

    /// Accepts a request that belongs to the session and is new.
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

/// Up to [`CHUNK`] records from index `from` on.
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

/// A hash with the constants of lowbias32, which spreads close numbers.
fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7FEB_352D);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846C_A68B);
    x ^ x >> 16
}
