//! Entry to and return from exceptions (ARMv7-M ARM, B1.5.6 to B1.5.8), lockup (B1.5.15).
//!
//! A frame with floating-point registers is written at once; the hardware may do it lazily
//! (FPCCR.LSPEN), which a program can tell only by the time it takes.

use unicorn_engine::RegisterARM as Reg;

use super::Machine;
use crate::peripherals::nvic::{BUS_FAULT, HARD_FAULT, IRQ, USAGE_FAULT};
use crate::peripherals::scb::{FORCED, INVPC, STKERR, UNSTKERR, VECTTBL};
use crate::peripherals::tim1::CC_IRQ;
use crate::time::{Cost, Ticks};

/// Words of a frame without and with floating-point registers.
const FRAME: [u32; 2] = [8, 26];

/// Bit of the stacked xPSR that says that the stack was aligned by a word.
const ALIGNED: u32 = 1 << 9;

/// CONTROL.FPCA: there is floating-point context.
const FPCA: u32 = 1 << 2;

/// CONTROL.SPSEL: thread mode uses PSP.
const SPSEL: u32 = 1 << 1;

/// The registers of the first part of a frame, without the return address and xPSR.
const CALLER: [Reg; 6] = [Reg::R0, Reg::R1, Reg::R2, Reg::R3, Reg::R12, Reg::LR];

impl Machine {
    fn cycles(&self, cycles: f64) -> Ticks {
        (cycles * self.bus().ticks.2 as f64).round() as Ticks
    }

    /// Takes an exception. The next instruction is that of the handler.
    pub(super) fn enter(&mut self, number: u16) {
        let taken = self.bus().now;
        let control = self.get(Reg::CONTROL);
        let handler = self.bus().nvic.depth() > 0;
        let process = !handler && control & SPSEL != 0;
        let float = control & FPCA != 0;
        let pointer = if process { Reg::PSP } else { Reg::MSP };
        let stack = self.get(pointer);
        let size = 4 * FRAME[usize::from(float)];
        let aligns = self.bus().scb.aligns_stack() || float;
        let frame = stack.wrapping_sub(size) & if aligns { !7 } else { !3 };
        let mut xpsr = self.get(Reg::XPSR);
        // Its number is that of the exception that runs, which unicorn keeps in IPSR.
        xpsr = xpsr & !ALIGNED & !0x1FF | u32::from(self.bus().nvic.running());
        if frame.wrapping_add(size) != stack {
            xpsr |= ALIGNED;
        }
        let mut words: Vec<u32> = CALLER.iter().map(|register| self.get(*register)).collect();
        words.extend([self.pc, xpsr]);
        if float {
            words.extend((0..16).map(|i| self.single(i)));
            words.extend([self.get(Reg::FPSCR), 0]);
        }
        let written = words
            .iter()
            .zip((frame..).step_by(4))
            .all(|(word, at)| self.push(at, *word));
        self.set(pointer, frame);
        if !written {
            self.bus_mut().scb.cfsr |= STKERR;
            // The handler of a hard fault runs without a frame; any other has to wait for
            // the bus fault, which without a handler is a hard fault (B1.5.8).
            if number != HARD_FAULT {
                let masks = self.masks();
                match self.bus().nvic.escalate(BUS_FAULT, masks) {
                    Some(fault) => {
                        let bus = self.bus_mut();
                        bus.scb.hfsr |= if fault == HARD_FAULT { FORCED } else { 0 };
                        bus.nvic.set_pending(fault, true);
                        self.begin(fault, handler, process, float, taken);
                    }
                    None => self.locked = true,
                }
                return;
            }
        }
        self.begin(number, handler, process, float, taken);
    }

