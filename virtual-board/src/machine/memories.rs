//! The core's memories, as unicorn knows them: mapped for the run, protected by the MPU, or
//! answered by a callback.

use std::ffi::c_void;

use unicorn_engine::Prot;
use unicorn_engine::hook::uc_engine;

use super::Machine;
use super::emulator::{Core, Emulator, failed, state};
use super::hooks::bad_access;
use super::registers::masks;
use crate::bus::Bus;
use crate::memory::{AXI, Area};
use crate::peripherals::flash::{BANK, BANK_2};

/// Unit in which the emulator protects memory, bytes.
const PAGE: u32 = 4096;

/// The peripherals' registers begin here,
const PERIPHERALS: u32 = 0x4000_0000;

/// and those of the core here.
const CORE: u32 = 0xE000_0000;

/// What the emulator may ever allow. Bank 1 of the flash cannot be written in this model, and
/// data is not executed.
fn possible(area: Area) -> Prot {
    match area {
        Area::Flash => Prot::READ | Prot::EXEC,
        Area::Dtcm => Prot::READ | Prot::WRITE,
        Area::Itcm => Prot::ALL,
    }
}

impl Machine {
    /// Sets the emulator's permissions as the MPU has them.
    pub(super) fn protect(&mut self) {
        let masks = self.masks();
        let state = self.uc.state_mut();
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
                    (rights.write, Prot::WRITE),
                    (rights.execute, Prot::EXEC),
                ] {
                    if right && possible(area) & prot != Prot::NONE {
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
        // Where DTCM is protected, the address of a violation is wanted.
        let (start, size) = Area::Dtcm.range();
        let end = start + (size as u32 - 1);
        let whole = (start, size as u32, possible(Area::Dtcm));
        if !changes.contains(&whole)
            && let Err(error) = self.uc.at_bad_accesses(start..=end, bad_access)
        {
            self.bus_mut().refuse(error);
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

pub(super) fn map(emulator: &mut Emulator) -> Result<(), String> {
    for area in Area::ALL {
        let (start, size) = area.range();
        let pointer = emulator.state().bus.memory.pointer(area).cast();
        // SAFETY: the memory has this size and lives in the emulator's state, which is
        // dropped when nothing runs any more.
        unsafe { emulator.mem_map_ptr(u64::from(start), size as u64, possible(area), pointer) }
            .map_err(failed("memory"))?;
    }
    emulator.callback((AXI.0, AXI.1 as u32), read_axi, write_axi)?;
    emulator.callback((BANK_2, BANK as u32), read_flash, write_flash)?;
    emulator.callback(
        (PERIPHERALS, 0x2000_0000),
        read_register::<PERIPHERALS>,
        write_register::<PERIPHERALS>,
    )?;
    emulator.callback(
        (CORE, 0x10_0000),
        read_register::<CORE>,
        write_register::<CORE>,
    )
}

unsafe extern "C" fn read_axi(_: *mut uc_engine, offset: u64, size: u32, data: *mut c_void) -> u64 {
    // SAFETY: a callback's data.
    let axi = &unsafe { state(data) }.bus.memory.axi;
    let at = offset as usize;
    let bytes = axi.get(at..at + size as usize).unwrap_or(&[]);
    bytes
        .iter()
        .rev()
        .fold(0, |word, byte| word << 8 | u64::from(*byte))
}

unsafe extern "C" fn write_axi(
    _: *mut uc_engine,
    offset: u64,
    size: u32,
    value: u64,
    data: *mut c_void,
) {
    // SAFETY: a callback's data.
    let memory = &mut unsafe { state(data) }.bus.memory;
    memory.axi_writes += 1;
    let (at, size) = (offset as usize, size as usize);
    if let Some(bytes) = memory.axi.get_mut(at..at + size) {
        bytes.copy_from_slice(&value.to_le_bytes()[..size]);
    }
}

unsafe extern "C" fn read_register<const START: u32>(
    _: *mut uc_engine,
    offset: u64,
    size: u32,
    data: *mut c_void,
) -> u64 {
    // SAFETY: a callback's data.
    let state = unsafe { state(data) };
    let value = state.bus.read(START + offset as u32, size as usize);
    if state.bus.is_urgent() {
        state.wake = 0;
    }
    u64::from(value)
}

unsafe extern "C" fn write_register<const START: u32>(
    _: *mut uc_engine,
    offset: u64,
    size: u32,
    value: u64,
    data: *mut c_void,
) {
    // SAFETY: a callback's data.
    let state = unsafe { state(data) };
    state.wake = 0;
    state
        .bus
        .write(START + offset as u32, size as usize, value as u32);
}

/// The bus, for an access to the flash: it takes time and may change what is read next.
///
/// # Safety
/// As of [`state`].
unsafe fn at_flash<'a>(data: *mut c_void) -> &'a mut Bus {
    // SAFETY: as the caller's.
    let state = unsafe { state(data) };
    state.wake = 0;
    state.bus.accesses += 1;
    state.bus.unsteady += 1;
    &mut state.bus
}

unsafe extern "C" fn read_flash(
    uc: *mut uc_engine,
    offset: u64,
    size: u32,
    data: *mut c_void,
) -> u64 {
    // SAFETY: a callback's data.
    let bus = unsafe { at_flash(data) };
    let masks = masks(Core::of(uc));
    match bus
        .flash
        .read_memory(offset as usize, size as usize, bus.now)
    {
        Ok(data) => {
            bus.now = data.until;
            let ignored = bus.scb.ignores_bus_faults() && bus.nvic.execution_priority(masks) < 0;
            if data.fault && !ignored {
                bus.fault = Some(BANK_2 + offset as u32);
            }
            data.value
        }
        Err(why) => {
            bus.refuse(refused(offset, &why));
            0
        }
    }
}

unsafe extern "C" fn write_flash(
    _: *mut uc_engine,
    offset: u64,
    size: u32,
    value: u64,
    data: *mut c_void,
) {
    // SAFETY: a callback's data.
    let bus = unsafe { at_flash(data) };
    let done = bus
        .flash
        .write_memory(offset as usize, size as usize, value, bus.now);
    if let Err(why) = done {
        bus.refuse(refused(offset, &why));
    }
}

fn refused(offset: u64, why: &str) -> String {
    format!("flash at {:#010x}: {why}", u64::from(BANK_2) + offset)
}
