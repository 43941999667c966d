//! Levels: rms and peak of every sensor and leg over about a quarter of a second, in dB of full
//! scale, so that a slow line carries them.
//!
//! Each channel counts with every seventh sample, one of each kind in turn, so that a sample has
//! little to do. This does not change the rms of a vibration: what is above half of that lower
//! rate is folded, not filtered out. Seven, because a limit cycle often repeats after two to six
//! samples, and would look constant if the channel were always seen at the same place of the
//! cycle. A single sample that stands out can be missed; the monitors look at every one.
//! After a window the levels are evaluated, one number per sample, before the next window
//! begins: no sample has both to do.
//!
//! Sums are exact: they are integers. The logarithm is micromath's; `tests/levels.rs` measures
//! its error. The controller step uses none of this.

use micromath::F32;
use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::{DacCode, Samples};
use crate::table::{Table, ValidTable};

/// Sensors, force sensors and legs.
const CHANNELS: usize = 3 * LEGS;

/// Samples from one of a channel to the next: one of each kind after the other, and one sample
/// for the end of the round.
const ROUND: usize = LEGS + 1;

/// Windows per second.
const WINDOWS: f32 = 4.0;

/// Smallest and largest number of samples of a channel in a window. With more, a sum would not
/// fit into 32 bits.
const COUNTS: [u32; 2] = [16, 1 << 15];

/// A level below full scale, in steps of half a decibel.
///
/// Full scale is the amplitude of the largest signal that the converter carries: one code past
/// the highest ADC code, and for a DAC as many codes as zero force is above the lowest. A sine at
/// full scale has a peak of 0 dB and an rms of −3 dB.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Decibels(u8);

impl Decibels {
    /// No signal at all: a constant code, a code of zero, or no such sensor.
    pub const NOTHING: Self = Self(u8::MAX);

    /// The level, dB of full scale: 0 or below, in steps of 0.5. None without a signal.
    pub fn decibels(self) -> Option<f32> {
        // Not a product with −0.5, which would print as −0.0 at full scale.
        (self != Self::NOTHING).then(|| 0.0 - 0.5 * f32::from(self.0))
    }

    /// The level of a power, relative to that of full scale; `power` is above 0.
    fn of(power: f32, full: f32) -> Self {
        // Not below 1, where micromath would take a reciprocal first.
        let below = F32(larger_than_one(full / power)).log10().0;
        // Half decibels, rounded; the cast saturates.
        Self(((20.0 * below + 0.5) as u8).min(u8::MAX - 1))
    }
}

fn larger_than_one(x: f32) -> f32 {
    if x > 1.0 { x } else { 1.0 }
}

/// rms and peak of a channel in a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Level {
    /// rms about the mean of the window.
    pub rms: Decibels,
    /// Largest distance from code 0 of an ADC, or from the DAC code of zero force.
    pub peak: Decibels,
}

impl Level {
    /// No signal.
    const NOTHING: Self = Self {
        rms: Decibels::NOTHING,
        peak: Decibels::NOTHING,
    };
}

/// The levels of a window. As a reply on the link it fits into a frame of 64 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Levels {
    /// Number of the window since power-up or the last new table; 0 before the end of the first.
    pub window: u32,
    /// Sensors.
    pub sensors: [Level; LEGS],
    /// Force sensors of a table with both kinds; without a signal otherwise.
    pub forces: [Level; LEGS],
    /// Outputs to the legs.
    pub legs: [Level; LEGS],
    /// Largest leg force, relative to its limit, %.
    pub limit: u8,
    /// Average time that the processor is busy with a sample, relative to the sample period, %; 0
    /// on a board without a clock for it.
    pub load: u8,
}

impl Levels {
    /// Before the first window.
    const NOTHING: Self = Self {
        window: 0,
        sensors: [Level::NOTHING; LEGS],
        forces: [Level::NOTHING; LEGS],
        legs: [Level::NOTHING; LEGS],
        limit: 0,
        load: 0,
    };

    fn channel(&mut self, i: usize) -> Option<&mut Level> {
        let Self {
            sensors,
            forces,
            legs,
            ..
        } = self;
        sensors.iter_mut().chain(forces).chain(legs).nth(i)
    }
}

/// Sums of one channel over a window.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sums {
    first: i32,
    second: u64,
    peak: u32,
}

impl Sums {
    const NOTHING: Self = Self {
        first: 0,
        second: 0,
        peak: 0,
    };

    /// `code` is below 2¹⁶ in size, so that no sum overflows with the largest of [`COUNTS`].
    #[inline]
    fn add(&mut self, code: i32) {
        let size = code.unsigned_abs();
        self.first += code;
        self.second += u64::from(size) * u64::from(size);
        self.peak = self.peak.max(size);
    }

    /// The variance times the square of `count`: n·Σx² − (Σx)², exact.
    fn variance(&self, count: u32) -> u64 {
        let first = u64::from(self.first.unsigned_abs());
        (u64::from(count) * self.second).saturating_sub(first * first)
    }
}

