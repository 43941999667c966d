//! Test signals that are added to the leg forces before the clamp.
//!
//! Phases are integers in units of 2⁻³² turns, so a frequency is exact and a sine does
//! not drift, however long it runs. Everything else is `f32` and gives the same bits on
//! the host and on a board.

use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::LegForces;
use crate::table::ValidTable;

/// Largest number of sines in a multisine.
pub const LINES: u32 = 64;

/// Longest injection, samples: ten minutes at 20 kHz.
pub const LONGEST: u32 = 12_000_000;

/// Time without a request on the link after which an injection ends by itself, s: the host
/// that began it may be gone.
pub const UNASKED: f32 = 5.0;

/// A test signal of amplitude 1. In a multisine each sine has amplitude 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Signal {
    /// One sine.
    Sine {
        /// Frequency, Hz.
        hz: f32,
    },
    /// A sine whose frequency changes linearly in time.
    Sweep {
        /// Frequency at the start, Hz.
        from: f32,
        /// Frequency at the end, Hz.
        to: f32,
    },
    /// `count` sines of amplitude 1. Sine k, from 0, has first + k·apart turns per period
    /// and Schroeder's phase −π·k²/count, which keeps the peak of the sum low.
    Multisine {
        /// Period of the signal, samples.
        period: u32,
        /// Turns of the first sine per period.
        first: u32,
        /// Difference in turns per period from each sine to the next.
        apart: u32,
        /// Number of sines, 1 to [`LINES`].
        count: u32,
    },
    /// White noise, uniformly distributed from −1 to 1.
    Noise {
        /// Seed of the generator. The same seed gives the same noise.
        seed: u32,
    },
}

/// A test signal on the legs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Injection {
    /// The signal over time.
    pub signal: Signal,
    /// Amplitude in each leg, N. A positive force pushes the frame away from its foot.
    pub legs: [f32; LEGS],
    /// Duration, samples, 1 to [`LONGEST`].
    pub samples: u32,
}

impl Injection {
    /// Whether the injection is allowed under `table`: a duration up to [`LONGEST`],
    /// frequencies up to half the sample rate, and a peak within each leg's force limit.
    pub fn is_within(&self, table: &ValidTable) -> bool {
        let table = table.get();
        let highest = 0.5 * table.sample_rate;
        let frequency = |hz: f32| hz > 0.0 && hz <= highest;
        let (signal, peak) = match self.signal {
            Signal::Sine { hz } => (frequency(hz), 1.0),
            Signal::Sweep { from, to } => (frequency(from) && frequency(to), 1.0),
            Signal::Multisine {
                period,
                first,
                apart,
                count,
            } => {
                let last = u64::from(first) + u64::from(apart) * u64::from(count.saturating_sub(1));
                let good = (1..=LINES).contains(&count)
                    && first > 0
                    && (count == 1 || apart > 0)
                    && 2 * last <= u64::from(period);
                (good, count as f32)
            }
            Signal::Noise { .. } => (true, 1.0),
        };
        let sizes = self.legs.iter().zip(&table.actuators);
        // False for NaN.
        let mut within = sizes.map(|(size, drive)| size.abs() * peak <= drive.limit);
        signal && within.all(|within| within) && (1..=LONGEST).contains(&self.samples)
    }
}

/// A running injection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Injector {
    injection: Injection,
    /// Number of the next sample, from 0.
    at: u32,
    /// Phase of a sine or sweep, 2⁻³² turns; state of the noise generator.
    phase: u32,
    /// Phase advance of a sine or sweep in the next sample, 2⁻⁶⁴ turns.
    step: u64,
    /// Change of `step` per sample.
    slope: i64,
    /// The forces of the next sample, N.
    forces: LegForces,
}

impl Injector {
    /// Starts `injection` at its first sample, at the sample rate of `table`.
    pub fn new(table: &ValidTable, injection: Injection) -> Self {
        let rate = table.get().sample_rate;
        // At most half a turn.
        let step = |hz: f32| phase_step(hz, rate);
        let (phase, from, to) = match injection.signal {
            Signal::Sine { hz } => (0, step(hz), step(hz)),
            Signal::Sweep { from, to } => (0, step(from), step(to)),
            Signal::Multisine { .. } => (0, 0, 0),
            // The generator's state must not be zero.
            Signal::Noise { seed } => (seed.wrapping_mul(0x9E37_79B9) | 1, 0, 0),
        };
        let change = (i64::from(to) - i64::from(from)) << 32;
        let mut injector = Self {
            injection,
            at: 0,
            phase,
            step: u64::from(from) << 32,
            slope: change / i64::from(injection.samples.max(1)),
            forces: LegForces::ZERO,
        };
        injector.compute();
        injector
    }

    /// Remaining samples.
    pub fn left(&self) -> u32 {
        self.injection.samples.saturating_sub(self.at)
    }

    /// The forces of the next sample, N.
    pub fn forces(&self) -> LegForces {
        self.forces
    }

    /// Moves on to the next sample. False at the end of the injection.
    pub fn advance(&mut self) -> bool {
        self.at += 1;
        if self.at >= self.injection.samples {
            return false;
        }
        self.compute();
        true
    }

    fn compute(&mut self) {
        let value = match self.injection.signal {
            Signal::Sine { .. } | Signal::Sweep { .. } => {
                let value = sine(self.phase);
                self.phase = self.phase.wrapping_add((self.step >> 32) as u32);
                self.step = self.step.wrapping_add_signed(self.slope);
                value
            }
            Signal::Multisine {
                period,
                first,
                apart,
                count,
            } => multisine(self.at, period, first, apart, count),
            Signal::Noise { .. } => {
                // Marsaglia's xorshift with shifts 13, 17, 5.
                let mut x = self.phase;
                x ^= x << 13;
                x ^= x >> 17;
                x ^= x << 5;
                self.phase = x;
                // The upper 24 bits are exact in an f32.
                (x >> 8) as f32 / 8_388_608.0 - 1.0
            }
        };
        self.forces = LegForces(self.injection.legs.map(|size| size * value));
    }
}

/// Phase advance per sample of a sine of `hz` at sample rate `rate`, Hz, in 2⁻³² turns.
pub fn phase_step(hz: f32, rate: f32) -> u32 {
    // The cast saturates.
    (hz / rate * 4_294_967_296.0) as u32
}

fn multisine(at: u32, period: u32, first: u32, apart: u32, count: u32) -> f32 {
    let period = u64::from(period.max(1));
    let turn = |parts: u64, of: u64| (((parts % of) << 32) / of) as u32;
    let mut sum = 0.0;
    for k in 0..count.min(LINES) {
        let turns = u64::from(first) + u64::from(k) * u64::from(apart);
        // Schroeder's phase −π·k²/count, as turns to subtract.
        let schroeder = turn(u64::from(k) * u64::from(k), 2 * u64::from(count.max(1)));
        let phase = turn(turns * (u64::from(at) % period), period);
        sum += sine(phase.wrapping_sub(schroeder));
    }
    sum
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
