//! The self-test and the pilot. Each leg in turn gets a small sine, and the answer of
//! every sensor at that frequency is compared with the model's. This reveals a sensor that
//! is dead, inverted, swapped with another or of the wrong gain, and a faulty leg.
//!
//! With Y the phasors of the sensors at that frequency and U those of the forces of all
//! legs, Y = P·U whether the loop is open or closed. So the same plant P serves the
//! self-test before the loop is closed, and the pilot while it is closed. The pilot's sine
//! is far smaller and its measurements are longer.

use crate::LEGS;
use crate::codes::{DacCode, LegForces};
use crate::multisine::sine;
use crate::step::{Values, larger};
use crate::supervisor::Cause;
use crate::table::{Phasor, SelfTest, Table};

impl Phasor {
    const ONE: Self = Self { re: 1.0, im: 0.0 };

    /// Of length 1, at this part of a turn, 2⁻³² turns.
    fn unit(phase: u32) -> Self {
        Self {
            re: sine(phase.wrapping_add(1 << 30)),
            im: sine(phase),
        }
    }

    fn times(self, other: Self) -> Self {
        Self {
            re: self.re * other.re - self.im * other.im,
            im: self.re * other.im + self.im * other.re,
        }
    }

    fn minus(self, other: Self) -> Self {
        Self {
            re: self.re - other.re,
            im: self.im - other.im,
        }
    }

    fn scaled(self, factor: f32) -> Self {
        Self {
            re: self.re * factor,
            im: self.im * factor,
        }
    }

    fn square(self) -> f32 {
        self.re * self.re + self.im * self.im
    }
}

/// How a [`Probe`] tests the legs: as the self-test or as the pilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    /// Amplitude of the sine, N.
    amplitude: f32,
    /// Time each leg is measured, samples.
    measure: u32,
    /// Whether the noise is measured after the last leg, with no leg driven.
    listens: bool,
}

impl Course {
    /// The self-test, with the loop open.
    pub const fn open(test: &SelfTest) -> Self {
        Self {
            amplitude: test.amplitude,
            measure: test.measure,
            listens: false,
        }
    }

    /// The pilot, with the loop closed. None if `test` has no pilot.
    pub const fn closed(test: &SelfTest) -> Option<Self> {
        if test.pilot > 0.0 {
            Some(Self {
                amplitude: test.pilot,
                measure: test.watch,
                listens: true,
            })
        } else {
            None
        }
    }
}

/// Phasors at the sine's frequency, measured over one leg's window.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LockIn {
    /// Sensor values, `shown[kind][sensor]`, sensor units.
    shown: [[Phasor; LEGS]; 2],
    /// Forces of the legs, codes.
    given: [Phasor; LEGS],
}

impl LockIn {
    const EMPTY: Self = Self {
        shown: [[Phasor::ZERO; LEGS]; 2],
        given: [Phasor::ZERO; LEGS],
    };
}

/// A running test of all legs, one after the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// The leg with the sine. One past the last while the noise is measured, or until the
    /// verdict.
    leg: usize,
    /// Samples since the start of this leg.
    at: u32,
    /// Cosine and sine of the phase.
    wave: Phasor,
    /// Their turn from one sample to the next; zero before the first sample of a leg.
    turn: Phasor,
    /// Cosine and sine of the position in the window of a measurement, one turn long.
    place: Phasor,
    /// Their turn from one sample to the next.
    pace: Phasor,
    /// The current and the previous measurement, which alternate.
    windows: [LockIn; 2],
    /// Whether the second of `windows` is the current one.
    second: bool,
    /// Number of its sensors that were evaluated. One per sample, because all at once would
    /// make this the longest sample.
    stage: usize,
    /// Sums over the sensors of each kind: squared errors, and squared expected answers.
    off: [(f32, f32); 2],
    /// Sums over the legs for each sensor: squared errors, and squared expected answers.
    sensors: [(f32, f32); 2 * LEGS],
    /// For each leg: the larger of the two kinds' relative squared errors, and each kind's
    /// sum of squared expected answers.
    legs: [(f32, [f32; 2]); LEGS],
}

/// What one sample shows to a [`Probe`].
#[derive(Clone, Copy, Debug)]
pub struct Answer<'a> {
    /// The values of the table's sensors, sensor units. A constant part does not matter.
    pub sensors: &'a Values,
    /// The values of the force sensors of a [`Complement`](crate::table::Complement), N. Without
    /// one they are ignored.
    pub forces: &'a Values,
    /// The codes put out in the same sample.
    pub dac: &'a [DacCode; LEGS],
}

