//! Everything around the core: peripherals, chips and wires, and the order in which things
//! happen to them. The core calls [`Bus::read`] and [`Bus::write`]; [`Bus::events`] lets
//! happen what is due.
//!
//! A new peripheral has a file in [`crate::peripherals`], and in this folder:
//!
//! | | |
//! |---|---|
//! | `map.rs` | a [`Block`] with its addresses; the compiler then names the other places |
//! | `access.rs` | reads and writes, and its reset by RCC |
//! | `events.rs` | when it does something by itself, and what; its interrupt's line |
//! | `wiring.rs` | its pins, and a chip at them |
//! | `mod.rs` | a field of [`Bus`], and its state after a reset of the board |
//! | `clocks.rs` | the clock of what it counts, if it counts |
//!
//! Its clock's bit is in [`crate::peripherals::rcc`].

mod access;
mod clocks;
mod events;
mod map;
mod wiring;

use std::collections::BTreeMap;

use crate::chips::ad5676r::Ad5676r;
use crate::chips::ad7606::Ad7606;
use crate::counts::Counts;
use crate::gate::Gate;
use crate::memory::Memory;
use crate::peripherals::dbgmcu::Dbgmcu;
use crate::peripherals::dma::Dma;
use crate::peripherals::dwt::Dwt;
use crate::peripherals::flash::Flash;
use crate::peripherals::gpio::Gpio;
use crate::peripherals::iwdg::Iwdg;
use crate::peripherals::mpu::Mpu;
use crate::peripherals::nvic::Nvic;
use crate::peripherals::pwr::Pwr;
use crate::peripherals::rcc::{Rcc, Reset};
use crate::peripherals::scb::Scb;
use crate::peripherals::spi::{self, Spi};
use crate::peripherals::syscfg::Syscfg;
use crate::peripherals::tim1::Tim1;
use crate::peripherals::usart::Usart;
use crate::time::{Cost, Ticks};
use crate::wires::{Level, Pin, Recorder};

pub use map::Block;

/// Why the run cannot go on: the image does something that the model does not have, or
/// that the hardware forbids.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unmodelled {
    /// What it does, with the register's name and address.
    pub what: String,
    /// The instruction's address.
    pub pc: u32,
}

impl std::fmt::Display for Unmodelled {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} (pc {:#010x})", self.what, self.pc)
    }
}

impl std::error::Error for Unmodelled {}

/// A series of values read, as a number: two series differ, if not their numbers are the same
/// by an unlikely chance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Answers(u64);

impl Answers {
    fn push(&mut self, address: u32, value: u32) {
        let read = u64::from(address) << 32 | u64::from(value);
        // The constant is that of FNV-1a.
        self.0 = (self.0.rotate_left(23) ^ read).wrapping_mul(0x100_0000_01B3);
    }
}

/// The board without its core.
pub struct Bus {
    /// The core's time.
    pub now: Ticks,
    /// What instructions and accesses cost.
    pub cost: Cost,
    /// Ticks for an instruction, an access, and a core cycle, at the present clock.
    pub ticks: (Ticks, Ticks, Ticks),
    /// The instruction that runs.
    pub pc: u32,
    /// When something happens next; the end of time if nothing does.
    due: Ticks,
    /// Accesses to registers since the start.
    pub accesses: u64,
    /// Accesses that change something, or whose answer changes with time alone and not with
    /// an event. All others, repeated, give the same until the next event.
    pub unsteady: u64,
    /// What the core has read from registers since this was cleared.
    pub answers: Answers,
    /// Events so far.
    pub happened: u64,
    /// Why the run cannot go on.
    pub error: Option<Unmodelled>,
    /// A reset is due.
    pub reset: Option<Reset>,
    /// A bus fault of the access under way: its address.
    pub fault: Option<u32>,
    /// Memories.
    pub memory: Memory,
    /// Holds sampling until the plant has answered.
    pub gate: Gate,
    /// Counters of the sample interrupt.
    pub counts: Counts,
    /// Histories of pins.
    pub recorder: Recorder,
    /// The ADC.
    pub adc: Ad7606,
    /// The DAC.
    pub dac: Ad5676r,
    /// Levels that something else than the board's own wiring holds on pins.
    pub held: BTreeMap<Pin, Level>,
    /// Whether SPI3, SPI4 and SPI5 never end a transfer.
    dead_spi: [bool; 3],
    /// The interrupt controller.
    pub nvic: Nvic,
    /// The system control block.
    pub scb: Scb,
    /// The memory protection unit.
    pub mpu: Mpu,
    /// The MPU was written: permissions must be set anew.
    pub mpu_changed: bool,
    /// The clocks.
    pub rcc: Rcc,
    /// The flash.
    pub flash: Flash,
    /// The sample timer.
    pub tim1: Tim1,
    /// The link's port.
    pub usart3: Usart,
    /// The watchdog.
    pub iwdg: Iwdg,
    dwt: Dwt,
    pwr: Pwr,
    syscfg: Syscfg,
    dbgmcu: Dbgmcu,
    gpio: [Gpio; 11],
    dma: Dma,
    spi3: Spi,
    spi4: Spi,
    spi5: Spi,
    core: u64,
}

