//! Skipping passes of the main loop in which nothing can happen.
//!
//! A pass is what the core does from an instruction until it comes to the same instruction
//! again. If at both moments all registers and all memory are the same, if in between no
//! exception was taken, no register of a peripheral was accessed and no memory behind a
//! callback was written, then the next pass does exactly the same, and the one after it,
//! until something from outside happens: an exception, or a change in what the program can
//! only learn through such an access. So whole passes are skipped that end before the next
//! event of any peripheral: the state stays the same, time and instruction count advance by
//! as many passes, and everything after is what it would have been, to the tick. Nothing
//! the program could see is changed.
//!
//! A peripheral that writes memory by itself (DMA) must have its transfers among the
//! events, and call [`Idle::forget`] for each.

use unicorn_engine::{RegisterARM as Reg, Unicorn};

use crate::bus::Bus;
use crate::machine::State;
use crate::memory::Area;
use crate::time::Ticks;

/// Everything in the core that a program can see.
pub type Registers = [u64; 36];

/// Instructions after which a place that did not come again is given up.
const LONGEST_PASS: u64 = 20_000;

/// Comes back to a place with other registers before it is given up: it is in an inner loop.
const INNER: u32 = 32;

/// The state at the beginning of a pass.
struct Start {
    pc: u32,
    registers: Registers,
    accesses: u64,
    axi_writes: u64,
    at: Ticks,
    instructions: u64,
    others: u32,
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
        }
    }
}

impl Idle {
    /// Something has happened that a pass does not: an exception, a defect of a scene.
    pub fn forget(&mut self) {
        self.start = None;
        self.idle = false;
        self.place = u32::MAX;
        self.look = 0;
    }

    /// Whether the program does nothing but wait.
    pub fn is_idle(&self) -> bool {
        self.idle
    }

    /// Whether a pass may end at this instruction.
    pub(crate) fn watches(&self, pc: u32) -> bool {
        pc == self.place
    }

    /// Whether a place is wanted.
    pub(crate) fn looks(&self, bus: &Bus) -> bool {
        (self.skips || bus.gate.is_closed()) && bus.nvic.depth() == 0 && bus.now >= self.look
    }

    /// When a place is wanted at the latest.
    pub(crate) fn next(&self) -> Ticks {
        self.look
    }

    fn begin(&mut self, pc: u32, registers: Registers, bus: &Bus, instructions: u64) {
        self.memory.clear();
        self.memory.extend_from_slice(bus.memory.area(Area::Dtcm));
        self.memory.extend_from_slice(bus.memory.area(Area::Itcm));
        self.idle = false;
        self.place = pc;
        self.look = bus.now + LONGEST_PASS * bus.ticks.0;
        self.start = Some(Start {
            pc,
            registers,
            accesses: bus.accesses,
            axi_writes: bus.memory.axi_writes,
            at: bus.now,
            instructions,
            others: 0,
        });
    }

    fn same_memory(&self, bus: &Bus) -> bool {
        let data = bus.memory.area(Area::Dtcm);
        let (old_data, old_code) = self.memory.split_at(data.len());
        old_data == data && old_code == bus.memory.area(Area::Itcm)
    }

    /// A pass has ended, or a place was wanted. `next` is when something happens next.
    pub(crate) fn pass(
        &mut self,
        pc: u32,
        registers: Registers,
        bus: &mut Bus,
        instructions: &mut u64,
        next: Ticks,
    ) {
        let Some(start) = self.start.as_mut().filter(|start| start.pc == pc) else {
            self.begin(pc, registers, bus, *instructions);
            return;
        };
        if start.registers != registers {
            start.others += 1;
            if start.others > INNER {
                self.begin(pc, registers, bus, *instructions);
            }
            return;
        }
        let untouched = start.accesses == bus.accesses && start.axi_writes == bus.memory.axi_writes;
        let (at, length) = (bus.now - start.at, *instructions - start.instructions);
        if !untouched || !self.same_memory(bus) {
            self.begin(pc, registers, bus, *instructions);
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
        if let Some(start) = &mut self.start {
            start.at = bus.now;
            start.instructions = *instructions;
        }
        self.look = bus.now + LONGEST_PASS * bus.ticks.0;
    }
}

/// Reads all registers.
pub(crate) fn registers(uc: &Unicorn<'_, State>) -> Registers {
    const NAMES: [Reg; 36] = [
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
        Reg::MSP,
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
    // CONTROL, FAULTMASK: a pass in thread mode that changes them and changes them back
    // between two looks at the same place ends with the same values as it began.
    NAMES.map(|name| uc.reg_read(name).unwrap_or(0))
}
