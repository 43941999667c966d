//! The monitors: faults of sensors, outputs and the board, found in every sample.

use crate::LEGS;
use crate::codes::{DacCode, Samples};
use crate::step::{Status, larger};
use crate::supervisor::{Cause, Mode};
use crate::table::{Table, ValidTable};

/// Number of sensors of both kinds.
const SENSORS: usize = 2 * LEGS;

/// Time constant of the average of a sensor's jumps from sample to sample, samples.
const USUAL: u32 = 64;

/// Smallest ratio of a spike to the average jump. A vibration of any frequency stays below
/// it.
const FAR: u32 = 8;

/// Jumps that are remembered: the three of a spike, rounded up to a power of two.
const JUMPS: usize = 4;

/// Each channel is added to the sums of the window every so many samples, in turn: a variance
/// needs no more.
const TURNS: usize = 4;

/// What is remembered of a sensor from sample to sample.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Watched {
    /// The previous code.
    before: i32,
    /// Consecutive samples with the same code.
    still: u32,
    /// The last differences between consecutive codes, in a ring: [`Monitors::last`].
    jumps: [i32; JUMPS],
    /// [`USUAL`] times the recent average of their absolute values.
    level: u32,
    /// Spikes in the current second.
    spikes: u32,
}

impl Watched {
    const NEW: Self = Self {
        before: 0,
        still: 0,
        jumps: [0; JUMPS],
        level: 0,
        spikes: 0,
    };

    /// Takes the next code; its jump goes to the place `next` of the ring. Returns whether it
    /// ends a spike of at least `limit`.
    #[inline]
    fn jump(&mut self, next: usize, code: i32, limit: u32) -> bool {
        let now = code - self.before;
        self.before = code;
        self.jumps[next % JUMPS] = now;
        self.level = self.level - self.level / USUAL + now.unsigned_abs();
        if now == 0 {
            self.still = self.still.saturating_add(1);
            return false;
        }
        self.still = 0;
        now.unsigned_abs() >= limit && self.is_spike(next, limit)
    }

    /// Whether the jumps up to the one at `last` are a spike of at least `limit`.
    #[cold]
    #[inline(never)]
    fn is_spike(&self, last: usize, limit: u32) -> bool {
        let [first, there, back] =
            [2, 1, 0].map(|before| self.jumps[(last + JUMPS - before) % JUMPS]);
        let size = there.unsigned_abs().min(back.unsigned_abs());
        // Quiet before it, and then back near the old value.
        size >= limit
            && 4 * first.unsigned_abs() <= size
            && 2 * (there + back).unsigned_abs() <= size
            && size >= FAR * self.level / USUAL
    }
}

/// The state of the monitors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Monitors {
    sensors: [Watched; SENSORS],
    /// Place of the last jump in each sensor's ring.
    last: usize,
    /// Consecutive samples at a rail.
    rail: [u32; SENSORS],
    /// Whether any of `rail` is not zero.
    railed: bool,
    /// Spikes of all sensors in the current second.
    spikes: u32,
    /// Samples of the current second.
    second: u32,
    /// Consecutive samples that could not be read.
    lost: u32,
    /// Four times the clamped samples, less one for each sample that was not.
    saturated: u32,
    /// Samples since the last valid frame, while the legs are driven.
    silence: u32,
    /// The current and the previous window, which alternate: a copy would take longer than
    /// everything else.
    windows: [WindowSums; 2],
    /// Whether the first window has begun.
    begun: bool,
    /// Whether the second of `windows` is the current one.
    turn: bool,
    /// The next part of the previous window to evaluate.
    stage: usize,
    /// Variance of each sensor in the previous window, squared sensor units.
    variances: [f32; SENSORS],
    /// Consecutive windows in which a sensor was implausible.
    strange: [u32; SENSORS],
    /// Largest variance of a leg force in the last evaluated window, relative to the square
    /// of its limit.
    power: f32,
    /// Consecutive windows in which it grew.
    grown: u32,
}

/// Sums of the differences of a code from its value at the start of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sums {
    origin: i32,
    /// Number of codes.
    count: u32,
    /// Of the differences.
    first: i64,
    /// Of their squares.
    second: i64,
}