impl Bus {
    /// A board on which power has just come on.
    pub fn new(cost: Cost) -> Self {
        let mut bus = Self {
            now: 0,
            cost,
            ticks: (0, 0, 0),
            pc: 0,
            due: Ticks::MAX,
            accesses: 0,
            unsteady: 0,
            answers: Answers::default(),
            happened: 0,
            error: None,
            reset: None,
            fault: None,
            memory: Memory::default(),
            gate: Gate::default(),
            counts: Counts::default(),
            recorder: Recorder::default(),
            adc: Ad7606::default(),
            dac: Ad5676r::default(),
            held: BTreeMap::new(),
            dead_spi: [false; 3],
            nvic: Nvic::default(),
            scb: Scb::default(),
            mpu: Mpu::default(),
            mpu_changed: false,
            rcc: Rcc::default(),
            flash: Flash::default(),
            tim1: Tim1::default(),
            usart3: Usart::default(),
            iwdg: Iwdg::default(),
            dwt: Dwt::default(),
            pwr: Pwr::default(),
            syscfg: Syscfg::default(),
            dbgmcu: Dbgmcu::default(),
            gpio: std::array::from_fn(Gpio::new),
            dma: Dma::default(),
            spi3: Spi::new(spi::FULL),
            spi4: Spi::new(spi::LIMITED),
            spi5: Spi::new(spi::LIMITED),
            core: 0,
        };
        bus.rcc.reset(Reset::Power);
        bus.clock();
        bus.wires();
        bus
    }

    /// Resets everything but memories and chips. Power also clears what survives others.
    pub fn reset(&mut self, cause: Reset) {
        self.flash.reset();
        self.usart3.reset();
        self.rcc.reset(cause);
        if cause == Reset::Power {
            self.pwr = Pwr::default();
            self.memory.scramble();
            self.adc.power_up();
            self.dac.power_up(self.now);
        } else {
            self.pwr.reset();
        }
        self.nvic = Nvic::default();
        self.scb = Scb::default();
        self.mpu = Mpu::default();
        self.mpu_changed = true;
        self.tim1 = Tim1::default();
        self.iwdg = Iwdg::default();
        self.dwt = Dwt::default();
        self.syscfg = Syscfg::default();
        self.dbgmcu = Dbgmcu::default();
        self.gpio = std::array::from_fn(Gpio::new);
        self.dma = Dma::default();
        for spi in [&mut self.spi3, &mut self.spi4, &mut self.spi5] {
            spi.reset();
        }
        self.gate.reset(self.now);
        self.reset = None;
        self.fault = None;
        self.core = 0;
        self.clock();
        self.wires();
        self.schedule();
    }

    /// Stops the run.
    pub fn refuse(&mut self, what: String) {
        if self.error.is_none() {
            self.error = Some(Unmodelled { what, pc: self.pc });
        }
    }
}
