//! A board to run, disturb and look at.

use crate::bus::{Bus, Unmodelled};
use crate::chips::ad5676r::Ad5676r;
use crate::image::Image;
use crate::machine::{Machine, Stop};
use crate::peripherals::rcc::Reset;
use crate::time::{Cost, SECOND, Ticks, in_seconds};
pub use crate::wires::LEGS;
use crate::wires::Pin;

/// Longest time between two samples while the plant waits for one: the board starts, or
/// erases flash.
const PATIENCE: Ticks = 60 * SECOND;

/// A board with an image, from the moment at which power comes on.
pub struct Board {
    /// Its core, for what is not here.
    pub machine: Machine,
    /// Its image.
    pub image: Image,
    /// Every reset since the first power-on: when, and why.
    pub resets: Vec<(Ticks, Reset)>,
}

impl Board {
    /// A board on which power has just come on.
    ///
    /// # Errors
    /// If the image cannot be loaded.
    pub fn new(image: Image, cost: Cost) -> Result<Self, String> {
        Ok(Self {
            machine: Machine::new(&image, cost)?,
            image,
            resets: Vec::new(),
        })
    }

    /// The board around the core.
    pub fn bus(&self) -> &Bus {
        self.machine.bus()
    }

    /// The board around the core, to be changed.
    pub fn bus_mut(&mut self) -> &mut Bus {
        self.machine.bus_mut()
    }

    /// Time since the first power-on.
    pub fn now(&self) -> Ticks {
        self.bus().now
    }

    /// Runs for a time, through any resets.
    ///
    /// # Errors
    /// If the image does something that is not modelled.
    pub fn run(&mut self, time: Ticks) -> Result<(), Unmodelled> {
        let until = self.now() + time;
        while let Stop::Reset(cause) = self.machine.run(until)? {
            self.resets.push((self.now(), cause));
        }
        Ok(())
    }

    /// Runs until an instruction is next, at most for a time. Whether it came.
    ///
    /// # Errors
    /// If the image does something that is not modelled.
    pub fn run_to(&mut self, address: u32, time: Ticks) -> Result<bool, Unmodelled> {
        let until = self.now() + time;
        loop {
            match self.machine.run_to(until, Some(address))? {
                Stop::Reset(cause) => self.resets.push((self.now(), cause)),
                stop => return Ok(stop == Stop::Address),
            }
        }
    }

    /// Resets the board from outside.
    pub fn reset(&mut self, cause: Reset) {
        self.machine.reset(cause);
        self.resets.push((self.now(), cause));
    }

    /// Records a pin and all outputs from now on.
    pub fn record(&mut self, pins: &[Pin]) {
        let now = self.now();
        let bus = self.bus_mut();
        bus.dac.record(now);
        for pin in pins {
            bus.watch(*pin);
        }
    }

    /// Every change of a leg's output since [`Board::record`]: when, and to what code.
    pub fn output(&self, leg: usize) -> &[(Ticks, u16)] {
        self.bus().dac.history(leg).changes()
    }

    /// Voltages of the legs' outputs now.
    pub fn volts(&self) -> [f64; LEGS] {
        let outputs = self.bus().dac.outputs();
        std::array::from_fn(|leg| Ad5676r::volts(outputs[leg]))
    }

    /// What the run measured of the sample interrupt, in a few lines.
    pub fn measured(&self) -> String {
        let bus = self.bus();
        let counts = &bus.counts;
        let microseconds = |ticks: Ticks| 1e6 * in_seconds(ticks);
        let jitter = counts.latency.max - counts.latency.min;
        format!(
            "  {} samples, {} late; core cycles: {} per instruction, {} more per access, which \
             are parameters\n  \
             the interrupt begins {:.3} to {:.3} µs after its event (jitter {:.3} µs), at most \
             {:.3} µs of it masked\n  \
             it returns {:.1} µs after its event, at most {:.1} µs\n  \
             instructions from codes to codes: {:.0}, at most {}; after that: {:.0}, at most {}\n  \
             accesses to registers without waiting: ADC's frame {}, DAC's frames {}
  \
             the DAC's frames end {:.2} to {:.2} µs after the sample",
            counts.instructions.count,
            counts.late,
            bus.cost.instruction,
            bus.cost.access,
            microseconds(counts.latency.min),
            microseconds(counts.latency.max),
            microseconds(jitter),
            microseconds(counts.masked),
            1e6 * in_seconds(1) * counts.response.mean(),
            microseconds(counts.response.max),
            counts.latch.mean(),
            counts.latch.max,
            counts.follow.mean(),
            counts.follow.max,
            counts.adc.max,
            counts.dac.max,
            microseconds(counts.written.min),
            microseconds(counts.written.max),
        )
    }

