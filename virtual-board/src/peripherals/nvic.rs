//! Exceptions: what is pending, enabled and active, and who goes first (ARMv7-M ARM, B1.5,
//! and B3.4 for the registers of the NVIC).

use super::{Refusal, Register, only, unknown};

/// Number of HardFault.
pub const HARD_FAULT: u16 = 3;
/// Number of NMI.
pub const NMI: u16 = 2;
/// Number of MemManage.
pub const MEM_MANAGE: u16 = 4;
/// Number of BusFault.
pub const BUS_FAULT: u16 = 5;
/// Number of UsageFault.
pub const USAGE_FAULT: u16 = 6;
/// Number of SVCall.
pub const SV_CALL: u16 = 11;
/// Number of PendSV.
pub const PEND_SV: u16 = 14;
/// Number of the first interrupt.
pub const IRQ: u16 = 16;

/// Interrupts of an STM32H743 (RM0433, table 147).
const INTERRUPTS: u16 = 150;

/// All exceptions.
const COUNT: usize = (IRQ + INTERRUPTS) as usize;

/// Of the eight bits of a priority the STM32H7 has the upper four.
const PRIORITY: u8 = 0xF0;

/// Registers, as offsets from 0xE000E000.
pub const REGISTERS: [Register; 5] = [
    (0x100, "NVIC_ISER0"),
    (0x180, "NVIC_ICER0"),
    (0x200, "NVIC_ISPR0"),
    (0x280, "NVIC_ICPR0"),
    (0x400, "NVIC_IPR0"),
];

/// The core's mask registers (B1.4.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Masks {
    /// PRIMASK: only faults and NMI.
    pub primask: bool,
    /// FAULTMASK: only NMI.
    pub faultmask: bool,
    /// BASEPRI: only those of a higher priority; 0 masks nothing.
    pub basepri: u8,
}

/// The state of all exceptions.
pub struct Nvic {
    enabled: [bool; COUNT],
    pending: [bool; COUNT],
    /// Interrupt lines that are high now.
    lines: [bool; COUNT],
    priority: [u8; COUNT],
    /// Active exceptions, the one that runs last.
    active: Vec<u16>,
    /// AIRCR.PRIGROUP.
    pub prigroup: u8,
    /// How many are pending, so that there is usually nothing to search.
    waiting: u32,
}

impl Default for Nvic {
    fn default() -> Self {
        let mut enabled = [false; COUNT];
        // Those of the core are always on, but for the three faults of SHCSR.
        enabled[..usize::from(IRQ)].fill(true);
        enabled[usize::from(MEM_MANAGE)..=usize::from(USAGE_FAULT)].fill(false);
        Self {
            enabled,
            pending: [false; COUNT],
            lines: [false; COUNT],
            priority: [0; COUNT],
            active: Vec::new(),
            prigroup: 0,
            waiting: 0,
        }
    }
}

impl Nvic {
    /// Sets or clears an exception's pending state.
    pub fn set_pending(&mut self, number: u16, pending: bool) {
        let slot = &mut self.pending[usize::from(number)];
        if *slot != pending {
            *slot = pending;
            self.waiting = self
                .waiting
                .wrapping_add_signed(if pending { 1 } else { -1 });
        }
    }

    /// Whether an exception is pending.
    pub fn is_pending(&self, number: u16) -> bool {
        self.pending[usize::from(number)]
    }

    /// Whether any is pending.
    pub fn waits(&self) -> bool {
        self.waiting != 0
    }

    /// Turns one of the three faults of SHCSR on or off.
    pub fn enable(&mut self, number: u16, enabled: bool) {
        self.enabled[usize::from(number)] = enabled;
    }

    /// Whether an exception is enabled.
    pub fn is_enabled(&self, number: u16) -> bool {
        self.enabled[usize::from(number)]
    }

    /// An interrupt's line. While it is high the interrupt is pending, unless its handler
    /// runs; and again when that returns.
    pub fn line(&mut self, irq: u16, high: bool) {
        let number = IRQ + irq;
        let rose = high && !self.lines[usize::from(number)];
        self.lines[usize::from(number)] = high;
        if rose || high && !self.is_active(number) {
            self.set_pending(number, true);
        }
    }

    /// Whether an exception is active.
    pub fn is_active(&self, number: u16) -> bool {
        self.active.contains(&number)
    }

    /// The exception that runs, 0 in thread mode.
    pub fn running(&self) -> u16 {
        self.active.last().copied().unwrap_or(0)
    }

    /// How many exceptions are active.
    pub fn depth(&self) -> usize {
        self.active.len()
    }

    /// An exception's priority: the smaller goes first.
    fn priority(&self, number: u16) -> i16 {
        match number {
            1 => -3,
            2 => -2,
            HARD_FAULT => -1,
            _ => i16::from(self.priority[usize::from(number)]),
        }
    }

