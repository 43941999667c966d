//! Everything around the core: peripherals, chips and wires, and the order in which things
//! happen to them. The core calls [`Bus::read`] and [`Bus::write`]; [`Bus::events`] lets
//! happen what is due.

use std::collections::BTreeMap;

use crate::chips::ad5676r::Ad5676r;
use crate::chips::ad7606::Ad7606;
use crate::counts::Counts;
use crate::gate::Gate;
use crate::memory::Memory;
use crate::peripherals::dbgmcu::{self, Dbgmcu};
use crate::peripherals::dwt::{self, Dwt};
use crate::peripherals::flash::{self, Flash};
use crate::peripherals::gpio::{self, Function, Gpio};
use crate::peripherals::iwdg::{self, Iwdg};
use crate::peripherals::mpu::{self, Mpu};
use crate::peripherals::nvic::{self, NMI, Nvic};
use crate::peripherals::pwr::{self, Pwr};
use crate::peripherals::rcc::{self, Domain, Rcc, Reset};
use crate::peripherals::scb::{self, Scb};
use crate::peripherals::spi::{self, Frame, Spi};
use crate::peripherals::syscfg::{self, Syscfg};
use crate::peripherals::tim1::{self, Tim1};
use crate::peripherals::usart::{self, Usart};
use crate::peripherals::{Refusal, name, unknown};
use crate::time::{Cost, Ticks};
use crate::wires::{Level, Pin, Recorder, pins};

/// Fastest clock of the AD7606 with VDRIVE at 3.3 V, Hz (data sheet, f_SCLK).
const ADC_CLOCK: u64 = 14_500_000;

/// Fastest clock of the AD5676R, Hz (data sheet, t1).
const DAC_CLOCK: u64 = 50_000_000;

/// A block of registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Block {
    /// SPI1.
    Spi1,
    /// SPI3.
    Spi3,
    /// USART3.
    Usart3,
    /// TIM1.
    Tim1,
    /// The flash's registers.
    Flash,
    /// SYSCFG.
    Syscfg,
    /// IWDG1.
    Iwdg1,
    /// A GPIO port, 0 is A.
    Gpio(u8),
    /// RCC.
    Rcc,
    /// PWR.
    Pwr,
    /// DBGMCU.
    Dbgmcu,
    /// DWT.
    Dwt,
    /// The core's system control space.
    Scs,
}

impl Block {
    /// The block at an address, and the offset in it (RM0433, 2.3.2, table 8).
    fn at(address: u32) -> Option<(Self, u32)> {
        let block = match address {
            0x4000_3C00..0x4000_4000 => Self::Spi3,
            0x4000_4800..0x4000_4C00 => Self::Usart3,
            0x4001_0000..0x4001_0400 => Self::Tim1,
            0x4001_3000..0x4001_3400 => Self::Spi1,
            0x5200_2000..0x5200_2400 => Self::Flash,
            0x5800_0400..0x5800_0800 => Self::Syscfg,
            0x5800_4800..0x5800_4C00 => Self::Iwdg1,
            0x5802_0000..0x5802_2C00 => Self::Gpio((address >> 10 & 0xF) as u8),
            0x5802_4400..0x5802_4800 => Self::Rcc,
            0x5802_4800..0x5802_4C00 => Self::Pwr,
            0x5C00_1000..0x5C00_1400 => Self::Dbgmcu,
            0xE000_1000..0xE000_2000 => return Some((Self::Dwt, address & 0xFFF)),
            0xE000_E000..0xE000_F000 => return Some((Self::Scs, address & 0xFFF)),
            _ => return None,
        };
        Some((block, address & 0x3FF))
    }

