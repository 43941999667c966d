//! The core's memories, as unicorn knows them: mapped for the run, protected by the MPU, or
//! answered by a callback.

use unicorn_engine::{Prot, Unicorn};

use super::registers::masks;
use super::{Machine, State, failed};
use crate::memory::{AXI, Area};
use crate::peripherals::flash::{BANK, BANK_2};

/// Unit in which the emulator protects memory, bytes.
const PAGE: u32 = 4096;

impl Machine {
    /// Sets the emulator's permissions as the MPU has them.
    pub(super) fn protect(&mut self) {
        let masks = self.masks();
        let state = self.uc.get_data_mut();
        state.bus.mpu_changed = false;
        let above = state.bus.nvic.execution_priority(masks) < 0;
        let mut changes = Vec::new();
        for area in Area::ALL {
            let (start, size) = area.range();
            for page in (start..start + size as u32).step_by(PAGE as usize) {
                let rights = state.bus.mpu.rights(page, above);
                let mut allowed = Prot::NONE;
                for (right, prot) in [
                    (rights.read, Prot::READ),
                    (rights.write && area != Area::Flash, Prot::WRITE),
                    (rights.execute, Prot::EXEC),
                ] {
                    if right {
                        allowed |= prot;
                    }
                }
                match changes.last_mut() {
                    Some((_, size, last)) if *last == allowed && page != start => *size += PAGE,
                    _ => changes.push((page, PAGE, allowed)),
                }
            }
        }
        if std::mem::replace(&mut state.protected, changes.clone()) == changes {
            return;
        }
        for (start, size, allowed) in changes {
            let done = self
                .uc
                .mem_protect(u64::from(start), u64::from(size), allowed);
            if let Err(error) = done {
                self.bus_mut().refuse(format!("the emulator: {error:?}"));
            }
        }
    }
}

pub(super) fn map(uc: &mut Unicorn<'static, State>) -> Result<(), String> {
    for area in Area::ALL {
        let (start, size) = area.range();
        let allowed = if area == Area::Flash {
            Prot::READ | Prot::EXEC
        } else {
            Prot::ALL
        };
        let pointer = uc.get_data().bus.memory.pointer(area).cast();
        // SAFETY: the memory has this size and lives in the emulator's data, which is
        // dropped when nothing runs any more.
        unsafe { uc.mem_map_ptr(u64::from(start), size as u64, allowed, pointer) }
            .map_err(failed("memory"))?;
    }
    uc.mmio_map(
        u64::from(AXI.0),
        AXI.1 as u64,
        Some(|uc: &mut Unicorn<'_, State>, offset: u64, size: usize| {
            let axi = &uc.get_data().bus.memory.axi;
            let bytes = axi
                .get(offset as usize..offset as usize + size)
                .unwrap_or(&[]);
            bytes
                .iter()
                .rev()
                .fold(0, |word, byte| word << 8 | u64::from(*byte))
        }),
        Some(
            |uc: &mut Unicorn<'_, State>, offset: u64, size: usize, value: u64| {
                let memory = &mut uc.get_data_mut().bus.memory;
                memory.axi_writes += 1;
                let at = offset as usize;
                if let Some(bytes) = memory.axi.get_mut(at..at + size) {
                    bytes.copy_from_slice(&value.to_le_bytes()[..size]);
                }
            },
        ),
    )
    .map_err(failed("AXI SRAM"))?;
    uc.mmio_map(
        u64::from(BANK_2),
        BANK as u64,
        Some(|uc: &mut Unicorn<'_, State>, offset: u64, size: usize| {
            read_flash(uc, offset as usize, size)
        }),
        Some(
            |uc: &mut Unicorn<'_, State>, offset: u64, size: usize, value: u64| {
                let state = uc.get_data_mut();
                let bus = &mut state.bus;
                bus.accesses += 1;
                bus.unsteady += 1;
                state.wake = 0;
                if let Err(why) = bus
                    .flash
                    .write_memory(offset as usize, size, value, bus.now)
                {
                    bus.refuse(format!(
                        "flash at {:#010x}: {why}",
                        u64::from(BANK_2) + offset
                    ));
                }
            },
        ),
    )
    .map_err(failed("bank 2"))?;
    for (start, size) in [(0x4000_0000u64, 0x2000_0000u64), (0xE000_0000, 0x0010_0000)] {
        uc.mmio_map(
            start,
            size,
            Some(
                move |uc: &mut Unicorn<'_, State>, offset: u64, size: usize| {
                    let state = uc.get_data_mut();
                    let value = state.bus.read((start + offset) as u32, size);
                    if state.bus.is_urgent() {
                        state.wake = 0;
                    }
                    u64::from(value)
                },
            ),
            Some(
                move |uc: &mut Unicorn<'_, State>, offset: u64, size: usize, value: u64| {
                    let state = uc.get_data_mut();
                    state.wake = 0;
                    state.bus.write((start + offset) as u32, size, value as u32);
                },
            ),
        )
        .map_err(failed("peripherals"))?;
    }
    Ok(())
}

fn read_flash(uc: &mut Unicorn<'_, State>, offset: usize, size: usize) -> u64 {
    let masks = masks(uc);
    let state = uc.get_data_mut();
    let bus = &mut state.bus;
    bus.accesses += 1;
    bus.unsteady += 1;
    state.wake = 0;
    match bus.flash.read_memory(offset, size, bus.now) {
        Ok(data) => {
            bus.now = data.until;
            let ignored = bus.scb.ignores_bus_faults() && bus.nvic.execution_priority(masks) < 0;
            if data.fault && !ignored {
                bus.fault = Some(BANK_2 + offset as u32);
            }
            data.value
        }
        Err(why) => {
            bus.refuse(format!(
                "flash at {:#010x}: {why}",
                BANK_2 as usize + offset
            ));
            0
        }
    }
}
