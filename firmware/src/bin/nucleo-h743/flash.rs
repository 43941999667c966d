//! The last two sectors of flash bank 2, where a table is kept.

use embassy_stm32::flash::{Blocking, Error, Flash};
use embassy_stm32::pac::FLASH;
use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

use crate::guard::Watchdog;

/// Of a sector.
const SECTOR: usize = 128 * 1024;

/// Of both.
pub const SIZE: u32 = 2 * SECTOR as u32;

/// What is written, and corrected, at once.
const WORD: usize = 32;

/// From the start of flash.
const OFFSET: u32 = 2048 * 1024 - SIZE;

/// Where flash is.
const BASE: usize = 0x0800_0000;

/// Both sectors. While one is erased or written the image in bank 1 goes on, loop
/// included.
pub struct Sectors(pub Flash<'static, Blocking>);

/// What the flash says.
#[derive(Debug)]
pub struct Failed(Error);

impl NorFlashError for Failed {
    fn kind(&self) -> NorFlashErrorKind {
        match self.0 {
            Error::Size => NorFlashErrorKind::OutOfBounds,
            Error::Unaligned => NorFlashErrorKind::NotAligned,
            _ => NorFlashErrorKind::Other,
        }
    }
}

impl ErrorType for Sectors {
    type Error = Failed;
}

impl ReadNorFlash for Sectors {
    const READ_SIZE: usize = 1;

    /// A word whose writing was cut off by a power failure may not match its error
    /// correction; reading it would be a bus fault. It is read as zeros, which is no
    /// item of the store's.
    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        if offset + bytes.len() as u32 > SIZE {
            return Err(Failed(Error::Size));
        }
        let start = BASE + (OFFSET + offset) as usize;
        // A little at a time: the loop waits meanwhile.
        for (i, part) in bytes.chunks_mut(WORD).enumerate() {
            read_part(start + i * WORD, part);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        SIZE as usize
    }
}

fn read_part(start: usize, bytes: &mut [u8]) {
    let bank = FLASH.bank(1);
    critical_section::with(|_| {
        // SAFETY: faults of data accesses are ignored from here to the end, and looked at
        // in the flash's own status; no interrupt comes in between.
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

/// Of the configuration and control register: data faults are ignored where the mask
/// of all faults is set.
const BFHFNMIGN: u32 = 1 << 8;

impl NorFlash for Sectors {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
        Watchdog::while_slow(|| self.0.blocking_erase(OFFSET + from, OFFSET + to)).map_err(Failed)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed> {
        self.0
            .blocking_write(OFFSET + offset, bytes)
            .map_err(Failed)
    }
}