    /// The name of a register in it.
    pub fn register(self, offset: u32) -> String {
        let plain = |registers| name(registers, offset);
        match self {
            Self::Spi1 => plain(&spi::REGISTERS).replace("SPI", "SPI1"),
            Self::Spi3 => plain(&spi::REGISTERS).replace("SPI", "SPI3"),
            Self::Usart3 => plain(&usart::REGISTERS),
            Self::Tim1 => plain(&tim1::REGISTERS),
            Self::Flash => plain(&flash::REGISTERS),
            Self::Syscfg => plain(&syscfg::REGISTERS),
            Self::Iwdg1 => plain(&iwdg::REGISTERS).replace("IWDG", "IWDG1"),
            Self::Gpio(port) => {
                let letter = char::from(b'A' + port);
                plain(&gpio::REGISTERS).replace("GPIO", &format!("GPIO{letter}"))
            }
            Self::Rcc => plain(&rcc::REGISTERS),
            Self::Pwr => plain(&pwr::REGISTERS),
            Self::Dbgmcu => plain(&dbgmcu::REGISTERS),
            Self::Dwt => plain(&dwt::REGISTERS),
            Self::Scs if offset == dwt::DEMCR.0 => dwt::DEMCR.1.to_owned(),
            Self::Scs if (0x100..0xD00).contains(&offset) => {
                // A register of many: by its first and a number.
                let first = nvic::REGISTERS.iter().rfind(|(at, _)| *at <= offset);
                first.map_or_else(String::new, |(at, name)| {
                    let size = if *at == 0x400 { 1 } else { 4 };
                    format!("{}{}", name.trim_end_matches('0'), (offset - at) / size)
                })
            }
            Self::Scs if (0xD90..0xDBC).contains(&offset) => plain(&mpu::REGISTERS),
            Self::Scs => plain(&scb::REGISTERS),
        }
    }

    /// Whether a register is read without an effect, and changes with an event alone.
    fn is_steady(self, offset: u32) -> bool {
        match self {
            Self::Flash => true,
            Self::Spi1 | Self::Spi3 => offset == 0x14,
            Self::Usart3 => offset == 0x1C,
            // All but the counter.
            Self::Tim1 => offset != 0x24,
            Self::Gpio(_) => true,
            _ => false,
        }
    }

