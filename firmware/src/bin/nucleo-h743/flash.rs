//! The last two sectors of flash bank 2, which store a table.

use embassy_stm32::flash::{Blocking, Error, Flash};
use embassy_stm32::pac::FLASH;
use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

use crate::guard::Watchdog;

/// Size of a sector, bytes.
const SECTOR: usize = 128 * 1024;

/// Size of both sectors, bytes.
pub const SIZE: u32 = 2 * SECTOR as u32;

/// Size of a flash word, the unit of writing and of error correction, bytes.
const WORD: usize = 32;

/// Offset of the sectors from the start of flash, bytes.
const OFFSET: u32 = 2048 * 1024 - SIZE;

/// Address of flash.
const BASE: usize = 0x0800_0000;

/// Both sectors. While one is erased or written, the image in bank 1 keeps running, including
/// the loop.
pub struct Sectors(pub Flash<'static, Blocking>);

/// An error of the flash.
#[derive(Debug)]
pub struct FlashError(Error);

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self.0 {
            Error::Size => NorFlashErrorKind::OutOfBounds,
            Error::Unaligned => NorFlashErrorKind::NotAligned,
            _ => NorFlashErrorKind::Other,
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
        if offset + bytes.len() as u32 > SIZE {
            return Err(FlashError(Error::Size));
        }
        let start = BASE + (OFFSET + offset) as usize;
        // One word at a time, because the loop waits meanwhile.
        for (i, part) in bytes.chunks_mut(WORD).enumerate() {
            read_part(start + i * WORD, part);
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
        }
        if bank.sr().read().dbeccerr() {
            bytes.fill(0);
            bank.ccr().write(|w| w.set_clr_dbeccerr(true));
        }
    });
}

/// Bit of the configuration and control register: bus faults of data accesses are ignored
/// while FAULTMASK is set.
const BFHFNMIGN: u32 = 1 << 8;

impl NorFlash for Sectors {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        Watchdog::while_slow(|| self.0.blocking_erase(OFFSET + from, OFFSET + to))
            .map_err(FlashError)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        self.0
            .blocking_write(OFFSET + offset, bytes)
            .map_err(FlashError)
    }
}
