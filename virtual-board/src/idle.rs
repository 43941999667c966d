//! Skipping passes of the main loop in which nothing can happen.
//!
//! A pass is what the core does from an instruction until it comes to the same instruction
//! again. If at both moments all registers and all memory are the same, if in between no
//! exception was taken, no memory behind a callback was written, and peripherals were only
//! read, and only registers that change with an event alone ([`Bus::unsteady`]), then the next
//! pass does exactly the same, and the one after it, until something from outside happens: an
//! exception, or a change in what the program can only learn through such an access. So whole
//! passes are skipped that end before the next event of any peripheral: the state stays the
//! same, time and instruction count advance by as many passes, and everything after is what it
//! would have been, to the tick. Nothing the program could see is changed.
//!
//! A pass in which an event happened has to run. If it begins in the same state as one before
//! and reads the same from the peripherals ([`Answers`]), it also ends in the same state: the
//! memory is compared once, not in each pass.
//!
//! A peripheral that writes memory by itself (DMA) must have its transfers among the
//! events, and call [`Idle::forget`] for each.

use unicorn_engine::RegisterARM as Reg;

use crate::bus::{Answers, Bus};
use crate::machine::Core;
use crate::memory::Area;
use crate::time::{MICROSECOND, Ticks};

/// Everything in the core that a program can see.
pub type Registers = [u64; 36];

/// Instructions after which a place that did not come again is given up.
const LONGEST_PASS: u64 = 20_000;

/// After something has happened, the program has something to do; a pass that begins too
/// soon is compared in vain. Twice as long after each vain comparison,
const BUSY: Ticks = MICROSECOND;

/// up to this.
const BUSIEST: Ticks = 128 * MICROSECOND;

/// Comes back to a place with other registers before it is given up: it is in an inner loop.
const INNER: u32 = 32;

/// The state at the beginning of a pass.
struct Start {
    registers: Registers,
    unsteady: u64,
    axi_writes: u64,
    at: Ticks,
    instructions: u64,
    happened: u64,
    others: u32,
    /// What a pass read that left the memory as it was. One that begins in the same state and
    /// reads the same does the same: the memory need not be compared again.
    harmless: Option<Answers>,
}

/// What is known of passes.
pub struct Idle {
    /// Whether passes are skipped. Without, the same happens, but in every pass.
    pub skips: bool,
    /// Passes skipped since the start.
    pub passes: u64,
    /// Time of the skipped passes.
    pub skipped: Ticks,
    start: Option<Start>,
    memory: Vec<u8>,
    /// The last pass changed nothing.
    idle: bool,
    /// The place of `start`, or one where no instruction is.
    place: u32,
    /// When to look for another place.
    look: Ticks,
    /// How long to wait with that after the next vain comparison.
    busy: Ticks,
}

impl Default for Idle {
    fn default() -> Self {
        Self {
            skips: true,
            passes: 0,
            skipped: 0,
            start: None,
            memory: Vec::new(),
            idle: false,
            place: u32::MAX,
            look: 0,
            busy: BUSY,
        }
    }
}

impl Idle {
    /// Something has happened at `now` that a pass does not do: an exception, a defect of a
    /// scene.
    pub fn forget(&mut self, now: Ticks) {
        self.start = None;
        self.idle = false;
        self.place = u32::MAX;
        self.busy = BUSY;
        self.look = now + BUSY;
    }

    /// This is no place where a pass begins: another is wanted later.
    fn give_up(&mut self, now: Ticks) {
        self.start = None;
        self.idle = false;
        self.place = u32::MAX;
        self.busy = (2 * self.busy).min(BUSIEST);
        self.look = now + self.busy;
    }

    /// Whether the program does nothing but wait for the next event.
    pub fn is_idle(&self, bus: &Bus) -> bool {
        let still = |start: &Start| start.happened == bus.happened;
        self.idle && self.start.as_ref().is_some_and(still)
    }

    /// The registers at the beginning of the pass.
    pub(crate) fn registers(&self) -> Option<&Registers> {
        self.start.as_ref().map(|start| &start.registers)
    }

    /// Whether a pass may end at this instruction.
    pub(crate) fn watches(&self, pc: u32) -> bool {
        pc == self.place
    }

