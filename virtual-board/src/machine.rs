//! The core: unicorn runs its instructions; exceptions, faults, time and resets are here
//! and in [`crate::exceptions`], because unicorn has no interrupt controller.
//!
//! A hook before every instruction counts it, lets what is due happen, and stops the
//! emulator when an exception is to be taken. An exception is taken between two
//! instructions, at most one instruction after it became possible; an IT block (up to four
//! instructions) counts as one.

use unicorn_engine::{
    Arch, ArmCpuModel, HookType, MemType, Mode, Prot, RegisterARM as Reg, Unicorn, uc_error,
};

use crate::bus::{Bus, Unmodelled};
use crate::idle::Idle;
use crate::image::Image;
use crate::memory::{AXI, Area};
use crate::peripherals::flash::{BANK, BANK_2};
use crate::peripherals::nvic::{BUS_FAULT, MEM_MANAGE, Masks, SV_CALL, USAGE_FAULT};
use crate::peripherals::rcc::Reset;
use crate::peripherals::scb::{
    BFARVALID, DACCVIOL, IACCVIOL, IBUSERR, INVSTATE, MMARVALID, PRECISERR, UNDEFINSTR,
};
use crate::time::{Cost, Ticks};

/// What unicorn calls an exception of the core (QEMU's numbers).
mod trap {
    pub const SWI: u32 = 2;
    pub const PREFETCH_ABORT: u32 = 3;
    pub const DATA_ABORT: u32 = 4;
    pub const EXCEPTION_EXIT: u32 = 8;
    pub const INVSTATE: u32 = 18;
}

/// What the hooks know.
pub struct State {
    /// The board.
    pub bus: Bus,
    /// Instructions since the start.
    pub instructions: u64,
    /// Finds passes of the main loop that can be skipped.
    pub idle: Idle,
    /// The next moment at which the hook has more to do than to count.
    pub(crate) wake: Ticks,
    /// The run ends then.
    until: Ticks,
    /// The run ends at this address.
    stop_at: Option<u32>,
    /// The run ends where the program waits at the closed gate.
    stop_at_gate: bool,
    /// Hook calls since the emulator was told to stop.
    stopping: u32,
    /// An exception that unicorn raised.
    trap: Option<u32>,
    /// Permissions of pages as last set: start, size, what is allowed.
    protected: Vec<(u32, u32, Prot)>,
    /// A memory access that unicorn could not carry out.
    bad_access: Option<(MemType, u32)>,
}

impl State {
    /// Whether the run ends because nothing but the plant's next sample can change anything:
    /// the program does nothing, or only waits, and nothing is on its way to it.
    fn waits_at_gate(&self, dead: bool) -> bool {
        self.stop_at_gate
            && self.bus.gate.is_closed()
            && (dead || self.idle.is_idle(&self.bus))
            && self.bus.usart3.is_quiet()
            && self.bus.next().is_none()
    }
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The time has come.
    Time,
    /// The address was reached; its instruction has not run.
    Address,
    /// The gate is closed and the program does nothing but wait.
    Gate,
    /// The board was reset, and has started anew.
    Reset(Reset),
}

/// A core with its board.
pub struct Machine {
    pub(crate) uc: Unicorn<'static, State>,
    /// The core is locked up: only a reset helps.
    pub locked: bool,
    /// WFI: it sleeps until an exception.
    asleep: bool,
    /// The next instruction.
    pub(crate) pc: u32,
}

impl Drop for Machine {
    fn drop(&mut self) {
        // The emulator knows the addresses of the memories, which are freed with its data:
        // nothing may run from here on, and nothing does.
        self.locked = true;
    }
}

fn failed(what: &'static str) -> impl Fn(uc_error) -> String {
    move |error| format!("the emulator: {what}: {error:?}")
}