    /// The part of a priority that decides on preemption (B1.5.4).
    fn group(&self, priority: i16) -> i16 {
        if priority < 0 {
            priority
        } else {
            priority & !((2 << self.prigroup) - 1)
        }
    }

    /// What runs now has this priority; 256 if nothing does (B1.5.4, execution priority).
    pub fn execution_priority(&self, masks: Masks) -> i16 {
        let active = self.active.iter().map(|n| self.group(self.priority(*n)));
        let mut priority = active.min().unwrap_or(256);
        if masks.basepri != 0 {
            priority = priority.min(self.group(i16::from(masks.basepri)));
        }
        if masks.primask {
            priority = priority.min(0);
        }
        if masks.faultmask {
            priority = priority.min(-1);
        }
        priority
    }

    /// The enabled pending exception that goes first, if any does.
    fn first(&self) -> Option<u16> {
        if self.waiting == 0 {
            return None;
        }
        (1..COUNT as u16)
            .filter(|n| self.is_pending(*n) && self.is_enabled(*n))
            .min_by_key(|n| (self.priority(*n), *n))
    }

    /// Whether an enabled exception is pending, masked or not.
    pub fn wants(&self) -> bool {
        self.first().is_some()
    }

    /// Whether the pending exception that goes first is above what is active, so that only
    /// the masks decide whether it is taken now.
    pub fn may_preempt(&self) -> bool {
        self.take(Masks::default()).is_some()
    }

    /// The exception to take now, if there is one.
    pub fn take(&self, masks: Masks) -> Option<u16> {
        let first = self.first()?;
        let group = self.group(self.priority(first));
        (group < self.execution_priority(masks)).then_some(first)
    }

    /// Whether an enabled exception that is not active would have to wait if it came now.
    pub fn holds_back(&self, number: u16, masks: Masks) -> bool {
        self.is_enabled(number)
            && !self.is_active(number)
            && self.group(self.priority(number)) >= self.execution_priority(masks)
    }

    /// A fault's exception: itself, or HardFault if it is off or not above what runs.
    /// None: the core locks up (B1.5.14, B1.5.15).
    pub fn escalate(&self, fault: u16, masks: Masks) -> Option<u16> {
        let running = self.execution_priority(masks);
        if self.is_enabled(fault) && self.group(self.priority(fault)) < running {
            return Some(fault);
        }
        (running > -1).then_some(HARD_FAULT)
    }

    /// An exception begins.
    pub fn enter(&mut self, number: u16) {
        self.set_pending(number, false);
        self.active.push(number);
    }

    /// An exception ends. False if it was not active.
    pub fn leave(&mut self, number: u16) -> bool {
        let Some(at) = self.active.iter().rposition(|n| *n == number) else {
            return false;
        };
        self.active.remove(at);
        if self.lines[usize::from(number)] {
            self.set_pending(number, true);
        }
        true
    }

    /// Reads a register of the NVIC.
    ///
    /// # Errors
    /// If there is none at this offset.
    pub fn read(&self, offset: u32, size: usize) -> Result<u32, Refusal> {
        let word = |flags: &[bool; COUNT], first: u32| {
            (0..32).fold(0, |word, bit| {
                let number = usize::from(IRQ) + (first * 32 + bit) as usize;
                word | u32::from(flags.get(number).copied().unwrap_or(false)) << bit
            })
        };
        match (offset, size) {
            (0x100..0x114, 4) => Ok(word(&self.enabled, (offset - 0x100) / 4)),
            (0x180..0x194, 4) => Ok(word(&self.enabled, (offset - 0x180) / 4)),
            (0x200..0x214, 4) => Ok(word(&self.pending, (offset - 0x200) / 4)),
            (0x280..0x294, 4) => Ok(word(&self.pending, (offset - 0x280) / 4)),
            (0x400..0x496, 1) => Ok(u32::from(self.priority[(offset - 0x400 + 16) as usize])),
            _ => unknown(),
        }
    }

    /// Writes a register of the NVIC.
    ///
    /// # Errors
    /// If there is none at this offset.
    pub fn write(&mut self, offset: u32, size: usize, value: u32) -> Result<(), Refusal> {
        let numbers = |first: u32| {
            (0..32u32)
                .filter(move |bit| value >> bit & 1 != 0)
                .map(move |bit| IRQ + (first * 32 + bit) as u16)
                .filter(|number| usize::from(*number) < COUNT)
        };
        match (offset, size) {
            (0x100..0x114, 4) => {
                numbers((offset - 0x100) / 4).for_each(|n| self.enable(n, true));
            }
            (0x180..0x194, 4) => {
                numbers((offset - 0x180) / 4).for_each(|n| self.enable(n, false));
            }
            (0x200..0x214, 4) => {
                numbers((offset - 0x200) / 4).for_each(|n| self.set_pending(n, true));
            }
            (0x280..0x294, 4) => {
                for n in numbers((offset - 0x280) / 4) {
                    self.set_pending(n, self.lines[usize::from(n)]);
                }
            }
            (0x400..0x496, 1) => self.set_priority((offset - 0x400) as u16 + IRQ, value as u8),
            _ => return unknown(),
        }
        Ok(())
    }

