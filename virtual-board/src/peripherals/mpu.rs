//! Memory protection unit (ARMv7-M ARM, B3.5): sixteen regions.

use super::{Refusal, Register, only, unknown};

/// Registers, as offsets from 0xE000E000.
pub const REGISTERS: [Register; 11] = [
    (0xD90, "MPU_TYPE"),
    (0xD94, "MPU_CTRL"),
    (0xD98, "MPU_RNR"),
    (0xD9C, "MPU_RBAR"),
    (0xDA0, "MPU_RASR"),
    (0xDA4, "MPU_RBAR_A1"),
    (0xDA8, "MPU_RASR_A1"),
    (0xDAC, "MPU_RBAR_A2"),
    (0xDB0, "MPU_RASR_A2"),
    (0xDB4, "MPU_RBAR_A3"),
    (0xDB8, "MPU_RASR_A3"),
];

const REGIONS: usize = 16;

/// What privileged code may do with an address. The image is never unprivileged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rights {
    /// Data can be read.
    pub read: bool,
    /// Data can be written.
    pub write: bool,
    /// Instructions can be fetched.
    pub execute: bool,
}

impl Rights {
    /// All of it.
    pub const ALL: Self = Self {
        read: true,
        write: true,
        execute: true,
    };

    const NONE: Self = Self {
        read: false,
        write: false,
        execute: false,
    };
}

/// The unit. Memory types and cacheability (TEX, S, C, B) are stored without an effect: no
/// cache is modelled.
#[derive(Default)]
pub struct Mpu {
    ctrl: u32,
    number: usize,
    /// RBAR without its lower bits, and RASR.
    regions: [(u32, u32); REGIONS],
}

impl Mpu {
    /// Reads a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32) -> Result<u32, Refusal> {
        match offset {
            0xD90 => Ok((REGIONS as u32) << 8),
            0xD94 => Ok(self.ctrl),
            0xD98 => Ok(self.number as u32),
            0xD9C | 0xDA4 | 0xDAC | 0xDB4 => Ok(self.regions[self.number].0 | self.number as u32),
            0xDA0 | 0xDA8 | 0xDB0 | 0xDB8 => Ok(self.regions[self.number].1),
            _ => unknown(),
        }
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it is not modelled, or a region is smaller than the pages of 4 KiB in which the
    /// emulator protects memory, or has subregions switched off.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Refusal> {
        match offset {
            0xD94 => self.ctrl = only(value, 7)?,
            0xD98 => self.number = value as usize % REGIONS,
            0xD9C | 0xDA4 | 0xDAC | 0xDB4 => {
                // VALID: the region's number comes along.
                if value >> 4 & 1 != 0 {
                    self.number = (value & 0xF) as usize;
                }
                self.regions[self.number].0 = value & !0x1F;
            }
            0xDA0 | 0xDA8 | 0xDB0 | 0xDB8 => {
                only(value, 1 << 28 | 7 << 24 | 0x3F << 16 | 0xFF3F)?;
                if value & 1 != 0 && (value >> 1 & 0x1F) < 11 {
                    return Err("regions below 4 KiB are not modelled".to_owned());
                }
                if value & 1 != 0 && value >> 8 & 0xFF != 0 {
                    return Err("subregions are not modelled".to_owned());
                }
                self.regions[self.number].1 = value;
            }
            _ => return unknown(),
        }
        Ok(())
    }

    /// Whether it is on.
    pub fn is_on(&self) -> bool {
        self.ctrl & 1 != 0
    }

    /// What code may do with the page of an address (B3.5.1 to 3). `above`: at priority -1
    /// or higher, where the unit is off unless HFNMIENA is set. The private peripheral bus
    /// is always open.
    pub fn rights(&self, address: u32, above: bool) -> Rights {
        if !self.is_on() || above && self.ctrl >> 1 & 1 == 0 || address >> 20 == 0xE00 {
            return Rights::ALL;
        }
        let hit = self.regions.iter().rev().find(|(base, attributes)| {
            let size = (attributes >> 1 & 0x1F) + 1;
            attributes & 1 != 0 && (size == 32 || address >> size == base >> size)
        });
        let Some((_, attributes)) = hit else {
            // PRIVDEFENA: the default map, else a fault.
            return if self.ctrl >> 2 & 1 != 0 {
                Rights::ALL
            } else {
                Rights::NONE
            };
        };
        let (read, write) = match attributes >> 24 & 7 {
            0 => (false, false),
            1..=3 => (true, true),
            _ => (true, false),
        };
        Rights {
            read,
            write,
            execute: read && attributes >> 28 & 1 == 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_highest_region_counts() -> Result<(), Refusal> {
        let mut mpu = Mpu::default();
        // Region 0: 0x1FF00000, 128 KiB, no access, never executed. Region 1 within it:
        // its first 4 KiB, read-only.
        mpu.write(0xD9C, 0x1FF0_0000 | 1 << 4)?;
        mpu.write(0xDA0, 1 << 28 | 16 << 1 | 1)?;
        mpu.write(0xD9C, 0x1FF0_0000 | 1 << 4 | 1)?;
        mpu.write(0xDA0, 6 << 24 | 11 << 1 | 1)?;
        assert_eq!(mpu.rights(0x1FF1_0000, false), Rights::ALL);
        mpu.write(0xD94, 0b101)?;
        assert_eq!(mpu.rights(0x1FF1_0000, false), Rights::NONE);
        assert_eq!(mpu.rights(0x1FF1_0000, true), Rights::ALL);
        let first = mpu.rights(0x1FF0_0FFF, false);
        assert!(first.read && !first.write && first.execute);
        assert_eq!(mpu.rights(0x1FF2_0000, false), Rights::ALL);
        mpu.write(0xD94, 0b011)?;
        assert_eq!(mpu.rights(0x1FF2_0000, false), Rights::NONE);
        assert_eq!(mpu.rights(0x1FF1_0000, true), Rights::NONE);
        assert_eq!(mpu.rights(0xE000_ED94, false), Rights::ALL);
        assert!(mpu.write(0xDA0, 4 << 1 | 1).is_err());
        Ok(())
    }
}
