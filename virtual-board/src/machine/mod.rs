//! The core: unicorn runs its instructions; exceptions, faults, time and resets are here,
//! because unicorn has no interrupt controller.
//!
//! A hook before every instruction counts it, lets what is due happen, and stops the
//! emulator when an exception is to be taken. An exception is taken between two
//! instructions, at most one instruction after it became possible; an IT block (up to four
//! instructions) counts as one.

mod emulator;
mod exceptions;
mod faults;
mod hooks;
mod memories;
mod registers;

pub(crate) use emulator::Core;

use unicorn_engine::{MemType, Prot, RegisterARM as Reg};

use crate::bus::{Bus, Unmodelled};
use crate::idle::Idle;
use crate::image::Image;
use crate::peripherals::rcc::Reset;
use crate::time::{Cost, Ticks};
use crate::wires::{INPUTS, LEGS};
use emulator::Emulator;
use registers::general;

/// What the hooks know.
pub struct State {
    /// The board.
    pub bus: Bus,
    /// Instructions since the start.
    pub instructions: u64,
    /// Finds passes of the main loop that can be skipped.
    pub idle: Idle,
    /// The next moment at which the hook has more to do than to count; 0: at once.
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
    /// How long the loop's interrupt is masked, if that is measured.
    masking: Option<Masking>,
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

/// How long the loop's interrupt is masked outside its handler.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Masking {
    /// Since when it has been.
    since: Option<Ticks>,
    /// The longest time.
    pub longest: Ticks,
    /// The first instruction after that.
    pub before: u32,
    /// How often it was.
    pub count: u64,
}

impl Masking {
    /// Whole passes were skipped, in each of which it is masked and not masked again.
    fn skip(&mut self, time: Ticks) {
        if let Some(since) = &mut self.since {
            *since += time;
        }
    }

    fn note(&mut self, masked: bool, now: Ticks, pc: u32) {
        if masked {
            self.since.get_or_insert(now);
        } else if let Some(since) = self.since.take() {
            self.count += 1;
            if now - since > self.longest {
                self.longest = now - since;
                self.before = pc;
            }
        }
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
    uc: Emulator,
    /// The core is locked up: only a reset helps.
    pub locked: bool,
    /// WFI: it sleeps until an exception.
    asleep: bool,
    /// The next instruction.
    pc: u32,
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
            masking: None,
        };
        let mut uc = Emulator::new(state)?;
        memories::map(&mut uc)?;
        hooks::hook(&mut uc)?;
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
        &self.uc.state().bus
    }

    /// The board.
    pub fn bus_mut(&mut self) -> &mut Bus {
        let state = self.uc.state_mut();
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
        self.uc.state().instructions
    }

    /// What is known of idle passes.
    pub fn idle(&self) -> &Idle {
        &self.uc.state().idle
    }

    /// What is known of idle passes.
    pub fn idle_mut(&mut self) -> &mut Idle {
        &mut self.uc.state_mut().idle
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

    /// The plant has answered: the ADC's inputs with a sensor have these codes, and the gate opens.
    /// The program cannot see it before it reads a peripheral.
    pub fn answer(&mut self, codes: [i16; LEGS]) {
        let state = self.uc.state_mut();
        let bus = &mut state.bus;
        for (input, code) in INPUTS.into_iter().zip(codes) {
            bus.adc.inputs[input] = code;
        }
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
        self.uc.state_mut().stop_at_gate = true;
    }

    /// Takes the bytes that the board has sent over the link. The program cannot see it.
    pub fn take_link(&mut self) -> Vec<u8> {
        self.uc.state_mut().bus.usart3.outgoing.drain(..).collect()
    }

    /// From now on it is measured how long the loop's interrupt is masked. The run is slower
    /// then.
    pub fn measure_masking(&mut self) {
        self.uc.state_mut().masking = Some(Masking::default());
        self.bus_mut();
    }

    /// How long the loop's interrupt was masked since [`Machine::measure_masking`].
    pub fn masking(&self) -> Option<Masking> {
        self.uc.state().masking
    }

    /// Resets the board.
    pub fn reset(&mut self, cause: Reset) {
        self.uc.state_mut().bus.counts.cut();
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
        let state = self.uc.state_mut();
        state.until = until;
        state.stop_at = address;
        loop {
            self.uc.state_mut().bus.schedule();
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
            if self.uc.state().waits_at_gate(self.asleep || self.locked) {
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
        let bus = &mut self.uc.state_mut().bus;
        let next = bus.next().unwrap_or(until).clamp(bus.now, until);
        bus.now = next;
        bus.events(next);
    }
}
