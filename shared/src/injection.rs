//! Test signals that are added to the leg forces before the clamp.
//!
//! Phases are integers in units of 2⁻³² turns, so a frequency is exact and a sine does
//! not drift, however long it runs. Everything else is `f32` and gives the same bits on
//! the host and on a board.
//!
//! The sum of many sines would take too long in a sample. So one period of a multisine is computed
//! first, some numbers per sample, in a memory that the board provides; until then the legs get
//! no force. 64 sines with a period of 8,192 samples take 3.5 s at 20 kHz.

use core::cell::Cell;

use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::LegForces;
use crate::table::ValidTable;

/// Largest number of sines in a multisine.
pub const LINES: u32 = 64;

/// Longest period of a multisine, samples.
pub const PERIOD: u32 = 8192;

/// Values of a multisine that are added up per sample while its period is computed.
const TERMS: u32 = 8;

/// Values of a sine that are computed per sample before that.
const SINES: u32 = 2;

/// Memory for one sample of a multisine's period: a sine with one turn per period, and the sum of
/// all sines.
pub type Point = [f32; 2];

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
    /// and Schroeder's phase −π·k²/count, which keeps the peak of the sum low, rounded to a whole
    /// number of `period`-ths of a turn.
    Multisine {
        /// Period of the signal, samples, up to [`PERIOD`].
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
                    && period <= PERIOD
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

/// What comes after a sample of an injection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Its memory is being filled; the legs get no force.
    Waits,
    /// Its first sample.
    Begins,
    /// Another sample.
    Goes,
    /// Nothing: it has ended.
    Ends,
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
    /// What is left to compute of a multisine's period.
    filling: Option<Filling>,
    /// The forces of the next sample, N.
    forces: LegForces,
}

/// A multisine's period while it is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Filling {
    /// The sine with one turn per period; the next value.
    Sine(u32),
    /// The sum.
    Line {
        /// Number of the sine that is added.
        line: u32,
        /// Number of the next value.
        at: u32,
        /// Its phase, in `period`-ths of a turn.
        phase: u32,
    },
}

