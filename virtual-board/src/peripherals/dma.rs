//! Direct memory access controller DMA1 (RM0433, chapter 16) with its request multiplexer DMAMUX1
//! (chapter 18): streams from memory to a peripheral's register in direct mode, words alone.
//!
//! A stream reads a word from memory when it is enabled and after each transfer, before the
//! request for it comes (16.3.12).

use super::{Refusal, Register, only, unknown};
use crate::time::Ticks;

/// Registers of DMA1 (16.5) of which there is one.
pub const REGISTERS: [Register; 4] = [
    (0x00, "DMA1_LISR"),
    (0x04, "DMA1_HISR"),
    (0x08, "DMA1_LIFCR"),
    (0x0C, "DMA1_HIFCR"),
];

/// Registers of a stream, from its first.
const STREAM: [Register; 6] = [
    (0x00, "CR"),
    (0x04, "NDTR"),
    (0x08, "PAR"),
    (0x0C, "M0AR"),
    (0x10, "M1AR"),
    (0x14, "FCR"),
];

/// Number of streams, and of DMAMUX1's channels that feed them.
pub const STREAMS: usize = 8;

/// DMAMUX1's number of TIM1's first channel (table 121).
pub const TIM1_CH1: u32 = 11;

/// DMAMUX1's number of SPI3's transmitter.
pub const SPI3_TX: u32 = 62;

const EN: u32 = 1;
const CIRC: u32 = 1 << 8;
const MINC: u32 = 1 << 10;

/// DIR, PSIZE and MSIZE of words from memory to a peripheral.
const OUTWARDS: u32 = 1 << 6 | 2 << 11 | 2 << 13;

/// Flags of a stream: half and all of a transfer.
const HTIF: u32 = 1 << 4;
const TCIF: u32 = 1 << 5;

/// The name of one of DMA1's registers.
pub fn register(offset: u32) -> String {
    match offset.checked_sub(0x10) {
        None => super::name(&REGISTERS, offset),
        Some(after) => format!(
            "DMA1_S{}{}",
            after / 0x18,
            super::name(&STREAM, after % 0x18)
        ),
    }
}

/// The name of one of DMAMUX1's registers (18.6).
pub fn mux_register(offset: u32) -> String {
    format!("DMAMUX1_C{}CR", offset / 4)
}

/// A stream.
#[derive(Clone, Copy, Debug, Default)]
struct Stream {
    cr: u32,
    /// What was written to NDTR, and what is left.
    count: (u32, u32),
    par: u32,
    m0ar: u32,
    flags: u32,
    /// DMAREQ_ID of its channel of DMAMUX1.
    request: u32,
    /// The word that was read from memory.
    word: Option<u32>,
    /// When the transfer that was requested takes place.
    moves: Option<Ticks>,
}

/// A transfer from a stream: the peripheral's address, and the word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transfer {
    /// Where it goes.
    pub address: u32,
    /// What goes there.
    pub word: u32,
}

/// The controller.
#[derive(Default)]
pub struct Dma {
    streams: [Stream; STREAMS],
}

impl Stream {
    fn is_enabled(&self) -> bool {
        self.cr & EN != 0
    }

    /// Address of the word that it reads next, if it wants one.
    fn wants(&self) -> Option<u32> {
        let (all, left) = self.count;
        let next = if self.cr & MINC != 0 { all - left } else { 0 };
        let wants = self.is_enabled() && self.word.is_none() && left > 0;
        wants.then_some(self.m0ar + 4 * next)
    }

    fn moved(&mut self) {
        self.word = None;
        let (all, left) = self.count;
        let left = left - 1;
        if left <= all / 2 {
            self.flags |= HTIF;
        }
        self.count.1 = left;
        if left == 0 {
            self.flags |= TCIF;
            if self.cr & CIRC != 0 {
                self.count.1 = all;
            } else {
                self.cr &= !EN;
            }
        }
    }
}

impl Dma {
    /// When a transfer takes place next.
    pub fn next(&self) -> Option<Ticks> {
        self.streams.iter().filter_map(|stream| stream.moves).min()
    }