/// The result of a [`Probe`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// All answers were within the tolerance.
    Passed,
    /// Answers were outside the tolerance; the sensors or legs at fault.
    Failed(Cause),
    /// The noise was too high for a result.
    Noisy,
}

impl Probe {
    /// Before the first sample.
    pub const NEW: Self = Self {
        leg: 0,
        at: 0,
        wave: Phasor::ONE,
        turn: Phasor::ZERO,
        place: Phasor::ONE,
        pace: Phasor::ZERO,
        windows: [LockIn::EMPTY; 2],
        second: false,
        stage: usize::MAX,
        off: [(0.0, 0.0); 2],
        sensors: [(0.0, 0.0); 2 * LEGS],
        legs: [(0.0, [0.0; 2]); LEGS],
    };

    /// The forces of this sample, N.
    pub fn push(&self, course: Course) -> LegForces {
        let mut push = LegForces::ZERO;
        if let Some(force) = push.0.get_mut(self.leg) {
            *force = course.amplitude * self.wave.im;
        }
        push
    }

    /// Starts again with the next sample.
    pub fn restart(&mut self) {
        if (self.leg, self.at, self.stage) == (0, 0, usize::MAX) {
            return;
        }
        let window = &mut self.windows[usize::from(self.second)];
        *window = LockIn::EMPTY;
        (self.leg, self.at, self.stage) = (0, 0, usize::MAX);
        (self.wave, self.place) = (Phasor::ONE, Phasor::ONE);
        self.sensors = [(0.0, 0.0); 2 * LEGS];
    }

    /// Takes one sample. Returns the result after the last leg, and starts again with the next
    /// sample.
    #[inline]
    pub fn see(&mut self, table: &Table, course: Course, answer: Answer<'_>) -> Option<Verdict> {
        let test = &table.self_test;
        let last = if course.listens { LEGS } else { LEGS - 1 };
        if self.leg <= last {
            if self.at >= test.settle {
                self.add(table, course, answer);
            }
            if self.at == 0 {
                self.turn = Phasor::unit(test.step);
                self.pace = Phasor::unit(u32::MAX / course.measure.max(1));
            }
            self.wave = self.wave.times(self.turn);
            self.at += 1;
            if self.at >= test.settle.saturating_add(course.measure) {
                self.leg += 1;
                (self.at, self.wave, self.place) = (0, Phasor::ONE, Phasor::ONE);
                self.second = !self.second;
                self.windows[usize::from(self.second)] = LockIn::EMPTY;
                (self.stage, self.off) = (0, [(0.0, 0.0); 2]);
                return None;
            }
        }
        if self.stage > 2 * LEGS {
            return None;
        }
        self.evaluate(table, course, self.leg > last)
    }

    /// Evaluates one part of the previous measurement.
    #[inline(never)]
    fn evaluate(&mut self, table: &Table, course: Course, ended: bool) -> Option<Verdict> {
        let stage = self.stage;
        self.stage = stage.saturating_add(1);
        if stage < 2 * LEGS {
            self.look(table, stage);
            return None;
        }
        self.close();
        if !ended {
            return None;
        }
        let noise = if course.listens {
            self.off.map(|(error, _)| error)
        } else {
            [0.0; 2]
        };
        let verdict = self.verdict(&table.self_test, noise);
        self.restart();
        Some(verdict)
    }

    /// Lock-in detection with a Hann window, which suppresses other frequencies and constant
    /// parts.
    #[inline]
    fn add(&mut self, table: &Table, course: Course, answer: Answer<'_>) {
        // The window is 1 − cos, of mean 1, one turn long.
        let scale = 2.0 * (1.0 - self.place.re) / course.measure.max(1) as f32;
        self.place = self.place.times(self.pace);
        let wave = self.wave.scaled(scale);
        let window = &mut self.windows[usize::from(self.second)];
        let [shown, beside] = &mut window.shown;
        let add = |phasor: &mut Phasor, value: f32| {
            phasor.re += value * wave.im;
            phasor.im += value * wave.re;
        };
        let Answer {
            sensors,
            forces,
            dac,
        } = answer;
        // By index: what iterates takes twice as many instructions.
        for i in 0..LEGS {
            add(&mut shown[i], sensors[i]);
        }
        if table.complement().is_some() {
            for i in 0..LEGS {
                add(&mut beside[i], forces[i]);
            }
        }
        let (given, drives) = (&mut window.given, &table.actuators);
        for i in 0..LEGS {
            add(&mut given[i], f32::from(dac[i].0) - drives[i].zero);
        }
    }