    /// Reads ICSR (B3.2.4).
    pub fn icsr(&self) -> u32 {
        let first = self.first().unwrap_or(0);
        let isr = (IRQ..COUNT as u16).any(|n| self.is_pending(n));
        u32::from(self.running())
            | u32::from(self.active.len() <= 1) << 11
            | u32::from(first) << 12
            | u32::from(isr) << 22
            | u32::from(self.is_pending(PEND_SV)) << 28
    }

    /// Writes ICSR.
    ///
    /// # Errors
    /// If it sets a bit that is not modelled.
    pub fn set_icsr(&mut self, value: u32) -> Result<(), Refusal> {
        only(value, 1 << 28 | 1 << 27)?;
        if value >> 28 & 1 != 0 {
            self.set_pending(PEND_SV, true);
        }
        if value >> 27 & 1 != 0 {
            self.set_pending(PEND_SV, false);
        }
        Ok(())
    }

    /// Sets an exception's priority (SHPR, IPR).
    pub fn set_priority(&mut self, number: u16, priority: u8) {
        self.priority[usize::from(number)] = priority & PRIORITY;
    }

    /// An exception's priority as its register reads.
    pub fn priority_register(&self, number: u16) -> u8 {
        self.priority[usize::from(number)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: Masks = Masks {
        primask: false,
        faultmask: false,
        basepri: 0,
    };

    fn with(priorities: &[(u16, u8)]) -> Nvic {
        let mut nvic = Nvic::default();
        for (irq, priority) in priorities {
            nvic.set_priority(IRQ + irq, *priority);
            nvic.enable(IRQ + irq, true);
        }
        nvic
    }

    /// B1.5.4: the smaller number first, then the smaller exception number; only a higher
    /// group preempts.
    #[test]
    fn who_goes_first() {
        let mut nvic = with(&[(1, 0x20), (2, 0x10), (3, 0x10)]);
        for irq in [1, 2, 3] {
            nvic.line(irq, true);
        }
        assert_eq!(nvic.take(NONE), Some(IRQ + 2));
        nvic.enter(IRQ + 2);
        assert_eq!(nvic.take(NONE), None);
        nvic.line(2, false);
        assert!(nvic.leave(IRQ + 2));
        assert_eq!(nvic.take(NONE), Some(IRQ + 3));
        // With PRIGROUP 5 the upper two bits decide: 0x10 and 0x20 are one group.
        nvic.enter(IRQ + 3);
        nvic.prigroup = 5;
        nvic.set_priority(IRQ + 1, 0);
        assert_eq!(nvic.take(NONE), None);
        nvic.prigroup = 0;
        assert_eq!(nvic.take(NONE), Some(IRQ + 1));
    }

    #[test]
    fn masks() {
        let mut nvic = with(&[(1, 0x40)]);
        nvic.line(1, true);
        let masked = |basepri| nvic.take(Masks { basepri, ..NONE }).is_none();
        assert_eq!(
            [0, 0x30, 0x40, 0x50].map(masked),
            [false, true, true, false]
        );
        let primask = Masks {
            primask: true,
            ..NONE
        };
        let faultmask = Masks {
            faultmask: true,
            ..NONE
        };
        assert_eq!(nvic.take(primask), None);
        assert_eq!(nvic.escalate(BUS_FAULT, primask), Some(HARD_FAULT));
        assert_eq!(nvic.escalate(BUS_FAULT, faultmask), None);
        nvic.enable(BUS_FAULT, true);
        assert_eq!(nvic.escalate(BUS_FAULT, NONE), Some(BUS_FAULT));
        nvic.enter(HARD_FAULT);
        assert_eq!(nvic.escalate(BUS_FAULT, NONE), None);
    }

    /// A level that stays high comes again after the return, a pulse does not.
    #[test]
    fn levels_and_pulses() {
        let mut nvic = with(&[(1, 0)]);
        nvic.line(1, true);
        nvic.enter(IRQ + 1);
        nvic.line(1, true);
        assert!(!nvic.is_pending(IRQ + 1));
        nvic.leave(IRQ + 1);
        assert_eq!(nvic.take(NONE), Some(IRQ + 1));
        nvic.enter(IRQ + 1);
        nvic.line(1, false);
        nvic.leave(IRQ + 1);
        assert_eq!(nvic.take(NONE), None);
    }
}
