//! Embedded flash of two banks of 1 MiB, in sectors of 128 KiB, with error correction over
//! words of 32 bytes (RM0433, chapter 4). Bank 1 holds the image and is never written; its
//! error correction is not modelled.

use std::collections::BTreeMap;

use super::{Refusal, Register, only, unknown};
use crate::time::{MICROSECOND, SECOND, Ticks};

/// Registers (4.9); those of bank 2 are 0x100 above.
pub const REGISTERS: [Register; 18] = [
    (0x000, "FLASH_ACR"),
    (0x004, "FLASH_KEYR1"),
    (0x008, "FLASH_OPTKEYR"),
    (0x00C, "FLASH_CR1"),
    (0x010, "FLASH_SR1"),
    (0x014, "FLASH_CCR1"),
    (0x018, "FLASH_OPTCR"),
    (0x01C, "FLASH_OPTSR_CUR"),
    (0x020, "FLASH_OPTSR_PRG"),
    (0x024, "FLASH_OPTCCR"),
    (0x028, "FLASH_PRAR_CUR1"),
    (0x060, "FLASH_ECC_FA1R"),
    (0x104, "FLASH_KEYR2"),
    (0x10C, "FLASH_CR2"),
    (0x110, "FLASH_SR2"),
    (0x114, "FLASH_CCR2"),
    (0x128, "FLASH_PRAR_CUR2"),
    (0x160, "FLASH_ECC_FA2R"),
];

/// Where bank 2 begins.
pub const BANK_2: u32 = 0x0810_0000;

/// Size of a bank, bytes.
pub const BANK: usize = 1 << 20;

/// Size of a sector, bytes.
pub const SECTOR: usize = 128 * 1024;

/// Size of a word of error correction, bytes.
pub const WORD: usize = 32;

/// Until a word is written: 32 bits in parallel, typical (data sheet: 130 µs).
pub const PROGRAM: Ticks = 130 * MICROSECOND;

/// Until a sector is erased: 32 bits in parallel, typical (data sheet: 1.1 s; at most 4 s
/// at eight bits).
pub const ERASE: Ticks = 11 * SECOND / 10;

const BSY: u32 = 1;
const WBNE: u32 = 1 << 1;
const QW: u32 = 1 << 2;
const EOP: u32 = 1 << 16;
const PGSERR: u32 = 1 << 18;
/// SR: an error of one bit was corrected.
pub const SNECCERR: u32 = 1 << 25;
/// SR: an error of two bits was found.
pub const DBECCERR: u32 = 1 << 26;

/// Turned bits in a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turned {
    /// One: corrected as it is read, with SNECCERR.
    One,
    /// Two, or a word whose writing was cut off: a bus fault, with DBECCERR.
    Two,
}

/// What is under way in a bank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Work {
    Program(usize, [u8; WORD]),
    Erase(usize),
}

/// Registers of a bank.
#[derive(Clone)]
struct Bank {
    cr: u32,
    flags: u32,
    /// Keys that were right so far.
    keys: u8,
    /// A wrong key locks until the next reset (4.9.2).
    broken: bool,
    fail: u32,
}

impl Default for Bank {
    fn default() -> Self {
        Self {
            cr: 0x31,
            flags: 0,
            keys: 0,
            broken: false,
            fail: 0,
        }
    }
}

/// What a read of bank 2 gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Data {
    /// The value, the first byte lowest.
    pub value: u64,
    /// Bus error: the word cannot be corrected.
    pub fault: bool,
    /// The bus waits until then, because the bank is busy.
    pub until: Ticks,
}

/// The peripheral and the memory of bank 2.
pub struct Flash {
    /// The memory of bank 2.
    pub memory: Vec<u8>,
    /// Words of bank 2 with turned bits.
    pub turned: BTreeMap<usize, Turned>,
    /// Words written and sectors erased since power-up.
    pub operations: u64,
    acr: u32,
    banks: [Bank; 2],
    /// The write buffer: the word's index, its bytes, and which have come.
    buffer: Option<(usize, [u8; WORD], u32)>,
    work: Option<(Ticks, Work)>,
}

impl Default for Flash {
    fn default() -> Self {
        Self {
            memory: vec![0xFF; BANK],
            turned: BTreeMap::new(),
            operations: 0,
            acr: 0x37,
            banks: Default::default(),
            buffer: None,
            work: None,
        }
    }
}

impl Flash {
    /// A reset: what is under way is cut off, as by a loss of power.
    pub fn reset(&mut self) {
        match self.work.take() {
            // Part of the bits are written.
            Some((_, Work::Program(word, data))) => {
                let half = &mut self.memory[word * WORD..][..WORD / 2];
                half.copy_from_slice(&data[..WORD / 2]);
                self.turned.insert(word, Turned::Two);
            }
            // No word of the sector can be relied on.
            Some((_, Work::Erase(sector))) => {
                let words = SECTOR / WORD;
                for word in sector * words..(sector + 1) * words {
                    self.turned.insert(word, Turned::Two);
                }
            }
            None => {}
        }
        self.acr = 0x37;
        self.banks = Default::default();
        self.buffer = None;
    }

