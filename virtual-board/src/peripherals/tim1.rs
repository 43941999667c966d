//! Advanced timer TIM1 (RM0433, chapter 38): up-counting, four compare channels, PWM and
//! combined PWM, no preload. Times here are those of the sampling clock, which stands
//! still while the gate is closed.

use super::{Refusal, Register, only, unknown};
use crate::time::{Ticks, cycles, whole};
use crate::wires::Level;

/// Registers (38.4).
pub const REGISTERS: [Register; 22] = [
    (0x00, "TIM1_CR1"),
    (0x04, "TIM1_CR2"),
    (0x08, "TIM1_SMCR"),
    (0x0C, "TIM1_DIER"),
    (0x10, "TIM1_SR"),
    (0x14, "TIM1_EGR"),
    (0x18, "TIM1_CCMR1"),
    (0x1C, "TIM1_CCMR2"),
    (0x20, "TIM1_CCER"),
    (0x24, "TIM1_CNT"),
    (0x28, "TIM1_PSC"),
    (0x2C, "TIM1_ARR"),
    (0x30, "TIM1_RCR"),
    (0x34, "TIM1_CCR1"),
    (0x38, "TIM1_CCR2"),
    (0x3C, "TIM1_CCR3"),
    (0x40, "TIM1_CCR4"),
    (0x44, "TIM1_BDTR"),
    (0x48, "TIM1_DCR"),
    (0x4C, "TIM1_DMAR"),
    (0x54, "TIM1_CCMR3"),
    (0x58, "TIM1_CCR5"),
];

/// Interrupt of its capture and compare channels.
pub const CC_IRQ: u16 = 27;

/// DIER: a compare event of the first channel is a request to the DMA.
const CC1DE: u32 = 1 << 9;

/// What happened at a moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// When.
    pub at: Ticks,
    /// The counter began a new period.
    pub update: bool,
    /// Bit x - 1: the counter reached CCRx.
    pub matches: u32,
}

/// The timer.
pub struct Tim1 {
    /// It was enabled, and nothing has happened since.
    fresh: bool,
    /// Its clock, Hz.
    pub clock: u64,
    enabled: bool,
    dier: u32,
    /// The first channel's request to the DMA.
    dma: bool,
    sr: u32,
    ccmr: [u32; 2],
    ccer: u32,
    /// PSC as written, and as it counts since the last update.
    psc: (u32, u32),
    arr: u32,
    ccr: [u32; 4],
    ccr5: u32,
    moe: bool,
    /// Moment of count 0 of this period, if it runs.
    start: Ticks,
    /// The count up to which events have happened; the counter, if it does not run.
    done: u32,
}

impl Default for Tim1 {
    fn default() -> Self {
        Self {
            fresh: false,
            clock: 1,
            enabled: false,
            dier: 0,
            dma: false,
            sr: 0,
            ccmr: [0; 2],
            ccer: 0,
            psc: (0, 0),
            arr: 0xFFFF,
            ccr: [0; 4],
            ccr5: 0,
            moe: false,
            start: 0,
            done: 0,
        }
    }
}

impl Tim1 {
    /// Whether it counts.
    pub fn is_enabled(&self) -> bool {
        self.enabled
    }

    /// Whether it has just begun to count, and nothing has happened since.
    pub fn is_fresh(&self) -> bool {
        self.enabled && self.fresh
    }

    /// Whether it has just begun to count from 0, the beginning of a period.
    pub fn has_begun(&self) -> bool {
        self.is_fresh() && self.done == 0
    }

    /// Moment of a count of this period.
    fn moment(&self, count: u32) -> Ticks {
        let ticks = u64::from(count) * u64::from(self.psc.1 + 1);
        self.start + cycles(ticks, self.clock)
    }

    fn count(&self, now: Ticks) -> u32 {
        if !self.enabled {
            return self.done;
        }
        let passed = whole(now - self.start, self.clock) / u64::from(self.psc.1 + 1);
        // Events up to now have happened, so this is within the period.
        (passed as u32).clamp(self.done, self.arr)
    }

    /// The next count at which something happens: a compare value, or one past the end.
    fn next_count(&self) -> u32 {
        let compares = self.ccr.iter().copied().chain([self.ccr5]);
        compares
            .filter(|count| *count > self.done && *count <= self.arr)
            .min()
            .unwrap_or(self.arr + 1)
    }

    /// When the next event is, and whether it is the beginning of a period.
    pub fn next(&self) -> Option<(Ticks, bool)> {
        let count = self.next_count();
        self.enabled.then(|| (self.moment(count), count > self.arr))
    }

