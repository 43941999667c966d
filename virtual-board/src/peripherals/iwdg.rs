//! Independent watchdog (RM0433, chapter 47), on the low-speed oscillator.

use super::{Refusal, Register, only, unknown};
use crate::time::{Ticks, cycles};

/// Registers (47.4).
pub const REGISTERS: [Register; 5] = [
    (0x00, "IWDG_KR"),
    (0x04, "IWDG_PR"),
    (0x08, "IWDG_RLR"),
    (0x0C, "IWDG_SR"),
    (0x10, "IWDG_WINR"),
];

/// Frequency of the low-speed oscillator, Hz (data sheet: 31.4 to 32.6 kHz).
pub const LSI: u64 = 32_000;

/// Cycles of the oscillator until a write to PR or RLR has arrived ("up to five", 47.4.4).
const UPDATE: u64 = 5;

/// The watchdog.
pub struct Iwdg {
    open: bool,
    pr: u32,
    rlr: u32,
    /// When the last writes to PR and RLR have arrived.
    updated: [Ticks; 2],
    /// When it bites, by the sampling clock, if it runs.
    bites: Option<Ticks>,
    running: bool,
}

impl Default for Iwdg {
    fn default() -> Self {
        Self {
            open: false,
            pr: 0,
            rlr: 0xFFF,
            updated: [0; 2],
            bites: None,
            running: false,
        }
    }
}

impl Iwdg {
    /// The time-out: RLR + 1 counts of the oscillator divided by 4 to 256 (47.3.2).
    fn time_out(&self) -> Ticks {
        let divider = 4 << self.pr.min(6);
        cycles(u64::from(self.rlr + 1) * divider, LSI)
    }

    /// When it bites, by the sampling clock, if it runs and nobody feeds it.
    pub fn next(&self) -> Option<Ticks> {
        self.bites
    }

    /// Reads a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32, now: Ticks) -> Result<u32, Refusal> {
        let busy = self.updated.map(|at| u32::from(at > now));
        match offset {
            0x04 => Ok(self.pr),
            0x08 => Ok(self.rlr),
            0x0C => Ok(busy[0] | busy[1] << 1),
            0x10 => Ok(0xFFF),
            _ => unknown(),
        }
    }

    /// Writes a register. The count goes by the sampling clock, which may stand still; a
    /// write arrives all the same.
    ///
    /// # Errors
    /// If it, or a value, is not modelled, or PR or RLR is not open or still busy.
    pub fn write(
        &mut self,
        offset: u32,
        value: u32,
        now: Ticks,
        sampling: Ticks,
    ) -> Result<(), Refusal> {
        let slot = match offset {
            0x00 => {
                self.open = value == 0x5555;
                match value {
                    0x5555 => {}
                    0xAAAA => self.feed(sampling),
                    0xCCCC => {
                        self.running = true;
                        self.feed(sampling);
                    }
                    _ => return Err(format!("{value:#06x} is no key")),
                }
                return Ok(());
            }
            0x04 => 0,
            0x08 => 1,
            _ => return unknown(),
        };
        if !self.open {
            return Err("written without the key 0x5555".to_owned());
        }
        if self.updated[slot] > now {
            return Err("written while its flag in IWDG_SR is set".to_owned());
        }
        match slot {
            0 => self.pr = only(value, 7)?,
            _ => self.rlr = only(value, 0xFFF)?,
        }
        self.updated[slot] = now + cycles(UPDATE, LSI);
        Ok(())
    }

    fn feed(&mut self, sampling: Ticks) {
        if self.running {
            self.bites = Some(sampling + self.time_out());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::{MILLISECOND, SECOND};

    #[test]
    fn it_bites_after_its_time_out() -> Result<(), Refusal> {
        let mut dog = Iwdg::default();
        dog.write(0x00, 0xCCCC, 0, 0)?;
        // As after a reset: 4,096 counts of 32 kHz/4.
        assert_eq!(dog.next(), Some(512 * MILLISECOND));
        assert!(dog.write(0x04, 4, 0, 0).is_err());
        dog.write(0x00, 0x5555, 0, 0)?;
        dog.write(0x04, 4, 0, 0)?;
        dog.write(0x08, 25, 0, 0)?;
        assert_eq!(dog.read(0x0C, 0)?, 3);
        let later = SECOND / 32_000 * 5;
        assert_eq!(dog.read(0x0C, later)?, 0);
        dog.write(0x00, 0xAAAA, later, later)?;
        assert_eq!(dog.next(), Some(later + 52 * MILLISECOND));
        Ok(())
    }
}
