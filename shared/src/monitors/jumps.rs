//! Codes from sample to sample: those that stay the same, and those that jump and return.

use crate::LEGS;
use crate::codes::AdcCode;
use crate::table::Table;

use super::{SENSORS, Sight, mask};

/// Time constant of the average of a sensor's jumps from sample to sample, samples.
const USUAL: u32 = 64;

/// Smallest ratio of a spike to the average jump. A vibration of any frequency stays below
/// it.
const FAR: u32 = 8;

/// Samples after an injection in which no spike counts. Forces jump where it ends, and accelerations
/// with them. A closed loop of little delay undoes part of that in the next sample, which looks like
/// a spike in every sensor.
const ECHO: u32 = 64;

/// Samples that are remembered: the three before the end of a spike, rounded up to a power of
/// two.
const MEMORY: usize = 4;

/// What is remembered of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Watched {
    /// The last codes, in a ring: [`Jumps::last`].
    codes: [AdcCode; MEMORY],
    /// Consecutive samples with the same code.
    still: u32,
    /// [`USUAL`] times the recent average of the differences between consecutive codes, without
    /// their sign.
    level: u32,
    /// Spikes in the current second.
    spikes: u32,
}

/// Differences between consecutive codes of every sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jumps {
    sensors: [Watched; SENSORS],
    /// Place of the last code in each sensor's ring.
    last: usize,
    /// Spikes of all sensors in the current second.
    spikes: u32,
    /// Samples of the current second.
    second: u32,
    /// Samples until spikes count again.
    echo: u32,
}

impl Jumps {
    /// Before the first sample.
    pub const NEW: Self = Self {
        sensors: [Watched {
            codes: [AdcCode(0); MEMORY],
            still: 0,
            level: 0,
            spikes: 0,
        }; SENSORS],
        last: 0,
        spikes: 0,
        second: 0,
        echo: 0,
    };

    /// Looks at the codes of all sensors. Spikes do not count while forces are clamped, nor during
    /// an injection and soon after it. Returns whether a code may have been the same for too long:
    /// [`Jumps::stuck`].
    #[inline]
    pub fn see(&mut self, table: &Table, sight: &Sight<'_>) -> bool {
        let samples = sight.samples;
        self.second += 1;
        // Rates are positive and far below 2³².
        if self.second >= table.sample_rate as u32 {
            self.second = 0;
            self.spikes = 0;
            for sensor in &mut self.sensors {
                sensor.spikes = 0;
            }
        }
        let last = self.last;
        self.last = (last + 1) % MEMORY;
        let [sensors, forces] = self.sensors.as_chunks_mut::<LEGS>().0 else {
            return false;
        };
        let (mut sizes, mut still) = look(sensors, last, &samples.sensors);
        if table.complement().is_some() {
            let beside = look(forces, last, &samples.forces);
            (sizes, still) = (sizes | beside.0, still | beside.1);
        }
        let limits = &table.supervision;
        // No jump is larger than all bits of all jumps together.
        let least = limits.spike.map(|limit| u32::from(limit).wrapping_sub(1));
        if sight.injecting {
            self.echo = ECHO;
        } else if self.echo > 0 {
            self.echo -= 1;
        } else if !sight.status.clamped && sizes > least[0].min(least[1]) {
            self.judge(table);
        }
        limits.stuck > 0 && still >= limits.stuck
    }

    /// Counts the sensors whose code now ends a spike.
    #[cold]
    #[inline(never)]
    fn judge(&mut self, table: &Table) {
        for (i, sensor) in self.sensors.iter_mut().enumerate() {
            let code = |ago: usize| i32::from(sensor.codes[(self.last + MEMORY - ago) % MEMORY].0);
            let [a, b, c, d] = [3, 2, 1, 0].map(code);
            let [first, there, back] = [b - a, c - b, d - c];
            let size = there.unsigned_abs().min(back.unsigned_abs());
            let limit = table.supervision.spike[usize::from(i >= LEGS)];
            // Quiet before it, and then back near the old value. 0 switches the monitor off.
            if limit > 0
                && size >= u32::from(limit)
                && 4 * first.unsigned_abs() <= size
                && 2 * (there + back).unsigned_abs() <= size
                && size >= FAR * sensor.level / USUAL
            {
                sensor.spikes += 1;
                self.spikes += 1;
            }
        }
    }

    /// The sensors whose code has been the same for too long.
    pub fn stuck(&self, table: &Table) -> Option<u16> {
        mask(table, |i| self.sensors[i].still >= table.supervision.stuck)
    }

    /// The sensors with at least half as many spikes as the worst one, if there were too many of
    /// all sensors in the current second.
    #[inline]
    pub fn spiky(&self, table: &Table) -> Option<u16> {
        if self.spikes < table.supervision.spikes {
            return None;
        }
        let spikes = self.sensors.map(|sensor| sensor.spikes);
        let most = spikes.iter().copied().fold(0, u32::max);
        mask(table, |i| 2 * spikes[i] >= most)
    }
}

/// Takes the next codes of these sensors; `last` is the place of those before. Returns all bits of
/// all jumps together, and all bits of the numbers of samples for which codes have been the same.
///
/// A slice, not an array: unrolled, it would take two and a half times as many instructions.
#[inline(never)]
fn look(sensors: &mut [Watched], last: usize, codes: &[AdcCode; LEGS]) -> (u32, u32) {
    let (mut sizes, mut still) = (0, 0);
    for (sensor, code) in sensors.iter_mut().zip(codes) {
        let jump = i32::from(code.0) - i32::from(sensor.codes[last % MEMORY].0);
        sensor.codes[(last + 1) % MEMORY] = *code;
        let size = jump.unsigned_abs();
        sizes |= size;
        sensor.level = sensor.level - sensor.level / USUAL + size;
        if jump == 0 {
            sensor.still = sensor.still.saturating_add(1);
            still |= sensor.still;
        } else {
            sensor.still = 0;
        }
    }
    (sizes, still)
}
