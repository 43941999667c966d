//! Memories of an STM32H743 (RM0433, 2.3.2, table 7) that the image uses.
//!
//! The core reads and writes ITCM, DTCM and bank 1 of the flash directly. AXI SRAM and bank
//! 2 of the flash are reached through callbacks: the former so that every write to it is
//! seen, the latter because it has its error correction and its waiting.

/// A memory that the core accesses directly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Area {
    /// Instruction memory of the core; code is copied there at start.
    Itcm,
    /// Bank 1 of the flash.
    Flash,
    /// Data memory of the core.
    Dtcm,
}

impl Area {
    /// All areas.
    pub const ALL: [Self; 3] = [Self::Itcm, Self::Flash, Self::Dtcm];

    /// Address and size, bytes.
    pub const fn range(self) -> (u32, usize) {
        match self {
            Self::Itcm => (0, 64 * 1024),
            Self::Flash => (0x0800_0000, 1024 * 1024),
            Self::Dtcm => (0x2000_0000, 128 * 1024),
        }
    }
}

/// Address and size of the AXI SRAM, bytes.
pub const AXI: (u32, usize) = (0x2400_0000, 512 * 1024);

/// Bytes at a fixed place, which the emulator accesses behind our back.
struct Bytes {
    start: *mut u8,
    size: usize,
}

impl Bytes {
    fn new(size: usize) -> Self {
        let bytes = vec![0u8; size].into_boxed_slice();
        Self {
            start: Box::into_raw(bytes).cast(),
            size,
        }
    }
}

impl Drop for Bytes {
    fn drop(&mut self) {
        let slice = std::ptr::slice_from_raw_parts_mut(self.start, self.size);
        // SAFETY: it came from a box of this size in `new`, and nothing else frees it. The
        // emulator that knew the address is closed before: see `Machine`.
        drop(unsafe { Box::from_raw(slice) });
    }
}

/// The memories.
pub struct Memory {
    areas: [Bytes; 3],
    /// AXI SRAM.
    pub axi: Vec<u8>,
    /// How often the core has written to AXI SRAM.
    pub axi_writes: u64,
}

impl Default for Memory {
    fn default() -> Self {
        Self {
            areas: Area::ALL.map(|area| Bytes::new(area.range().1)),
            axi: vec![0; AXI.1],
            axi_writes: 0,
        }
    }
}

impl Memory {
    /// Where an area begins, for the emulator.
    pub fn pointer(&self, area: Area) -> *mut u8 {
        self.areas[area as usize].start
    }

    /// The bytes of an area.
    pub fn area(&self, area: Area) -> &[u8] {
        let Bytes { start, size } = self.areas[area as usize];
        // SAFETY: allocated with this size in `Bytes::new`. The emulator writes to it only
        // while it runs, and it calls back between instructions of its one thread.
        unsafe { std::slice::from_raw_parts(start, size) }
    }

    /// The bytes of an area.
    pub fn area_mut(&mut self, area: Area) -> &mut [u8] {
        let Bytes { start, size } = self.areas[area as usize];
        // SAFETY: as in `area`, and there is no other reference: it borrows `self`.
        unsafe { std::slice::from_raw_parts_mut(start, size) }
    }

    /// Reads bytes at an address, for loaders and tests. None if nothing is there.
    pub fn read(&self, address: u32, size: usize) -> Option<&[u8]> {
        let direct = Area::ALL.into_iter().find_map(|area| {
            let at = address.checked_sub(area.range().0)? as usize;
            self.area(area).get(at..at + size)
        });
        direct.or_else(|| {
            let at = address.checked_sub(AXI.0)? as usize;
            self.axi.get(at..at + size)
        })
    }

    /// Reads an aligned or unaligned word. None if nothing is there.
    pub fn word(&self, address: u32) -> Option<u32> {
        let bytes = self.read(address, 4)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    }

    /// Writes bytes at an address. False if nothing is there.
    pub fn write(&mut self, address: u32, bytes: &[u8]) -> bool {
        for area in Area::ALL {
            let at = address.wrapping_sub(area.range().0) as usize;
            if let Some(slot) = self
                .area_mut(area)
                .get_mut(at..at.saturating_add(bytes.len()))
            {
                slot.copy_from_slice(bytes);
                return true;
            }
        }
        let at = address.wrapping_sub(AXI.0) as usize;
        let slot = self.axi.get_mut(at..at.saturating_add(bytes.len()));
        slot.map(|slot| slot.copy_from_slice(bytes)).is_some()
    }

    /// Volatile memory as it may be after power came on: no pattern, but the same each time.
    pub fn scramble(&mut self) {
        let mut state = 0x9E37_79B9_7F4A_7C15u64;
        let mut fill = |bytes: &mut [u8]| {
            for chunk in bytes.chunks_mut(8) {
                // xorshift64.
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                chunk.copy_from_slice(&state.to_le_bytes()[..chunk.len()]);
            }
        };
        fill(self.area_mut(Area::Itcm));
        fill(self.area_mut(Area::Dtcm));
        fill(&mut self.axi);
    }
}
