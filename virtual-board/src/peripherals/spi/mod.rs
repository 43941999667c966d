//! Serial peripheral interface, SPI3, SPI4 or SPI5 (RM0433, chapter 50): a master, full-duplex or in
//! one direction, with its select line by hardware or software; or a slave that receives. A
//! frame of DSIZE + 1 bits is exchanged with the wire as its last bit ends.

#[cfg(test)]
mod tests;

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

/// What an instance can do (50.3, table 396).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Features {
    /// Size of each FIFO, bytes.
    fifo: usize,
    /// Most bits in a frame.
    bits: u32,
    /// Most frames in a transfer.
    frames: u32,
}

/// SPI1 to SPI3.
pub const FULL: Features = Features {
    fifo: 16,
    bits: 32,
    frames: 0xFFFF,
};

/// SPI4 to SPI6. Their data registers have sixteen bits.
pub const LIMITED: Features = Features {
    fifo: 8,
    bits: 16,
    frames: 1023,
};

/// COMM: only MOSI is used.
const TRANSMITTER: u32 = 1;

/// COMM: a master uses only MISO, and its clock runs by itself; a slave uses only MOSI.
const RECEIVER: u32 = 2;

const SPE: u32 = 1;
const CSTART: u32 = 1 << 9;
const SSI: u32 = 1 << 12;
const TXDMAEN: u32 = 1 << 15;
const MASTER: u32 = 1 << 22;
const SSM: u32 = 1 << 26;
const SSOE: u32 = 1 << 29;
const SSOM: u32 = 1 << 30;
const AFCNTR: u32 = 1 << 31;
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

/// What a master does on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wire {
    /// Nothing.
    Still,
    /// A frame, until then.
    Frame(Ticks),
    /// A pause between frames (MIDI), until then.
    Pause(Ticks),
}

/// The peripheral.
pub struct Spi {
    /// Its kernel clock, Hz, if it runs.
    pub kernel: Option<u64>,
    features: Features,
    cr1: u32,
    tsize: u32,
    cfg1: u32,
    cfg2: u32,
    flags: u32,
    tx: VecDeque<u8>,
    rx: VecDeque<u8>,
    /// Frames of the transfer that are yet to end.
    left: u32,
    /// Frames of the transfer that are yet to be written to TXDR.
    wanted: u32,
    wire: Wire,
    /// A master holds its select line low.
    selects: bool,
    /// Bits of a frame that a slave has received, and how many.
    shifted: (u32, u32),
}

impl Spi {
    /// An instance after its reset.
    pub fn new(features: Features) -> Self {
        Self {
            kernel: None,
            features,
            cr1: 0,
            tsize: 0,
            cfg1: 0,
            cfg2: 0,
            flags: 0,
            tx: VecDeque::new(),
            rx: VecDeque::new(),
            left: 0,
            wanted: 0,
            wire: Wire::Still,
            selects: false,
            shifted: (0, 0),
        }
    }

    /// Resets it.
    pub fn reset(&mut self) {
        *self = Self {
            kernel: self.kernel,
            ..Self::new(self.features)
        };
    }

    fn is_enabled(&self) -> bool {
        self.cr1 & SPE != 0
    }