impl Machine {
    /// A board with an image in its flash, on which power has just come on.
    ///
    /// # Errors
    /// If the emulator cannot be set up, or the image does not fit.
    pub fn new(image: &Image, cost: Cost) -> Result<Self, String> {
        let mut bus = Bus::new(cost);
        image.load(&mut bus.memory)?;
        let state = State {
            bus,
            instructions: 0,
            idle: Idle::default(),
            wake: 0,
            until: Ticks::MAX,
            stop_at: None,
            stop_at_gate: false,
            stopping: 0,
            trap: None,
            protected: Vec::new(),
            bad_access: None,
        };
        let mode = Mode::LITTLE_ENDIAN | Mode::THUMB;
        let mut uc = Unicorn::new_with_data(Arch::ARM, mode, state).map_err(failed("start"))?;
        uc.ctl_set_cpu_model(ArmCpuModel::CORTEX_M7 as i32)
            .map_err(failed("model"))?;
        // No address ends the run, not even 0, where code is.
        uc.ctl_exits_enable().map_err(failed("exits"))?;
        map(&mut uc)?;
        hook(&mut uc)?;
        let mut machine = Self {
            uc,
            locked: false,
            asleep: false,
            pc: 0,
        };
        machine.reset(Reset::Power);
        Ok(machine)
    }

    /// The board.
    pub fn bus(&self) -> &Bus {
        &self.uc.get_data().bus
    }

    /// The board.
    pub fn bus_mut(&mut self) -> &mut Bus {
        let state = self.uc.get_data_mut();
        // What is changed may be due at once.
        state.wake = 0;
        state.idle.forget(state.bus.now);
        &mut state.bus
    }

    /// The next instruction.
    pub fn pc(&self) -> u32 {
        self.pc
    }

    /// Instructions since the start, those of skipped passes too.
    pub fn instructions(&self) -> u64 {
        self.uc.get_data().instructions
    }

    /// What is known of idle passes.
    pub fn idle(&self) -> &Idle {
        &self.uc.get_data().idle
    }

    /// What is known of idle passes.
    pub fn idle_mut(&mut self) -> &mut Idle {
        &mut self.uc.get_data_mut().idle
    }

    pub(crate) fn get(&self, register: Reg) -> u32 {
        // A register of this core: it cannot fail.
        self.uc.reg_read(register).unwrap_or(0) as u32
    }