impl Sums {
    /// Before the first code of a window, which is `origin`.
    const fn at(origin: i32) -> Self {
        Self {
            origin,
            count: 0,
            first: 0,
            second: 0,
        }
    }

    #[inline]
    fn add(&mut self, code: i32) {
        // Codes have sixteen bits, so a square fits into 64.
        let d = i64::from(code - self.origin);
        self.count += 1;
        self.first += d;
        self.second += d * d;
    }

    /// The variance of the codes.
    fn variance(&self) -> f32 {
        let n = self.count as f32;
        let mean = single(self.first) / n;
        single(self.second) / n - mean * mean
    }
}

/// The number in single precision, by its halves: the conversion of a whole one would be a
/// subroutine.
#[inline]
fn single(x: i64) -> f32 {
    // The upper half has the sign; the lower one is what is left.
    (x >> 32) as i32 as f32 * 4_294_967_296.0 + x as u32 as f32
}

/// Sums over a window.
#[derive(Clone, Copy, Debug, PartialEq)]
struct WindowSums {
    /// Samples.
    count: u32,
    /// Missed deadlines.
    late: u32,
    sensors: [Sums; SENSORS],
    forces: [Sums; LEGS],
}

impl WindowSums {
    const EMPTY: Self = Self {
        count: 0,
        late: 0,
        sensors: [Sums::at(0); SENSORS],
        forces: [Sums::at(0); LEGS],
    };
}

/// Number of sensors that the table uses.
fn count(table: &Table) -> usize {
    if table.complement().is_some() {
        SENSORS
    } else {
        LEGS
    }
}

/// A mask with bit i set where `is(i)`, of the sensors that the table uses. None if no bit
/// is set.
fn mask(table: &Table, is: impl Fn(usize) -> bool) -> Option<u16> {
    let mut bits = 0;
    for i in 0..count(table) {
        if is(i) {
            bits |= 1 << i;
        }
    }
    (bits != 0).then_some(bits)
}

impl Monitors {
    /// Before the first sample.
    pub const NEW: Self = Self {
        sensors: [Watched::NEW; SENSORS],
        last: 0,
        rail: [0; SENSORS],
        railed: false,
        spikes: 0,
        second: 0,
        lost: 0,
        saturated: 0,
        silence: 0,
        windows: [WindowSums::EMPTY; 2],
        begun: false,
        turn: false,
        stage: usize::MAX,
        variances: [0.0; SENSORS],
        strange: [0; SENSORS],
        power: 0.0,
        grown: 0,
    };

    /// To be called when a valid frame arrived on the link.
    pub fn heard(&mut self) {
        self.silence = 0;
    }

    /// Samples since the last valid frame on the link; 0 while nothing drives the legs.
    pub fn silence(&self) -> u32 {
        self.silence
    }

    /// To be called instead of [`Monitors::see`] when a sample could not be read.
    pub fn lost(&mut self, table: &ValidTable) -> Option<Cause> {
        self.lost = self.lost.saturating_add(1);
        (self.lost >= table.get().supervision.lost).then_some(Cause::Lost)
    }

