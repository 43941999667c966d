//! What happens before every instruction.

use std::ffi::c_void;

use unicorn_engine::hook::uc_engine;
use unicorn_engine::{MemType, Prot, TlbEntry};

use super::State;
use super::emulator::{Core, Emulator, state};
use super::registers::masks;
use crate::memory::Area;
use crate::peripherals::nvic::IRQ;
use crate::peripherals::tim1::CC_IRQ;
use crate::time::Ticks;

pub(super) fn hook(emulator: &mut Emulator) -> Result<(), String> {
    emulator.before_instructions(before_instruction)?;
    let (start, size) = Area::Dtcm.range();
    emulator.at_bad_accesses(0..=start - 1, bad_access)?;
    emulator.at_bad_accesses(start + size as u32..=u32::MAX, bad_access)?;
    emulator.at_new_pages(page)?;
    emulator.at_traps(trap)
}

pub(super) unsafe extern "C" fn bad_access(
    _: *mut uc_engine,
    kind: MemType,
    address: u64,
    _: i32,
    _: i64,
    data: *mut c_void,
) -> bool {
    // SAFETY: a callback's data.
    unsafe { state(data) }.bad_access = Some((kind, address as u32));
    false
}

/// Addresses are physical ones, and what is allowed is in the memories' own permissions. But
/// unicorn need not look at each write for code to translate anew where none is ever
/// executed.
unsafe extern "C" fn page(
    uc: *mut uc_engine,
    address: u64,
    kind: MemType,
    entry: *mut TlbEntry,
    _: *mut c_void,
) -> bool {
    let (start, size) = Area::Dtcm.range();
    let data = (u64::from(start)..u64::from(start) + size as u64).contains(&address);
    let perms = if data && kind != MemType::FETCH {
        Prot::READ | Prot::WRITE
    } else {
        Prot::ALL
    };
    let filled = TlbEntry {
        paddr: address,
        perms,
    };
    if kind != MemType::FETCH {
        // Before this call unicorn has written down the state of the IT block, if there is
        // one, and does not take it back: the next block would begin with it.
        Core::of(uc).leave_it_block();
    }
    // SAFETY: unicorn gives the address of an entry that it has not filled yet.
    unsafe { entry.write(filled) };
    true
}

unsafe extern "C" fn trap(uc: *mut uc_engine, number: u32, data: *mut c_void) {
    // SAFETY: a callback's data.
    unsafe { state(data) }.trap = Some(number);
    Core::of(uc).stop();
}

/// Most of the emulator's time passes here: with nothing due, it is a few comparisons and
/// additions.
unsafe extern "C" fn before_instruction(
    uc: *mut uc_engine,
    address: u64,
    _: u32,
    data: *mut c_void,
) {
    let pc = address as u32;
    // SAFETY: a callback's data.
    let state = unsafe { state(data) };
    if (state.bus.now >= state.wake || state.idle.watches(pc)) && stops(Core::of(uc), state, pc) {
        return;
    }
    let bus = &mut state.bus;
    bus.pc = pc;
    state.instructions += 1;
    bus.now += bus.ticks.0;
    if bus.counts.is_inside() {
        bus.counts.instruction(pc);
    }
}

/// Lets what is due happen, and stops the emulator if it has to.
#[cold]
#[inline(never)]
fn stops(core: Core, state: &mut State, pc: u32) -> bool {
    if state.stopping > 0 {
        // In an IT block unicorn takes a stop back: it is asked for until it comes.
        state.stopping += 1;
    } else if due(core, state, pc) {
        state.stopping = 1;
        state.wake = 0;
    } else {
        return false;
    }
    core.stop();
    true
}

/// Lets what is due happen. Whether the emulator has to stop before this instruction.
fn due(core: Core, state: &mut State, pc: u32) -> bool {
    if state.bus.now >= state.wake {
        let now = state.bus.now;
        state.bus.events(now);
    }
    if let Some(masking) = &mut state.masking {
        let masked = state.bus.nvic.holds_back(IRQ + CC_IRQ, masks(core));
        masking.note(masked, state.bus.now, pc);
    }
    let wanted = state.idle.next(&state.bus);
    if state.idle.watches(pc) {
        skip(core, state);
    } else if wanted.is_some_and(|at| at <= state.bus.now) {
        let registers = crate::idle::registers(core);
        state
            .idle
            .begin(pc, registers, &mut state.bus, state.instructions);
    }
    if state.waits_at_gate(false) {
        return true;
    }
    let (until, stop_at) = (state.until, state.stop_at);
    let bus = &mut state.bus;
    if bus.error.is_some()
        || bus.reset.is_some()
        || bus.fault.is_some()
        || bus.mpu_changed
        || !bus.runs()
        || bus.now >= until
        || stop_at == Some(pc)
    {
        return true;
    }
    let look = state.idle.next(bus).unwrap_or(until);
    let next = bus.next().unwrap_or(until).min(until).min(look);
    let each = stop_at.is_some() || state.masking.is_some();
    state.wake = if each { 0 } else { next };
    if !bus.nvic.may_preempt() {
        return false;
    }
    if bus.nvic.take(masks(core)).is_some() {
        return true;
    }
    // Masked: the next instruction may change that.
    state.wake = 0;
    false
}

/// Compares with the pass before, and skips passes if nothing has changed.
fn skip(core: Core, state: &mut State) {
    let registers = state.idle.registers();
    let same = registers.is_some_and(|registers| crate::idle::same(core, registers));
    let next = state.bus.next().unwrap_or(Ticks::MAX).min(state.until);
    let before = state.idle.skipped;
    state
        .idle
        .pass(same, &mut state.bus, &mut state.instructions, next);
    if let Some(masking) = &mut state.masking {
        masking.skip(state.idle.skipped - before);
    }
}
