//! The core's registers.

use unicorn_engine::RegisterARM as Reg;

use super::Machine;
use super::emulator::Core;
use crate::peripherals::nvic::Masks;

impl Machine {
    pub(super) fn get(&self, register: Reg) -> u32 {
        self.uc.core().get(register) as u32
    }

    pub(super) fn set(&mut self, register: Reg, value: u32) {
        if self.uc.reg_write(register, u64::from(value)).is_err() {
            self.bus_mut()
                .refuse(format!("the emulator has no register {register:?}"));
        }
    }

    /// A register by its number, 0 to 15, or the next instruction's address for 15.
    pub fn register(&self, number: u8) -> u32 {
        match number {
            15 => self.pc,
            _ => self.get(general(number)),
        }
    }

    /// Sets a register, 0 to 15.
    pub fn set_register(&mut self, number: u8, value: u32) {
        match number {
            15 => self.pc = value & !1,
            _ => self.set(general(number), value),
        }
        self.bus_mut();
    }

    /// The mask registers.
    pub fn masks(&self) -> Masks {
        masks(self.uc.core())
    }
}

/// R0 to R12, SP, LR.
pub(super) fn general(number: u8) -> Reg {
    const ALL: [Reg; 15] = [
        Reg::R0,
        Reg::R1,
        Reg::R2,
        Reg::R3,
        Reg::R4,
        Reg::R5,
        Reg::R6,
        Reg::R7,
        Reg::R8,
        Reg::R9,
        Reg::R10,
        Reg::R11,
        Reg::R12,
        Reg::SP,
        Reg::LR,
    ];
    ALL[usize::from(number.min(14))]
}

pub(super) fn masks(core: Core) -> Masks {
    let get = |register| core.get(register) as u32;
    Masks {
        primask: get(Reg::PRIMASK) & 1 != 0,
        faultmask: get(Reg::FAULTMASK) & 1 != 0,
        basepri: get(Reg::BASEPRI) as u8,
    }
}
