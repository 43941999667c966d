//! Power control (RM0433, chapter 6).

use super::{Refusal, Register, only, unknown};
use crate::time::{MICROSECOND, Ticks};

/// Registers (6.8).
pub const REGISTERS: [Register; 9] = [
    (0x00, "PWR_CR1"),
    (0x04, "PWR_CSR1"),
    (0x08, "PWR_CR2"),
    (0x0C, "PWR_CR3"),
    (0x10, "PWR_CPUCR"),
    (0x18, "PWR_D3CR"),
    (0x20, "PWR_WKUPCR"),
    (0x24, "PWR_WKUPFR"),
    (0x28, "PWR_WKUPEPR"),
];

/// Until another voltage scale is reached. A model's figure.
const SETTLE: Ticks = 20 * MICROSECOND;

/// The peripheral.
pub struct Pwr {
    cr1: u32,
    cr3: u32,
    /// CR3's lower byte can be written once after power-on (6.8.4).
    supplied: bool,
    vos: u32,
    /// When VOSRDY is set.
    ready: Ticks,
}

impl Default for Pwr {
    fn default() -> Self {
        Self {
            cr1: 0xF000_C000,
            cr3: 6,
            supplied: false,
            vos: 1,
            ready: 0,
        }
    }
}

impl Pwr {
    /// The voltage changes, also when SYSCFG's overdrive does.
    pub fn settle(&mut self, now: Ticks) {
        self.ready = now + SETTLE;
    }

    /// A reset that is none of power: CR3 keeps its lower byte.
    pub fn reset(&mut self) {
        *self = Self {
            supplied: self.supplied,
            cr3: self.cr3,
            ..Self::default()
        };
    }

    /// Reads a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32, now: Ticks) -> Result<u32, Refusal> {
        let ready = u32::from(self.ready <= now) << 13;
        Ok(match offset {
            0x00 => self.cr1,
            0x0C => self.cr3,
            // ACTVOSRDY, ACTVOS; VOSRDY, VOS.
            0x04 | 0x18 => ready | self.vos << 14,
            _ => return unknown(),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled.
    pub fn write(&mut self, offset: u32, value: u32, now: Ticks) -> Result<(), Refusal> {
        match offset {
            // DBP: the backup domain may be written.
            0x00 => self.cr1 = only(value, 0xF000_C000 | 1 << 8)?,
            0x0C => {
                // SCUEN and LDOEN, not BYPASS: the internal regulator.
                let value = only(value, 6)?;
                if !self.supplied {
                    self.cr3 = value;
                    self.supplied = true;
                }
            }
            0x18 => {
                let value = only(value & !(1 << 13), 3 << 14)?;
                if value >> 14 == 0 {
                    return Err("VOS = 0 is reserved".to_owned());
                }
                if self.vos != value >> 14 {
                    self.vos = value >> 14;
                    self.settle(now);
                }
            }
            _ => return unknown(),
        }
        Ok(())
    }
}
