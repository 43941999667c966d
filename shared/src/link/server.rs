//! The board's end of the link.

use heapless::{HistoryBuf, Vec};

use super::{CHUNK, FrameError, Packet, Reply, Request, VERSION};
use crate::controller::{Controller, Refusal};
use crate::recorder::Record;
use crate::supervisor::Event;

/// Sessions and sequence numbers.
#[derive(Debug, Default)]
pub struct Server {
    /// 0 before the first.
    session: u32,
    /// Of the last request that was carried out.
    sequence: u32,
    /// What the last sessions were begun with.
    nonces: HistoryBuf<u32, 8>,
}

impl Server {
    /// Before any session.
    pub const fn new() -> Self {
        Self {
            session: 0,
            sequence: 0,
            nonces: HistoryBuf::new(),
        }
    }

    /// Carries out a request, or says why not. A frame that is malformed, of
    /// another session or not newer than the last changes nothing.
    pub fn answer(
        &mut self,
        incoming: Result<Packet<Request>, FrameError>,
        controller: &mut Controller<'_>,
    ) -> Packet<Reply> {
        let (sequence, outcome) = match incoming {
            Ok(packet) => (packet.sequence, self.carry_out(&packet, controller)),
            Err(FrameError::Version) => (0, Err(Refusal::Version)),
            Err(_) => (0, Err(Refusal::Frame)),
        };
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
        if packet.session != self.session || self.session == 0 {
            return Err(Refusal::Session);
        }
        if packet.sequence <= self.sequence {
            return Err(Refusal::Replayed);
        }
        self.sequence = packet.sequence;
        controller.heard();
        let done = |()| Reply::Done;
        match packet.body {
            // Above.
            Request::Hello(_) => Ok(Reply::Hello),
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
        }
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
