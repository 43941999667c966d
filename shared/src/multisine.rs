//! A sum of sines at chosen frequencies, and the part of every sensor and leg at each of them.
//!
//! A window is a power of two of samples, and each sine has a whole number of turns in it. So
//! phases are exact, a line does not leak into another one, and windows of any length need no
//! records: the board adds up products with sine and cosine itself.
//!
//! In two stages, so that a sample has little to do. First the codes are averaged over [`BLOCK`]
//! samples with a triangular weight, which keeps what is above half of that lower rate from being
//! folded onto the lines. Then each average counts with each line, some lines per sample. Codes
//! and weights are integers, and sums are exact. Hann's window over all of it keeps what is between
//! the lines, as the vibrations of the floor, from leaking into them.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::{AdcCode, DacCode};
use crate::recorder::Record;

/// Largest number of lines.
pub const LINES: usize = 32;

/// Sensors, force sensors and legs.
pub const CHANNELS: usize = 3 * LEGS;

/// Samples from one average to the next.
pub const BLOCK: u32 = 8;

/// Shortest and longest window, as powers of two of samples. With a longer one, a sum would not fit
/// into 64 bits.
pub const WINDOWS: [u8; 2] = [10, 20];

/// Fewest turns of a line in a window: Hann's window is three lines wide.
pub const FEWEST: u32 = 2;

/// Weight 1 of a sine, as an integer.
const WHOLE: f32 = (1 << 21) as f32;

/// Code of a DAC that counts as zero. A constant part is in no line; this one keeps sums small.
const MIDDLE: i32 = 1 << 15;

/// A quarter of a turn.
const QUARTER: u32 = 1 << 30;

/// A sine of a multisine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Turns in a window: at least [`FEWEST`], and so few that there are two averages per turn.
    pub turns: u32,
    /// Amplitude, as a part of that of the injection.
    pub amplitude: f32,
}

impl Line {
    /// Phase at sample `at` of the signal, 2⁻³² turns, with windows of 2^`window` samples.
    fn phase(&self, window: u8, at: u32) -> u32 {
        at.wrapping_mul(self.turns) << (32 - window)
    }
}

/// The part of every channel at one line, in the last whole window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LineParts {
    /// Number of whole windows since the signal began.
    pub windows: u32,
    /// X of the part Re(X·e^(jωt)), codes, with t from the begin of the signal: [re, im] of
    /// sensors, force sensors and legs.
    pub parts: [[f32; 2]; CHANNELS],
}

/// Memory for a line and its sums.
#[derive(Clone, Copy, Debug)]
pub struct Slot {
    line: Line,
    /// Of this window and the one before, in turn: products with cosine and sine.
    sums: [[[i64; 2]; CHANNELS]; 2],
}

impl Slot {
    /// No line.
    pub const EMPTY: Self = Self {
        line: Line {
            turns: 0,
            amplitude: 0.0,
        },
        sums: [[[0; 2]; CHANNELS]; 2],
    };
}

/// The lines, and what has been summed up of them.
#[derive(Debug)]
pub struct Multisine<'a> {
    slots: &'a mut [Slot],
    /// Lines in use.
    count: usize,
    /// Length of a window, as a power of two of samples.
    window: u8,
    /// Step of the phases, 2⁻³² turns: line k is shifted by k² of it.
    shift: u32,
    /// Samples since the signal began.
    at: u32,
    /// The averages under way: that with its middle at a past sample, and the next one.
    open: [[i32; CHANNELS]; 2],
    /// The last whole average.
    block: [i32; CHANNELS],
    /// Sample in the middle of `block`, since the signal began.
    middle: u32,
    /// The line that `block` counts with next; none if it is not below `count`.
    due: usize,
}

impl<'a> Multisine<'a> {
    /// No lines, and memory for as many as `slots` are, up to [`LINES`].
    pub fn new(slots: &'a mut [Slot]) -> Self {
        Self {
            slots,
            count: 0,
            window: WINDOWS[0],
            shift: 0,
            at: 0,
            open: [[0; CHANNELS]; 2],
            block: [0; CHANNELS],
            middle: 0,
            due: 0,
        }
    }

    /// Sets the lines, and a window of 2^`window` samples. False, and nothing changes, if a number
    /// is outside its range or there are more lines than memory.
    pub fn set(&mut self, window: u8, lines: &Vec<Line, LINES>) -> bool {
        let [shortest, longest] = WINDOWS;
        let Some(slots) = self.slots.get_mut(..lines.len()) else {
            return false;
        };
        if !(shortest..=longest).contains(&window) {
            return false;
        }
        let highest = (1 << window) / (2 * BLOCK);
        let is_good = |line: &Line| {
            (FEWEST..highest).contains(&line.turns)
                && line.amplitude >= 0.0
                && line.amplitude.is_finite()
        };
        if lines.is_empty() || !lines.iter().all(is_good) {
            return false;
        }
        for (slot, line) in slots.iter_mut().zip(lines) {
            slot.line = *line;
        }
        self.count = lines.len();
        self.window = window;
        // Schroeder's phases, −k²/(2·count) turns, keep the peak of the sum low.
        self.shift = ((1 << 31) / lines.len() as u32).wrapping_neg();
        self.begin();
        true
    }

    /// The sum of the amplitudes; 0 without lines.
    pub fn peak(&self) -> f32 {
        self.lines().map(|slot| slot.line.amplitude).sum()
    }

