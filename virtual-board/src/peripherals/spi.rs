//! Serial peripheral interface, SPI1 or SPI3, as a master, full-duplex or in one direction
//! (RM0433, chapter 50). FIFOs of 16 bytes; a frame of DSIZE + 1 bits is exchanged with the
//! wire as its last bit ends.

use std::collections::VecDeque;

use super::{Refusal, Register, only, unknown};
use crate::time::{Ticks, cycles};

/// Registers (50.11), with the name of the first of the peripherals.
pub const REGISTERS: [Register; 14] = [
    (0x00, "SPI_CR1"),
    (0x04, "SPI_CR2"),
    (0x08, "SPI_CFG1"),
    (0x0C, "SPI_CFG2"),
    (0x10, "SPI_IER"),
    (0x14, "SPI_SR"),
    (0x18, "SPI_IFCR"),
    (0x20, "SPI_TXDR"),
    (0x30, "SPI_RXDR"),
    (0x40, "SPI_CRCPOLY"),
    (0x44, "SPI_TXCRC"),
    (0x48, "SPI_RXCRC"),
    (0x4C, "SPI_UDRDR"),
    (0x50, "SPI_I2SCFGR"),
];

/// Size of each FIFO, bytes.
const FIFO: usize = 16;

/// COMM: only MOSI is used.
const TRANSMITTER: u32 = 1;

/// COMM: only MISO is used, and the clock runs by itself.
const RECEIVER: u32 = 2;

const EOT: u32 = 1 << 3;
const TXTF: u32 = 1 << 4;
const OVR: u32 = 1 << 6;

/// A frame that is to be exchanged with the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Number of bits.
    pub bits: u32,
    /// What MOSI sends, in the lower bits, the highest first.
    pub data: u32,
    /// The clock idles high.
    pub cpol: bool,
    /// Data is taken at the second edge of a clock.
    pub cpha: bool,
    /// Length of a bit.
    pub bit: Ticks,
}

/// The peripheral.
#[derive(Default)]
pub struct Spi {
    /// Its kernel clock, Hz, if it runs.
    pub kernel: Option<u64>,
    cr1: u32,
    tsize: u32,
    cfg1: u32,
    cfg2: u32,
    flags: u32,
    tx: VecDeque<u8>,
    rx: VecDeque<u8>,
    /// Frames left of the transfer.
    left: u32,
    /// When the frame on the wire ends.
    ends: Option<Ticks>,
}

impl Spi {
    fn is_enabled(&self) -> bool {
        self.cr1 & 1 != 0
    }

    fn bits(&self) -> u32 {
        (self.cfg1 & 0x1F) + 1
    }

    /// Bytes that a frame takes in the FIFOs: one, two or four (50.4.11).
    fn bytes(&self) -> usize {
        (self.bits() as usize).div_ceil(8).next_power_of_two()
    }

    /// COMM (50.11.4): 0 is full-duplex.
    fn comm(&self) -> u32 {
        self.cfg2 >> 17 & 3
    }

    fn sends(&self) -> bool {
        self.comm() != RECEIVER
    }

    fn receives(&self) -> bool {
        self.comm() != TRANSMITTER
    }

    /// Whether the transfer has no fixed length: TSIZE is 0.
    fn is_endless(&self) -> bool {
        self.tsize == 0
    }

    fn bit(&self) -> Ticks {
        let divider = 2u64 << (self.cfg1 >> 28 & 7);
        cycles(divider, self.kernel.unwrap_or(1))
    }

    /// When the frame on the wire ends.
    pub fn next(&self) -> Option<Ticks> {
        self.ends
    }

    /// Begins a frame at `now`, if there is one to send.
    fn begin(&mut self, now: Ticks) {
        let running = self.cr1 >> 9 & 1 != 0 && self.is_enabled();
        let running = running && (self.left > 0 || self.is_endless());
        let ready = !self.sends() || self.tx.len() >= self.bytes();
        if running && self.ends.is_none() && ready && self.kernel.is_some() {
            self.ends = Some(now + u64::from(self.bits()) * self.bit());
        }
    }

    /// The frame that ends at or before `now`, if there is one, to be answered with
    /// [`Spi::finish`].
    pub fn due(&self, now: Ticks) -> Option<Frame> {
        self.ends.filter(|ends| *ends <= now)?;
        let bytes = self.tx.iter().take(self.bytes());
        let data = bytes
            .rev()
            .fold(0, |word, byte| word << 8 | u32::from(*byte));
        Some(Frame {
            bits: self.bits(),
            data,
            cpol: self.cfg2 >> 25 & 1 != 0,
            cpha: self.cfg2 >> 24 & 1 != 0,
            bit: self.bit(),
        })
    }

    /// Ends the frame that was due with what MISO brought.
    pub fn finish(&mut self, received: u32) {
        let Some(ended) = self.ends.take() else {
            return;
        };
        let bytes = self.bytes();
        if self.sends() {
            self.tx.drain(..bytes);
        }
        if self.receives() {
            if self.rx.len() + bytes > FIFO {
                self.flags |= OVR;
            } else {
                self.rx.extend(&received.to_le_bytes()[..bytes]);
            }
        }
        if !self.is_endless() {
            self.left -= 1;
            if self.left == 0 {
                self.flags |= EOT | TXTF;
                self.cr1 &= !(1 << 9);
            }
        }
        self.begin(ended);
    }

