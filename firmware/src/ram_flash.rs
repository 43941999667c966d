//! RAM that behaves like flash, for the emulated boards, which have no flash to write.

use core::convert::Infallible;

use embedded_storage_async::nor_flash::{ErrorType, MultiwriteNorFlash, NorFlash, ReadNorFlash};

/// Number of pages.
const PAGES: usize = 2;

/// Size of a page, bytes.
const PAGE: usize = 8192;

/// RAM that behaves like flash: erased bytes are 0xFF, and a write can only clear bits.
pub struct RamFlash([u8; Self::SIZE]);

impl RamFlash {
    /// Total size, bytes.
    pub const SIZE: usize = PAGES * PAGE;

    /// Erased memory.
    pub const fn new() -> Self {
        Self([0xFF; Self::SIZE])
    }

    fn part(&mut self, from: u32, to: u32) -> &mut [u8] {
        self.0
            .get_mut(from as usize..to as usize)
            .unwrap_or(&mut [])
    }
}

impl Default for RamFlash {
    fn default() -> Self {
        Self::new()
    }
}

impl ErrorType for RamFlash {
    type Error = Infallible;
}

impl ReadNorFlash for RamFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        let end = offset.saturating_add(bytes.len() as u32);
        for (byte, stored) in bytes.iter_mut().zip(self.part(offset, end)) {
            *byte = *stored;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        Self::SIZE
    }
}

impl NorFlash for RamFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
        self.part(from, to).fill(0xFF);
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Infallible> {
        let end = offset.saturating_add(bytes.len() as u32);
        for (stored, byte) in self.part(offset, end).iter_mut().zip(bytes) {
            *stored &= byte;
        }
        Ok(())
    }
}

impl MultiwriteNorFlash for RamFlash {}
