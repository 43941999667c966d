//! The messages of the link.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::upload::PIECE;
use crate::controller::{ControllerReport, Health, Identity, Refusal, Telemetry};
use crate::injection::Injection;
use crate::levels::Levels;
use crate::multisine::{LINES, Line, LineParts};
use crate::recorder::{Record, Recording};

/// Largest number of records in one reply.
pub const CHUNK: usize = 8;

/// A message from host to board. The order is part of the wire format.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(
    clippy::large_enum_variant,
    reason = "one at a time, and no allocator for a box"
)]
pub enum Request {
    /// Begins a session and ends any other. The number is chosen by the host, at random.
    Hello(u32),
    /// Request mode, gain, fault and counters.
    Report,
    /// Request the identity of the table in use.
    Identity,
    /// Test sensors and legs.
    SelfTest,
    /// Close the loop.
    Start,
    /// Open the loop, or end a self-test or an injection.
    Stop,
    /// Clear the fault.
    Clear,
    /// Set the target of the loop gain, as a fraction of the table's, above 0 and up to 1.
    SetGain(f32),
    /// Add a test signal to the leg forces.
    Inject(Injection),
    /// Start a recording.
    Record(Recording),
    /// Request up to [`CHUNK`] records of a complete recording, from this index on.
    Recording(u32),
    /// Request up to [`CHUNK`] records from before the latched fault, from this index on.
    Snapshot(u32),
    /// Send every Nth sample as telemetry; 0 for none.
    Telemetry(u32),
    /// Bytes of an encoded table, and the offset of the first one.
    Piece(u32, Vec<u8, PIECE>),
    /// Store the uploaded table, of this length in bytes and with this checksum, and run it.
    Keep(u32, u32),
    /// Delete the stored table and run the one compiled into the firmware.
    Forget,
    /// Request timing and stack use of the processor.
    Health,
    /// Request the levels of the last window.
    Levels,
    /// Set the lines of the multisine, and the length of its windows as a power of two of samples.
    Multisine(u8, Vec<Line, LINES>),
    /// Request the answers at the multisine's line with this index.
    Line(u8),
}

/// A message from board to host. The order is part of the wire format.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(
    clippy::large_enum_variant,
    reason = "one at a time, and no allocator for a box"
)]
pub enum Reply {
    /// A session has begun. Its number is in the packet.
    Hello,
    /// Mode, gain, fault and counters.
    Report(ControllerReport),
    /// Identity of the table in use.
    Identity(Identity),
    /// The request was carried out, or was started.
    Done,
    /// The request was refused, and nothing has changed.
    Refused(Refusal),
    /// Up to [`CHUNK`] records: fewer at the end, none past it.
    Records(Vec<Record, CHUNK>),
    /// A telemetry sample, sent without a request for each.
    Telemetry(Telemetry),
    /// Timing and stack use of the processor.
    Health(Health),
    /// Levels of the last window.
    Levels(Levels),
    /// Answers at a line of the multisine.
    Line(LineParts),
}
