//! USART3 (RM0433, chapter 48), eight data bits, one stop bit, with or without its FIFO,
//! and the line on both sides of it.

use std::collections::VecDeque;

use super::{Refusal, Register, only, unknown};
use crate::time::{Ticks, cycles};

/// Registers (48.7).
pub const REGISTERS: [Register; 12] = [
    (0x00, "USART3_CR1"),
    (0x04, "USART3_CR2"),
    (0x08, "USART3_CR3"),
    (0x0C, "USART3_BRR"),
    (0x10, "USART3_GTPR"),
    (0x14, "USART3_RTOR"),
    (0x18, "USART3_RQR"),
    (0x1C, "USART3_ISR"),
    (0x20, "USART3_ICR"),
    (0x24, "USART3_RDR"),
    (0x28, "USART3_TDR"),
    (0x2C, "USART3_PRESC"),
];

/// Its interrupt.
pub const IRQ: u16 = 39;

/// Size of each FIFO.
const FIFO: usize = 16;

/// Bits of a character on the line.
const CHARACTER: u64 = 10;

const ORE: u32 = 1 << 3;
const IDLE: u32 = 1 << 4;
const RXNE: u32 = 1 << 5;
const TC: u32 = 1 << 6;
const TXE: u32 = 1 << 7;

/// The peripheral and its line.
pub struct Usart {
    /// Its kernel clock, Hz.
    pub kernel: u64,
    /// Baud rate of the other end.
    pub line_baud: u64,
    /// Bytes that the other end has yet to send, back to back.
    pub incoming: VecDeque<u8>,
    /// Bytes that have been sent to the other end.
    pub outgoing: VecDeque<u8>,
    /// Bytes lost because nobody read them in time.
    pub overruns: u64,
    cr1: u32,
    cr2: u32,
    cr3: u32,
    brr: u32,
    flags: u32,
    rx: VecDeque<u8>,
    tx: VecDeque<u8>,
    /// The character on the line to here, and when it ends.
    arriving: Option<(Ticks, u8)>,
    /// When the line has been quiet for a character.
    quiet: Option<Ticks>,
    /// The character on the line from here, and when it ends.
    leaving: Option<(Ticks, u8)>,
}

impl Default for Usart {
    fn default() -> Self {
        Self {
            kernel: 1,
            line_baud: 921_600,
            incoming: VecDeque::new(),
            outgoing: VecDeque::new(),
            overruns: 0,
            cr1: 0,
            cr2: 0,
            cr3: 0,
            brr: 0,
            flags: TC,
            rx: VecDeque::new(),
            tx: VecDeque::new(),
            arriving: None,
            quiet: None,
            leaving: None,
        }
    }
}

impl Usart {
    /// A reset: the registers, not the line.
    pub fn reset(&mut self) {
        let line = std::mem::take(self);
        *self = Self {
            kernel: line.kernel,
            line_baud: line.line_baud,
            incoming: line.incoming,
            outgoing: line.outgoing,
            overruns: line.overruns,
            arriving: line.arriving,
            ..Self::default()
        };
    }

    fn is_on(&self, bit: u32) -> bool {
        self.cr1 & 1 != 0 && self.cr1 >> bit & 1 != 0
    }

    fn room(&self) -> usize {
        if self.cr1 >> 29 & 1 != 0 { FIFO } else { 1 }
    }

    /// Whether nothing is on the line, in either direction, or about to be.
    pub fn is_quiet(&self) -> bool {
        self.incoming.is_empty()
            && self.arriving.is_none()
            && self.leaving.is_none()
            && self.tx.is_empty()
            && self.quiet.is_none()
    }

    fn bit(&self) -> Ticks {
        cycles(u64::from(self.brr), self.kernel)
    }

    /// When something happens next on the line.
    pub fn next(&self) -> Option<Ticks> {
        let arriving = self.arriving.map(|(at, _)| at);
        let leaving = self.leaving.map(|(at, _)| at);
        [arriving, leaving, self.quiet].into_iter().flatten().min()
    }

    /// The other end sends the next byte, if it has one and the line is free.
    pub fn listen(&mut self, now: Ticks) {
        if self.arriving.is_none()
            && let Some(byte) = self.incoming.pop_front()
        {
            let end = now + cycles(CHARACTER, self.line_baud);
            self.arriving = Some((end, byte));
            self.quiet = None;
        }
    }

    /// Lets what is due happen.
    pub fn advance(&mut self, now: Ticks) {
        while let Some((end, byte)) = self.arriving.filter(|(end, _)| *end <= now) {
            self.arriving = None;
            if self.is_on(2) {
                self.quiet = Some(end + CHARACTER * self.bit());
                if self.rx.len() < self.room() {
                    self.rx.push_back(byte);
                } else {
                    self.flags |= ORE;
                    self.overruns += 1;
                }
            }
            self.listen(end);
        }
        if self.quiet.is_some_and(|at| at <= now) {
            self.quiet = None;
            self.flags |= IDLE;
        }
        while let Some((end, byte)) = self.leaving.filter(|(end, _)| *end <= now) {
            self.outgoing.push_back(byte);
            self.leaving = None;
            self.send(end);
            if self.leaving.is_none() {
                self.flags |= TC;
            }
        }
    }

    fn send(&mut self, now: Ticks) {
        if self.leaving.is_none()
            && self.is_on(3)
            && let Some(byte) = self.tx.pop_front()
        {
            self.leaving = Some((now + CHARACTER * self.bit(), byte));
        }
    }