    /// Numbers of the enabled streams whose request DMAMUX1 takes from `source`, and that do not
    /// serve one already.
    pub fn waiting(&self, source: u32) -> Option<usize> {
        self.streams.iter().position(|stream| {
            stream.is_enabled() && stream.request == source && stream.moves.is_none()
        })
    }

    /// A stream's request comes, and its transfer will take place at a moment.
    pub fn request(&mut self, stream: usize, moves: Ticks) {
        self.streams[stream].moves = Some(moves);
    }

    /// The transfer that is due, if there is one.
    pub fn due(&mut self, now: Ticks) -> Option<Transfer> {
        let due = |stream: &&mut Stream| stream.moves.is_some_and(|at| at <= now);
        let stream = self.streams.iter_mut().find(due)?;
        stream.moves = None;
        let word = stream.word?;
        stream.moved();
        Some(Transfer {
            address: stream.par,
            word,
        })
    }

    /// Reads from memory what the streams want.
    ///
    /// # Errors
    /// If the DMA does not reach that memory.
    pub fn load(&mut self, read: impl Fn(u32) -> Option<u32>) -> Result<(), Refusal> {
        for stream in &mut self.streams {
            if let Some(address) = stream.wants() {
                let word = read(address);
                stream.word =
                    Some(word.ok_or_else(|| format!("DMA1 does not reach {address:#010x}"))?);
            }
        }
        Ok(())
    }

    /// Where flags of a stream are: register, 0 for LISR, and lowest bit.
    fn flags(stream: usize) -> (u32, u32) {
        ((stream / 4) as u32, [0, 6, 16, 22][stream % 4])
    }

    /// Reads a register of DMA1.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32) -> Result<u32, Refusal> {
        if offset < 0x08 {
            let flags = (0..STREAMS).filter(|i| Self::flags(*i).0 == offset / 4);
            return Ok(flags.fold(0, |word, i| {
                word | self.streams[i].flags << Self::flags(i).1
            }));
        }
        let Some((stream, register)) = place(offset) else {
            return unknown();
        };
        let stream = &self.streams[stream];
        Ok(match register {
            0x00 => stream.cr,
            0x04 => stream.count.1,
            0x08 => stream.par,
            0x0C => stream.m0ar,
            _ => return unknown(),
        })
    }

    /// Writes a register of DMA1.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled, or the stream is enabled.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Refusal> {
        if (0x08..0x10).contains(&offset) {
            for (i, stream) in self.streams.iter_mut().enumerate() {
                let (register, bit) = Self::flags(i);
                if register == (offset - 0x08) / 4 {
                    stream.flags &= !(value >> bit);
                }
            }
            return Ok(());
        }
        let Some((stream, register)) = place(offset) else {
            return unknown();
        };
        let stream = &mut self.streams[stream];
        if stream.is_enabled() && !(register == 0 && value & EN == 0) {
            return Err("written while the stream is enabled".to_owned());
        }
        match register {
            0x00 => {
                // PL says nothing where streams do not compete.
                let value = only(value, EN | CIRC | MINC | OUTWARDS | 3 << 16)?;
                if value & EN != 0 {
                    if value & OUTWARDS != OUTWARDS {
                        return Err("only words from memory to a peripheral".to_owned());
                    }
                    if stream.flags != 0 {
                        return Err("enabled with flags of the last transfer".to_owned());
                    }
                    if stream.count.1 == 0 {
                        return Err("enabled with nothing to transfer".to_owned());
                    }
                }
                stream.cr = value;
                (stream.word, stream.moves) = (None, None);
            }
            0x04 => {
                let count = only(value, 0xFFFF)?;
                stream.count = (count, count);
            }
            0x08 => stream.par = value,
            0x0C => stream.m0ar = value,
            _ => return unknown(),
        }
        Ok(())
    }

    /// Reads a register of DMAMUX1.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read_mux(&self, offset: u32) -> Result<u32, Refusal> {
        match self.streams.get(offset as usize / 4) {
            Some(stream) => Ok(stream.request),
            None => unknown(),
        }
    }

    /// Writes a register of DMAMUX1.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled.
    pub fn write_mux(&mut self, offset: u32, value: u32) -> Result<(), Refusal> {
        match self.streams.get_mut(offset as usize / 4) {
            Some(stream) => stream.request = only(value, 0x7F)?,
            None => return unknown(),
        }
        Ok(())
    }
}

