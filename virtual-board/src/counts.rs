//! Counters of the sample interrupt. All are exact for the model; what they say about a
//! real board depends on the costs of instructions and accesses, which are parameters.

use std::collections::BTreeMap;

use crate::bus::Block;
use crate::time::Ticks;

/// Address of bank 1 of the flash.
const FLASH: u32 = 0x0800_0000;

/// Smallest, largest and sum of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Series {
    /// How many.
    pub count: u64,
    /// Smallest; 0 if there are none.
    pub min: u64,
    /// Largest.
    pub max: u64,
    /// Sum.
    pub sum: u64,
}

impl Series {
    /// Takes a value in.
    pub fn push(&mut self, value: u64) {
        self.min = if self.count == 0 {
            value
        } else {
            self.min.min(value)
        };
        self.max = self.max.max(value);
        self.sum += value;
        self.count += 1;
    }

    /// Mean; NaN if there are none.
    pub fn mean(&self) -> f64 {
        self.sum as f64 / self.count as f64
    }
}

/// The counters.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    /// Instructions of the handler, from its first to its return, without those of other
    /// exceptions.
    pub instructions: Series,
    /// From the timer's event to the handler's first instruction, ticks.
    pub latency: Series,
    /// From the timer's event to the handler's return, ticks.
    pub response: Series,
    /// From a sample to the end of the frames that write the DAC, ticks.
    pub written: Series,
    /// Longest time that the handler's interrupt was requested and masked or not yet taken,
    /// ticks. A part of `latency`; the rest is the entry.
    pub masked: Ticks,
    /// Timer events that came while the handler of the one before had not returned.
    pub overlapped: u64,
    /// Reads and writes of registers in the handler.
    pub accesses: BTreeMap<(Block, u32), [u64; 2]>,
    /// How often each halfword of bank 1 was fetched as an instruction of the handler.
    flash: Vec<u64>,
    /// The moment of the last sample.
    sample: Option<Ticks>,
    /// The moment of the last timer event that no handler has been entered for.
    event: Option<Ticks>,
    /// The moment of the timer event that the handler runs for.
    serving: Option<Ticks>,
    /// The moment at which the interrupt was requested, until it is taken.
    request: Option<Ticks>,
    inside: bool,
    current: u64,
}

impl Counts {
    /// A sample is taken.
    pub fn sampled(&mut self, at: Ticks) {
        self.sample = Some(at);
    }

    /// The frames of a sample have been sent to the DAC.
    pub fn wrote(&mut self, at: Ticks) {
        if let Some(sample) = self.sample {
            self.written.push(at - sample);
        }
    }

    /// The compare event of the sample interrupt.
    pub fn timer_event(&mut self, at: Ticks) {
        self.overlapped += u64::from(self.inside || self.event.is_some());
        self.event = Some(at);
    }

    /// The interrupt's line is high.
    pub fn requested(&mut self, at: Ticks) {
        if !self.inside {
            self.request.get_or_insert(at);
        }
    }

    /// The interrupt is taken at `at`, and its first instruction runs at `first`.
    pub fn entered(&mut self, at: Ticks, first: Ticks) {
        if let Some(request) = self.request.take() {
            self.masked = self.masked.max(at - request);
        }
        self.serving = self.event.take();
        if let Some(event) = self.serving {
            self.latency.push(first - event);
        }
        self.inside = true;
        self.current = 0;
    }

    /// The handler has returned.
    pub fn left(&mut self, at: Ticks) {
        self.inside = false;
        self.request = None;
        self.instructions.push(self.current);
        if let Some(event) = self.serving.take() {
            self.response.push(at - event);
        }
    }

    /// The board was reset.
    pub fn cut(&mut self) {
        self.inside = false;
        (self.event, self.serving, self.request) = (None, None, None);
        self.sample = None;
    }

    /// Whether the handler runs; what preempts it does not count.
    pub fn is_inside(&self) -> bool {
        self.inside
    }

    /// An instruction of the handler.
    pub fn instruction(&mut self, pc: u32) {
        self.current += 1;
        if let Some(at) = pc.checked_sub(FLASH) {
            if self.flash.is_empty() {
                self.flash = vec![0; 1 << 19];
            }
            if let Some(count) = self.flash.get_mut(at as usize / 2) {
                *count += 1;
            }
        }
    }

    /// Instructions of the handler that were fetched from flash: their addresses, and how
    /// often each was.
    pub fn from_flash(&self) -> impl Iterator<Item = (u32, u64)> {
        let counts = self.flash.iter().zip((FLASH..).step_by(2));
        counts
            .filter(|(count, _)| **count > 0)
            .map(|(count, pc)| (pc, *count))
    }

    /// An access to a register.
    pub fn access(&mut self, block: Block, offset: u32, write: bool) {
        if self.inside {
            self.accesses.entry((block, offset)).or_default()[usize::from(write)] += 1;
        }
    }
}
