//! Running until something ends it, and faults of instructions (ARMv7-M ARM, B1.5.14).

use unicorn_engine::{MemType, RegisterARM as Reg, uc_error};

use super::Machine;
use crate::peripherals::nvic::{BUS_FAULT, MEM_MANAGE, SV_CALL, USAGE_FAULT};
use crate::peripherals::scb::{
    BFARVALID, DACCVIOL, FORCED, IACCVIOL, IBUSERR, INVSTATE, MMARVALID, PRECISERR, UNDEFINSTR,
};

/// What unicorn calls an exception of the core (QEMU's numbers).
mod trap {
    pub const SWI: u32 = 2;
    pub const PREFETCH_ABORT: u32 = 3;
    pub const DATA_ABORT: u32 = 4;
    pub const EXCEPTION_EXIT: u32 = 8;
    pub const INVSTATE: u32 = 18;
}

impl Machine {
    /// Runs instructions until there is something to do between two of them.
    pub(super) fn step_in(&mut self) {
        let state = self.uc.state_mut();
        state.wake = 0;
        state.stopping = 0;
        state.trap = None;
        state.bad_access = None;
        let begin = u64::from(self.pc | 1);
        let outcome = self.uc.emu_start(begin, 0, 0, 0);
        self.pc = self.get(Reg::PC);
        let state = self.uc.state_mut();
        if let Some(calls) = state.stopping.checked_sub(1) {
            // All but the last of the instructions of an IT block ran.
            let ran = u64::from(calls);
            state.instructions += ran;
            state.bus.now += ran * state.bus.ticks.0;
        }
        let trap = state.trap.take();
        let bad_access = state.bad_access.take();
        match (outcome, trap) {
            _ if self.pc >= 0xFFFF_FF00 => self.leave(self.pc | 1),
            (Ok(()), None) if self.bus().fault.is_some() => {
                let address = self.bus_mut().fault.take();
                // The instruction is over, but it has only read: it is given again.
                self.pc = self.bus().pc;
                self.bus_fault(PRECISERR, address);
            }
            (Ok(()), None) if self.uc.state().stopping == 0 => self.asleep = true,
            (Ok(()), None) => {}
            (_, Some(trap::EXCEPTION_EXIT)) => self.leave(self.pc | 1),
            (_, Some(trap::SWI)) => self.bus_mut().nvic.set_pending(SV_CALL, true),
            (_, Some(trap::PREFETCH_ABORT)) => self.mpu_fault(IACCVIOL, None),
            (_, Some(trap::DATA_ABORT)) => {
                self.bus_mut()
                    .refuse("a data abort of unknown cause".to_owned());
            }
            (_, Some(trap::INVSTATE)) => self.fault(USAGE_FAULT, INVSTATE),
            (_, Some(number)) => {
                self.bus_mut()
                    .refuse(format!("the emulator's exception {number}"));
            }
            (Err(error), None) => self.failed(error, bad_access),
        }
    }

    /// An instruction could not be carried out.
    fn failed(&mut self, error: uc_error, bad_access: Option<(MemType, u32)>) {
        let address = bad_access.map(|(_, address)| address);
        match error {
            uc_error::INSN_INVALID => self.fault(USAGE_FAULT, UNDEFINSTR),
            uc_error::EXCEPTION => self.fault(USAGE_FAULT, INVSTATE),
            uc_error::FETCH_UNMAPPED => self.bus_fault(IBUSERR, None),
            uc_error::READ_UNMAPPED | uc_error::WRITE_UNMAPPED => {
                self.bus_fault(PRECISERR, address);
            }
            // The flash of bank 1 is the only memory that cannot be written.
            uc_error::WRITE_PROT if address.is_some_and(|at| at >> 20 == 0x080) => {
                self.bus_mut()
                    .refuse("a write to bank 1 of the flash".to_owned());
            }
            uc_error::FETCH_PROT => self.fetch_forbidden(),
            uc_error::READ_PROT | uc_error::WRITE_PROT => self.mpu_fault(DACCVIOL, address),
            _ => self.bus_mut().refuse(format!("the emulator: {error:?}")),
        }
    }

    /// A fault of the instruction at the present address, with its bits in CFSR.
    pub(super) fn fault(&mut self, number: u16, cause: u32) {
        let masks = self.masks();
        let bus = self.bus_mut();
        bus.scb.cfsr |= cause;
        match bus.nvic.escalate(number, masks) {
            Some(taken) => {
                if taken != number {
                    bus.scb.hfsr |= FORCED;
                }
                bus.nvic.set_pending(taken, true);
            }
            None => self.locked = true,
        }
    }
    /// By the MPU, or because the emulator is never to execute this memory.
    fn fetch_forbidden(&mut self) {
        let above = self.bus().nvic.execution_priority(self.masks()) < 0;
        if self.bus().mpu.rights(self.pc, above).execute {
            let at = self.pc;
            self.bus_mut()
                .refuse(format!("code in data, at {at:#010x}"));
        } else {
            self.mpu_fault(IACCVIOL, None);
        }
    }

    fn bus_fault(&mut self, cause: u32, address: Option<u32>) {
        let masks = self.masks();
        let bus = self.bus_mut();
        let above = bus.nvic.execution_priority(masks) < 0;
        if let Some(address) = address {
            if bus.scb.ignores_bus_faults() && above {
                bus.refuse(format!("an ignored bus fault at {address:#010x}"));
                return;
            }
            bus.scb.bfar = address;
            bus.scb.cfsr |= BFARVALID;
        }
        self.fault(BUS_FAULT, cause);
    }

    fn mpu_fault(&mut self, cause: u32, address: Option<u32>) {
        let bus = self.bus_mut();
        if let Some(address) = address {
            bus.scb.mmfar = address;
            bus.scb.cfsr |= MMARVALID;
        }
        self.fault(MEM_MANAGE, cause);
    }
}
