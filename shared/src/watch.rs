//! The monitors: what is wrong with sensors, outputs and the board.

use crate::LEGS;
use crate::codes::{AdcCode, DacCode, Samples};
use crate::step::Status;
use crate::supervisor::{Cause, Mode};
use crate::table::{Table, ValidTable};

/// Sensors of both kinds.
const SENSORS: usize = 2 * LEGS;

/// Samples over which a sensor's usual jump is averaged.
const USUAL: i32 = 64;

/// A spike is this many times larger: no vibration is, whatever its frequency.
const FAR: i32 = 8;

/// What the monitors remember.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Watch {
    rail: [u32; SENSORS],
    still: [u32; SENSORS],
    before: [AdcCode; SENSORS],
    /// From sample to sample, the last three of them, the oldest first.
    jumps: [[i32; SENSORS]; 3],
    /// Their usual size: its average of late, times [`USUAL`].
    level: [i32; SENSORS],
    /// Spikes in the last second, and how much of that is over.
    spikes: [u32; SENSORS],
    second: u32,
    lost: u32,
    saturated: u32,
    silence: u32,
    /// The one under way and the one before, by turns: to copy one would take longer
    /// than all the rest.
    windows: [Window; 2],
    /// Which is under way, and how far the other was concluded.
    turn: bool,
    stage: usize,
    variances: [f32; SENSORS],
    /// Windows in a row in which a sensor was strange.
    strange: [u32; SENSORS],
    /// Variance of the forces in the window before, of their limits.
    power: f32,
    grown: u32,
}

/// Sums over a window.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Window {
    count: u32,
    late: u32,
    /// The sensors' codes at its start, from which the sums count.
    origin: [AdcCode; SENSORS],
    sums: [i64; SENSORS],
    squares: [i64; SENSORS],
    /// The outputs at its start, and sums and squares from there, codes.
    start: [DacCode; LEGS],
    forces: [(f32, f32); LEGS],
}

impl Window {
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

/// A table's sensors in one row: six, and the six beside them if there are any.
fn in_row(samples: Samples) -> [AdcCode; SENSORS] {
    let mut row = [AdcCode(0); SENSORS];
    let both = samples.sensors.iter().chain(&samples.forces);
    for (slot, code) in row.iter_mut().zip(both) {
        *slot = *code;
    }
    row
}

fn count(table: &Table) -> usize {
    if table.complement().is_some() {
        SENSORS
    } else {
        LEGS
    }
}

/// Bit i where `is(i)`, of the sensors that the table has.
fn mask(table: &Table, is: impl Fn(usize) -> bool) -> Option<u16> {
    let mut bits = 0;
    for i in 0..count(table) {
        if is(i) {
            bits |= 1 << i;
        }
    }
    (bits != 0).then_some(bits)
}

impl Watch {
    /// With nothing seen yet.
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
        windows: [Window::EMPTY; 2],
        turn: false,
        stage: usize::MAX,
        variances: [0.0; SENSORS],
        strange: [0; SENSORS],
        power: 0.0,
        grown: 0,
    };

    /// A frame came over the link.
    pub fn heard(&mut self) {
        self.silence = 0;
    }

    /// A sample was not read.
    pub fn lost(&mut self, table: &ValidTable) -> Option<Cause> {
        self.lost = self.lost.saturating_add(1);
        (self.lost >= table.get().supervision.lost).then_some(Cause::Lost)
    }

    /// One sample with what the step made of it; `late` if the deadline before it
    /// was missed, `calm` if nothing is injected: legs that jump, as those that are at
    /// their limits do, make jumps in the sensors.
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
            // Four steps up and one down: a limit cycle that is clamped in some of
            // its samples counts too.
            self.saturated = self.saturated.saturating_add(4);
        } else {
            self.saturated = self.saturated.saturating_sub(1);
        }
        let driven = mode.is_loop() || mode == Mode::Testing;
        self.silence = if driven {
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
        if limits.silence > 0 && self.silence >= limits.silence {
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
            // Quiet before, and back to about where it was.
            let alone = 4 * first[i].abs() <= size && 2 * (there[i] + back[i]).abs() <= size;
            let far = size >= limit && size >= FAR * self.level[i] / USUAL;
            self.spikes[i] += u32::from(limit > 0 && alone && far && calm);
            self.level[i] += now[i].abs() - self.level[i] / USUAL;
        }
        self.jumps = [there, back, now];
    }

    /// The window under way, and the one before.
    fn windows(&mut self) -> (&mut Window, &mut Window) {
        let [a, b] = &mut self.windows;
        if self.turn { (b, a) } else { (a, b) }
    }

    fn add(&mut self, table: &Table, codes: [AdcCode; SENSORS], dac: [DacCode; LEGS], late: bool) {
        let (w, _) = self.windows();
        if w.count == 0 {
            *w = Window {
                origin: codes,
                start: dac,
                ..Window::EMPTY
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

    /// The next part of what a window that has ended says: a sensor a sample, then a
    /// kind, then the forces. All at once would be the longest sample of all.
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

    /// A sensor's variance, in its own unit.
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

    /// A kind's sensors with each other.
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

    /// The forces, and what all of it comes to.
    fn power(&mut self, table: &Table, mode: Mode) -> Option<Cause> {
        let limits = &table.supervision;
        let (_, w) = self.windows();
        let n = w.count as f32;
        // About its mean: what is slow, as the loop's own motion, is no part of it.
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
        // What is still below the level may have begun to grow.
        let begins = mode.is_loop() && power > limits.growth * self.power;
        self.grown = if begins { self.grown + 1 } else { 0 };
        self.power = power;
        if grows && self.grown >= limits.grown {
            return Some(Cause::Diverging);
        }
        mask(table, |i| self.strange[i] >= limits.strange).map(Cause::Implausible)
    }
}
