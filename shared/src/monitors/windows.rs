//! Variances of sensors and leg forces over windows of time, and what they tell.
//!
//! A channel is added to the sums of its window in every fourth sample: a variance needs no more.

use crate::LEGS;
use crate::codes::{Calibration, DacCode, Samples};
use crate::step::{larger, single};
use crate::supervisor::{Cause, Mode};
use crate::table::Table;

use super::{SENSORS, Sight, mask};

/// Samples from one code of a channel to the next in the sums.
const TURNS: usize = 4;

/// Sums of the differences of a code from the first one of the window.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sums {
    origin: i32,
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
            first: 0,
            second: 0,
        }
    }

    #[inline]
    fn add(&mut self, code: i32, begins: bool) {
        if begins {
            *self = Self::at(code);
            return;
        }
        // Codes have sixteen bits, so a square fits into 64.
        let d = i64::from(code - self.origin);
        self.first += d;
        self.second += d * d;
    }

    /// The variance of `count` codes.
    fn variance(&self, count: u32) -> f32 {
        let n = count as f32;
        let mean = single(self.first) / n;
        single(self.second) / n - mean * mean
    }
}

/// Sums over a window.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Window {
    /// Samples.
    count: u32,
    /// Missed deadlines.
    late: u32,
    sensors: [[Sums; LEGS]; 2],
    forces: [Sums; LEGS],
}

impl Window {
    const EMPTY: Self = Self {
        count: 0,
        late: 0,
        sensors: [[Sums::at(0); LEGS]; 2],
        forces: [Sums::at(0); LEGS],
    };

    /// Number of codes of a channel that is added in the samples of this turn.
    fn added(&self, turn: usize) -> u32 {
        // `turn` is below `TURNS`.
        (self.count + (TURNS - 1 - turn) as u32) / TURNS as u32
    }
}

/// The turn in which a sensor, or leg, is added. Legs and sensors alternate, so that every sample
/// adds as many.
const fn turn(leg: bool, i: usize) -> usize {
    (if leg { i + TURNS / 2 } else { i }) % TURNS
}

/// The current window, and the evaluation of the one before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Windows {
    /// The current and the previous window, which alternate: a copy would take longer than
    /// everything else.
    both: [Window; 2],
    /// Whether the second of `both` is the current one.
    second: bool,
    /// The next part of the previous window to evaluate.
    stage: usize,
    /// Variance of each sensor in the previous window, squared sensor units.
    variances: [f32; SENSORS],
    /// Consecutive windows in which a sensor was implausible.
    strange: [u32; SENSORS],
    /// Largest variance of a leg force in the previous window as far as it is evaluated,
    /// relative to the square of its limit.
    strongest: f32,
    /// Largest of the window before that.
    power: f32,
    /// Consecutive windows in which it grew.
    grown: u32,
    /// Samples until sensors are compared again. A signal in one leg shakes some of them much more
    /// than others, until what it has excited has decayed. Where nothing follows the sensors, that is
    /// no fault.
    shaken: u32,
}

impl Windows {
    /// Before the first sample.
    pub const NEW: Self = Self {
        both: [Window::EMPTY; 2],
        second: false,
        stage: usize::MAX,
        variances: [0.0; SENSORS],
        strange: [0; SENSORS],
        strongest: 0.0,
        power: 0.0,
        grown: 0,
        shaken: 0,
    };

    /// Adds a sample to the current window. Returns the fault that this one or the window before
    /// shows, if any.
    #[inline]
    pub fn see(&mut self, table: &Table, mode: Mode, sight: &Sight<'_>) -> Option<Cause> {
        let limits = &table.supervision;
        if mode == Mode::Idle && sight.injecting {
            self.shaken = limits.settle.saturating_mul(2);
        } else {
            self.shaken = self.shaken.saturating_sub(1);
        }
        let window = &mut self.both[usize::from(self.second)];
        window.add(sight.samples, sight.dac, table.complement().is_some());
        window.late += u32::from(sight.late);
        if window.late > limits.late {
            return Some(Cause::Late);
        }
        if window.count >= limits.window {
            self.second = !self.second;
            self.stage = 0;
            let window = &mut self.both[usize::from(self.second)];
            (window.count, window.late) = (0, 0);
        }
        if self.stage < STAGES {
            self.stage += 1;
            return self.evaluate(table, mode, self.stage - 1);
        }
        None
    }

    fn previous(&self) -> &Window {
        &self.both[usize::from(!self.second)]
    }

    /// Evaluates one part of the previous window. Everything at once would make this the longest
    /// sample.
    #[inline(never)]
    fn evaluate(&mut self, table: &Table, mode: Mode, stage: usize) -> Option<Cause> {
        match stage {
            0..LEGS => {
                self.variance(0, stage, &table.sensors);
                if let Some(beside) = table.complement() {
                    self.variance(1, stage, &beside.sensors);
                }
            }
            COMPARED..STRONG => self.compare(table, stage - COMPARED),
            STRONG..VERDICT => {
                let first = 2 * (stage - STRONG);
                if first == 0 {
                    self.strongest = 0.0;
                }
                for leg in [first, first + 1] {
                    let drive = &table.actuators[leg % LEGS];
                    let window = self.previous();
                    let variance =
                        window.forces[leg % LEGS].variance(window.added(turn(true, leg)));
                    // About the mean, so that slow changes, such as the loop's own motion, do
                    // not count.
                    let stroke = drive.gain * drive.limit;
                    self.strongest = larger(self.strongest, variance / (stroke * stroke));
                }
            }
            _ => return self.verdict(table, mode),
        }
        None
    }