    /// Checks one sample with the output and status of its step, and returns the first
    /// fault found. `late` says that the previous deadline was missed, `calm` that nothing
    /// is injected: forces that jump, as injected and clamped ones may, cause jumps in the
    /// sensors that are no spikes.
    pub fn see(
        &mut self,
        table: &ValidTable,
        mode: Mode,
        samples: &Samples,
        (dac, status): (&[DacCode; LEGS], Status),
        late: bool,
        calm: bool,
    ) -> Option<Cause> {
        let table = table.get();
        let limits = &table.supervision;
        self.lost = 0;
        if !self.begun {
            self.begun = true;
            self.begin(samples, dac);
        }
        self.count_rails(status);
        let stuck = self.look(table, samples, calm && !status.clamped);
        if mode.is_loop() && status.clamped {
            // Four up and one down, so that a limit cycle that is clamped in only some of
            // its samples counts too.
            self.saturated = self.saturated.saturating_add(4);
        } else {
            self.saturated = self.saturated.saturating_sub(1);
        }
        let driven = mode.is_loop() || mode == Mode::Testing;
        self.silence = if driven || !calm {
            self.silence.saturating_add(1)
        } else {
            0
        };
        self.add(table, samples, dac, late);

        if status.not_finite {
            return Some(Cause::NotFinite);
        }
        if self.railed
            && let Some(bits) = mask(table, |i| self.rail[i] >= limits.rail)
        {
            return Some(Cause::Rail(bits));
        }
        if stuck && let Some(bits) = mask(table, |i| self.sensors[i].still >= limits.stuck) {
            return Some(Cause::Stuck(bits));
        }
        if self.spikes >= limits.spikes {
            let spikes = self.sensors.map(|sensor| sensor.spikes);
            let most = spikes.iter().copied().fold(0, u32::max);
            return mask(table, |i| 2 * spikes[i] >= most).map(Cause::Erratic);
        }
        if self.saturated / 4 >= limits.saturated {
            return Some(Cause::Saturated);
        }
        // An injection alone ends without a fault: see `Controller`.
        if driven && limits.silence > 0 && self.silence >= limits.silence {
            return Some(Cause::Silent);
        }
        let (window, _) = self.windows();
        if window.late > limits.late {
            return Some(Cause::Late);
        }
        if window.count >= limits.window {
            self.turn = !self.turn;
            self.stage = 0;
            self.begin(samples, dac);
        }
        self.conclude(table, mode)
    }

    /// Counts the samples at a rail. Nothing to do as long as there are none.
    #[inline]
    fn count_rails(&mut self, status: Status) {
        if !status.at_rail() && !self.railed {
            return;
        }
        let bits = u16::from(status.sensors_at_rail) | u16::from(status.forces_at_rail) << LEGS;
        self.railed = bits != 0;
        for (i, rail) in self.rail.iter_mut().enumerate() {
            *rail = if bits >> i & 1 != 0 {
                rail.saturating_add(1)
            } else {
                0
            };
        }
    }

    /// Looks at the codes of all sensors. Returns whether one has not changed for too long.
    #[inline]
    fn look(&mut self, table: &Table, samples: &Samples, calm: bool) -> bool {
        self.second += 1;
        // Rates are positive and far below 2³².
        if self.second >= table.sample_rate as u32 {
            self.second = 0;
            self.spikes = 0;
            for sensor in &mut self.sensors {
                sensor.spikes = 0;
            }
        }
        let limits = &table.supervision;
        let longest = if limits.stuck > 0 {
            limits.stuck
        } else {
            u32::MAX
        };
        let mut stuck = false;
        let next = (self.last + 1) % JUMPS;
        self.last = next;
        let kinds = [&samples.sensors, &samples.forces];
        let watched = self.sensors.as_chunks_mut::<LEGS>().0.iter_mut();
        // The table may use one kind only.
        let all = watched.zip(kinds).zip(limits.spike);
        for ((watched, codes), spike) in all.take(count(table) / LEGS) {
            // 0 switches the monitor off.
            let spike = if spike == 0 || !calm {
                u32::MAX
            } else {
                u32::from(spike)
            };
            for i in 0..LEGS {
                let sensor = &mut watched[i];
                if sensor.jump(next, codes[i].0.into(), spike) {
                    sensor.spikes += 1;
                    self.spikes += 1;
                }
                stuck |= sensor.still >= longest;
            }
        }
        stuck
    }

    /// Adds a sample to the current window: of every channel, every fourth sample.
    #[inline]
    fn add(&mut self, table: &Table, samples: &Samples, dac: &[DacCode; LEGS], late: bool) {
        let (window, _) = self.windows();
        let turn = window.count as usize % TURNS;
        window.count += 1;
        window.late += u32::from(late);
        let kinds = [&samples.sensors, &samples.forces];
        let sums = window.sensors.as_chunks_mut::<LEGS>().0.iter_mut();
        for (sums, codes) in sums.zip(kinds).take(count(table) / LEGS) {
            for i in [turn, turn + TURNS] {
                if let (Some(sums), Some(code)) = (sums.get_mut(i), codes.get(i)) {
                    sums.add(code.0.into());
                }
            }
        }
        for i in [turn, turn + TURNS] {
            if let (Some(sums), Some(code)) = (window.forces.get_mut(i), dac.get(i)) {
                sums.add(code.0.into());
            }
        }
    }