    /// The status register (50.11.6).
    fn sr(&self) -> u32 {
        let bytes = self.bytes();
        let rxp = self.rx.len() >= bytes;
        let txp = self.tx.len() + bytes <= FIFO && self.is_enabled();
        let sent = self.tx.is_empty() || self.left == 0 && !self.is_endless();
        let txc = self.ends.is_none() && sent;
        let word = u32::from(self.rx.len() >= 4) << 15;
        let level = if self.rx.len() < 4 {
            self.rx.len() as u32
        } else {
            0
        };
        self.flags
            | u32::from(rxp)
            | u32::from(txp) << 1
            | u32::from(rxp && txp) << 2
            | u32::from(txc) << 12
            | level << 13
            | word
            | self.left << 16
    }

    /// Reads a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&mut self, offset: u32, size: usize) -> Result<u32, Refusal> {
        Ok(match offset {
            0x00 => self.cr1,
            0x04 => self.tsize,
            0x08 => self.cfg1,
            0x0C => self.cfg2,
            0x14 => self.sr(),
            0x30 => {
                if self.rx.len() < size {
                    return Err("read while the FIFO is empty".to_owned());
                }
                let bytes: Vec<u8> = self.rx.drain(..size).collect();
                bytes
                    .iter()
                    .rev()
                    .fold(0, |word, byte| word << 8 | u32::from(*byte))
            }
            _ => return unknown(),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled, or the peripheral is not in a state
    /// in which it may be written.
    pub fn write(
        &mut self,
        offset: u32,
        size: usize,
        value: u32,
        now: Ticks,
    ) -> Result<(), Refusal> {
        let locked = || Err("written while SPE is set".to_owned());
        match offset {
            0x00 => {
                let value = only(value, 1 | 1 << 9 | 1 << 12)?;
                let was = self.is_enabled();
                // CSTART can be set only with SPE, and ends by itself.
                self.cr1 = value | self.cr1 & (1 << 9);
                if value & 1 == 0 {
                    // Both FIFOs are flushed, and what is on the wire is cut off.
                    self.cr1 &= !(1 << 9);
                    self.tx.clear();
                    self.rx.clear();
                    self.ends = None;
                    self.left = 0;
                } else if !was {
                    if self.cfg2 >> 22 & 1 == 0 {
                        return Err("slaves are not modelled".to_owned());
                    }
                    self.left = self.tsize;
                }
                let starts = value & 1 != 0 && value >> 9 & 1 != 0;
                if starts && self.is_endless() && self.comm() != TRANSMITTER {
                    return Err("endless transfers that receive are not modelled".to_owned());
                }
                self.begin(now);
            }
            0x04 if self.is_enabled() => return locked(),
            0x04 => self.tsize = only(value, 0xFFFF)?,
            0x08 if self.is_enabled() => return locked(),
            // DSIZE, MBR; FTHLV = 0: a packet is a frame.
            0x08 => self.cfg1 = only(value, 0x1F | 7 << 28)?,
            0x0C if self.is_enabled() => return locked(),
            // COMM, MASTER, CPHA, CPOL, SSM, AFCNTR.
            0x0C => {
                let bits = 3 << 17 | 1 << 22 | 1 << 24 | 1 << 25 | 1 << 26 | 1 << 31;
                let value = only(value, bits)?;
                if value >> 17 & 3 == 3 {
                    return Err("half-duplex is not modelled".to_owned());
                }
                self.cfg2 = value;
            }
            0x18 => self.flags &= !only(value, 0xFF8)?,
            0x20 => {
                if !self.is_enabled() {
                    return Err("written while SPE is clear".to_owned());
                }
                if self.tx.len() + size > FIFO {
                    return Err("written while the FIFO is full".to_owned());
                }
                self.tx.extend(&value.to_le_bytes()[..size]);
                self.begin(now);
            }
            _ => return unknown(),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ready(mbr: u32) -> Result<Spi, Refusal> {
        let mut spi = Spi {
            kernel: Some(112_000_000),
            ..Spi::default()
        };
        spi.write(0x00, 4, 1 << 12, 0)?;
        spi.write(0x08, 4, 7 | mbr << 28, 0)?;
        spi.write(0x0C, 4, 1 << 22 | 1 << 25 | 1 << 26 | 1 << 31, 0)?;
        Ok(spi)
    }

    /// Three bytes at 28 MHz: 24 bits of 35.71 ns; the first byte first.
    #[test]
    fn a_transfer_takes_its_bits() -> Result<(), Refusal> {
        let mut spi = ready(1)?;
        spi.write(0x04, 4, 3, 0)?;
        spi.write(0x00, 4, 1 | 1 << 12, 0)?;
        for byte in [0x12, 0x34, 0x56] {
            spi.write(0x20, 1, byte, 0)?;
        }
        assert_eq!(spi.next(), None);
        spi.write(0x00, 4, 1 | 1 << 9 | 1 << 12, 1000)?;
        let mut sent = Vec::new();
        let mut ended = 0;
        while let Some(at) = spi.next() {
            assert_eq!(spi.read(0x14, 4)? & EOT, 0);
            let frame = spi.due(at).ok_or("due")?;
            sent.push(frame.data);
            spi.finish(frame.data ^ 0xFF);
            ended = at;
        }
        assert_eq!(sent, [0x12, 0x34, 0x56]);
        assert_eq!(ended - 1000, 24 * cycles(4, 112_000_000));
        assert_eq!(spi.read(0x14, 4)? & (EOT | TXTF | OVR), EOT | TXTF);
        let read: Result<Vec<_>, _> = (0..3).map(|_| spi.read(0x30, 1)).collect();
        assert_eq!(read?, [0xED, 0xCB, 0xA9]);
        spi.write(0x18, 4, EOT | TXTF, 0)?;
        assert_eq!(spi.read(0x14, 4)? & EOT, 0);
        assert!(spi.read(0x30, 1).is_err());
        Ok(())
    }

    /// A frame of 32 bits: the last byte written goes first (50.4.11).
    #[test]
    fn words_go_out_from_the_highest_bit() -> Result<(), Refusal> {
        let mut spi = ready(0)?;
        spi.write(0x08, 4, 31, 0)?;
        spi.write(0x04, 4, 1, 0)?;
        spi.write(0x00, 4, 1 | 1 << 12, 0)?;
        spi.write(0x20, 4, 0x1234_5678, 0)?;
        spi.write(0x00, 4, 1 | 1 << 9 | 1 << 12, 0)?;
        let frame = spi.due(Ticks::MAX).ok_or("due")?;
        assert_eq!((frame.bits, frame.data), (32, 0x1234_5678));
        spi.finish(0xCAFE_F00D);
        assert_eq!(spi.read(0x30, 4)?, 0xCAFE_F00D);
        Ok(())
    }

    /// Without end, in one direction: a word goes out when it is written, and TXC (50.11.6)
    /// tells its end.
    #[test]
    fn words_are_sent_as_they_come() -> Result<(), Refusal> {
        let mut spi = ready(1)?;
        spi.write(0x08, 4, 23 | 1 << 28, 0)?;
        spi.write(0x0C, 4, 1 << 17 | 1 << 22 | 1 << 25 | 1 << 26 | 1 << 31, 0)?;
        spi.write(0x00, 4, 1 | 1 << 12, 0)?;
        spi.write(0x00, 4, 1 | 1 << 9 | 1 << 12, 0)?;
        for word in [0x12_3456, 0xAB_CDEF] {
            assert_ne!(spi.read(0x14, 4)? & 1 << 12, 0);
            spi.write(0x20, 4, word, 1000)?;
            assert_eq!(spi.read(0x14, 4)? & 1 << 12, 0);
            let ends = spi.next().ok_or("begun")?;
            assert_eq!(ends - 1000, 24 * cycles(4, 112_000_000));
            assert_eq!(spi.due(ends).ok_or("due")?.data, word);
            spi.finish(0xFF_FFFF);
        }
        assert_eq!(spi.read(0x14, 4)? & (EOT | OVR | 1), 0);
        Ok(())
    }

    /// A receiver's clock runs by itself for TSIZE frames.
    #[test]
    fn a_receiver_needs_no_data_to_send() -> Result<(), Refusal> {
        let mut spi = ready(2)?;
        spi.write(0x08, 4, 31 | 2 << 28, 0)?;
        spi.write(0x0C, 4, 2 << 17 | 1 << 22 | 1 << 25 | 1 << 26 | 1 << 31, 0)?;
        spi.write(0x04, 4, 3, 0)?;
        spi.write(0x00, 4, 1 | 1 << 12, 0)?;
        assert_eq!(spi.next(), None);
        spi.write(0x00, 4, 1 | 1 << 9 | 1 << 12, 0)?;
        for word in 1..=3 {
            assert!(spi.next().is_some());
            spi.finish(word);
        }
        assert_eq!(spi.next(), None);
        assert_ne!(spi.read(0x14, 4)? & EOT, 0);
        for word in 1..=3 {
            assert_eq!(spi.read(0x30, 4)?, word);
        }
        Ok(())
    }

    #[test]
    fn a_kernel_without_a_clock_never_ends() -> Result<(), Refusal> {
        let mut spi = ready(1)?;
        spi.kernel = None;
        spi.write(0x04, 4, 1, 0)?;
        spi.write(0x00, 4, 1 | 1 << 12, 0)?;
        spi.write(0x20, 1, 0, 0)?;
        spi.write(0x00, 4, 1 | 1 << 9 | 1 << 12, 0)?;
        assert_eq!(spi.next(), None);
        assert!(spi.write(0x08, 4, 7, 0).is_err());
        Ok(())
    }
}