    /// When a place is wanted, if none comes before. Handlers do not wait.
    pub(crate) fn next(&self, bus: &Bus) -> Option<Ticks> {
        let wanted = self.skips || bus.gate.is_closed();
        (wanted && bus.nvic.depth() == 0).then_some(self.look)
    }

    /// A place was wanted: a pass begins here.
    pub(crate) fn begin(
        &mut self,
        pc: u32,
        registers: Registers,
        bus: &mut Bus,
        instructions: u64,
    ) {
        bus.answers = Answers::default();
        self.memory.clear();
        self.memory.extend_from_slice(bus.memory.area(Area::Dtcm));
        self.memory.extend_from_slice(bus.memory.area(Area::Itcm));
        self.idle = false;
        self.place = pc;
        self.look = bus.now + LONGEST_PASS * bus.ticks.0;
        self.start = Some(Start {
            registers,
            unsteady: bus.unsteady,
            axi_writes: bus.memory.axi_writes,
            at: bus.now,
            instructions,
            happened: bus.happened,
            others: 0,
            harmless: None,
        });
    }

    fn same_memory(&self, bus: &Bus) -> bool {
        let data = bus.memory.area(Area::Dtcm);
        let (old_data, old_code) = self.memory.split_at(data.len());
        old_data == data && old_code == bus.memory.area(Area::Itcm)
    }

    /// A pass has ended, with the `same` registers or others. `next` is when something
    /// happens next.
    pub(crate) fn pass(&mut self, same: bool, bus: &mut Bus, instructions: &mut u64, next: Ticks) {
        let Some(start) = &mut self.start else {
            return;
        };
        if !same {
            start.others += 1;
            if start.others > INNER {
                self.give_up(bus.now);
            }
            return;
        }
        let untouched = start.unsteady == bus.unsteady && start.axi_writes == bus.memory.axi_writes;
        let (at, length) = (bus.now - start.at, *instructions - start.instructions);
        // The emulator was stopped and started at the place.
        if length == 0 {
            return;
        }
        // What the pass read may have changed in it: then the next one tells.
        let alone = start.happened == bus.happened;
        start.happened = bus.happened;
        let answers = std::mem::take(&mut bus.answers);
        let known = start.harmless == Some(answers);
        if !untouched || !(known || self.same_memory(bus)) {
            self.give_up(bus.now);
            return;
        }
        if let Some(start) = &mut self.start {
            start.harmless = Some(answers);
        }
        if !alone {
            self.mark(bus.now, *instructions);
            return;
        }
        self.idle = true;
        // At a closed gate without events time has no end to skip to.
        if self.skips && !bus.gate.is_closed() | bus.next().is_some() {
            let passes = (next.saturating_sub(bus.now + 1))
                .checked_div(at)
                .unwrap_or(0);
            bus.now += passes * at;
            *instructions += passes * length;
            self.passes += passes;
            self.skipped += passes * at;
        }
        self.mark(bus.now, *instructions);
        self.look = bus.now + LONGEST_PASS * bus.ticks.0;
    }

    /// The next pass begins at the same place, in the same state.
    fn mark(&mut self, now: Ticks, instructions: u64) {
        if let Some(start) = &mut self.start {
            (start.at, start.instructions) = (now, instructions);
        }
    }
}

/// Reads all registers.
pub(crate) fn registers(core: Core) -> Registers {
    NAMES.map(|name| core.get(name))
}

/// Whether all registers have these values.
pub(crate) fn same(core: Core, registers: &Registers) -> bool {
    let mut pairs = NAMES.iter().zip(registers);
    pairs.all(|(name, value)| core.get(*name) == *value)
}

/// The registers, those first that differ most often. CONTROL and FAULTMASK are not among
/// them: they change only through an instruction of the pass or an exception.
const NAMES: [Reg; 36] = [
    Reg::MSP,
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
    Reg::LR,
    Reg::PSP,
    Reg::XPSR,
    Reg::PRIMASK,
    Reg::BASEPRI,
    Reg::FPSCR,
    Reg::D0,
    Reg::D1,
    Reg::D2,
    Reg::D3,
    Reg::D4,
    Reg::D5,
    Reg::D6,
    Reg::D7,
    Reg::D8,
    Reg::D9,
    Reg::D10,
    Reg::D11,
    Reg::D12,
    Reg::D13,
    Reg::D14,
    Reg::D15,
];