    fn is_master(&self) -> bool {
        self.cfg2 & MASTER != 0
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

    /// Clock cycles that CFG2 has in four bits: MSSI at 0, MIDI at 4.
    fn idle(&self, at: u32) -> Ticks {
        u64::from(self.cfg2 >> at & 0xF) * self.bit()
    }

    fn mode(&self) -> (bool, bool) {
        (self.cfg2 >> 25 & 1 != 0, self.cfg2 >> 24 & 1 != 0)
    }

    /// The select line, if it drives one: whether it is low.
    pub fn select(&self) -> Option<bool> {
        let drives = self.is_master() && self.cfg2 & SSOE != 0;
        let holds = self.is_enabled() || self.cfg2 & AFCNTR != 0;
        (drives && holds).then_some(self.selects)
    }

    /// Whether it wants the DMA to write TXDR.
    pub fn requests(&self) -> bool {
        self.cfg1 & TXDMAEN != 0 && self.has_room()
    }

    /// When something happens next on the wire.
    pub fn next(&self) -> Option<Ticks> {
        match self.wire {
            Wire::Still => None,
            Wire::Frame(ends) | Wire::Pause(ends) => Some(ends),
        }
    }

    /// Begins a frame at `now`, if there is one to send.
    fn begin(&mut self, now: Ticks) {
        let running = self.cr1 & CSTART != 0 && self.is_enabled();
        let running = running && (self.left > 0 || self.is_endless());
        let ready = !self.sends() || self.tx.len() >= self.bytes();
        if running && self.wire == Wire::Still && ready && self.kernel.is_some() {
            let lead = if self.selects || self.cfg2 & SSOE == 0 {
                0
            } else {
                self.idle(0)
            };
            self.selects = true;
            self.wire = Wire::Frame(now + lead + u64::from(self.bits()) * self.bit());
        }
    }

    /// The frame that ends at or before `now`, if there is one, to be answered with
    /// [`Spi::finish`].
    pub fn due(&mut self, now: Ticks) -> Option<Frame> {
        match self.wire {
            Wire::Pause(ends) if ends <= now => {
                self.wire = Wire::Still;
                self.begin(ends);
                None
            }
            Wire::Frame(ends) if ends <= now => {
                let bytes = self.tx.iter().take(self.bytes());
                let data = bytes
                    .rev()
                    .fold(0, |word, byte| word << 8 | u32::from(*byte));
                let (cpol, cpha) = self.mode();
                Some(Frame {
                    bits: self.bits(),
                    data,
                    cpol,
                    cpha,
                    bit: self.bit(),
                })
            }
            _ => None,
        }
    }

    /// Whether the frame on the wire is the last of several.
    pub fn ends_several(&self) -> bool {
        self.tsize > 1 && self.left == 1
    }

    /// Ends the frame that was due with what MISO brought.
    pub fn finish(&mut self, received: u32) {
        let Wire::Frame(ended) = self.wire else {
            return;
        };
        self.wire = Wire::Still;
        if self.sends() {
            self.tx.drain(..self.bytes());
        }
        self.count(received);
        if self.cr1 & CSTART == 0 {
            self.selects = false;
            return;
        }
        let pause = self.idle(4);
        // 50.4.7: SS is high between frames only if MIDI is more than 1.
        if self.cfg2 & SSOM != 0 && self.cfg2 >> 4 & 0xF > 1 {
            self.selects = false;
        }
        if pause > 0 {
            self.wire = Wire::Pause(ended + pause);
        } else {
            self.begin(ended);
        }
    }

    /// A frame of the transfer has ended.
    fn count(&mut self, received: u32) {
        let bytes = self.bytes();
        if self.receives() {
            if self.rx.len() + bytes > self.features.fifo {
                self.flags |= OVR;
            } else {
                self.rx.extend(&received.to_le_bytes()[..bytes]);
            }
        }
        if self.left > 0 {
            self.left -= 1;
            if self.left == 0 {
                self.flags |= EOT | TXTF;
                self.cr1 &= !CSTART;
            }
        }
    }

    /// A slave's clock had a cycle, in the master's mode, with this level on MOSI. Whether it took
    /// it: it must be selected, by SSI here.
    ///
    /// # Errors
    /// If it has another mode.
    pub fn clock(&mut self, mode: (bool, bool), mosi: bool) -> Result<(), Refusal> {
        let listens = self.is_enabled() && !self.is_master() && self.cr1 & SSI == 0;
        if !listens || self.kernel.is_none() {
            return Ok(());
        }
        if self.mode() != mode {
            return Err(format!(
                "a slave with {:?}, a master with {mode:?}",
                self.mode()
            ));
        }
        let (word, bits) = self.shifted;
        self.shifted = (word << 1 | u32::from(mosi), bits + 1);
        if self.shifted.1 == self.bits() {
            let word = std::mem::take(&mut self.shifted).0;
            self.count(word);
        }
        Ok(())
    }

    /// TXP (50.11.6): a frame can be written. Not more than TSIZE.
    fn has_room(&self) -> bool {
        let room = self.tx.len() + self.bytes() <= self.features.fifo;
        self.is_enabled() && self.sends() && room && (self.wanted > 0 || self.is_endless())
    }

    /// The status register (50.11.6).
    fn sr(&self) -> u32 {
        let bytes = self.bytes();
        let rxp = self.rx.len() >= bytes;
        let txp = self.has_room();
        let sent = self.tx.is_empty() || self.left == 0 && !self.is_endless();
        let txc = self.wire == Wire::Still && sent;
        let word = u32::from(self.rx.len() >= 4) << 15;
        let level = (self.rx.len() % 4 / bytes) as u32;
        let counted = if self.features == FULL { self.left } else { 0 };
        self.flags
            | u32::from(rxp)
            | u32::from(txp) << 1
            | u32::from(rxp && txp) << 2
            | u32::from(txc) << 12
            | level << 13
            | word
            | counted << 16
    }

    /// The data registers of some instances have sixteen bits.
    fn check_data(&self, size: usize) -> Result<(), Refusal> {
        if 8 * size as u32 > self.features.bits {
            return Err(format!("an access of {size} bytes"));
        }
        Ok(())
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
                self.check_data(size)?;
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
            0x00 => self.write_cr1(only(value, SPE | CSTART | SSI)?, now)?,
            0x04 if self.is_enabled() => return locked(),
            0x04 => self.tsize = only(value, self.features.frames)?,
            0x08 if self.is_enabled() => return locked(),
            // DSIZE, TXDMAEN, MBR; FTHLV = 0: a packet is a frame.
            0x08 => {
                let value = only(value, 0x1F | TXDMAEN | 7 << 28)?;
                if (value & 0x1F) + 1 > self.features.bits {
                    return Err("DSIZE is more than the instance has".to_owned());
                }
                self.cfg1 = value;
            }
            0x0C if self.is_enabled() => return locked(),
            // MSSI, MIDI, COMM, MASTER, CPHA, CPOL, SSM, SSOE, SSOM, AFCNTR.
            0x0C => {
                let bits = 0xFF | 3 << 17 | MASTER | 3 << 24 | SSM | SSOE | SSOM | AFCNTR;
                let value = only(value, bits)?;
                if value >> 17 & 3 == 3 {
                    return Err("half-duplex is not modelled".to_owned());
                }
                self.cfg2 = value;
            }
            0x18 => self.flags &= !only(value, 0xFF8)?,
            0x20 => {
                self.check_data(size)?;
                if !self.has_room() {
                    return Err("written while TXP is clear".to_owned());
                }
                self.tx.extend(&value.to_le_bytes()[..size]);
                if !self.is_endless() && self.tx.len().is_multiple_of(self.bytes()) {
                    self.wanted -= 1;
                    if self.wanted == 0 {
                        self.flags |= TXTF;
                    }
                }
                self.begin(now);
            }
            _ => return unknown(),
        }
        Ok(())
    }

