//! AD7606, eight channels sampled at one instant (data sheet rev. C), in serial mode: the
//! straps are those of `docs/board.md`.

use crate::time::{MICROSECOND, Ticks};

/// The number of channels.
pub const CHANNELS: usize = 8;

/// Shortest conversion without oversampling (t_CONV).
pub const SHORTEST: Ticks = 345 * MICROSECOND / 100;

/// Longest conversion without oversampling (t_CONV).
pub const LONGEST: Ticks = 415 * MICROSECOND / 100;

/// A data line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// V1 to V4 first.
    DoutA,
    /// V5 to V8 first.
    DoutB,
}

/// What is wrong with the chip or its wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Defect {
    /// BUSY is high for ever.
    BusyHigh,
    /// BUSY is low for ever.
    BusyLow,
    /// A data line is cut: what the processor reads is `0` or `1` for ever.
    Dead(Line, bool),
}

/// The chip.
pub struct Ad7606 {
    /// Codes of its inputs now, V1 to V8.
    pub inputs: [i16; CHANNELS],
    /// Largest deviation of a sampled code from its input: noise, the same in every run.
    pub noise: i16,
    /// How long it converts, [`SHORTEST`] to [`LONGEST`].
    pub conversion: Ticks,
    /// What is wrong with it.
    pub defect: Option<Defect>,
    /// Rising edges of CONVST that it took since power-up.
    pub samples: u64,
    random: u32,
    sampled: [i16; CHANNELS],
    results: [i16; CHANNELS],
    /// The end of the conversion that is under way.
    ready: Option<Ticks>,
    convst: bool,
    selected: bool,
    reset: bool,
    /// Bits that DOUTA and DOUTB have shifted out since CS fell.
    shifted: usize,
    /// It converts only after the reset that it needs after power-up.
    started: bool,
}

impl Default for Ad7606 {
    fn default() -> Self {
        Self {
            inputs: [0; CHANNELS],
            noise: 0,
            random: 1,
            conversion: LONGEST,
            defect: None,
            samples: 0,
            sampled: [0; CHANNELS],
            results: [0; CHANNELS],
            ready: None,
            convst: false,
            selected: false,
            reset: false,
            shifted: 0,
            started: false,
        }
    }
}

impl Ad7606 {
    /// Power comes on: it needs its reset before it converts.
    pub fn power_up(&mut self) {
        *self = Self {
            inputs: self.inputs,
            noise: self.noise,
            conversion: self.conversion,
            defect: self.defect,
            ..Self::default()
        };
    }

    /// CONVST A and B. A rising edge samples all channels, unless a conversion is under way.
    pub fn convst(&mut self, high: bool, now: Ticks) {
        let rising = high && !self.convst;
        self.convst = high;
        if rising && self.started && !self.reset && self.ready.is_none() {
            self.samples += 1;
            self.sampled = self
                .inputs
                .map(|code| code.saturating_add(self.deviation()));
            self.ready = Some(now + self.conversion);
        }
    }

    fn deviation(&mut self) -> i16 {
        // xorshift32.
        self.random ^= self.random << 13;
        self.random ^= self.random >> 17;
        self.random ^= self.random << 5;
        let span = 2 * u32::from(self.noise.unsigned_abs()) + 1;
        // Below the span, which fits.
        ((self.random % span) as i16) - self.noise
    }

    /// RESET: high ends a conversion and clears the results.
    pub fn reset(&mut self, high: bool) {
        self.reset = high;
        if high {
            self.started = true;
            self.ready = None;
            self.results = [0; CHANNELS];
        }
    }

    /// CS: a falling edge puts the first bit on DOUTA and DOUTB.
    pub fn select(&mut self, low: bool) {
        if low && !self.selected {
            self.shifted = 0;
        }
        self.selected = low;
    }

    /// Whether CS is low.
    pub fn is_selected(&self) -> bool {
        self.selected
    }

    /// One cycle of SCLK. Returns what DOUTA and DOUTB held before it: DOUTA gives V1 to V8,
    /// DOUTB V5 to V8 and then V1 to V4, each from its highest bit down.
    pub fn clock(&mut self) -> (bool, bool) {
        let bit = |channel: usize, shifted: usize| {
            let code = self.results[(channel + shifted / 16) % CHANNELS].cast_unsigned();
            code >> (15 - shifted % 16) & 1 != 0
        };
        let mut bits = (bit(0, self.shifted), bit(4, self.shifted));
        if self.shifted >= 16 * CHANNELS {
            bits = (false, false);
        }
        self.shifted += 1;
        match self.defect {
            Some(Defect::Dead(Line::DoutA, level)) => bits.0 = level,
            Some(Defect::Dead(Line::DoutB, level)) => bits.1 = level,
            _ => {}
        }
        bits
    }

    /// The level of BUSY.
    pub fn busy(&self) -> bool {
        match self.defect {
            Some(Defect::BusyHigh) => true,
            Some(Defect::BusyLow) => false,
            _ => self.ready.is_some(),
        }
    }

    /// When the conversion ends that is under way.
    pub fn next(&self) -> Option<Ticks> {
        self.ready
    }

    /// Lets time pass. Returns whether BUSY fell.
    pub fn advance(&mut self, now: Ticks) -> bool {
        let ended = self.ready.is_some_and(|ready| ready <= now);
        if ended {
            self.ready = None;
            self.results = self.sampled;
        }
        ended
    }

    /// Puts other codes in the place of those of the last sample, as if the inputs had held
    /// them since then.
    pub fn resample(&mut self) {
        self.sampled = self.inputs;
        if self.ready.is_none() {
            self.results = self.sampled;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn started() -> Ad7606 {
        let mut chip = Ad7606::default();
        chip.reset(true);
        chip.reset(false);
        chip.inputs = [1, -2, 3, -4, 5, -6, 7, -8];
        chip
    }

    fn word(chip: &mut Ad7606) -> (i16, i16) {
        (0..16).fold((0, 0), |(a, b), _| {
            let (bit_a, bit_b) = chip.clock();
            (a << 1 | i16::from(bit_a), b << 1 | i16::from(bit_b))
        })
    }

    #[test]
    fn a_rising_edge_samples_and_both_lines_shift() {
        let mut chip = started();
        chip.convst(true, 0);
        assert!(chip.busy());
        // Another edge while it converts is ignored.
        chip.convst(false, 1);
        chip.inputs = [100; CHANNELS];
        chip.convst(true, 2);
        assert_eq!(chip.samples, 1);
        assert!(!chip.advance(LONGEST - 1));
        assert!(chip.advance(LONGEST));
        assert!(!chip.busy());
        chip.select(true);
        let read: Vec<_> = (0..4).map(|_| word(&mut chip)).collect();
        assert_eq!(read, [(1, 5), (-2, -6), (3, 7), (-4, -8)]);
        assert_eq!(word(&mut chip).0, 5);
        // CS again: from the start.
        chip.select(false);
        chip.select(true);
        assert_eq!(word(&mut chip).0, 1);
    }

    #[test]
    fn it_needs_its_reset() {
        let mut chip = Ad7606::default();
        chip.convst(true, 0);
        assert!(!chip.busy());
        let mut chip = started();
        chip.convst(true, 0);
        chip.reset(true);
        assert!(!chip.busy());
    }

    #[test]
    fn a_stuck_busy_stays() {
        let mut chip = started();
        chip.defect = Some(Defect::BusyHigh);
        assert!(chip.busy());
        chip.defect = Some(Defect::BusyLow);
        chip.convst(true, 0);
        assert!(!chip.busy());
    }
}
