//! Microcontroller debug unit (RM0433, 60.5.8). What it changes only a debugger sees.

use super::{Refusal, Register, only, unknown};

/// Registers.
pub const REGISTERS: [Register; 2] = [(0x00, "DBGMCU_IDC"), (0x04, "DBGMCU_CR")];

/// The peripheral.
#[derive(Default)]
pub struct Dbgmcu {
    cr: u32,
}

impl Dbgmcu {
    /// Reads a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32) -> Result<u32, Refusal> {
        match offset {
            // Revision V of an STM32H743.
            0x00 => Ok(0x2003_6450),
            0x04 => Ok(self.cr),
            _ => unknown(),
        }
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Refusal> {
        match offset {
            // DBGSLEEP_D1, DBGSTOP_D1, DBGSTBY_D1, D1DBGCKEN, D3DBGCKEN.
            0x04 => self.cr = only(value, 7 | 3 << 21)?,
            _ => return unknown(),
        }
        Ok(())
    }
}