/// What the meter is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Task {
    /// Adding samples: of the channels with this number in their kind, after so many rounds.
    Add { turn: usize, rounds: u32 },
    /// Evaluating the window: the next channel, and whether its peak is next.
    Evaluate { channel: usize, peak: bool },
}

impl Task {
    const FIRST: Self = Self::Add { turn: 0, rounds: 0 };
}

/// Makes [`Levels`] from samples and outputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meter {
    task: Task,
    sums: [Sums; CHANNELS],
    /// The levels under evaluation; with the number of the last window until then.
    next: Levels,
    levels: Levels,
}

/// Samples of a channel in a window.
fn count(table: &Table) -> u32 {
    // The cast saturates.
    let count = (table.sample_rate / (WINDOWS * ROUND as f32)) as u32;
    let [least, most] = COUNTS;
    count.clamp(least, most)
}

/// Length of a window of samples, s.
pub fn seconds(table: &Table) -> f32 {
    count(table) as f32 * ROUND as f32 / table.sample_rate
}

impl Meter {
    /// Before the first sample.
    pub const NEW: Self = Self {
        task: Task::FIRST,
        sums: [Sums::NOTHING; CHANNELS],
        next: Levels::NOTHING,
        levels: Levels::NOTHING,
    };

    /// The levels of the last whole window, with the share `busy`/`period` as the load.
    pub fn levels(&self, busy: u32, period: u32) -> Levels {
        let load = (100 * u64::from(busy)).checked_div(period.into());
        Levels {
            load: load.unwrap_or(0).min(u8::MAX.into()) as u8,
            ..self.levels
        }
    }

    /// Takes a sample and its outputs: adds one channel of each kind, or evaluates one number of
    /// the window that has ended.
    pub fn see(&mut self, table: &ValidTable, samples: &Samples, dac: &[DacCode; LEGS]) {
        let table = table.get();
        self.task = match self.task {
            Task::Add { turn, rounds } if turn < LEGS => {
                self.add(table, turn, samples, dac);
                Task::Add {
                    turn: turn + 1,
                    rounds,
                }
            }
            Task::Add { rounds, .. } if rounds + 1 < count(table) => Task::Add {
                turn: 0,
                rounds: rounds + 1,
            },
            Task::Add { .. } => Task::Evaluate {
                channel: 0,
                peak: false,
            },
            Task::Evaluate { channel, peak } if channel < CHANNELS => {
                self.evaluate(table, channel, peak);
                Task::Evaluate {
                    channel: channel + usize::from(peak),
                    peak: !peak,
                }
            }
            Task::Evaluate { .. } => {
                self.next.window = self.next.window.wrapping_add(1);
                self.levels = self.next;
                self.next.limit = 0;
                Task::FIRST
            }
        };
    }

    /// Adds the codes of one channel of each kind.
    #[inline]
    fn add(&mut self, table: &Table, turn: usize, samples: &Samples, dac: &[DacCode; LEGS]) {
        let [sensors, forces, legs] = [0, LEGS, 2 * LEGS].map(|kind| kind + turn);
        if let (Some(sums), Some(code)) = (self.sums.get_mut(sensors), samples.sensors.get(turn)) {
            sums.add(code.0.into());
        }
        if let (Some(sums), Some(code)) = (self.sums.get_mut(forces), samples.forces.get(turn)) {
            sums.add(code.0.into());
        }
        if let (Some(sums), Some(code), Some(drive)) = (
            self.sums.get_mut(legs),
            dac.get(turn),
            table.actuators.get(turn),
        ) {
            // A valid table has it within sixteen bits.
            sums.add(i32::from(code.0) - drive.zero as i32);
        }
    }

    /// Evaluates one number of a channel. With the peak, the last one, its sums begin anew.
    fn evaluate(&mut self, table: &Table, channel: usize, peak: bool) {
        let drive = channel
            .checked_sub(2 * LEGS)
            .and_then(|leg| table.actuators.get(leg));
        let scale = drive.map_or(f32::from(table.adc_max.0) + 1.0, |drive| drive.zero);
        let (Some(sums), Some(level)) = (self.sums.get_mut(channel), self.next.channel(channel))
        else {
            return;
        };
        if !peak {
            let count = count(table);
            let full = scale * count as f32;
            level.rms = match sums.variance(count) {
                0 => Decibels::NOTHING,
                variance => Decibels::of(variance as f32, full * full),
            };
            return;
        }
        let size = sums.peak as f32;
        *sums = Sums::NOTHING;
        level.peak = if size > 0.0 {
            Decibels::of(size * size, scale * scale)
        } else {
            Decibels::NOTHING
        };
        if let Some(drive) = drive {
            // Rounded; the cast saturates.
            let share = (100.0 * size / (drive.gain * drive.limit).abs() + 0.5) as u8;
            self.next.limit = self.next.limit.max(share);
        }
    }
}
