//! The last two sectors of flash bank 2, which store a table (RM0433, chapter 4).
//!
//! Errors are cleared by the bank's CCR before each operation, so that an earlier one, such as
//! a bit that was corrected or a speculative read of protected memory, does not make the next
//! one fail.

use cortex_m::peripheral::MPU;
use embassy_stm32::pac::FLASH;
use embassy_stm32::pac::flash::Bank;
use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

use crate::guard::Watchdog;

/// Size of a sector, bytes.
const SECTOR: u32 = 128 * 1024;

/// Size of both sectors, bytes.
pub const SIZE: u32 = 2 * SECTOR;

/// Number of the first of the two sectors in bank 2.
const FIRST: u32 = 6;

/// Size of a flash word, the unit of writing and of error correction, bytes.
const WORD: usize = 32;

/// Address of the first of the two sectors.
const START: usize = 0x0810_0000 + (FIRST * SECTOR) as usize;

/// The keys that unlock the control register, in order.
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// PSIZE: 64 bits are written at a time.
const PARALLELISM: u8 = 3;

/// Both sectors. While one is erased or written, the image in bank 1 keeps running, including
/// the loop.
pub struct Sectors(());

impl Sectors {
    /// To be called once.
    pub fn new() -> Self {
        Self(())
    }
}

/// An error of the flash.
#[derive(Debug)]
pub enum FlashError {
    /// Outside the two sectors.
    Bounds,
    /// Not at the start of a word or of a sector.
    Alignment,
    /// The flash reported an error.
    Operation,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Bounds => NorFlashErrorKind::OutOfBounds,
            Self::Alignment => NorFlashErrorKind::NotAligned,
            Self::Operation => NorFlashErrorKind::Other,
        }
    }
}

impl ErrorType for Sectors {
    type Error = FlashError;
}

impl ReadNorFlash for Sectors {
    const READ_SIZE: usize = 1;

    /// Reads bytes. A flash word whose writing was interrupted by a loss of power may fail its
    /// error correction, which would be a bus fault. Such a word reads as zeros, which are not
    /// a valid item of the store.
    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        check(offset, bytes.len(), 1)?;
        let mut at = offset as usize;
        let mut rest = bytes;
        while !rest.is_empty() {
            // One flash word at a time, because the loop waits meanwhile.
            let count = (WORD - at % WORD).min(rest.len());
            let (part, others) = rest.split_at_mut(count);
            read_part(START + at, part);
            Watchdog::feed_if_sampled();
            at += count;
            rest = others;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        SIZE as usize
    }
}

/// Reads bytes of one flash word, as zeros if its error correction fails.
fn read_part(start: usize, bytes: &mut [u8]) {
    let bank = FLASH.bank(1);
    critical_section::with(|_| {
        clear(bank);
        // SAFETY: bus faults of data accesses are ignored within this block and checked
        // afterwards in the status of the flash. No interrupt can occur in between.
        unsafe {
            let scb = &*cortex_m::peripheral::SCB::PTR;
            let ccr = scb.ccr.read();
            scb.ccr.write(ccr | BFHFNMIGN);
            core::arch::asm!("cpsid f", "dsb", "isb");
            for (i, byte) in bytes.iter_mut().enumerate() {
                *byte = core::ptr::with_exposed_provenance::<u8>(start + i).read_volatile();
            }
            core::arch::asm!("dsb", "cpsie f", "isb");
            scb.ccr.write(ccr);
            // The flags of the ignored fault.
            scb.cfsr.write(BUS_FAULTS);
        }
        if bank.sr().read().dbeccerr() {
            bytes.fill(0);
            clear(bank);
        }
    });
}

/// Bit of the configuration and control register: bus faults of data accesses are ignored
/// while FAULTMASK is set.
const BFHFNMIGN: u32 = 1 << 8;

/// The bus faults in the configurable fault status register.
const BUS_FAULTS: u32 = 0xFF00;

