//! One sample over a serial line: six ADC codes in, six DAC codes out.
//!
//! Both frames have 14 bytes: a first byte, six 16-bit words with the low byte
//! first, and a CRC-8 (SMBus polynomial) over the 13 bytes before it. The
//! request's first byte is [`SAMPLE`]; the reply's holds the [`Status`].

use crc::{CRC_8_SMBUS, Crc};
use shared::LEGS;
use shared::codes::{AdcCode, DacCode};
use shared::step::{Output, Status};

/// Bytes in a frame, either way.
pub const FRAME: usize = 2 * LEGS + 2;

/// First byte of a request.
pub const SAMPLE: u8 = 0x5A;

/// First byte of the reply to a frame that was not understood.
pub const REFUSED: u8 = 0xFF;

const CRC: Crc<u8> = Crc::<u8>::new(&CRC_8_SMBUS);

/// A frame that is not what it should be: a wrong first byte or CRC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadFrame;

impl core::fmt::Display for BadFrame {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("a frame with a wrong first byte or CRC")
    }
}

impl core::error::Error for BadFrame {}

fn pack(first: u8, words: [u16; LEGS]) -> [u8; FRAME] {
    let mut frame = [0; FRAME];
    frame[0] = first;
    for (bytes, word) in frame[1..].chunks_exact_mut(2).zip(words) {
        bytes.copy_from_slice(&word.to_le_bytes());
    }
    frame[FRAME - 1] = CRC.checksum(&frame[..FRAME - 1]);
    frame
}

fn unpack(frame: &[u8; FRAME]) -> Result<(u8, [u16; LEGS]), BadFrame> {
    if CRC.checksum(&frame[..FRAME - 1]) != frame[FRAME - 1] {
        return Err(BadFrame);
    }
    let words = core::array::from_fn(|i| u16::from_le_bytes([frame[1 + 2 * i], frame[2 + 2 * i]]));
    Ok((frame[0], words))
}

/// The request for one sample.
pub fn request(adc: [AdcCode; LEGS]) -> [u8; FRAME] {
    pack(SAMPLE, adc.map(|code| code.0.cast_unsigned()))
}

/// The codes of a request.
pub fn parse_request(frame: &[u8; FRAME]) -> Result<[AdcCode; LEGS], BadFrame> {
    match unpack(frame)? {
        (SAMPLE, words) => Ok(words.map(|word| AdcCode(word.cast_signed()))),
        _ => Err(BadFrame),
    }
}

/// The reply to a request: bits 0 to 5 are the sensors at a rail, bit 6 the
/// clamp, bit 7 a force that was not finite (then bits 0 to 6 are zero).
pub fn reply(output: &Output) -> [u8; FRAME] {
    let Status {
        sensors_at_rail,
        clamped,
        not_finite,
    } = output.status;
    let first = if not_finite {
        0x80
    } else {
        sensors_at_rail | u8::from(clamped) << 6
    };
    pack(first, output.dac.map(|code| code.0))
}

/// The reply to a request that was not understood.
pub fn refusal() -> [u8; FRAME] {
    pack(REFUSED, [0; LEGS])
}

/// The output in a reply.
pub fn parse_reply(frame: &[u8; FRAME]) -> Result<Output, BadFrame> {
    let (first, words) = unpack(frame)?;
    let not_finite = first & 0x80 != 0;
    if not_finite && first != 0x80 {
        return Err(BadFrame);
    }
    Ok(Output {
        dac: words.map(DacCode),
        status: Status {
            sensors_at_rail: first & 0x3F,
            clamped: first & 0x40 != 0,
            not_finite,
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_survive_the_line() {
        let adc = [-32768, -1, 0, 1, 255, 32767].map(AdcCode);
        assert_eq!(parse_request(&request(adc)), Ok(adc));
        let output = Output {
            dac: [0, 1, 255, 256, 32768, 65535].map(DacCode),
            status: Status {
                sensors_at_rail: 0b10_0001,
                clamped: true,
                not_finite: false,
            },
        };
        assert_eq!(parse_reply(&reply(&output)), Ok(output));
    }

    /// The layout as documented, byte by byte; the CRC worked out by hand-run
    /// long division (polynomial x⁸ + x² + x + 1).
    #[test]
    fn the_layout_is_the_documented_one() {
        let frame = request([0x0102, 0, 0, 0, 0, -2].map(AdcCode));
        assert_eq!(
            frame[..13],
            [0x5A, 0x02, 0x01, 0, 0, 0, 0, 0, 0, 0, 0, 0xFE, 0xFF]
        );
        let mut crc = 0u8;
        for byte in &frame[..13] {
            crc ^= byte;
            for _ in 0..8 {
                crc = if crc & 0x80 == 0 {
                    crc << 1
                } else {
                    (crc << 1) ^ 0x07
                };
            }
        }
        assert_eq!(frame[13], crc);
    }

    #[test]
    fn every_single_bit_error_is_refused() {
        let good = request([1, 2, 3, 4, 5, 6].map(AdcCode));
        for bit in 0..8 * FRAME {
            let mut bad = good;
            bad[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(parse_request(&bad), Err(BadFrame));
        }
        assert_eq!(parse_reply(&refusal()), Err(BadFrame));
    }
}