    /// When the operation under way ends.
    pub fn next(&self) -> Option<Ticks> {
        self.work.map(|(at, _)| at)
    }

    /// Ends the operation that is due.
    pub fn advance(&mut self, now: Ticks) {
        let Some((_, work)) = self.work.filter(|(at, _)| *at <= now) else {
            return;
        };
        self.work = None;
        self.operations += 1;
        self.banks[1].flags |= EOP;
        match work {
            Work::Program(word, data) => {
                self.memory[word * WORD..][..WORD].copy_from_slice(&data);
            }
            Work::Erase(sector) => {
                self.memory[sector * SECTOR..][..SECTOR].fill(0xFF);
                let words = SECTOR / WORD;
                self.turned
                    .retain(|word, _| !(sector * words..(sector + 1) * words).contains(word));
            }
        }
    }

    /// Reads bank 2, at an offset from its beginning.
    ///
    /// # Errors
    /// If the access crosses a word of error correction.
    pub fn read_memory(&mut self, offset: usize, size: usize, now: Ticks) -> Result<Data, Refusal> {
        let word = offset / WORD;
        if offset + size > (word + 1) * WORD {
            return Err("an access across two flash words".to_owned());
        }
        let until = self.work.map_or(now, |(at, _)| at.max(now));
        self.advance(until);
        let bytes = &self.memory[offset..offset + size];
        let value = bytes
            .iter()
            .rev()
            .fold(0, |value, byte| value << 8 | u64::from(*byte));
        let bank = &mut self.banks[1];
        let flag = match self.turned.get(&word) {
            None => 0,
            Some(Turned::One) => SNECCERR,
            Some(Turned::Two) => DBECCERR,
        };
        if flag != 0 && bank.flags & (SNECCERR | DBECCERR) == 0 {
            bank.fail = word as u32;
        }
        bank.flags |= flag;
        Ok(Data {
            value,
            fault: flag == DBECCERR,
            until,
        })
    }

    /// Writes to bank 2, at an offset from its beginning (4.3.9).
    ///
    /// # Errors
    /// If a word is written that is not erased, which ruins its error correction, or in a
    /// way that is not modelled.
    pub fn write_memory(
        &mut self,
        offset: usize,
        size: usize,
        value: u64,
        now: Ticks,
    ) -> Result<(), Refusal> {
        let bank = &mut self.banks[1];
        if bank.cr >> 1 & 1 == 0 || bank.cr & 1 != 0 {
            bank.flags |= PGSERR;
            return Ok(());
        }
        if self.work.is_some() {
            return Err("a second word in the queue is not modelled".to_owned());
        }
        let word = offset / WORD;
        let (first, mut data, mut come) = self.buffer.take().unwrap_or((word, [0; WORD], 0));
        if first != word {
            return Err("another word before the last one was complete".to_owned());
        }
        for (i, byte) in value.to_le_bytes()[..size].iter().enumerate() {
            let at = offset % WORD + i;
            data[at] = *byte;
            come |= 1 << at;
        }
        if come != u32::MAX {
            self.buffer = Some((word, data, come));
            return Ok(());
        }
        let old = &self.memory[word * WORD..][..WORD];
        if self.turned.contains_key(&word) || old.iter().any(|byte| *byte != 0xFF) {
            return Err(format!(
                "word {word} of bank 2 is written without being erased"
            ));
        }
        self.work = Some((now + PROGRAM, Work::Program(word, data)));
        Ok(())
    }

    fn sr(&self, bank: usize) -> u32 {
        let mut sr = self.banks[bank].flags;
        if bank == 1 {
            if self.work.is_some() {
                sr |= BSY | QW;
            }
            if self.buffer.is_some() {
                sr |= WBNE;
            }
        }
        sr
    }