    /// Lets the next event happen, if it is due. Returns it.
    pub fn advance(&mut self, now: Ticks) -> Option<Event> {
        let (at, update) = self.next().filter(|(at, _)| *at <= now)?;
        let count = self.next_count();
        self.fresh = false;
        if update {
            self.sr |= 1;
            self.start = at;
            self.done = 0;
            self.psc.1 = self.psc.0;
        } else {
            self.done = count;
        }
        let reached = self.done;
        let matches = (0..4).filter(|i| self.ccr[*i] == reached);
        let matches = matches.fold(0, |bits, i| bits | 1u32 << i);
        self.sr |= matches << 1 | u32::from(self.ccr5 == reached) << 16;
        self.dma |= matches & 1 != 0 && self.dier & CC1DE != 0;
        Some(Event {
            at,
            update,
            matches,
        })
    }

    /// Whether the first channel has a request to the DMA.
    pub fn requests_dma(&self) -> bool {
        self.dma
    }

    /// The DMA has taken that request.
    pub fn grant_dma(&mut self) {
        self.dma = false;
    }

    /// Whether the capture and compare interrupt is requested.
    pub fn requests(&self) -> bool {
        self.sr & self.dier & 0x1E != 0
    }

    /// OCxM of a channel, 0 to 3.
    fn mode(&self, channel: usize) -> u32 {
        let half = self.ccmr[channel / 2] >> (8 * (channel % 2));
        half >> 4 & 7 | (half >> 16 & 1) << 3
    }

    /// OCxREF before it is combined (38.4.8).
    fn reference(&self, channel: usize) -> bool {
        let below = self.done < self.ccr[channel];
        match self.mode(channel) {
            0b0110 | 0b1100 => below,
            0b0111 | 0b1101 => !below,
            _ => false,
        }
    }

    /// The level that a channel, 0 to 3, drives onto its pin.
    pub fn output(&self, channel: usize) -> Level {
        let ccer = self.ccer >> (4 * channel);
        if !self.moe || ccer & 1 == 0 {
            return Level::Floating;
        }
        let neighbour = channel ^ 1;
        let active = match self.mode(channel) {
            // Combined PWM mode 1: or; 2: and.
            0b1100 => self.reference(channel) || self.reference(neighbour),
            0b1101 => self.reference(channel) && self.reference(neighbour),
            _ => self.reference(channel),
        };
        Level::of(active != (ccer >> 1 & 1 != 0))
    }