/// Refuses what is outside the sectors or not aligned to `unit`.
fn check(offset: u32, length: usize, unit: usize) -> Result<(), FlashError> {
    let end = (offset as usize).checked_add(length);
    if end.is_none_or(|end| end > SIZE as usize) {
        return Err(FlashError::Bounds);
    }
    if !(offset as usize).is_multiple_of(unit) || !length.is_multiple_of(unit) {
        return Err(FlashError::Alignment);
    }
    Ok(())
}

/// Clears all errors and the end of operation.
fn clear(bank: Bank) {
    bank.ccr().write(|w| {
        w.set_clr_eop(true);
        w.set_clr_wrperr(true);
        w.set_clr_pgserr(true);
        w.set_clr_strberr(true);
        w.set_clr_incerr(true);
        w.set_clr_operr(true);
        w.set_clr_rdperr(true);
        w.set_clr_rdserr(true);
        w.set_clr_sneccerr(true);
        w.set_clr_dbeccerr(true);
    });
}

/// Runs an operation on the unlocked bank: `begin` starts it.
fn operate(begin: impl FnOnce(Bank)) -> Result<(), FlashError> {
    let bank = FLASH.bank(1);
    if bank.cr().read().lock() {
        for key in KEYS {
            bank.keyr().write_value(key);
        }
    }
    clear(bank);
    begin(bank);
    while bank.sr().read().qw() {}
    let status = bank.sr().read();
    bank.cr().modify(|w| {
        w.set_pg(false);
        w.set_ser(false);
        w.set_lock(true);
    });
    clear(bank);
    // Errors of reading are not errors of this operation.
    let failed =
        status.wrperr() || status.pgserr() || status.strberr() || status.incerr() || status.operr();
    if failed {
        return Err(FlashError::Operation);
    }
    Ok(())
}

impl NorFlash for Sectors {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let length = to.checked_sub(from).ok_or(FlashError::Bounds)?;
        check(from, length as usize, Self::ERASE_SIZE)?;
        for sector in from / SECTOR..to / SECTOR {
            Watchdog::while_slow(|| {
                operate(|bank| {
                    bank.cr().modify(|w| {
                        w.set_ser(true);
                        w.set_psize(PARALLELISM);
                        // Sectors of a bank are numbered from 0 to 7.
                        w.set_snb((FIRST + sector) as u8);
                    });
                    bank.cr().modify(|w| w.set_start(true));
                })
            })?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check(offset, bytes.len(), WORD)?;
        for (i, word) in bytes.chunks_exact(WORD).enumerate() {
            let start = START + offset as usize + i * WORD;
            operate(|bank| {
                bank.cr().modify(|w| {
                    w.set_pg(true);
                    w.set_psize(PARALLELISM);
                });
                for (k, part) in word.as_chunks().0.iter().enumerate() {
                    let at = core::ptr::with_exposed_provenance_mut::<u32>(start + 4 * k);
                    // SAFETY: an aligned word of the sectors, which nothing has a reference to.
                    unsafe { at.write_volatile(u32::from_le_bytes(*part)) };
                }
                cortex_m::asm::dsb();
            })?;
            Watchdog::feed_if_sampled();
        }
        Ok(())
    }
}

/// Forbids all access to the system memory at 0x1FF0_0000. The core may read there ahead of the
/// program; such a read is an error of the flash (RDSERR, RDPERR) although nothing asked for it.
pub fn forbid_system_memory(mpu: &mut MPU) {
    /// No execution, no access, strongly ordered; 2^20 bytes; enabled.
    const ATTRIBUTES: u32 = 1 << 28 | 19 << 1 | 1;
    /// The default map elsewhere; enabled.
    const CONTROL: u32 = 1 << 2 | 1;
    cortex_m::asm::dmb();
    // SAFETY: nothing of the image is there.
    unsafe {
        mpu.rnr.write(0);
        mpu.rbar.write(0x1FF0_0000);
        mpu.rasr.write(ATTRIBUTES);
        mpu.ctrl.write(CONTROL);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}
