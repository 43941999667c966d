//! What happens before every instruction.

use unicorn_engine::{HookType, Unicorn};

use super::registers::masks;
use super::{State, failed};
use crate::time::Ticks;

pub(super) fn hook(uc: &mut Unicorn<'static, State>) -> Result<(), String> {
    uc.add_code_hook(1, 0, |uc, address, _| on_instruction(uc, address as u32))
        .map_err(failed("hooks"))?;
    uc.add_mem_hook(HookType::MEM_INVALID, 1, 0, |uc, kind, address, _, _| {
        uc.get_data_mut().bad_access = Some((kind, address as u32));
        false
    })
    .map_err(failed("hooks"))?;
    uc.add_intr_hook(|uc, number| {
        uc.get_data_mut().trap = Some(number);
        let _ = uc.emu_stop();
    })
    .map_err(failed("hooks"))?;
    Ok(())
}

/// Before every instruction.
fn on_instruction(uc: &mut Unicorn<'_, State>, pc: u32) {
    let state = uc.get_data_mut();
    if state.stopping > 0 {
        // In an IT block unicorn takes a stop back: it is asked for until it comes.
        state.stopping += 1;
        let _ = uc.emu_stop();
        return;
    }
    if (state.bus.now >= state.wake || state.idle.watches(pc)) && due(uc, pc) {
        let state = uc.get_data_mut();
        state.stopping = 1;
        let _ = uc.emu_stop();
        return;
    }
    let state = uc.get_data_mut();
    let bus = &mut state.bus;
    bus.pc = pc;
    state.instructions += 1;
    bus.now += bus.ticks.0;
    if bus.counts.is_inside() {
        bus.counts.instruction(pc);
    }
}

/// Lets what is due happen. Whether the emulator has to stop before this instruction.
fn due(uc: &mut Unicorn<'_, State>, pc: u32) -> bool {
    let state = uc.get_data_mut();
    if state.bus.now >= state.wake {
        let now = state.bus.now;
        state.bus.events(now);
    }
    let wanted = state.idle.next(&state.bus);
    if state.idle.watches(pc) {
        skip(uc);
    } else if wanted.is_some_and(|at| at <= state.bus.now) {
        let registers = crate::idle::registers(uc);
        let state = uc.get_data_mut();
        state
            .idle
            .begin(pc, registers, &state.bus, state.instructions);
    }
    let state = uc.get_data_mut();
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
    state.wake = if stop_at.is_some() { 0 } else { next };
    if !bus.nvic.may_preempt() {
        return false;
    }
    let masks = masks(uc);
    let state = uc.get_data_mut();
    if state.bus.nvic.take(masks).is_some() {
        return true;
    }
    // Masked: the next instruction may change that.
    state.wake = 0;
    false
}

/// Compares with the pass before, and skips passes if nothing has changed.
fn skip(uc: &mut Unicorn<'_, State>) {
    let registers = uc.get_data().idle.registers();
    let same = registers.is_some_and(|registers| crate::idle::same(uc, registers));
    let State {
        idle,
        bus,
        instructions,
        until,
        ..
    } = uc.get_data_mut();
    let next = bus.next().unwrap_or(Ticks::MAX).min(*until);
    idle.pass(same, bus, instructions, next);
}