    /// Reads a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32, now: Ticks) -> Result<u32, Refusal> {
        Ok(match offset {
            0x00 => u32::from(self.enabled),
            0x0C => self.dier,
            0x10 => self.sr,
            0x18 => self.ccmr[0],
            0x1C => self.ccmr[1],
            0x20 => self.ccer,
            0x24 => self.count(now),
            0x28 => self.psc.0,
            0x2C => self.arr,
            0x34..0x44 => self.ccr[((offset - 0x34) / 4) as usize],
            0x58 => self.ccr5,
            0x44 => u32::from(self.moe) << 15,
            _ => return unknown(),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled.
    pub fn write(&mut self, offset: u32, value: u32, now: Ticks) -> Result<(), Refusal> {
        match offset {
            0x00 => {
                let enable = only(value, 1)? != 0;
                if enable && !self.enabled {
                    self.fresh = true;
                    let passed = u64::from(self.done) * u64::from(self.psc.1 + 1);
                    self.start = now - cycles(passed, self.clock).min(now);
                } else if !enable {
                    self.done = self.count(now);
                }
                self.enabled = enable;
            }
            // CCxIE, CC1DE.
            0x0C => {
                self.dier = only(value, 0x1E | CC1DE)?;
                self.dma &= self.dier & CC1DE != 0;
            }
            // Flags are cleared by writing 0.
            0x10 => self.sr &= value,
            0x14 => {
                only(value, 1)?;
                self.sr |= 1;
                self.done = 0;
                self.start = now;
                self.psc.1 = self.psc.0;
            }
            // What lies below the count has happened.
            0x24 if !self.enabled => self.done = only(value, 0xFFFF)?,
            0x18 | 0x1C => {
                // CCxS = 0 and no preload: only OCxM.
                let value = only(value, 0x0101_7070)?;
                let slot = ((offset - 0x18) / 4) as usize;
                self.ccmr[slot] = value;
                for channel in [2 * slot, 2 * slot + 1] {
                    if ![0b0000, 0b0110, 0b0111, 0b1100, 0b1101].contains(&self.mode(channel)) {
                        return Err(format!("OC{}M = {:#b}", channel + 1, self.mode(channel)));
                    }
                }
            }
            // CCxE, CCxP.
            0x20 => self.ccer = only(value, 0x3333)?,
            0x28 => self.psc.0 = only(value, 0xFFFF)?,
            0x2C => {
                let arr = only(value, 0xFFFF)?;
                if self.enabled && arr < self.count(now) {
                    return Err("below the counter while it runs".to_owned());
                }
                self.arr = arr;
            }
            0x34..0x44 => {
                if self.enabled {
                    self.done = self.count(now);
                }
                self.ccr[((offset - 0x34) / 4) as usize] = only(value, 0xFFFF)?;
            }
            // No GC5Cx: channel 5 is in no other's reference.
            0x58 => {
                if self.enabled {
                    self.done = self.count(now);
                }
                self.ccr5 = only(value, 0xFFFF)?;
            }
            // MOE alone: no break inputs, no dead time.
            0x44 => self.moe = only(value, 1 << 15)? != 0,
            _ => return unknown(),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::SECOND;

    /// A period of 1,000 counts at 240 MHz as the board sets it: CONVST 100 long, interrupt
    /// at 300, LDAC from 600 to 700.
    fn running() -> Result<Tim1, Refusal> {
        let mut timer = Tim1 {
            clock: 240_000_000,
            ..Tim1::default()
        };
        for (offset, value) in [
            (0x2C, 999),
            (0x34, 100),
            (0x38, 300),
            (0x3C, 600),
            (0x40, 700),
            (0x18, 6 << 4),
            (0x1C, 5 << 4 | 1 << 16 | 6 << 12),
            (0x20, 1 | 3 << 8),
            (0x44, 1 << 15),
            (0x14, 1),
            (0x10, 0),
            (0x0C, 4),
            (0x00, 1),
        ] {
            timer.write(offset, value, 0)?;
        }
        Ok(timer)
    }

    /// 38.3.11 and 38.3.12 by hand.
    #[test]
    fn edges_of_a_period() -> Result<(), Refusal> {
        let mut timer = running()?;
        let mut edges = vec![(0, timer.output(0), timer.output(2))];
        let count = SECOND / 240_000_000;
        while let Some(event) = timer.advance(1000 * count) {
            edges.push((event.at / count, timer.output(0), timer.output(2)));
            assert_eq!(event.at % count, 0);
        }
        let (high, low) = (Level::High, Level::Low);
        let expected = [
            (0, high, high),
            (100, low, high),
            (300, low, high),
            (600, low, low),
            (700, low, high),
            (1000, high, high),
        ];
        assert_eq!(edges, expected);
        Ok(())
    }

    #[test]
    fn flags_and_counter() -> Result<(), Refusal> {
        let mut timer = running()?;
        let count = SECOND / 240_000_000;
        timer.advance(100 * count);
        assert!(!timer.requests());
        assert_eq!(timer.read(0x24, 299 * count + count / 2)?, 299);
        timer.advance(300 * count);
        assert!(timer.requests());
        assert_eq!(timer.read(0x24, 310 * count)?, 310);
        timer.write(0x10, !(1 << 2), 310 * count)?;
        assert!(!timer.requests());
        // Stopped, it keeps its count and level.
        timer.write(0x00, 0, 310 * count)?;
        assert_eq!(timer.next(), None);
        assert_eq!(timer.read(0x24, 500 * count)?, 310);
        assert_eq!(timer.output(2), Level::High);
        Ok(())
    }

    #[test]
    fn a_prescaler_counts_from_the_next_update() -> Result<(), Refusal> {
        let mut timer = running()?;
        let count = SECOND / 240_000_000;
        timer.write(0x28, 1, 0)?;
        assert_eq!(timer.next(), Some((100 * count, false)));
        timer.write(0x14, 1, 0)?;
        assert_eq!(timer.next(), Some((200 * count, false)));
        Ok(())
    }

    #[test]
    fn without_main_output_enable_nothing_is_driven() -> Result<(), Refusal> {
        let mut timer = running()?;
        timer.write(0x44, 0, 0)?;
        assert_eq!(timer.output(0), Level::Floating);
        assert_eq!(timer.output(1), Level::Floating);
        assert!(timer.write(0x44, 1 << 12, 0).is_err());
        Ok(())
    }
}