    pub(crate) fn set(&mut self, register: Reg, value: u32) {
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

    /// Writes memory as a scene's defect, not as the program: code that was translated is
    /// forgotten. False if there is no memory.
    pub fn poke(&mut self, address: u32, bytes: &[u8]) -> bool {
        let end = u64::from(address) + bytes.len() as u64;
        let written = self.bus_mut().memory.write(address, bytes);
        written && self.uc.ctl_remove_cache(u64::from(address), end).is_ok()
    }

    /// Changes what instructions and accesses cost.
    pub fn set_cost(&mut self, cost: Cost) {
        self.bus_mut().set_cost(cost);
    }

    /// The plant has answered: the inputs of the ADC have these codes, and the gate opens.
    /// The program cannot see it before it reads a peripheral.
    pub fn answer(&mut self, codes: &[i16]) {
        let state = self.uc.get_data_mut();
        let bus = &mut state.bus;
        bus.adc.inputs[..codes.len()].copy_from_slice(codes);
        // If the timer has just been started at 0, its first CONVST came with that, and what
        // it sampled is known only now.
        let begins = bus.tim1.has_begun();
        if begins {
            bus.adc.resample();
        }
        bus.gate.open(bus.now, begins);
        bus.schedule();
        state.wake = 0;
    }

    /// From now on a run ends where the program waits at the closed gate.
    pub fn stop_at_gate(&mut self) {
        self.uc.get_data_mut().stop_at_gate = true;
    }

    /// Takes the bytes that the board has sent over the link. The program cannot see it.
    pub fn take_link(&mut self) -> Vec<u8> {
        self.uc
            .get_data_mut()
            .bus
            .usart3
            .outgoing
            .drain(..)
            .collect()
    }

    /// The mask registers.
    pub fn masks(&self) -> Masks {
        masks(&self.uc)
    }

    /// Resets the board.
    pub fn reset(&mut self, cause: Reset) {
        self.uc.get_data_mut().bus.counts.cut();
        self.bus_mut().reset(cause);
        if cause == Reset::Power {
            // The memories hold other code.
            let _ = self.uc.ctl_flush_tb();
        }
        for number in 0..13 {
            self.set(general(number), 0);
        }
        for register in [
            Reg::IPSR,
            Reg::CONTROL,
            Reg::PRIMASK,
            Reg::FAULTMASK,
            Reg::BASEPRI,
        ] {
            self.set(register, 0);
        }
        self.set(Reg::LR, u32::MAX);
        self.locked = false;
        self.asleep = false;
        let vtor = self.bus().scb.vtor;
        let word = |address| self.bus().memory.word(address);
        let (stack, entry) = (word(vtor), word(vtor + 4));
        match (stack, entry) {
            (Some(stack), Some(entry)) => {
                self.set(Reg::MSP, stack & !3);
                self.pc = entry & !1;
            }
            _ => self.locked = true,
        }
        self.protect();
    }

    /// Runs until a moment.
    ///
    /// # Errors
    /// If the image does something that is not modelled.
    pub fn run(&mut self, until: Ticks) -> Result<Stop, Unmodelled> {
        self.run_to(until, None)
    }

    /// Runs until a moment, or an address.
    ///
    /// # Errors
    /// If the image does something that is not modelled.
    pub fn run_to(&mut self, until: Ticks, address: Option<u32>) -> Result<Stop, Unmodelled> {
        let state = self.uc.get_data_mut();
        state.until = until;
        state.stop_at = address;
        loop {
            self.uc.get_data_mut().bus.schedule();
            let bus = self.bus();
            if let Some(error) = &bus.error {
                return Err(error.clone());
            }
            if let Some(cause) = bus.reset {
                self.reset(cause);
                return Ok(Stop::Reset(cause));
            }
            if bus.now >= until {
                return Ok(Stop::Time);
            }
            if address == Some(self.pc) {
                return Ok(Stop::Address);
            }
            if self.uc.get_data().waits_at_gate(self.asleep || self.locked) {
                return Ok(Stop::Gate);
            }
            if bus.mpu_changed {
                self.protect();
            }
            if self.locked || !self.bus().runs() {
                self.pass_time(until);
                continue;
            }
            let masks = self.masks();
            if let Some(number) = self.bus().nvic.take(masks) {
                self.asleep = false;
                self.enter(number);
                continue;
            }
            // WFI ends also for what PRIMASK masks (B1.5.19).
            if self.asleep && !self.bus().nvic.wants() {
                self.pass_time(until);
                continue;
            }
            self.asleep = false;
            self.step_in();
        }
    }

    /// Nothing runs: time passes to the next event.
    fn pass_time(&mut self, until: Ticks) {
        let bus = &mut self.uc.get_data_mut().bus;
        let next = bus.next().unwrap_or(until).clamp(bus.now, until);
        bus.now = next;
        bus.events(next);
    }

    /// Runs instructions until there is something to do between two of them.
    fn step_in(&mut self) {
        let state = self.uc.get_data_mut();
        state.wake = 0;
        state.stopping = 0;
        state.trap = None;
        state.bad_access = None;
        let begin = u64::from(self.pc | 1);
        let outcome = self.uc.emu_start(begin, 0, 0, 0);
        self.pc = self.get(Reg::PC);
        let state = self.uc.get_data_mut();
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
            (Ok(()), None) if self.uc.get_data().stopping == 0 => self.asleep = true,
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
            uc_error::FETCH_PROT => self.mpu_fault(IACCVIOL, None),
            uc_error::READ_PROT | uc_error::WRITE_PROT => self.mpu_fault(DACCVIOL, address),
            _ => self.bus_mut().refuse(format!("the emulator: {error:?}")),
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

    /// Sets the emulator's permissions as the MPU has them.
    fn protect(&mut self) {
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

/// Unit in which the emulator protects memory, bytes.
const PAGE: u32 = 4096;

/// R0 to R12, SP, LR.
fn general(number: u8) -> Reg {
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

fn masks(uc: &Unicorn<'_, State>) -> Masks {
    let get = |register| uc.reg_read(register).unwrap_or(0) as u32;
    Masks {
        primask: get(Reg::PRIMASK) & 1 != 0,
        faultmask: get(Reg::FAULTMASK) & 1 != 0,
        basepri: get(Reg::BASEPRI) as u8,
    }
}

fn map(uc: &mut Unicorn<'static, State>) -> Result<(), String> {
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

fn hook(uc: &mut Unicorn<'static, State>) -> Result<(), String> {
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