impl Injector {
    /// Starts `injection` at the sample rate of `table`. Without the `period` of its
    /// [`Signal::Multisine`], complete from another injection, it waits first. Every call of
    /// [`Injector::advance`] must come with the same memory.
    pub fn new(table: &ValidTable, injection: Injection, period: Option<&[Point]>) -> Self {
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
            filling: None,
            forces: LegForces::ZERO,
        };
        if period.is_none() && matches!(injection.signal, Signal::Multisine { .. }) {
            injector.filling = Some(Filling::Sine(0));
        } else {
            injector.compute(period.unwrap_or_default());
        }
        injector
    }

    /// Samples until its first one, at the start of the injection; 0 if it does not wait.
    pub fn waits(&self) -> u32 {
        match (self.filling, self.injection.signal) {
            (Some(_), Signal::Multisine { period, count, .. }) => {
                period.div_ceil(SINES) + count * period.div_ceil(TERMS)
            }
            _ => 0,
        }
    }

    /// The signal over time.
    pub fn signal(&self) -> Signal {
        self.injection.signal
    }

    /// Remaining samples.
    pub fn left(&self) -> u32 {
        self.injection.samples.saturating_sub(self.at)
    }

    /// The forces of the next sample, N.
    pub fn forces(&self) -> LegForces {
        self.forces
    }

    /// Moves on to the next sample. `period` is the memory of a multisine, at least as long as
    /// its period; its content does not matter at first.
    pub fn advance(&mut self, period: &mut [Point]) -> Next {
        let mut next = Next::Goes;
        if let Some(filling) = self.filling {
            self.filling = filling.go_on(&self.injection.signal, period);
            if self.filling.is_some() {
                return Next::Waits;
            }
            next = Next::Begins;
        } else {
            self.at += 1;
        }
        if self.at >= self.injection.samples {
            return Next::Ends;
        }
        self.compute(period);
        next
    }

    fn compute(&mut self, period: &[Point]) {
        let value = match self.injection.signal {
            Signal::Sine { .. } | Signal::Sweep { .. } => {
                let value = sine(self.phase);
                self.phase = self.phase.wrapping_add((self.step >> 32) as u32);
                self.step = self.step.wrapping_add_signed(self.slope);
                value
            }
            Signal::Multisine { period: length, .. } => {
                // `phase` is the place in the period.
                let value = period.get(self.phase as usize).map_or(0.0, |[_, sum]| *sum);
                self.phase += 1;
                if self.phase >= length {
                    self.phase = 0;
                }
                value
            }
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

impl Filling {
    /// Computes the next values. None after the last one of the last sine.
    fn go_on(self, signal: &Signal, memory: &mut [Point]) -> Option<Self> {
        let Signal::Multisine {
            period,
            first,
            apart,
            count,
        } = *signal
        else {
            return None;
        };
        // As `Injection::is_within` demands: nothing below divides by zero or overflows.
        let (period, count) = (period.clamp(1, PERIOD), count.clamp(1, LINES));
        match self {
            Self::Sine(at) => {
                let end = (at + SINES).min(period);
                let points = memory.get_mut(at as usize..end as usize)?;
                // 2³² as so many periods and a rest, without a division of 64 bits.
                let (periods, rest) = (u32::MAX / period, u32::MAX % period + 1);
                for (at, point) in (at..end).zip(points) {
                    let phase = at.wrapping_mul(periods).wrapping_add(at * rest / period);
                    *point = [sine(phase), 0.0];
                }
                Some(if end < period {
                    Self::Sine(end)
                } else {
                    Self::Line {
                        line: 0,
                        at: 0,
                        phase: 0,
                    }
                })
            }
            Self::Line { line, at, phase } => {
                let turns = u64::from(first) + u64::from(line) * u64::from(apart);
                // Below the period: `Injection::is_within`.
                let step = turns.min(u64::from(period)) as usize;
                let (length, mut phase) = (period as usize, phase as usize);
                let end = at.saturating_add(TERMS).min(period);
                let memory = Cell::from_mut(memory.get_mut(..length)?).as_slice_of_cells();
                for point in memory.get(at as usize..end as usize)? {
                    // Another point of the same memory.
                    let [sine, _] = memory.get(phase)?.get();
                    let [own, sum] = point.get();
                    point.set([own, sum + sine]);
                    phase += step;
                    if phase >= length {
                        phase -= length;
                    }
                }
                if end < period {
                    return Some(Self::Line {
                        line,
                        at: end,
                        phase: phase as u32,
                    });
                }
                let line = line + 1;
                // −k²/(2·count) turns, rounded. Numbers of lines and periods are small enough.
                let (square, whole) = (line * line, 2 * count);
                let shift = (square % whole * period + count) / whole;
                let phase = (period - shift) % period;
                (line < count).then_some(Self::Line { line, at: 0, phase })
            }
        }
    }
}

/// Phase advance per sample of a sine of `hz` at sample rate `rate`, Hz, in 2⁻³² turns.
pub fn phase_step(hz: f32, rate: f32) -> u32 {
    // The cast saturates.
    (hz / rate * 4_294_967_296.0) as u32
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

    /// A period against the sum of its sines in double precision.
    #[test]
    fn a_multisine_is_the_sum_of_its_sines() {
        let tau = core::f64::consts::TAU;
        for (period, first, apart, count) in [
            (8192u32, 1u32, 2u32, 64u32),
            (1000, 3, 5, 20),
            (7, 1, 1, 3),
            (16, 8, 0, 1),
        ] {
            let signal = Signal::Multisine {
                period,
                first,
                apart,
                count,
            };
            let mut memory = [[f32::NAN; 2]; PERIOD as usize];
            let mut filling = Some(Filling::Sine(0));
            let mut samples = 0;
            while let Some(filled) = filling {
                filling = filled.go_on(&signal, &mut memory);
                samples += 1;
            }
            assert_eq!(
                samples,
                period.div_ceil(SINES) + count * period.div_ceil(TERMS)
            );
            for (at, [_, value]) in memory[..period as usize].iter().enumerate() {
                let parts = f64::from(period);
                let sines = (0..count).map(|k| {
                    let turns = f64::from(first + k * apart) * at as f64 / parts;
                    let schroeder = f64::from(k * k) / f64::from(2 * count);
                    (tau * (turns - (schroeder * parts).round() / parts)).sin()
                });
                let error = (f64::from(*value) - sines.sum::<f64>()).abs();
                // The error of each sine, and the rounding of a sum of up to 64.
                assert!(error < 6e-7 * f64::from(count), "{period} {at}: {error:e}");
            }
        }
    }

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
