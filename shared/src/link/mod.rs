//! The link between a board and a host: frames and messages. `docs/link.md` describes the
//! wire format for other programs.
//!
//! A frame is a [`Packet`] encoded by postcard, followed by its CRC-32 (ISO-HDLC) with the
//! low byte first, both encoded by COBS, and a zero byte.

pub mod message;
pub mod server;
pub mod upload;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::CRC_32;

pub use message::{CHUNK, Reply, Request};
pub use server::{Answer, Job, Server};

/// Version of frames and messages.
pub const VERSION: u8 = 3;

/// Largest size of a packet with its CRC, bytes.
pub const PACKET: usize = 512;

/// Largest size of a frame with its zero, bytes: COBS adds one byte in 254.
pub const FRAME: usize = PACKET + PACKET / 254 + 2;

/// A message with its session and sequence number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Packet<T> {
    /// Version of the link, [`VERSION`].
    pub version: u8,
    /// Number of the session, chosen by the board in its reply to [`Request::Hello`]; 0 in
    /// the `Hello` itself.
    pub session: u32,
    /// Number of the request, higher from each request to the next. A reply has the number of
    /// its request; telemetry, and the reply to a malformed frame, have 0.
    pub sequence: u32,
    /// The message itself.
    pub body: T,
}

/// Why bytes are not a valid frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// Longer than [`FRAME`].
    Length,
    /// Not encoded by COBS.
    Encoding,
    /// The checksum is wrong.
    Checksum,
    /// Of another version of the link.
    Version,
    /// The checksum is right, but the content is not a message of this version.
    Content,
}

impl core::fmt::Display for FrameError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Length => "a frame that is too long",
            Self::Encoding => "a frame that is not COBS",
            Self::Checksum => "a frame with a wrong checksum",
            Self::Version => "a frame of another version of the link",
            Self::Content => "a frame whose content is not a message",
        })
    }
}

impl core::error::Error for FrameError {}

/// Encodes a packet as a frame. None if the packet is longer than [`PACKET`].
pub fn encode<T: Serialize>(packet: &Packet<T>) -> Option<Vec<u8, FRAME>> {
    let mut plain = [0; PACKET];
    let room = plain.get_mut(..PACKET - 4)?;
    let length = postcard::to_slice(packet, room).ok()?.len();
    let sum = CRC_32.checksum(plain.get(..length)?);
    plain
        .get_mut(length..length + 4)?
        .copy_from_slice(&sum.to_le_bytes());
    let mut frame = Vec::new();
    frame.resize_default(FRAME).ok()?;
    let length = cobs::try_encode(plain.get(..length + 4)?, frame.get_mut(..FRAME - 1)?).ok()?;
    // The rest is zero; the first zero ends the frame.
    frame.truncate(length + 1);
    Some(frame)
}

/// Decodes the packet in a frame without its zero. Overwrites `frame`.
///
/// # Errors
/// If the bytes are not a valid frame.
pub fn decode<T: for<'a> Deserialize<'a>>(frame: &mut [u8]) -> Result<Packet<T>, FrameError> {
    let length = cobs::decode_in_place(frame).map_err(|_| FrameError::Encoding)?;
    let plain = frame.get(..length).ok_or(FrameError::Encoding)?;
    let (packet, sum) = plain.split_last_chunk::<4>().ok_or(FrameError::Checksum)?;
    if CRC_32.checksum(packet) != u32::from_le_bytes(*sum) {
        return Err(FrameError::Checksum);
    }
    match packet.first() {
        Some(&VERSION) => {}
        Some(_) => return Err(FrameError::Version),
        None => return Err(FrameError::Content),
    }
    match postcard::take_from_bytes(packet) {
        Ok((packet, [])) => Ok(packet),
        // A message with bytes left over is not of this version.
        Ok(_) | Err(_) => Err(FrameError::Content),
    }
}

/// Splits a stream of bytes into frames.
#[derive(Debug, Default)]
pub struct Cutter {
    bytes: Vec<u8, FRAME>,
    /// Whether the bytes are already longer than a frame.
    over: bool,
}

impl Cutter {
    /// Before the first byte.
    pub const fn new() -> Self {
        Self {
            bytes: Vec::new(),
            over: false,
        }
    }

    /// Takes the next byte. Returns a packet or an error if the byte ends a frame.
    pub fn push<T: for<'a> Deserialize<'a>>(
        &mut self,
        byte: u8,
    ) -> Option<Result<Packet<T>, FrameError>> {
        if byte != 0 {
            self.over |= self.bytes.push(byte).is_err();
            return None;
        }
        let over = core::mem::take(&mut self.over);
        let frame = if over {
            Some(Err(FrameError::Length))
        } else if self.bytes.is_empty() {
            // Extra zeros between frames are allowed.
            None
        } else {
            Some(decode(&mut self.bytes))
        };
        self.bytes.clear();
        frame
    }
}