    /// The variance of a sensor, in its squared unit.
    fn variance(&mut self, kind: usize, i: usize, calibrations: &[Calibration; LEGS]) {
        let window = self.previous();
        let i = i % LEGS;
        let variance = window.sensors[kind % 2][i].variance(window.added(turn(false, i)));
        let gain = calibrations[i].gain;
        self.variances[(kind * LEGS + i) % SENSORS] = variance * gain * gain;
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
        let median = median(*variances);
        let [wild_by, dull_by] = [limits.wild, limits.dull].map(|ratio| ratio * ratio);
        for (strange, variance) in strange.iter_mut().zip(variances) {
            let wild = *variance > wild_by * median;
            let dull = variance * dull_by < median;
            let unlike = self.shaken == 0 && (wild || dull);
            *strange = if unlike { *strange + 1 } else { 0 };
        }
    }

    /// The fault of the previous window, if any.
    fn verdict(&mut self, table: &Table, mode: Mode) -> Option<Cause> {
        let limits = &table.supervision;
        let power = self.strongest;
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

/// The stage that compares the first kind of sensors; before it, one sensor of each kind each.
const COMPARED: usize = LEGS;

/// The stage of the first two legs.
const STRONG: usize = COMPARED + 2;

/// The last stage.
const VERDICT: usize = STRONG + LEGS / 2;

/// Number of parts in which a window is evaluated: fewer than the samples of the shortest window.
const STAGES: usize = VERDICT + 1;

impl Window {
    #[inline]
    fn add(&mut self, samples: &Samples, dac: &[DacCode; LEGS], beside: bool) {
        let at = self.count as usize;
        let begins = at < TURNS;
        self.count += 1;
        let [sensors, forces] = &mut self.sensors;
        add_turn(sensors, at % TURNS, begins, |i| samples.sensors[i].0.into());
        if beside {
            add_turn(forces, at % TURNS, begins, |i| samples.forces[i].0.into());
        }
        // Those of which `turn` is that of this sample.
        let leg = (at + TURNS / 2) % TURNS;
        add_turn(&mut self.forces, leg, begins, |i| dac[i].0.into());
    }
}

/// Adds the channels `first` and `first` + [`TURNS`], if there are such.
#[inline]
fn add_turn(sums: &mut [Sums; LEGS], first: usize, begins: bool, code: impl Fn(usize) -> i32) {
    for i in [first, first + TURNS] {
        if let Some(sums) = sums.get_mut(i) {
            sums.add(code(i % LEGS), begins);
        }
    }
}

/// The median of six numbers: the mean of the third and the fourth.
fn median(mut x: [f32; LEGS]) -> f32 {
    // A sorting network of twelve comparisons (Knuth, The Art of Computer Programming, vol. 3,
    // 5.3.4): a general sort takes five times as many instructions.
    const NETWORK: [(usize, usize); 12] = [
        (0, 5),
        (1, 3),
        (2, 4),
        (1, 2),
        (3, 4),
        (0, 3),
        (2, 5),
        (0, 1),
        (2, 3),
        (4, 5),
        (1, 2),
        (3, 4),
    ];
    for (a, b) in NETWORK {
        let (first, second) = (x[a], x[b]);
        if first > second {
            (x[a], x[b]) = (second, first);
        }
    }
    0.5 * (x[2] + x[3])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codes::AdcCode;

    /// Every sequence of zeros and ones (a network that sorts them sorts everything: the
    /// zero-one principle), and every order of six numbers.
    #[test]
    fn the_median_is_that_of_the_sorted_numbers() {
        for k in 0..6u32.pow(6) {
            let x: [f32; LEGS] = core::array::from_fn(|i| (k / 6u32.pow(i as u32) % 6) as f32);
            let mut sorted = x;
            sorted.sort_unstable_by(f32::total_cmp);
            assert_eq!(median(x), 0.5 * (sorted[2] + sorted[3]), "{x:?}");
        }
    }

    /// Against sums in double precision over the same codes.
    #[test]
    fn variances_are_those_of_the_codes() {
        let mut window = Window::EMPTY;
        let code = |k: u32, i: u32| ((k * k * 7 + k * (31 + i) + 5000 * i) % 2000) as i16 - 900;
        let samples = |k| Samples {
            sensors: core::array::from_fn(|i| AdcCode(code(k, i as u32))),
            forces: core::array::from_fn(|i| AdcCode(code(k, 6 + i as u32))),
        };
        let dac = |k| core::array::from_fn(|i| DacCode((30_000 + code(k, 12 + i as u32)) as u16));
        for length in [16u32, 17, 18, 19, 1000] {
            window.count = 0;
            for k in 0..length {
                window.add(&samples(k), &dac(k), true);
            }
            for i in 0..LEGS {
                let channels = [
                    (&window.sensors[0][i], turn(false, i), 0),
                    (&window.sensors[1][i], turn(false, i), 6),
                    (&window.forces[i], turn(true, i), 12),
                ];
                for (sums, turn, first) in channels {
                    let codes: [f64; 300] = core::array::from_fn(|j| {
                        f64::from(code((turn + TURNS * j) as u32, first + i as u32))
                    });
                    let count = (turn as u32..length).step_by(TURNS).count();
                    assert_eq!(window.added(turn), count as u32);
                    let codes = &codes[..count];
                    let mean = codes.iter().sum::<f64>() / count as f64;
                    let variance =
                        codes.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count as f64;
                    let found = f64::from(sums.variance(window.added(turn)));
                    // The sums are exact; the rest is single precision, relative to squares.
                    assert!(
                        (found - variance).abs() < 1e-5 * (variance + 4e6),
                        "{length} {first} {i}: {found} {variance}"
                    );
                }
            }
        }
    }
}
