//! Counters of the sample interrupt. All are exact for the model; what they say about a
//! real board depends on the costs of instructions and accesses, which are parameters.
//!
//! An access to a register is counted for the chip that it serves ([`Chip`]). Reading a
//! status register again that was read last counts as waiting, not as another access, as in
//! `firmware::budget`.

use crate::bus::Block;
use crate::time::Ticks;

/// Offset of the register of an SPI that codes are read from.
const RXDR: u32 = 0x30;

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

/// What an access to a register is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chip {
    /// The ADC's bus and pins.
    Adc,
    /// The DAC's.
    Dac,
    /// Neither.
    Other,
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
    /// Reads and writes of registers in the handler, in the order of their first.
    pub accesses: Vec<((Block, u32), [u64; 2])>,
    /// Accesses of a sample for the ADC.
    pub adc: Series,
    /// Accesses of a sample for the DAC.
    pub dac: Series,
    /// Instructions from the last code read to the first access for the DAC.
    pub latch: Series,
    /// Instructions after the last access for the DAC.
    pub follow: Series,
    /// Samples whose frames ended after their latch.
    pub late: u64,
    /// How often each halfword of bank 1 was fetched as an instruction of the handler.
    flash: Vec<u64>,
    /// The moment of the last sample.
    taken: Option<Ticks>,
    /// The moment of the last timer event that no handler has been entered for.
    event: Option<Ticks>,
    /// The moment of the timer event that the handler runs for.
    serving: Option<Ticks>,
    /// The moment at which the interrupt was requested, until it is taken.
    request: Option<Ticks>,
    inside: bool,
    current: u64,
    sample: Sample,
}

/// What is counted in the handler that runs.
#[derive(Clone, Debug, Default)]
struct Sample {
    adc: u64,
    dac: u64,
    /// Instructions when the last code was read.
    adc_last: u64,
    /// Instructions when the DAC was first accessed after that, and when it was last.
    dac_first: Option<u64>,
    dac_last: u64,
    /// The last access, if it was a read.
    read: Option<(Block, u32)>,
    /// Whether the outputs were latched since the timer's event.
    latched: bool,
}

impl Counts {
    /// A sample is taken.
    pub fn sampled(&mut self, at: Ticks) {
        self.taken = Some(at);
    }

    /// The frames of a sample have been sent to the DAC.
    pub fn wrote(&mut self, at: Ticks) {
        if let Some(taken) = self.taken {
            self.written.push(at - taken);
        }
        self.late += u64::from(self.sample.latched);
    }

    /// The compare event of the sample interrupt.
    pub fn timer_event(&mut self, at: Ticks) {
        self.overlapped += u64::from(self.inside || self.event.is_some());
        self.event = Some(at);
        if !self.inside {
            self.sample.latched = false;
        }
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
        self.sample = Sample {
            latched: self.sample.latched,
            ..Sample::default()
        };
    }

    /// The handler has returned.
    pub fn left(&mut self, at: Ticks) {
        self.inside = false;
        self.request = None;
        self.instructions.push(self.current);
        let sample = &self.sample;
        // Without the DAC after the ADC it was no sample of the loop.
        if let (Some(dac_first), 1..) = (sample.dac_first, sample.adc_last) {
            self.adc.push(sample.adc);
            self.dac.push(sample.dac);
            self.latch.push(dac_first - sample.adc_last);
            self.follow.push(self.current - sample.dac_last);
        }
        if let Some(event) = self.serving.take() {
            self.response.push(at - event);
        }
    }

    /// The board was reset.
    pub fn cut(&mut self) {
        self.inside = false;
        (self.event, self.serving, self.request) = (None, None, None);
        self.taken = None;
    }

    /// Whether the handler runs; what preempts it does not count.
    pub fn is_inside(&self) -> bool {
        self.inside
    }

    /// An instruction of the handler.
    #[inline]
    pub fn instruction(&mut self, pc: u32) {
        self.current += 1;
        // What runs from ITCM is below.
        if pc >= FLASH {
            self.fetched(pc - FLASH);
        }
    }

    #[cold]
    fn fetched(&mut self, at: u32) {
        if self.flash.is_empty() {
            self.flash = vec![0; 1 << 19];
        }
        if let Some(count) = self.flash.get_mut(at as usize / 2) {
            *count += 1;
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

    /// LDAC has moved, and the DAC's outputs take what was written if it `latched`.
    pub fn latched(&mut self, latched: bool) {
        self.sample.latched |= latched;
    }

    /// An access to a register.
    pub fn access(&mut self, block: Block, offset: u32, write: bool, chip: Chip) {
        if !self.inside {
            return;
        }
        let place = (block, offset);
        let found = self.accesses.iter().position(|(at, _)| *at == place);
        // They are few.
        let index = found.unwrap_or_else(|| {
            self.accesses.push((place, [0; 2]));
            self.accesses.len() - 1
        });
        self.accesses[index].1[usize::from(write)] += 1;
        if !block.is_behind_bridge() {
            return;
        }
        let sample = &mut self.sample;
        let again = !write && block.is_steady(offset) && sample.read == Some(place);
        sample.read = (!write).then_some(place);
        match chip {
            Chip::Adc => {
                sample.adc += u64::from(!again);
                if (offset, write) == (RXDR, false) {
                    sample.adc_last = self.current;
                    sample.dac_first = None;
                }
            }
            Chip::Dac => {
                sample.dac_first.get_or_insert(self.current);
                sample.dac += u64::from(!again);
                sample.dac_last = self.current;
            }
            Chip::Other => {}
        }
    }
}