    /// Evaluates one sensor of the previous measurement.
    fn look(&mut self, table: &Table, sensor: usize) {
        let (kind, i) = (sensor / LEGS, sensor % LEGS);
        if kind > 0 && table.complement().is_none() {
            return;
        }
        let plant = if kind > 0 {
            &table.self_test.forces
        } else {
            &table.self_test.sensors
        };
        let ended = &self.windows[usize::from(!self.second)];
        let mut expected = Phasor::ZERO;
        let given = ended.given.iter().zip(&table.actuators);
        for (answers, (given, drive)) in plant.iter().zip(given) {
            // From codes to N.
            let part = answers[i].times(given.scaled(1.0 / drive.gain));
            expected.re += part.re;
            expected.im += part.im;
        }
        let shown = ended.shown.as_flattened();
        let (Some(shown), Some(sums), Some(off)) = (
            shown.get(sensor),
            self.sensors.get_mut(sensor),
            self.off.get_mut(kind),
        ) else {
            return;
        };
        let error = shown.minus(expected).square();
        let whole = expected.square();
        *off = (off.0 + error, off.1 + whole);
        // Only measurements with a sine count: the noise belongs to no sensor.
        if self.leg <= LEGS {
            *sums = (sums.0 + error, sums.1 + whole);
        }
    }

    /// Evaluates the leg of the previous measurement, after all of its sensors.
    fn close(&mut self) {
        let pushed = self.leg.checked_sub(1);
        if let Some(leg) = pushed.and_then(|leg| self.legs.get_mut(leg)) {
            let worst = self.off.map(|(error, whole)| {
                // The table has no sensors of this kind.
                if error == 0.0 && whole == 0.0 {
                    0.0
                } else {
                    over(error, whole)
                }
            });
            *leg = (larger(worst[0], worst[1]), self.off.map(|(_, whole)| whole));
        }
    }

    fn verdict(&self, test: &SelfTest, noise: [f32; 2]) -> Verdict {
        let square = test.tolerance * test.tolerance;
        for (kind, noise) in noise.into_iter().enumerate() {
            let answers = self.legs.iter().map(|(_, wholes)| wholes[kind]);
            let weakest = answers.fold(f32::MAX, |least, whole| -larger(-least, -whole));
            // The noise alone is half of the error that would be a fault.
            if noise > 0.25 * square * weakest {
                return Verdict::Noisy;
            }
        }
        let sensors = self.sensors.map(|(error, whole)| {
            // The table has no such sensor.
            if whole == 0.0 && error == 0.0 {
                0.0
            } else {
                over(error, whole)
            }
        });
        let legs = self.legs.map(|(error, _)| error);
        let worst = |errors: &[f32]| errors.iter().copied().fold(0.0, larger);
        let [by_sensor, by_leg] = [worst(&sensors), worst(&legs)];
        if by_sensor <= square && by_leg <= square {
            return Verdict::Passed;
        }
        // With the loop closed the error of one leg or sensor appears in all others, but
        // smaller.
        let bits = |errors: &[f32], worst: f32| {
            let mut bits = 0u16;
            for (i, error) in errors.iter().enumerate() {
                if *error > square && *error > 0.5 * worst {
                    bits |= 1 << i;
                }
            }
            bits
        };
        // A dead sensor has a relative error of 1 and causes a small error in every leg; a
        // dead leg the other way round. Where one leg moves one sensor only, both errors are
        // the same but for rounding, and the sensor is named.
        Verdict::Failed(if by_sensor >= 0.999 * by_leg {
            Cause::TestSensors(bits(&sensors, by_sensor))
        } else {
            Cause::TestLegs(bits(&legs, by_leg) as u8)
        })
    }
}

/// The relative error. NaN counts as the largest possible error.
fn over(error: f32, whole: f32) -> f32 {
    let ratio = error / whole;
    if ratio.is_nan() { f32::MAX } else { ratio }
}