    /// Reads a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32) -> Result<u32, Refusal> {
        let bank = (offset >> 8 & 1) as usize;
        Ok(match offset & !0x100 {
            0x000 if bank == 0 => self.acr,
            0x00C => self.banks[bank].cr,
            0x010 => self.sr(bank),
            0x060 => self.banks[bank].fail,
            _ => return unknown(),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled.
    pub fn write(&mut self, offset: u32, value: u32, now: Ticks) -> Result<(), Refusal> {
        let number = (offset >> 8 & 1) as usize;
        let bank = &mut self.banks[number];
        match offset & !0x100 {
            // LATENCY, WRHIGHFREQ.
            0x000 if number == 0 => self.acr = only(value, 0x3F)?,
            0x004 => {
                bank.keys = match (bank.keys, value) {
                    (0, 0x4567_0123) => 1,
                    (1, 0xCDEF_89AB) => 2,
                    _ => {
                        bank.broken = true;
                        0
                    }
                };
                if bank.keys == 2 && !bank.broken {
                    bank.cr &= !1;
                    bank.keys = 0;
                }
            }
            // Locked, the register ignores writes (4.3.11).
            0x00C if bank.cr & 1 != 0 => {}
            0x00C => {
                // LOCK, PG, SER, PSIZE, START, SNB.
                let value = only(value, 0x7B7)?;
                bank.cr = value & !(1 << 7);
                if value >> 7 & 1 != 0 {
                    if value >> 2 & 1 == 0 || value >> 1 & 1 != 0 || number == 0 {
                        return Err("START of anything but a sector of bank 2".to_owned());
                    }
                    if self.work.is_some() {
                        return Err("START while the bank is busy".to_owned());
                    }
                    let sector = (value >> 8 & 7) as usize;
                    self.work = Some((now + ERASE, Work::Erase(sector)));
                }
            }
            // Read-only (4.9.5): flags are cleared through CCR.
            0x010 => {}
            0x014 => bank.flags &= !only(value, 0x1FEF_0000)?,
            _ => return unknown(),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unlocked() -> Result<Flash, Refusal> {
        let mut flash = Flash::default();
        flash.write(0x104, 0x4567_0123, 0)?;
        flash.write(0x104, 0xCDEF_89AB, 0)?;
        assert_eq!(flash.read(0x10C)? & 1, 0);
        Ok(flash)
    }

    fn program(flash: &mut Flash, word: usize, now: Ticks) -> Result<(), Refusal> {
        flash.write(0x10C, 0x22, now)?;
        for i in 0..8 {
            flash.write_memory(word * WORD + 4 * i, 4, 0x1111 * i as u64, now)?;
        }
        Ok(())
    }

    #[test]
    fn a_word_is_written_when_it_is_complete() -> Result<(), Refusal> {
        let mut flash = unlocked()?;
        flash.write(0x10C, 0x22, 0)?;
        flash.write_memory(0, 4, 7, 0)?;
        assert_eq!(flash.read(0x110)?, WBNE);
        for i in 1..8 {
            flash.write_memory(4 * i, 4, 7, 0)?;
        }
        assert_eq!(flash.read(0x110)?, BSY | QW);
        flash.advance(PROGRAM);
        assert_eq!(flash.read(0x110)?, EOP);
        let read = flash.read_memory(4, 1, PROGRAM)?;
        assert_eq!((read.value, read.fault), (7, false));
        assert!(program(&mut flash, 0, PROGRAM).is_err());
        Ok(())
    }

    #[test]
    fn locked_or_without_pg_nothing_is_written() -> Result<(), Refusal> {
        let mut flash = Flash::default();
        flash.write(0x10C, 2, 0)?;
        flash.write_memory(0, 4, 7, 0)?;
        assert_eq!(flash.read(0x110)?, PGSERR);
        // Through SR nothing is cleared.
        flash.write(0x110, PGSERR, 0)?;
        assert_eq!(flash.read(0x110)?, PGSERR);
        flash.write(0x114, PGSERR, 0)?;
        assert_eq!(flash.read(0x110)?, 0);
        flash.write(0x104, 1, 0)?;
        flash.write(0x104, 0x4567_0123, 0)?;
        flash.write(0x104, 0xCDEF_89AB, 0)?;
        assert_eq!(flash.read(0x10C)? & 1, 1);
        Ok(())
    }

    #[test]
    fn erasing_takes_its_time_and_the_bank_waits() -> Result<(), Refusal> {
        let mut flash = unlocked()?;
        flash.memory[SECTOR] = 0;
        flash.write(0x10C, 0x24 | 1 << 8 | 1 << 7, 0)?;
        assert_eq!(flash.next(), Some(ERASE));
        let read = flash.read_memory(SECTOR, 1, 5)?;
        assert_eq!((read.value, read.until), (0xFF, ERASE));
        Ok(())
    }

    #[test]
    fn turned_bits() -> Result<(), Refusal> {
        let mut flash = unlocked()?;
        flash.turned.insert(3, Turned::One);
        flash.turned.insert(4, Turned::Two);
        let one = flash.read_memory(3 * WORD + 5, 1, 0)?;
        assert_eq!((one.value, one.fault), (0xFF, false));
        assert_eq!(flash.read(0x110)?, SNECCERR);
        assert_eq!(flash.read(0x160)?, 3);
        assert!(flash.read_memory(4 * WORD, 1, 0)?.fault);
        assert_eq!(flash.read(0x110)?, SNECCERR | DBECCERR);
        Ok(())
    }

    #[test]
    fn a_reset_cuts_off_what_is_under_way() -> Result<(), Refusal> {
        let mut flash = unlocked()?;
        program(&mut flash, 9, 0)?;
        flash.reset();
        assert_eq!(flash.turned.get(&9), Some(&Turned::Two));
        assert_eq!(flash.read(0x10C)? & 1, 1);
        Ok(())
    }
}