    /// What is counted of the sample interrupt, in words: see [`crate::counts`].
    pub fn counts(&self) -> String {
        let bus = self.bus();
        let counts = &bus.counts;
        let samples = counts.instructions.count.max(1);
        let cycle = bus.ticks.2.max(1);
        let mut lines = vec![
            format!(
                "{} samples; instructions {} to {}, mean {:.0}",
                counts.instructions.count,
                counts.instructions.min,
                counts.instructions.max,
                counts.instructions.mean()
            ),
            format!(
                "cycles from the timer's event to the handler {} to {}, to its return {} to {}; longest masked {}; {} events during a handler",
                counts.latency.min / cycle,
                counts.latency.max / cycle,
                counts.response.min / cycle,
                counts.response.max / cycle,
                counts.masked / cycle,
                counts.overlapped
            ),
        ];
        for ((block, offset), [reads, writes]) in &counts.accesses {
            let per = |count: u64| count as f64 / samples as f64;
            lines.push(format!(
                "{:<14} {:8.2} reads {:8.2} writes a sample",
                block.register(*offset),
                per(*reads),
                per(*writes)
            ));
        }
        let mut functions = std::collections::BTreeMap::<&str, u64>::new();
        for (pc, count) in counts.from_flash() {
            let name = self.image.function(pc).map_or("?", |symbol| &symbol.name);
            *functions.entry(name).or_default() += count;
        }
        for (name, count) in functions {
            let each = count as f64 / samples as f64;
            lines.push(format!(
                "from flash: {each:8.1} instructions a sample of {name}"
            ));
        }
        lines.join("\n")
    }

    /// Sends bytes to the board over the link, back to back.
    pub fn send(&mut self, bytes: &[u8]) {
        let bus = self.bus_mut();
        bus.usart3.incoming.extend(bytes);
        let now = bus.now;
        bus.usart3.listen(now);
    }

    /// Takes the bytes that the board has sent over the link.
    pub fn received(&mut self) -> Vec<u8> {
        // Whether they are taken or not, the program does not see.
        self.machine.take_link()
    }

    /// From now on every sample waits for [`Board::sample`].
    pub fn lockstep(&mut self) {
        self.bus_mut().gate.install();
        self.machine.stop_at_gate();
    }

    /// Runs until the gate is closed, the link is quiet and the program only waits.
    ///
    /// # Errors
    /// If the image does something that is not modelled, or no sample comes.
    pub fn settle(&mut self) -> Result<(), Unmodelled> {
        let until = self.now() + PATIENCE;
        loop {
            match self.machine.run(until)? {
                Stop::Gate => return Ok(()),
                Stop::Reset(cause) => self.resets.push((self.now(), cause)),
                Stop::Time | Stop::Address => {
                    return Err(Unmodelled {
                        what: "the board takes no samples".to_owned(),
                        pc: self.machine.pc(),
                    });
                }
            }
        }
    }

    /// One sample with these codes of the sensors: from CONVST until the board waits for the
    /// next one. Returns the codes on the outputs after the sample's latch. If that is
    /// later than the next sample (a latch beyond the period), those are returned that wait
    /// for it, because the plant is simulated sample by sample.
    ///
    /// # Errors
    /// As for [`Board::settle`].
    pub fn sample(&mut self, codes: [i16; LEGS]) -> Result<[u16; LEGS], Unmodelled> {
        self.machine.answer(codes);
        self.settle()?;
        let latest = self.bus().dac.latest();
        Ok(std::array::from_fn(|leg| latest[leg]))
    }
}
