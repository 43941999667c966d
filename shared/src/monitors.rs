//! The monitors: faults of sensors, outputs and the board, found in every sample.

use crate::LEGS;
use crate::codes::{AdcCode, DacCode, Samples};
use crate::step::Status;
use crate::supervisor::{Cause, Mode};
use crate::table::{Table, ValidTable};

/// Number of sensors of both kinds.
const SENSORS: usize = 2 * LEGS;

/// Time constant of the average of a sensor's jumps from sample to sample, samples.
const USUAL: i32 = 64;

/// Smallest ratio of a spike to the average jump. A vibration of any frequency stays below
/// it.
const FAR: i32 = 8;

/// The state of the monitors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Monitors {
    /// Consecutive samples at a rail.
    rail: [u32; SENSORS],
    /// Consecutive samples with the same code.
    still: [u32; SENSORS],
    /// The previous codes.
    before: [AdcCode; SENSORS],
    /// The last three differences between consecutive codes, the oldest first.
    jumps: [[i32; SENSORS]; 3],
    /// [`USUAL`] times the recent average of their absolute values.
    level: [i32; SENSORS],
    /// Spikes in the current second.
    spikes: [u32; SENSORS],
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

/// Sums over a window.
#[derive(Clone, Copy, Debug, PartialEq)]
struct WindowSums {
    /// Samples.
    count: u32,
    /// Missed deadlines.
    late: u32,
    /// The sensors' codes at the start of the window. The sums are of differences from
    /// these.
    origin: [AdcCode; SENSORS],
    sums: [i64; SENSORS],
    squares: [i64; SENSORS],
    /// The outputs at the start of the window.
    start: [DacCode; LEGS],
    /// Sum and sum of squares of the differences from `start`, codes.
    forces: [(f32, f32); LEGS],
}

impl WindowSums {
    const EMPTY: Self = Self {
        count: 0,
        late: 0,
        origin: [AdcCode(0); SENSORS],
        sums: [0; SENSORS],
        squares: [0; SENSORS],
        start: [DacCode(0); LEGS],
        forces: [(0.0, 0.0); LEGS],
    };
}

/// The codes of the six sensors, then those of the six force sensors.
fn in_row(samples: Samples) -> [AdcCode; SENSORS] {
    let mut row = [AdcCode(0); SENSORS];
    let both = samples.sensors.iter().chain(&samples.forces);
    for (slot, code) in row.iter_mut().zip(both) {
        *slot = *code;
    }
    row
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
        rail: [0; SENSORS],
        still: [0; SENSORS],
        before: [AdcCode(0); SENSORS],
        jumps: [[0; SENSORS]; 3],
        level: [0; SENSORS],
        spikes: [0; SENSORS],
        second: 0,
        lost: 0,
        saturated: 0,
        silence: 0,
        windows: [WindowSums::EMPTY; 2],
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
        samples: Samples,
        (dac, status): ([DacCode; LEGS], Status),
        late: bool,
        calm: bool,
    ) -> Option<Cause> {
        let table = table.get();
        let limits = &table.supervision;
        self.lost = 0;
        let codes = in_row(samples);
        let railed = [status.sensors_at_rail, status.forces_at_rail];
        for i in 0..SENSORS {
            let at_rail = railed[i / LEGS] >> (i % LEGS) & 1 != 0;
            self.rail[i] = if at_rail {
                self.rail[i].saturating_add(1)
            } else {
                0
            };
            self.still[i] = if codes[i] == self.before[i] {
                self.still[i].saturating_add(1)
            } else {
                0
            };
        }
        self.count_spikes(table, codes, calm && !status.clamped);
        self.before = codes;
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
        self.add(table, codes, dac, late);

        if status.not_finite {
            return Some(Cause::NotFinite);
        }
        if let Some(bits) = mask(table, |i| self.rail[i] >= limits.rail) {
            return Some(Cause::Rail(bits));
        }
        if limits.stuck > 0
            && let Some(bits) = mask(table, |i| self.still[i] >= limits.stuck)
        {
            return Some(Cause::Stuck(bits));
        }
        if self.spikes.iter().sum::<u32>() >= limits.spikes {
            let most = self.spikes.iter().copied().fold(0, u32::max);
            return mask(table, |i| 2 * self.spikes[i] >= most).map(Cause::Erratic);
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
            let (next, _) = self.windows();
            next.count = 0;
        }
        self.conclude(table, mode)
    }

    fn count_spikes(&mut self, table: &Table, codes: [AdcCode; SENSORS], calm: bool) {
        self.second += 1;
        // Rates are positive and far below 2³².
        if self.second >= table.sample_rate as u32 {
            self.second = 0;
            self.spikes = [0; SENSORS];
        }
        let limits = table.supervision.spike;
        let [first, there, back] = self.jumps;
        let now: [i32; SENSORS] =
            core::array::from_fn(|i| i32::from(codes[i].0) - i32::from(self.before[i].0));
        for i in 0..count(table) {
            let limit = i32::from(limits[i / LEGS]);
            let size = there[i].abs().min(back[i].abs());
            // Quiet before it, and then back near the old value.
            let alone = 4 * first[i].abs() <= size && 2 * (there[i] + back[i]).abs() <= size;
            let far = size >= limit && size >= FAR * self.level[i] / USUAL;
            self.spikes[i] += u32::from(limit > 0 && alone && far && calm);
            self.level[i] += now[i].abs() - self.level[i] / USUAL;
        }
        self.jumps = [there, back, now];
    }

    /// The current and the previous window.
    fn windows(&mut self) -> (&mut WindowSums, &mut WindowSums) {
        let [a, b] = &mut self.windows;
        if self.turn { (b, a) } else { (a, b) }
    }

    fn add(&mut self, table: &Table, codes: [AdcCode; SENSORS], dac: [DacCode; LEGS], late: bool) {
        let (w, _) = self.windows();
        if w.count == 0 {
            *w = WindowSums {
                origin: codes,
                start: dac,
                ..WindowSums::EMPTY
            };
        }
        w.count += 1;
        w.late += u32::from(late);
        for (i, code) in codes.iter().enumerate().take(count(table)) {
            let d = i64::from(code.0) - i64::from(w.origin[i].0);
            w.sums[i] += d;
            w.squares[i] += d * d;
        }
        for ((force, code), start) in w.forces.iter_mut().zip(dac).zip(w.start) {
            let d = f32::from(code.0) - f32::from(start.0);
            let (sum, square) = force;
            *sum += d;
            *square += d * d;
        }
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
        let n = w.count as f32;
        if let (Some(variance), Some(sum), Some(square)) = (
            self.variances.get_mut(sensor),
            w.sums.get(sensor),
            w.squares.get(sensor),
        ) {
            let mean = *sum as f32 / n;
            *variance = (*square as f32 / n - mean * mean) * calibration.gain * calibration.gain;
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
        let n = w.count as f32;
        // About the mean, so that slow changes, such as the loop's own motion, do not count.
        let power = (0..LEGS)
            .map(|i| {
                let stroke = table.actuators[i].gain * table.actuators[i].limit;
                let (sum, square) = w.forces[i];
                let mean = sum / n;
                (square / n - mean * mean) / (stroke * stroke)
            })
            .fold(0.0, f32::max);
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