/// The stream, and the register in it.
fn place(offset: u32) -> Option<(usize, u32)> {
    let after = offset.checked_sub(0x10)?;
    let stream = (after / 0x18) as usize;
    (stream < STREAMS).then_some((stream, after % 0x18))
}

#[cfg(test)]
mod tests {
    use super::*;

    const RAM: u32 = 0x2400_0000;
    const TXDR: u32 = 0x4000_3C20;

    fn memory(address: u32) -> Option<u32> {
        address.checked_sub(RAM).map(|at| 100 + at / 4)
    }

    /// A stream of `count` words for `source`.
    fn ready(count: u32, cr: u32) -> Result<Dma, Refusal> {
        let mut dma = Dma::default();
        dma.write_mux(4, SPI3_TX)?;
        for (register, value) in [(0x04, count), (0x08, TXDR), (0x0C, RAM), (0x00, cr)] {
            dma.write(0x28 + register, value)?;
        }
        dma.load(memory)?;
        Ok(dma)
    }

    /// 16.3.9: a word a request, in order; then the stream is disabled, and its flags are set.
    #[test]
    fn words_go_out_in_order() -> Result<(), Refusal> {
        let mut dma = ready(3, OUTWARDS | MINC | EN)?;
        assert_eq!(dma.waiting(TIM1_CH1), None);
        for i in 0..3 {
            let stream = dma.waiting(SPI3_TX).ok_or("enabled")?;
            dma.request(stream, 10 * i);
            assert_eq!(dma.waiting(SPI3_TX), None);
            let transfer = dma.due(10 * i).ok_or("due")?;
            assert_eq!((transfer.address, transfer.word), (TXDR, 100 + i as u32));
            dma.load(memory)?;
        }
        assert_eq!(dma.waiting(SPI3_TX), None);
        assert_eq!(dma.read(0x28)? & EN, 0);
        assert_eq!(dma.read(0x2C)?, 0);
        assert_eq!(dma.read(0x00)?, (HTIF | TCIF) << 6);
        // Again only with clear flags, and with a count.
        assert!(dma.write(0x28, OUTWARDS | EN).is_err());
        dma.write(0x08, 0x3D << 6)?;
        assert!(dma.write(0x28, OUTWARDS | EN).is_err());
        dma.write(0x2C, 3)?;
        dma.write(0x28, OUTWARDS | EN)?;
        Ok(())
    }

    /// 16.3.12: the word is read when the stream is enabled, not when it is asked for.
    #[test]
    fn a_word_is_read_ahead() -> Result<(), Refusal> {
        let mut dma = ready(1, OUTWARDS | CIRC | EN)?;
        for expected in [100, 7] {
            let stream = dma.waiting(SPI3_TX).ok_or("enabled")?;
            dma.request(stream, 0);
            assert_eq!(dma.due(0).ok_or("due")?.word, expected);
            dma.load(|_| Some(7))?;
        }
        assert_eq!(dma.read(0x28)? & EN, EN);
        assert!(dma.write(0x2C, 2).is_err());
        dma.write(0x28, 0)?;
        dma.write(0x2C, 2)?;
        Ok(())
    }

    #[test]
    fn tightly_coupled_memory_is_out_of_reach() -> Result<(), Refusal> {
        let mut dma = ready(1, OUTWARDS)?;
        dma.write(0x34, 0x2000_0000)?;
        dma.write(0x28, OUTWARDS | EN)?;
        assert!(dma.load(memory).is_err());
        Ok(())
    }
}