    fn write_cr1(&mut self, value: u32, now: Ticks) -> Result<(), Refusal> {
        let was = self.is_enabled();
        // CSTART can be set only while SPE is (50.11.1), and ends by itself.
        let starts = if was { value & CSTART } else { 0 };
        self.cr1 = value & !CSTART | starts | self.cr1 & CSTART;
        if value & SPE == 0 {
            // Both FIFOs are flushed, what is on the wire is cut off, SS is high.
            self.cr1 &= !CSTART;
            self.tx.clear();
            self.rx.clear();
            self.wire = Wire::Still;
            self.selects = false;
            self.shifted = (0, 0);
            (self.left, self.wanted) = (0, 0);
            return Ok(());
        }
        if !was {
            self.check_select()?;
            (self.left, self.wanted) = (self.tsize, self.tsize);
        }
        if starts != 0 && self.is_endless() && self.comm() != TRANSMITTER {
            return Err("endless transfers that receive are not modelled".to_owned());
        }
        self.begin(now);
        Ok(())
    }

    /// The ways of selecting that are modelled.
    fn check_select(&self) -> Result<(), Refusal> {
        let software = self.cfg2 & SSM != 0;
        let drives = self.cfg2 & SSOE != 0;
        let known = match (self.is_master(), software) {
            // Without SSI, or with SS as an input, it could be taken for a slave (MODF).
            (true, true) => self.cr1 & SSI != 0 && !drives,
            (true, false) => drives,
            (false, true) => self.comm() == RECEIVER && !drives,
            (false, false) => false,
        };
        if known {
            Ok(())
        } else {
            Err("this way of selecting is not modelled".to_owned())
        }
    }
}
