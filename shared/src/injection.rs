//! Test signals that are added to the leg forces before the clamp.
//!
//! Phases are integers in units of 2⁻³² turns, so a frequency is exact and a sine does
//! not drift, however long it runs. Everything else is `f32` and gives the same bits on
//! the host and on a board.

use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::LegForces;
use crate::multisine::{Multisine, sine};
use crate::table::ValidTable;

/// Longest injection, samples: ten minutes at 20 kHz.
pub const LONGEST: u32 = 12_000_000;

/// Time without a request on the link after which an injection ends by itself, s: the host
/// that began it may be gone.
pub const UNASKED: f32 = 5.0;

/// Samples over which a multisine fades in and out: a jump of the force would shake sensors more than
/// all its lines do.
pub const FADE: u32 = 1024;

/// A test signal, of amplitude 1.
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
    /// The [`Multisine`] of the board, with the amplitudes of its lines. It fades in and out over
    /// [`FADE`] samples.
    Multisine,
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
    /// Whether the injection is allowed under `table`, with the board's `multisine`: a duration up
    /// to [`LONGEST`], frequencies up to half the sample rate, and a peak within each leg's force
    /// limit.
    pub fn is_within(&self, table: &ValidTable, multisine: &Multisine<'_>) -> bool {
        let table = table.get();
        let highest = 0.5 * table.sample_rate;
        let frequency = |hz: f32| hz > 0.0 && hz <= highest;
        let (signal, peak) = match self.signal {
            Signal::Sine { hz } => (frequency(hz), 1.0),
            Signal::Sweep { from, to } => (frequency(from) && frequency(to), 1.0),
            Signal::Multisine => (multisine.peak() > 0.0, multisine.peak()),
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
    /// Starts `injection` at the sample rate of `table`, with the board's `multisine`.
    pub fn new(table: &ValidTable, injection: Injection, multisine: &Multisine<'_>) -> Self {
        let rate = table.get().sample_rate;
        // At most half a turn.
        let step = |hz: f32| phase_step(hz, rate);
        let (phase, from, to) = match injection.signal {
            Signal::Sine { hz } => (0, step(hz), step(hz)),
            Signal::Sweep { from, to } => (0, step(from), step(to)),
            Signal::Multisine => (0, 0, 0),
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
        injector.compute(multisine);
        injector
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

    /// Moves on to the next sample. False if there is none.
    pub fn advance(&mut self, multisine: &Multisine<'_>) -> bool {
        self.at += 1;
        if self.at >= self.injection.samples {
            return false;
        }
        self.compute(multisine);
        true
    }

    fn compute(&mut self, multisine: &Multisine<'_>) {
        let value = match self.injection.signal {
            Signal::Sine { .. } | Signal::Sweep { .. } => {
                let value = sine(self.phase);
                self.phase = self.phase.wrapping_add((self.step >> 32) as u32);
                self.step = self.step.wrapping_add_signed(self.slope);
                value
            }
            Signal::Multisine => {
                let from_end = self.at.min(self.left()).min(FADE);
                multisine.value(self.at) * (from_end as f32 / FADE as f32)
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

/// Phase advance per sample of a sine of `hz` at sample rate `rate`, Hz, in 2⁻³² turns.
pub fn phase_step(hz: f32, rate: f32) -> u32 {
    // The cast saturates.
    (hz / rate * 4_294_967_296.0) as u32
}
