//! System configuration (RM0433, chapter 12).

use super::{Refusal, Register, only, unknown};

/// Registers (12.3).
pub const REGISTERS: [Register; 5] = [
    (0x04, "SYSCFG_PMCR"),
    (0x20, "SYSCFG_CCCSR"),
    (0x24, "SYSCFG_CCVR"),
    (0x28, "SYSCFG_CCCR"),
    (0x2C, "SYSCFG_PWRCR"),
];

/// The peripheral.
#[derive(Default)]
pub struct Syscfg {
    /// ODEN in PWRCR: the voltage for 480 MHz.
    pub overdrive: bool,
}

impl Syscfg {
    /// Reads a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32) -> Result<u32, Refusal> {
        match offset {
            0x2C => Ok(u32::from(self.overdrive)),
            _ => unknown(),
        }
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Refusal> {
        match offset {
            0x2C => self.overdrive = only(value, 1)? != 0,
            _ => return unknown(),
        }
        Ok(())
    }
}
