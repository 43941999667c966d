//! Cycle counter (ARMv7-M ARM, C1.8) and the bit of DEMCR (C1.6.5) that powers it.

use super::{Refusal, Register, only, unknown};
use crate::time::{Ticks, whole};

/// Registers, as offsets from 0xE0001000.
pub const REGISTERS: [Register; 3] = [
    (0x000, "DWT_CTRL"),
    (0x004, "DWT_CYCCNT"),
    (0xFB0, "DWT_LAR"),
];

/// DEMCR, as an offset from 0xE000E000.
pub const DEMCR: Register = (0xDFC, "DEMCR");

/// The counter.
#[derive(Default)]
pub struct Dwt {
    trace: bool,
    counting: bool,
    /// The count at `since`.
    count: u32,
    since: Ticks,
}

impl Dwt {
    fn count(&self, now: Ticks, core: u64) -> u32 {
        let passed = if self.counting && self.trace {
            // Wraps as the register does.
            whole(now - self.since, core) as u32
        } else {
            0
        };
        self.count.wrapping_add(passed)
    }

    /// To be called before the core's clock changes from `core` Hz.
    pub fn settle(&mut self, now: Ticks, core: u64) {
        self.count = self.count(now, core);
        self.since = now;
    }

    /// Reads a register; the core runs at `core` Hz.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32, now: Ticks, core: u64) -> Result<u32, Refusal> {
        match offset {
            // Four comparators.
            0x000 => Ok(0x4000_0000 | u32::from(self.counting)),
            0x004 => Ok(self.count(now, core)),
            _ => unknown(),
        }
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled.
    pub fn write(&mut self, offset: u32, value: u32, now: Ticks, core: u64) -> Result<(), Refusal> {
        self.settle(now, core);
        match offset {
            0x000 => self.counting = only(value & 0x0FFF_FFFF, 1)? != 0,
            0x004 => self.count = value,
            // The software lock of a Cortex-M7 is open for a debugger only; writing its key
            // is what programs do, and harmless.
            0xFB0 if value == 0xC5AC_CE55 => {}
            _ => return unknown(),
        }
        Ok(())
    }

    /// Reads DEMCR.
    pub fn demcr(&self) -> u32 {
        u32::from(self.trace) << 24
    }

    /// Writes DEMCR.
    ///
    /// # Errors
    /// If a bit that is set is not modelled.
    pub fn set_demcr(&mut self, value: u32, now: Ticks, core: u64) -> Result<(), Refusal> {
        self.settle(now, core);
        self.trace = only(value, 1 << 24)? != 0;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::MICROSECOND;

    #[test]
    fn it_counts_core_cycles_and_wraps() -> Result<(), Refusal> {
        let mut dwt = Dwt::default();
        let core = 480_000_000;
        dwt.set_demcr(1 << 24, 0, core)?;
        assert_eq!(dwt.read(4, MICROSECOND, core)?, 0);
        dwt.write(0, 1, MICROSECOND, core)?;
        assert_eq!(dwt.read(4, 2 * MICROSECOND, core)?, 480);
        dwt.write(4, u32::MAX, 2 * MICROSECOND, core)?;
        assert_eq!(dwt.read(4, 3 * MICROSECOND, core)?, 479);
        // At 64 MHz from here on.
        dwt.settle(3 * MICROSECOND, core);
        assert_eq!(dwt.read(4, 4 * MICROSECOND, 64_000_000)?, 479 + 64);
        Ok(())
    }
}
