//! What is said over the link.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::upload::PIECE;
use crate::controller::{Health, Identity, Refusal, Report, Telemetry};
use crate::injection::Injection;
use crate::recorder::{Record, Recording};

/// Records in one answer.
pub const CHUNK: usize = 8;

/// From host to board. The order is part of the wire format.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(
    clippy::large_enum_variant,
    reason = "one at a time, and nothing to allocate a box from"
)]
pub enum Request {
    /// Begins a session; any other ends. The number is the host's own, best a
    /// random one.
    Hello(u32),
    /// How do things stand?
    Report,
    /// What runs there?
    Identity,
    /// Test sensors and legs.
    SelfTest,
    /// Close the loop.
    Start,
    /// Open it; end a test or an injection.
    Stop,
    /// Forget the fault.
    Clear,
    /// Aim at this part of the law's force, above 0 and up to 1.
    SetGain(f32),
    /// Push the legs.
    Inject(Injection),
    /// Arm the recorder.
    Record(Recording),
    /// Records of a finished recording from this one on.
    Recording(u32),
    /// Samples before the latched fault from this one on.
    Snapshot(u32),
    /// One sample out of so many as it comes; 0 for none.
    Telemetry(u32),
    /// A piece of a table, from this byte on.
    Piece(u32, Vec<u8, PIECE>),
    /// Keep the table that came, so many bytes with this checksum, and run it.
    Keep(u32, u32),
    /// Forget the table that was kept and run the one compiled in.
    Forget,
    /// How does the processor do?
    Health,
}

/// From board to host. The order is part of the wire format.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(
    clippy::large_enum_variant,
    reason = "one at a time, and nothing to allocate a box from"
)]
pub enum Reply {
    /// The session's number is in the packet.
    Hello,
    /// How things stand.
    Report(Report),
    /// What runs here.
    Identity(Identity),
    /// It is done, or begun.
    Done,
    /// Nothing has changed.
    Refused(Refusal),
    /// Records, up to [`CHUNK`]; fewer at the end, none past it.
    Records(Vec<Record, CHUNK>),
    /// Nobody asked for this one.
    Telemetry(Telemetry),
    /// How the processor does.
    Health(Health),
}
