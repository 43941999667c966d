//! The link between a board and a host: frames and what is in them. The wire
//! format is described for other programs in `docs/link.md`.
//!
//! A frame is a [`Packet`] as postcard writes it, its CRC-32 (ISO-HDLC) with the
//! low byte first, all of it COBS-encoded, and a zero.

pub mod message;
pub mod server;
pub mod upload;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::CRC_32;

pub use message::{CHUNK, Reply, Request};
pub use server::{Answer, Job, Server};

/// Version of frames and messages.
pub const VERSION: u8 = 1;

/// The most bytes in a packet with its CRC.
pub const PACKET: usize = 512;

/// The most bytes in a frame, the zero included: COBS adds one in 254.
pub const FRAME: usize = PACKET + PACKET / 254 + 2;

/// A message with what it belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Packet<T> {
    /// [`VERSION`].
    pub version: u8,
    /// Given by the board in answer to [`Request::Hello`]; 0 in that.
    pub session: u32,
    /// Of requests, higher from each to the next; an answer has its request's; 0
    /// in what nobody asked for.
    pub sequence: u32,
    /// The message.
    pub body: T,
}

/// Bytes that are no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// Longer than a frame may be.
    Length,
    /// Not COBS.
    Encoding,
    /// The checksum is wrong.
    Checksum,
    /// Of another version.
    Version,
    /// The checksum is right and what is in it is not.
    Content,
}

impl core::fmt::Display for FrameError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Length => "a frame that is too long",
            Self::Encoding => "a frame that is not COBS",
            Self::Checksum => "a frame with a wrong checksum",
            Self::Version => "a frame of another version of the link",
            Self::Content => "a frame with something else in it",
        })
    }
}

impl core::error::Error for FrameError {}

/// The frame of a packet. None if it is longer than [`PACKET`].
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
    // What follows is zero: the frame's end.
    frame.truncate(length + 1);
    Some(frame)
}

/// The packet in a frame without its zero; `frame` is overwritten.
///
/// # Errors
/// Where it is none.
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
        // Bytes left over are not a message of this version.
        Ok(_) | Err(_) => Err(FrameError::Content),
    }
}

/// Cuts a stream of bytes into frames.
#[derive(Debug, Default)]
pub struct Cutter {
    bytes: Vec<u8, FRAME>,
    /// More came than a frame has.
    over: bool,
}

impl Cutter {
    /// With nothing in it.
    pub const fn new() -> Self {
        Self {
            bytes: Vec::new(),
            over: false,
        }
    }

    /// The next byte; a packet, or what was none, where a frame ends with it.
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
            // A zero too many begins a stream afresh.
            None
        } else {
            Some(decode(&mut self.bytes))
        };
        self.bytes.clear();
        frame
    }
}