    /// Begins a window. The codes of this sample are the origin of its sums.
    fn begin(&mut self, samples: &Samples, dac: &[DacCode; LEGS]) {
        let (window, _) = self.windows();
        (window.count, window.late) = (0, 0);
        let codes = samples.sensors.iter().chain(&samples.forces);
        for (sums, code) in window.sensors.iter_mut().zip(codes) {
            *sums = Sums::at(code.0.into());
        }
        for (sums, code) in window.forces.iter_mut().zip(dac) {
            *sums = Sums::at(code.0.into());
        }
    }

    /// The current and the previous window.
    fn windows(&mut self) -> (&mut WindowSums, &mut WindowSums) {
        let [a, b] = &mut self.windows;
        if self.turn { (b, a) } else { (a, b) }
    }

    /// Evaluates the next part of the previous window: one sensor per sample, then one kind
    /// of sensor, then the forces. Everything at once would make this the longest sample.
    fn conclude(&mut self, table: &Table, mode: Mode) -> Option<Cause> {
        let stage = self.stage;
        self.stage = stage.saturating_add(1);
        if stage < SENSORS {
            self.variance(table, stage);
        } else if stage < SENSORS + 2 {
            self.compare(table, stage - SENSORS);
        } else if stage == SENSORS + 2 {
            return self.power(table, mode);
        }
        None
    }

    /// The variance of a sensor, in its squared unit.
    fn variance(&mut self, table: &Table, sensor: usize) {
        let beside = table.complement().map(|complement| &complement.sensors);
        let kind = if sensor < LEGS {
            Some(&table.sensors)
        } else {
            beside
        };
        let Some(calibration) = kind.and_then(|kind| kind.get(sensor % LEGS)) else {
            return;
        };
        let [a, b] = &self.windows;
        let w = if self.turn { a } else { b };
        if let (Some(variance), Some(sums)) =
            (self.variances.get_mut(sensor), w.sensors.get(sensor))
        {
            *variance = sums.variance() * calibration.gain * calibration.gain;
        }
    }

    /// Compares the sensors of one kind with each other.
    fn compare(&mut self, table: &Table, kind: usize) {
        let limits = &table.supervision;
        let (Some(variances), Some(strange)) = (
            self.variances.as_chunks::<LEGS>().0.get(kind),
            self.strange.as_chunks_mut::<LEGS>().0.get_mut(kind),
        ) else {
            return;
        };
        let mut sorted = *variances;
        sorted.sort_unstable_by(f32::total_cmp);
        let median = 0.5 * (sorted[2] + sorted[3]);
        let [wild_by, dull_by] = [limits.wild, limits.dull].map(|ratio| ratio * ratio);
        for (strange, variance) in strange.iter_mut().zip(variances) {
            let wild = *variance > wild_by * median;
            let dull = variance * dull_by < median;
            *strange = if wild || dull { *strange + 1 } else { 0 };
        }
    }

    /// Evaluates the forces, and returns the fault of the window, if any.
    fn power(&mut self, table: &Table, mode: Mode) -> Option<Cause> {
        let limits = &table.supervision;
        let (_, w) = self.windows();
        // About the mean, so that slow changes, such as the loop's own motion, do not count.
        let power = (0..LEGS)
            .map(|i| {
                let stroke = table.actuators[i].gain * table.actuators[i].limit;
                w.forces[i].variance() / (stroke * stroke)
            })
            .fold(0.0, larger);
        let grows = mode.is_loop()
            && power > limits.growth * self.power
            && power > limits.level * limits.level;
        // Growth counts from below the level too.
        let begins = mode.is_loop() && power > limits.growth * self.power;
        self.grown = if begins { self.grown + 1 } else { 0 };
        self.power = power;
        if grows && self.grown >= limits.grown {
            return Some(Cause::Diverging);
        }
        mask(table, |i| self.strange[i] >= limits.strange).map(Cause::Implausible)
    }
}