    fn isr(&self) -> u32 {
        let fifo = self.cr1 >> 29 & 1 != 0;
        let empty = self.tx.is_empty();
        self.flags
            | u32::from(!self.rx.is_empty()) << 5
            | u32::from(self.tx.len() < self.room()) << 7
            | u32::from(self.arriving.is_some()) << 16
            | u32::from(self.is_on(3)) << 21
            | u32::from(self.is_on(2)) << 22
            | u32::from(fifo && empty) << 23
            | u32::from(fifo && self.rx.len() == FIFO) << 24
    }

    /// Whether its interrupt is requested: IDLEIE, RXNEIE (with ORE), TCIE, TXEIE, EIE.
    pub fn requests(&self) -> bool {
        let isr = self.isr();
        let by_flag = isr & self.cr1 & (IDLE | RXNE | TC | TXE) != 0;
        let overrun = isr & ORE != 0 && (self.cr1 & RXNE != 0 || self.cr3 & 1 != 0);
        by_flag || overrun
    }

    /// Reads a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&mut self, offset: u32) -> Result<u32, Refusal> {
        Ok(match offset {
            0x00 => self.cr1,
            0x04 => self.cr2,
            0x08 => self.cr3,
            0x0C => self.brr,
            0x1C => self.isr(),
            0x24 => u32::from(self.rx.pop_front().unwrap_or(0)),
            0x2C => 0,
            _ => return unknown(),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled, or the baud rate is not the line's.
    pub fn write(&mut self, offset: u32, value: u32, now: Ticks) -> Result<(), Refusal> {
        match offset {
            0x00 => {
                // UE, RE, TE, IDLEIE, RXNEIE, TCIE, TXEIE, FIFOEN; eight bits, no parity.
                let known = 0xFD | 1 << 29;
                let was = self.cr1;
                self.cr1 = only(value, known)?;
                if (was ^ value) >> 29 & 1 != 0 && was & 1 != 0 {
                    return Err("FIFOEN changed while UE is set".to_owned());
                }
                if value & 1 != 0 && was & 1 == 0 {
                    self.check_baud()?;
                }
                self.send(now);
            }
            // One stop bit, nothing inverted.
            0x04 => self.cr2 = only(value, 0)?,
            // EIE, and ONEBIT, which only matters on a noisy line.
            0x08 => self.cr3 = only(value, 1 | 1 << 11)?,
            0x0C => self.brr = only(value, 0xFFFF)?,
            0x20 => self.flags &= !(value & (ORE | IDLE | TC)),
            0x28 => {
                if self.tx.len() >= self.room() {
                    return Err("written while TXE is clear".to_owned());
                }
                self.tx.push_back(value as u8);
                self.flags &= !TC;
                self.send(now);
            }
            0x2C => only(value, 0).map(|_| ())?,
            _ => return unknown(),
        }
        Ok(())
    }

    /// Two ends of a line may differ by some 2.5 % (48.5.7, M = 00).
    fn check_baud(&self) -> Result<(), Refusal> {
        let baud = self.kernel as f64 / f64::from(self.brr.max(1));
        let line = self.line_baud as f64;
        if (baud / line - 1.0).abs() < 0.025 {
            Ok(())
        } else {
            Err(format!("{baud:.0} baud where the line has {line:.0}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::MICROSECOND;

    fn ready() -> Result<Usart, Refusal> {
        let mut usart = Usart {
            kernel: 120_000_000,
            ..Usart::default()
        };
        usart.write(0x0C, 130, 0)?;
        usart.write(0x00, 1 << 29, 0)?;
        usart.write(0x00, 0x3D | 1 << 29, 0)?;
        Ok(usart)
    }

    #[test]
    fn a_byte_takes_ten_bits_each_way() -> Result<(), Refusal> {
        let mut usart = ready()?;
        usart.incoming.extend([0xA5, 0x5A]);
        usart.listen(0);
        usart.advance(10 * MICROSECOND);
        assert!(!usart.requests());
        // 10.85 µs a byte.
        usart.advance(11 * MICROSECOND);
        assert!(usart.requests());
        assert_eq!(usart.read(0x24)?, 0xA5);
        usart.advance(22 * MICROSECOND);
        assert_eq!(usart.read(0x24)?, 0x5A);
        // IDLE one character later.
        assert_eq!(usart.read(0x1C)? & IDLE, 0);
        usart.advance(33 * MICROSECOND);
        assert_eq!(usart.read(0x1C)? & IDLE, IDLE);
        usart.write(0x20, IDLE, 0)?;
        assert!(!usart.requests());
        usart.write(0x28, 0x42, 0)?;
        assert_eq!(usart.read(0x1C)? & TC, 0);
        usart.advance(cycles(10 * 130, 120_000_000) - 1);
        assert!(usart.outgoing.is_empty());
        usart.advance(cycles(10 * 130, 120_000_000));
        assert_eq!(usart.outgoing, [0x42]);
        assert_eq!(usart.read(0x1C)? & TC, TC);
        assert!(usart.is_quiet());
        Ok(())
    }

    #[test]
    fn the_seventeenth_byte_overruns() -> Result<(), Refusal> {
        let mut usart = ready()?;
        usart.incoming.extend(0..17);
        usart.listen(0);
        usart.advance(1000 * MICROSECOND);
        assert_eq!(usart.read(0x1C)? & ORE, ORE);
        assert_eq!(usart.overruns, 1);
        let read: Result<Vec<_>, _> = (0..16).map(|_| usart.read(0x24)).collect();
        assert_eq!(read?, (0..16).collect::<Vec<u32>>());
        Ok(())
    }

    #[test]
    fn another_baud_rate_is_refused() -> Result<(), Refusal> {
        let mut usart = ready()?;
        usart.write(0x00, 1 << 29, 0)?;
        usart.write(0x0C, 1042, 0)?;
        assert!(usart.write(0x00, 1 | 1 << 29, 0).is_err());
        Ok(())
    }
}