    /// The block's clock, if it has one of its own.
    fn domain(self) -> Option<Domain> {
        match self {
            Self::Spi1 => Some(Domain::Spi1),
            Self::Spi3 => Some(Domain::Spi3),
            Self::Usart3 => Some(Domain::Usart3),
            Self::Tim1 => Some(Domain::Tim1),
            Self::Syscfg => Some(Domain::Syscfg),
            Self::Gpio(port) => Some(Domain::Gpio(port)),
            _ => None,
        }
    }
}

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
    /// Whether SPI1 and SPI3 never end a transfer.
    dead_spi: [bool; 2],
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
    spi1: Spi,
    spi3: Spi,
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
            dead_spi: [false; 2],
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
            spi1: Spi::default(),
            spi3: Spi::default(),
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
        self.spi1 = Spi::default();
        self.spi3 = Spi::default();
        self.gate.reset(self.now);
        self.reset = None;
        self.fault = None;
        self.core = 0;
        self.clock();
        self.wires();
        self.schedule();
    }

    /// Frequencies have changed.
    fn clock(&mut self) {
        let clocks = self.rcc.clocks();
        if clocks.core != self.core {
            let sampling = self.gate.sampling(self.now);
            self.dwt.settle(sampling, self.core);
            self.core = clocks.core;
            self.price();
        }
        self.tim1.clock = clocks.timer2;
        self.usart3.kernel = clocks.pclk1;
        let [dead_1, dead_3] = self.dead_spi;
        self.spi1.kernel = clocks.spi123.filter(|_| !dead_1);
        self.spi3.kernel = clocks.spi123.filter(|_| !dead_3);
    }

    /// SPI1 or SPI3 never ends a transfer from now on, as if its kernel had no clock.
    pub fn kill_spi(&mut self, dead: [bool; 2]) {
        self.dead_spi = dead;
        self.clock();
    }

    /// Changes what instructions and accesses cost.
    pub fn set_cost(&mut self, cost: Cost) {
        self.cost = cost;
        self.price();
    }

    fn price(&mut self) {
        let cycle = crate::time::SECOND as f64 / self.core.max(1) as f64;
        let ticks = |cycles: f64| (cycles * cycle).round() as Ticks;
        self.ticks = (
            ticks(self.cost.instruction),
            ticks(self.cost.access),
            ticks(1.0),
        );
    }

    /// Whether the core has a clock.
    pub fn runs(&self) -> bool {
        self.core != 0
    }

    /// The clock at HSE stops, or comes back.
    pub fn set_hse(&mut self, present: bool) {
        if present {
            self.rcc.hse_present = true;
        } else if self.rcc.lose_hse() {
            self.nvic.set_pending(NMI, true);
        }
        self.clock();
    }

    /// The core's clock, Hz.
    pub fn core(&self) -> u64 {
        self.core
    }

    /// Stops the run.
    pub fn refuse(&mut self, what: String) {
        if self.error.is_none() {
            self.error = Some(Unmodelled { what, pc: self.pc });
        }
    }

    /// When something happens next.
    pub fn next(&self) -> Option<Ticks> {
        (self.due != Ticks::MAX).then_some(self.due)
    }

    /// Finds out when something happens next; to be called when that may have changed.
    pub fn schedule(&mut self) {
        self.due = self.earliest().unwrap_or(Ticks::MAX);
    }

    fn earliest(&self) -> Option<Ticks> {
        let sampling = [self.tim1.next().map(|(at, _)| at), self.iwdg.next()];
        let sampling = sampling.into_iter().flatten().min();
        [
            sampling.and_then(|at| self.gate.moment(at)),
            self.spi1.next(),
            self.spi3.next(),
            self.usart3.next(),
            self.flash.next(),
            self.adc.next(),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// Whether the core may have to do something else than its next instruction.
    pub fn is_urgent(&self) -> bool {
        self.error.is_some() || self.reset.is_some() || self.fault.is_some() || self.nvic.waits()
    }

    /// Lets everything happen that is due by `now`, in the order of its moments.
    pub fn events(&mut self, now: Ticks) {
        while let Some(at) = self.next().filter(|at| *at <= now) {
            self.happened += 1;
            let sampling = self.gate.sampling(at);
            if self.iwdg.next().is_some_and(|bites| bites <= sampling) && !self.gate.is_closed() {
                self.reset = self.reset.or(Some(Reset::Watchdog));
                self.iwdg = Iwdg::default();
            }
            if let Some((_, update)) = self.tim1.next().filter(|(due, _)| *due <= sampling)
                && !self.gate.is_closed()
            {
                if update && self.gate.holds() {
                    self.gate.close(at);
                } else {
                    self.timer_event(sampling, at);
                }
            }
            if self.adc.advance(at) {
                self.note(pins::BUSY, at);
            }
            self.spi_event(at);
            self.usart3.advance(at);
            self.flash.advance(at);
            self.lines(at);
            self.schedule();
        }
    }

    fn timer_event(&mut self, sampling: Ticks, at: Ticks) {
        let Some(event) = self.tim1.advance(sampling) else {
            return;
        };
        if event.update {
            self.gate.pass();
        }
        // The end of LDAC.
        if event.matches >> 3 & 1 != 0 && self.gate.holds() {
            self.gate.close(at);
        }
        if event.matches >> 1 & 1 != 0 {
            self.counts.timer_event(at);
        }
        self.drive(pins::CONVST, at);
        self.drive(pins::LDAC, at);
    }

    fn spi_event(&mut self, at: Ticks) {
        if let Some(frame) = self.spi1.due(at) {
            let received = self.exchange_adc(frame);
            self.spi1.finish(received);
        }
        if let Some(frame) = self.spi3.due(at) {
            let received = self.exchange_dac(frame);
            self.spi3.finish(received);
        }
    }

    /// Whether a pin has an alternate function.
    fn is_alternate(&self, pin: Pin, number: u8) -> bool {
        self.gpio[usize::from(pin.0)].function(pin.1) == Function::Alternate(number)
    }

    /// A chip takes or gives data at falling edges, so its clock must rise before them.
    fn check_frame(&mut self, frame: Frame, chip: &str, modes: &[(bool, bool)], fastest: u64) {
        if !modes.contains(&(frame.cpol, frame.cpha)) {
            self.refuse(format!(
                "{chip} with CPOL {} and CPHA {}",
                u8::from(frame.cpol),
                u8::from(frame.cpha)
            ));
        }
        if frame.bit < crate::time::cycles(1, fastest) {
            self.refuse(format!("{chip} clocked faster than {fastest} Hz"));
        }
    }

    fn exchange_adc(&mut self, frame: Frame) -> u32 {
        if !self.adc.is_selected() || !self.is_alternate(pins::ADC_SCLK, 5) {
            return 0;
        }
        self.check_frame(frame, "AD7606", &[(true, false)], ADC_CLOCK);
        let connected = self.is_alternate(pins::DOUTA, 5);
        (0..frame.bits).fold(0, |word, _| {
            let (douta, _) = self.adc.clock();
            word << 1 | u32::from(douta && connected)
        })
    }

    fn exchange_dac(&mut self, frame: Frame) -> u32 {
        if !self.dac.is_selected() || !self.is_alternate(pins::DAC_SCLK, 6) {
            return 0;
        }
        let modes = [(true, false), (false, true)];
        self.check_frame(frame, "AD5676R", &modes, DAC_CLOCK);
        let sdi = self.is_alternate(pins::SDI, 6);
        let sdo = self.is_alternate(pins::SDO, 6);
        (0..frame.bits).rev().fold(0, |word, bit| {
            let out = self.dac.clock(sdi && frame.data >> bit & 1 != 0);
            word << 1 | u32::from(out && sdo)
        })
    }

    /// Sets the interrupt lines as the peripherals request.
    fn lines(&mut self, at: Ticks) {
        let timer = self.tim1.requests();
        if timer {
            self.counts.requested(at);
        }
        self.nvic.line(tim1::CC_IRQ, timer);
        self.nvic.line(usart::IRQ, self.usart3.requests());
    }

    /// The level on a pin.
    pub fn level(&self, pin: Pin) -> Level {
        if let Some(level) = self.held.get(&pin) {
            return *level;
        }
        let port = &self.gpio[usize::from(pin.0)];
        let driven = match port.function(pin.1) {
            Function::Output(level) => level,
            Function::Alternate(1) if pin == pins::CONVST => self.tim1.output(0),
            Function::Alternate(1) if pin == pins::LDAC => self.tim1.output(2),
            _ => Level::Floating,
        };
        let outside = match pin {
            pins::BUSY => Level::of(self.adc.busy()),
            // The resistor to ground.
            pins::DAC_RESET => Level::Low,
            _ => Level::Floating,
        };
        let levels = [driven, outside, port.pull(pin.1)];
        levels
            .into_iter()
            .find(|level| *level != Level::Floating)
            .unwrap_or(Level::Floating)
    }

    fn note(&mut self, pin: Pin, at: Ticks) {
        if self.recorder.watches(pin) {
            let level = self.level(pin);
            self.recorder.note(pin, at, level);
        }
    }

    /// Records a pin's level from now on.
    pub fn watch(&mut self, pin: Pin) {
        let level = self.level(pin);
        self.recorder.watch(pin, self.now, level);
    }

    /// A wire between processor and chip may have another level. A floating one counts as
    /// low: for CONVST, SYNC and CS nothing happens then, and LDAC low is the worse case,
    /// because every write to the DAC is at once on its output.
    pub fn drive(&mut self, pin: Pin, at: Ticks) {
        let high = self.level(pin).is_high(false);
        self.note(pin, at);
        match pin {
            pins::CONVST => {
                self.adc.convst(high, at);
                self.note(pins::BUSY, at);
            }
            pins::ADC_RESET => self.adc.reset(high),
            pins::CS => self.adc.select(!high && self.is_driven(pin)),
            pins::LDAC => self.dac.ldac(!high, at),
            pins::SYNC => {
                if let Err(frame) = self.dac.sync(!high && self.is_driven(pin), at) {
                    self.refuse(format!("AD5676R: frame {:#08x} is not modelled", frame.0));
                }
            }
            pins::DAC_RESET => self.dac.reset(!high, at),
            _ => {}
        }
    }

    fn is_driven(&self, pin: Pin) -> bool {
        self.level(pin) != Level::Floating
    }

    /// All wires between processor and chips, and all recorded pins.
    pub fn wires(&mut self) {
        let now = self.now;
        for pin in [
            pins::DAC_RESET,
            pins::CONVST,
            pins::ADC_RESET,
            pins::CS,
            pins::LDAC,
            pins::SYNC,
        ] {
            self.drive(pin, now);
        }
        let watched: Vec<Pin> = self.recorder.pins().collect();
        for pin in watched {
            self.note(pin, now);
        }
    }

    /// The alternate functions that the model has.
    fn check_alternates(&self, port: u8) -> Result<(), Refusal> {
        for number in 0..16 {
            let pin = Pin(port, number);
            let Function::Alternate(function) = self.gpio[usize::from(port)].function(number)
            else {
                continue;
            };
            let known = match pin {
                pins::CONVST | pins::LDAC => function == 1,
                pins::ADC_SCLK | pins::DOUTA => function == 5,
                pins::DAC_SCLK | pins::SDI | pins::SDO => function == 6,
                pins::LINK_TX | pins::LINK_RX => function == 7,
                // The debugger's.
                Pin(0, 13..=15) | Pin(1, 3..=4) => function == 0,
                _ => false,
            };
            if !known {
                return Err(format!("alternate function {function} of {pin:?}"));
            }
        }
        Ok(())
    }

    /// Accounts for an access, and lets happen what is due before it.
    fn begin(&mut self, address: u32) {
        self.accesses += 1;
        // The core's own registers are reached without a bridge.
        if address < 0xE000_0000 {
            self.now += self.ticks.1;
        }
        self.events(self.now);
    }

    /// A read by the core.
    pub fn read(&mut self, address: u32, size: usize) -> u32 {
        let Some((block, offset)) = Block::at(address) else {
            self.refuse(format!(
                "read of {size} bytes at {address:#010x}: no peripheral"
            ));
            return 0;
        };
        self.begin(address);
        self.unsteady += u64::from(!block.is_steady(offset));
        self.counts.access(block, offset, false);
        let answer = self
            .check(block, offset, size)
            .and_then(|()| self.read_register(block, offset, size));
        self.lines(self.now);
        answer.unwrap_or_else(|why| {
            let register = block.register(offset);
            self.refuse(format!("read of {register} at {address:#010x}: {why}"));
            0
        })
    }

    /// A write by the core.
    pub fn write(&mut self, address: u32, size: usize, value: u32) {
        let Some((block, offset)) = Block::at(address) else {
            self.refuse(format!(
                "write of {value:#x}, {size} bytes, to {address:#010x}: no peripheral"
            ));
            return;
        };
        self.begin(address);
        self.unsteady += 1;
        self.counts.access(block, offset, true);
        let done = self
            .check(block, offset, size)
            .and_then(|()| self.write_register(block, offset, size, value));
        self.lines(self.now);
        self.schedule();
        if let Err(why) = done {
            let register = block.register(offset);
            self.refuse(format!(
                "write of {value:#x} to {register} at {address:#010x}: {why}"
            ));
        }
    }

    fn check(&self, block: Block, offset: u32, size: usize) -> Result<(), Refusal> {
        if let Some(domain) = block.domain()
            && !self.rcc.is_on(domain)
        {
            return Err("its clock is off or its reset is on".to_owned());
        }
        let possible = match block {
            Block::Spi1 | Block::Spi3 | Block::Scs => true,
            // RDR and TDR.
            Block::Usart3 => size == 4 || matches!(offset, 0x24 | 0x28),
            // Registers of sixteen bits.
            Block::Tim1 => size >= 2,
            _ => size == 4,
        };
        if possible {
            Ok(())
        } else {
            Err(format!("an access of {size} bytes"))
        }
    }

    fn read_register(&mut self, block: Block, offset: u32, size: usize) -> Result<u32, Refusal> {
        let now = self.now;
        let sampling = self.gate.sampling(now);
        match block {
            Block::Spi1 => self.spi1.read(offset, size),
            Block::Spi3 => self.spi3.read(offset, size),
            Block::Usart3 => self.usart3.read(offset),
            Block::Tim1 => self.tim1.read(offset, sampling),
            Block::Flash => self.flash.read(offset),
            Block::Syscfg => self.syscfg.read(offset),
            Block::Iwdg1 => self.iwdg.read(offset, now),
            Block::Gpio(port) => {
                self.gpio[usize::from(port)].read(offset, |number| self.level(Pin(port, number)))
            }
            Block::Rcc => self.rcc.read(offset, now),
            Block::Pwr => self.pwr.read(offset, now),
            Block::Dbgmcu => self.dbgmcu.read(offset),
            Block::Dwt => self.dwt.read(offset, sampling, self.core),
            Block::Scs => match offset {
                0x100..0xD00 => self.nvic.read(offset, size),
                0xD90..0xDBC => self.mpu.read(offset),
                offset if offset == dwt::DEMCR.0 => Ok(self.dwt.demcr()),
                0xD00..0xF80 => self.scb.read(offset, size, &self.nvic),
                _ => unknown(),
            },
        }
    }

    fn write_register(
        &mut self,
        block: Block,
        offset: u32,
        size: usize,
        value: u32,
    ) -> Result<(), Refusal> {
        let now = self.now;
        let sampling = self.gate.sampling(now);
        match block {
            Block::Spi1 => self.spi1.write(offset, size, value, now),
            Block::Spi3 => self.spi3.write(offset, size, value, now),
            Block::Usart3 => self.usart3.write(offset, value, now),
            Block::Tim1 => {
                self.tim1.write(offset, value, sampling)?;
                if self.tim1.is_fresh() && self.gate.holds() {
                    self.gate.close(now);
                }
                self.drive(pins::CONVST, now);
                self.drive(pins::LDAC, now);
                Ok(())
            }
            Block::Flash => self.flash.write(offset, value, now),
            Block::Syscfg => {
                self.syscfg.write(offset, value)?;
                self.pwr.settle(now);
                Ok(())
            }
            Block::Iwdg1 => self.iwdg.write(offset, value, now, sampling),
            Block::Gpio(port) => self.write_gpio(port, offset, value),
            Block::Rcc => {
                self.rcc.write(offset, value, now)?;
                self.clock();
                self.reset_domains();
                Ok(())
            }
            Block::Pwr => self.pwr.write(offset, value, now),
            Block::Dbgmcu => self.dbgmcu.write(offset, value),
            Block::Dwt => self.dwt.write(offset, value, sampling, self.core),
            Block::Scs => self.write_core(offset, size, value),
        }
    }

    fn write_gpio(&mut self, port: u8, offset: u32, value: u32) -> Result<(), Refusal> {
        self.gpio[usize::from(port)].write(offset, value)?;
        // ODR and BSRR change levels alone.
        if !matches!(offset, 0x14 | 0x18) {
            self.check_alternates(port)?;
        }
        self.wires();
        Ok(())
    }

    fn write_core(&mut self, offset: u32, size: usize, value: u32) -> Result<(), Refusal> {
        match offset {
            0x100..0xD00 => self.nvic.write(offset, size, value),
            0xD90..0xDBC => {
                self.mpu_changed = true;
                self.mpu.write(offset, value)
            }
            offset if offset == dwt::DEMCR.0 => {
                let sampling = self.gate.sampling(self.now);
                self.dwt.set_demcr(value, sampling, self.core)
            }
            0xD00..0xF80 => {
                self.scb.write(offset, size, value, &mut self.nvic)?;
                if self.scb.reset_requested {
                    self.reset = self.reset.or(Some(Reset::Software));
                }
                Ok(())
            }
            _ => unknown(),
        }
    }

    /// Peripherals whose reset bit is set.
    fn reset_domains(&mut self) {
        for domain in Domain::all() {
            if !self.rcc.is_reset(domain) {
                continue;
            }
            match domain {
                Domain::Gpio(port) => {
                    self.gpio[usize::from(port)] = Gpio::new(usize::from(port));
                }
                Domain::Spi1 => self.spi1 = Spi::default(),
                Domain::Spi3 => self.spi3 = Spi::default(),
                Domain::Syscfg => self.syscfg = Syscfg::default(),
                Domain::Tim1 => self.tim1 = Tim1::default(),
                Domain::Usart3 => self.usart3.reset(),
            }
            self.clock();
            self.wires();
        }
    }
}
