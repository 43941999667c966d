//! One sample over a serial line, in place of the converters of an emulated board: twelve
//! ADC codes in, six DAC codes out.
//!
//! A frame is a first byte, 16-bit words with the low byte first, and a CRC-8 (SMBus
//! polynomial) over all bytes before it. A request has the first byte [`SAMPLE`] and the
//! codes of six sensors and six force sensors. A reply has the first byte [`SAMPLE`] and the
//! codes of six outputs.

use crc::{CRC_8_SMBUS, Crc};
use shared::LEGS;
use shared::codes::{AdcCode, DacCode, Samples};

/// Size of a request, bytes.
pub const REQUEST: usize = 2 + 4 * LEGS;

/// Size of a reply, bytes.
pub const REPLY: usize = 2 + 2 * LEGS;

/// First byte of a request, and of the reply to a valid one.
pub const SAMPLE: u8 = 0x5A;

/// First byte of the reply to a malformed request.
pub const REFUSED: u8 = 0xFF;

const CRC: Crc<u8> = Crc::<u8>::new(&CRC_8_SMBUS);

/// A malformed frame: its first byte or its CRC is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadFrame;

impl core::fmt::Display for BadFrame {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("a frame with a wrong first byte or CRC")
    }
}

impl core::error::Error for BadFrame {}

fn pack<const BYTES: usize>(first: u8, words: impl Iterator<Item = u16>) -> [u8; BYTES] {
    let mut frame = [0; BYTES];
    frame[0] = first;
    for (bytes, word) in frame[1..].chunks_exact_mut(2).zip(words) {
        bytes.copy_from_slice(&word.to_le_bytes());
    }
    frame[BYTES - 1] = CRC.checksum(&frame[..BYTES - 1]);
    frame
}

fn unpack<const BYTES: usize, const WORDS: usize>(
    frame: &[u8; BYTES],
) -> Result<(u8, [u16; WORDS]), BadFrame> {
    const { assert!(BYTES == 2 + 2 * WORDS) };
    if CRC.checksum(&frame[..BYTES - 1]) != frame[BYTES - 1] {
        return Err(BadFrame);
    }
    let words = core::array::from_fn(|i| u16::from_le_bytes([frame[1 + 2 * i], frame[2 + 2 * i]]));
    Ok((frame[0], words))
}

/// Encodes the request for one sample.
pub fn request(adc: Samples) -> [u8; REQUEST] {
    let codes = adc.sensors.into_iter().chain(adc.forces);
    pack(SAMPLE, codes.map(|code| code.0.cast_unsigned()))
}

/// Decodes the ADC codes of a request.
///
/// # Errors
/// If the request is malformed.
pub fn parse_request(frame: &[u8; REQUEST]) -> Result<Samples, BadFrame> {
    let (first, words) = unpack::<REQUEST, { 2 * LEGS }>(frame)?;
    if first != SAMPLE {
        return Err(BadFrame);
    }
    let code = |i: usize| AdcCode(words[i].cast_signed());
    Ok(Samples {
        sensors: core::array::from_fn(code),
        forces: core::array::from_fn(|i| code(LEGS + i)),
    })
}

/// Encodes the reply to a valid request, with the DAC codes to latch.
pub fn reply(dac: [DacCode; LEGS]) -> [u8; REPLY] {
    pack(SAMPLE, dac.into_iter().map(|code| code.0))
}

/// Encodes the reply to a malformed request.
pub fn refusal() -> [u8; REPLY] {
    pack(REFUSED, core::iter::empty())
}

/// Decodes the DAC codes of a reply.
///
/// # Errors
/// If the reply is malformed or says that the request was.
pub fn parse_reply(frame: &[u8; REPLY]) -> Result<[DacCode; LEGS], BadFrame> {
    match unpack::<REPLY, LEGS>(frame)? {
        (SAMPLE, words) => Ok(words.map(DacCode)),
        _ => Err(BadFrame),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_survive_the_line() {
        let adc = Samples {
            sensors: [-32768, -1, 0, 1, 255, 32767].map(AdcCode),
            forces: [2, 3, -4, 5, -6, 7].map(AdcCode),
        };
        assert_eq!(parse_request(&request(adc)), Ok(adc));
        let dac = [0, 1, 255, 256, 32768, 65535].map(DacCode);
        assert_eq!(parse_reply(&reply(dac)), Ok(dac));
    }

    /// The layout is the documented one, byte by byte, with the CRC from a long division
    /// (polynomial x⁸ + x² + x + 1).
    #[test]
    fn the_layout_is_the_documented_one() {
        let frame = request(Samples {
            sensors: [0x0102, 0, 0, 0, 0, -2].map(AdcCode),
            forces: [0, 0, 0, 0, 0, 0x0304].map(AdcCode),
        });
        let mut bytes = [0; 25];
        bytes[..3].copy_from_slice(&[0x5A, 0x02, 0x01]);
        bytes[11..13].copy_from_slice(&[0xFE, 0xFF]);
        bytes[23..].copy_from_slice(&[0x04, 0x03]);
        assert_eq!(frame[..25], bytes);
        let mut crc = 0u8;
        for byte in &bytes {
            crc ^= byte;
            for _ in 0..8 {
                crc = if crc & 0x80 == 0 {
                    crc << 1
                } else {
                    (crc << 1) ^ 0x07
                };
            }
        }
        assert_eq!(frame[25], crc);
    }

    #[test]
    fn every_single_bit_error_is_refused() {
        let good = request([1, 2, 3, 4, 5, 6].map(AdcCode).into());
        for bit in 0..8 * REQUEST {
            let mut bad = good;
            bad[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(parse_request(&bad), Err(BadFrame));
        }
        assert_eq!(parse_reply(&refusal()), Err(BadFrame));
    }
}