    fn lines(&self) -> impl Iterator<Item = &Slot> {
        self.slots.iter().take(self.count)
    }

    /// Drops all sums: the signal begins with the next sample.
    pub fn begin(&mut self) {
        self.at = 0;
        self.open = [[0; CHANNELS]; 2];
        self.middle = 0;
        self.due = usize::MAX;
    }

    /// The signal at its sample `at`.
    pub fn value(&self, at: u32) -> f32 {
        let mut sum = 0.0;
        for (k, Slot { line, .. }) in (0u32..).zip(self.lines()) {
            let shift = (k * k).wrapping_mul(self.shift);
            sum += line.amplitude * sine(line.phase(self.window, at).wrapping_add(shift));
        }
        sum
    }

    /// Takes the next sample of the signal.
    pub fn see(&mut self, record: &Record) {
        let code = |code: &AdcCode| i32::from(code.0);
        let drive = |code: &DacCode| i32::from(code.0) - MIDDLE;
        let adc = &record.adc;
        let sensors = adc.sensors.iter().chain(&adc.forces).map(code);
        let codes = sensors.chain(record.dac.iter().map(drive));
        let after = self.at % BLOCK;
        // Up to 8, of 16 bits.
        let weights = [BLOCK - after, after].map(u32::cast_signed);
        let [past, next] = &mut self.open;
        for ((code, past), next) in codes.zip(past.iter_mut()).zip(next.iter_mut()) {
            *past += weights[0] * code;
            *next += weights[1] * code;
        }
        self.add();
        if after == BLOCK - 1 {
            self.block = self.open[0];
            self.open = [self.open[1], [0; CHANNELS]];
            self.middle = self.at - after;
            self.due = 0;
        }
        self.at = self.at.wrapping_add(1);
    }

    /// Adds the last average to the sums of some lines: of all before the next average.
    fn add(&mut self) {
        let (window, middle, block) = (self.window, self.middle, self.block);
        let within = middle & ((1 << window) - 1);
        let hann = WHOLE * (1.0 - sine((within << (32 - window)).wrapping_add(QUARTER)));
        let side = (middle >> window) as usize % 2;
        let many = self.count.div_ceil(BLOCK as usize);
        let end = self.due.saturating_add(many).min(self.count);
        let Some(slots) = self.slots.get_mut(self.due..end) else {
            return;
        };
        for Slot { line, sums } in slots {
            let phase = line.phase(window, middle);
            let weights = [phase.wrapping_add(QUARTER), phase]
                .map(|phase| i64::from((hann * sine(phase)) as i32));
            for (sum, code) in sums[side].iter_mut().zip(block) {
                // The weight is 0 in the first average of a window.
                if within == 0 {
                    *sum = [0; 2];
                }
                sum[0] += weights[0] * i64::from(code);
                sum[1] += weights[1] * i64::from(code);
            }
        }
        self.due = end;
    }

    /// The answers at line `index` in the last whole window; zeros before the end of the first.
    /// None without such a line.
    pub fn answer(&self, index: usize) -> Option<LineParts> {
        let Slot { line, sums } = self.lines().nth(index)?;
        let windows = self.middle >> self.window;
        let mut parts = [[0.0; 2]; CHANNELS];
        if let Some(last) = windows.checked_sub(1) {
            // The triangle's own response, with its zeros at multiples of the lower rate.
            let half = line.turns << (31 - self.window);
            let sides = sine(BLOCK * half) / (BLOCK as f32 * sine(half));
            let averages = (1u32 << self.window) as f32 / BLOCK as f32;
            let square = (BLOCK * BLOCK) as f32 * sides * sides;
            let scale = 2.0 / (averages * square * WHOLE);
            for (part, [cosine, sine]) in parts.iter_mut().zip(sums[last as usize % 2]) {
                *part = [scale * cosine as f32, -scale * sine as f32];
            }
        }
        Some(LineParts { windows, parts })
    }
}

/// sin(2π·phase/2³²), with an error below 3e-7.
pub fn sine(phase: u32) -> f32 {
    // Signed phase, −½ to ½ turn, folded to −¼ to ¼ turn.
    let mut x = phase.cast_signed();
    if !(-0x4000_0000..=0x4000_0000).contains(&x) {
        x = 0x8000_0000_u32.wrapping_sub(phase).cast_signed();
    }
    let x = x as f32 * (core::f32::consts::TAU / 4_294_967_296.0);
    // Taylor series up to x¹¹; the remainder at π/2 is 6e-8.
    let square = x * x;
    let terms = [
        -1.0 / 39_916_800.0,
        1.0 / 362_880.0,
        -1.0 / 5_040.0,
        1.0 / 120.0,
        -1.0 / 6.0,
    ];
    let mut sum = 0.0;
    for term in terms {
        sum = sum * square + term;
    }
    x + x * square * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_is_a_sine() {
        for k in 0..100_000u32 {
            let phase = k.wrapping_mul(42_949).wrapping_add(k);
            let expected = (f64::from(phase) / 4_294_967_296.0 * core::f64::consts::TAU).sin();
            let error = (f64::from(sine(phase)) - expected).abs();
            assert!(error < 3e-7, "{phase:#x}: {error:e}");
        }
        for (phase, value) in [(0, 0.0), (1 << 30, 1.0), (1 << 31, 0.0), (3 << 30, -1.0)] {
            assert!((sine(phase) - value).abs() < 1e-6, "{phase:#x}");
        }
    }
}