    /// Starts the handler, with the frame written.
    fn begin(&mut self, number: u16, handler: bool, process: bool, float: bool, taken: Ticks) {
        let entry = self.cycles(Cost::ENTRY);
        let link = match (handler, process) {
            (true, _) => 0xFFFF_FFF1,
            (false, false) => 0xFFFF_FFF9,
            (false, true) => 0xFFFF_FFFD,
        };
        let link = if float { link & !0x10 } else { link };
        let bus = self.bus_mut();
        bus.now += entry;
        bus.nvic.enter(number);
        let vector = bus.scb.vtor.wrapping_add(4 * u32::from(number));
        let address = bus.memory.word(vector);
        if number == IRQ + CC_IRQ {
            let first = bus.now;
            bus.counts.entered(taken, first);
        }
        // Handler mode uses MSP; no floating-point context yet.
        self.set(Reg::IPSR, u32::from(number));
        let control = self.get(Reg::CONTROL);
        self.set(Reg::CONTROL, control & !FPCA & !SPSEL);
        self.set(Reg::LR, link);
        match address {
            // Without the Thumb bit the first instruction is a fault.
            Some(address) => self.pc = address & !1,
            None if number == HARD_FAULT => self.locked = true,
            None => {
                self.bus_mut().scb.hfsr |= VECTTBL;
                self.fault(HARD_FAULT, 0);
            }
        }
    }

    /// Returns from an exception: a branch to one of the values that entry puts into LR.
    pub(super) fn leave(&mut self, value: u32) {
        let number = self.bus().nvic.running();
        let (to_thread, process) = (value & 8 != 0, value & 4 != 0);
        let float = value & 0x10 == 0;
        let good = number != 0
            && value | 0x1C == 0xFFFF_FFFD
            && to_thread == (self.bus().nvic.depth() == 1)
            && (to_thread || !process);
        if !good {
            self.fault(USAGE_FAULT, INVPC);
            return;
        }
        let cost = self.cycles(Cost::RETURN);
        let bus = self.bus_mut();
        bus.now += cost;
        bus.nvic.leave(number);
        let now = bus.now;
        if number == IRQ + CC_IRQ {
            bus.counts.left(now);
        }
        if number != 2 {
            self.set(Reg::FAULTMASK, 0);
        }
        let pointer = if process { Reg::PSP } else { Reg::MSP };
        let frame = self.get(pointer);
        let size = FRAME[usize::from(float)];
        let words: Option<Vec<u32>> = (0..size)
            .map(|i| self.bus().memory.word(frame.wrapping_add(4 * i)))
            .collect();
        let Some(words) = words else {
            self.fault(BUS_FAULT, UNSTKERR);
            return;
        };
        for (register, word) in CALLER.into_iter().zip(&words) {
            self.set(register, *word);
        }
        let xpsr = words[7];
        if float {
            for (i, word) in (0..16).zip(&words[8..]) {
                self.set_single(i, *word);
            }
            self.set(Reg::FPSCR, words[24]);
        }
        let aligned = 4 * u32::from(xpsr & ALIGNED != 0);
        self.set(pointer, frame.wrapping_add(4 * size + aligned));
        self.set(Reg::IPSR, xpsr & 0x1FF);
        self.set(Reg::XPSR_NZCVQG, xpsr & !ALIGNED);
        // After IPSR: in handler mode SPSEL cannot be written.
        let control = self.get(Reg::CONTROL) & !FPCA & !SPSEL;
        let select = if process { SPSEL } else { 0 };
        let context = if float { FPCA } else { 0 };
        self.set(Reg::CONTROL, control | select | context);
        self.pc = words[6] & !1;
        let expected = self.bus().nvic.running();
        if xpsr & 0x1FF != u32::from(expected) {
            self.fault(USAGE_FAULT, INVPC);
        }
    }

    fn push(&mut self, address: u32, word: u32) -> bool {
        self.bus_mut().memory.write(address, &word.to_le_bytes())
    }

    /// A single-precision register, half of a double one.
    fn single(&self, number: u8) -> u32 {
        let pair = self.uc.core().get(DOUBLES[usize::from(number / 2)]);
        (pair >> (32 * (number % 2))) as u32
    }

    fn set_single(&mut self, number: u8, value: u32) {
        let register = DOUBLES[usize::from(number / 2)];
        let pair = self.uc.core().get(register);
        let shift = 32 * (number % 2);
        let pair = pair & !(0xFFFF_FFFF << shift) | u64::from(value) << shift;
        if self.uc.reg_write(register, pair).is_err() {
            self.bus_mut()
                .refuse("the emulator has no floating-point registers".to_owned());
        }
    }
}

const DOUBLES: [Reg; 8] = [
    Reg::D0,
    Reg::D1,
    Reg::D2,
    Reg::D3,
    Reg::D4,
    Reg::D5,
    Reg::D6,
    Reg::D7,
];
