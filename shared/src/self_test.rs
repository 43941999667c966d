//! The self-test and the pilot: each leg in turn pushes a small sine, and what
//! every sensor answers at that frequency is compared with what the model says. A
//! sensor that is dead, inverted, swapped with another or of the wrong gain shows,
//! and so does a leg.
//!
//! With Y what the sensors show at that frequency and U what all legs were given,
//! Y = P·U whether the loop is open or closed. So the same plant P serves the
//! self-test before the loop is closed and the pilot, far smaller and longer, while
//! it is.

use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::{Calibration, DacCode, LegForces, Samples};
use crate::injection::sine;
use crate::supervisor::Cause;
use crate::table::{Table, TableError};

/// A complex gain, unit of the sensor per N.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Phasor {
    /// In phase.
    pub re: f32,
    /// A quarter of a turn ahead.
    pub im: f32,
}

impl Phasor {
    /// Nothing.
    pub const ZERO: Self = Self { re: 0.0, im: 0.0 };

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

    fn square(self) -> f32 {
        self.re * self.re + self.im * self.im
    }
}

/// What is asked and what must be answered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SelfTest {
    /// The sine's turns per sample, in 2³² parts.
    pub step: u32,
    /// Its size in the self-test, N.
    pub amplitude: f32,
    /// Samples before a leg is measured: the swing of its first push dies out.
    pub settle: u32,
    /// Samples that the self-test measures a leg.
    pub measure: u32,
    /// The sine's size with the loop closed, N; 0 for no pilot.
    pub pilot: f32,
    /// Samples that the pilot measures a leg.
    pub watch: u32,
    /// How far an answer may be off, of what it should be: root of the sum of
    /// squares over all legs for a sensor, over the sensors of a kind for a leg.
    pub tolerance: f32,
    /// By leg: each sensor's answer.
    pub sensors: [[Phasor; LEGS]; LEGS],
    /// By leg: that of each force sensor beside them.
    pub forces: [[Phasor; LEGS]; LEGS],
}

/// How the legs are probed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    amplitude: f32,
    measure: u32,
    /// At the end the noise is measured as a leg is.
    listens: bool,
}

impl SelfTest {
    /// With the loop open.
    pub const fn open(&self) -> Course {
        Course {
            amplitude: self.amplitude,
            measure: self.measure,
            listens: false,
        }
    }

    /// With the loop closed; none without a pilot.
    pub const fn closed(&self) -> Option<Course> {
        if self.pilot > 0.0 {
            Some(Course {
                amplitude: self.pilot,
                measure: self.watch,
                listens: true,
            })
        } else {
            None
        }
    }

    /// Samples that the self-test takes.
    pub const fn length(&self) -> u64 {
        LEGS as u64 * (self.settle as u64 + self.measure as u64)
    }

    pub(crate) const fn validate(&self) -> Result<(), TableError> {
        let mut finite = true;
        let mut i = 0;
        while i < LEGS * LEGS {
            let (leg, sensor) = (i / LEGS, i % LEGS);
            let (a, b) = (&self.sensors[leg][sensor], &self.forces[leg][sensor]);
            finite = finite && a.re.is_finite() && a.im.is_finite();
            finite = finite && b.re.is_finite() && b.im.is_finite();
            i += 1;
        }
        let sizes = self.amplitude > 0.0
            && self.amplitude.is_finite()
            && self.pilot >= 0.0
            && self.pilot.is_finite();
        let lengths = self.step > 0 && self.measure > 0 && self.watch > 0;
        if finite && sizes && lengths && self.tolerance > 0.0 {
            Ok(())
        } else {
            Err(TableError::SelfTest)
        }
    }
}

/// A probe of all legs under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// The leg that pushes; one past the last while it listens.
    leg: usize,
    at: u32,
    phase: u32,
    /// What this leg's window has shown: by kind and sensor, units; by leg, N.
    shown: [[Phasor; LEGS]; 2],
    given: [Phasor; LEGS],
    /// Over all legs, squared: by sensor how far its answers were off, and what they
    /// should have been.
    sensors: [(f32, f32); 2 * LEGS],
    /// By leg: the larger of the kinds' squared errors, of what it should be, and by
    /// kind what that was.
    legs: [(f32, [f32; 2]); LEGS],
}

/// What came of a probe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// All is well.
    Passed,
    /// It is not.
    Failed(Cause),
    /// There was too much noise to tell.
    Noisy,
}

impl Probe {
    /// From the start.
    pub const NEW: Self = Self {
        leg: 0,
        at: 0,
        phase: 0,
        shown: [[Phasor::ZERO; LEGS]; 2],
        given: [Phasor::ZERO; LEGS],
        sensors: [(0.0, 0.0); 2 * LEGS],
        legs: [(0.0, [0.0; 2]); LEGS],
    };

    /// The forces of this sample.
    pub fn push(&self, course: Course) -> LegForces {
        let mut push = LegForces::ZERO;
        if let Some(force) = push.0.get_mut(self.leg) {
            *force = course.amplitude * sine(self.phase);
        }
        push
    }

    /// One sample: what the sensors read, and then the legs were given. At the end
    /// of all, what came of it; the next sample begins anew.
    pub fn see(
        &mut self,
        table: &Table,
        course: Course,
        samples: Samples,
        dac: [DacCode; LEGS],
    ) -> Option<Verdict> {
        let test = &table.self_test;
        if self.at >= test.settle {
            self.add(table, course, samples, dac);
        }
        self.phase = self.phase.wrapping_add(test.step);
        self.at += 1;
        if self.at < test.settle.saturating_add(course.measure) {
            return None;
        }
        let noise = self.close(table);
        self.leg += 1;
        (self.at, self.phase) = (0, 0);
        (self.shown, self.given) = ([[Phasor::ZERO; LEGS]; 2], [Phasor::ZERO; LEGS]);
        let last = if course.listens { LEGS } else { LEGS - 1 };
        if self.leg <= last {
            return None;
        }
        let verdict = self.verdict(test, if course.listens { noise } else { [0.0; 2] });
        *self = Self::NEW;
        Some(verdict)
    }

    /// Lock-in: the conjugate of the sine's phasor, in a Hann window, which keeps
    /// out what is at other frequencies.
    fn add(&mut self, table: &Table, course: Course, samples: Samples, dac: [DacCode; LEGS]) {
        let measure = course.measure.max(1);
        // Half a turn of squared sine: (1 − cos)/2.
        let turn = (u64::from(self.at - table.self_test.settle) << 32) / u64::from(measure);
        // Less than a whole one.
        let turn = turn as u32;
        let window = 1.0 - sine(turn.wrapping_add(1 << 30));
        let scale = 2.0 * window / measure as f32;
        let (sin, cos) = (
            scale * sine(self.phase),
            scale * sine(self.phase.wrapping_add(1 << 30)),
        );
        let beside = table.complement().map(|complement| &complement.sensors);
        let kinds: [(Option<&[Calibration; LEGS]>, _); 2] = [
            (Some(&table.sensors), samples.sensors),
            (beside, samples.forces),
        ];
        for (shown, (sensors, codes)) in self.shown.iter_mut().zip(kinds) {
            let Some(sensors) = sensors else { continue };
            for i in 0..LEGS {
                let value = sensors[i].value(codes[i]);
                shown[i].re += value * sin;
                shown[i].im += value * cos;
            }
        }
        for ((given, drive), code) in self.given.iter_mut().zip(&table.actuators).zip(dac) {
            let force = drive.force(code);
            given.re += force * sin;
            given.im += force * cos;
        }
    }

    /// The end of a leg's window; gives the squared error, by kind.
    #[inline(never)]
    fn close(&mut self, table: &Table) -> [f32; 2] {
        let plant = [&table.self_test.sensors, &table.self_test.forces];
        let kinds = if table.complement().is_some() { 2 } else { 1 };
        let mut errors = [0.0; 2];
        let mut wholes = [0.0; 2];
        for kind in 0..kinds {
            for i in 0..LEGS {
                let mut expected = Phasor::ZERO;
                for (answers, given) in plant[kind].iter().zip(self.given) {
                    let part = answers[i].times(given);
                    expected.re += part.re;
                    expected.im += part.im;
                }
                let error = self.shown[kind][i].minus(expected).square();
                let whole = expected.square();
                errors[kind] += error;
                wholes[kind] += whole;
                if self.leg < LEGS {
                    let sums = &mut self.sensors[kind * LEGS + i];
                    *sums = (sums.0 + error, sums.1 + whole);
                }
            }
        }
        if let Some(leg) = self.legs.get_mut(self.leg) {
            let worst = (0..kinds)
                .map(|kind| over(errors[kind], wholes[kind]))
                .fold(0.0, f32::max);
            *leg = (worst, wholes);
        }
        errors
    }

    fn verdict(&self, test: &SelfTest, noise: [f32; 2]) -> Verdict {
        let square = test.tolerance * test.tolerance;
        for (kind, noise) in noise.into_iter().enumerate() {
            let answers = self.legs.iter().map(|(_, wholes)| wholes[kind]);
            let weakest = answers.fold(f32::MAX, f32::min);
            // Half of what would be told as a fault.
            if noise > 0.25 * square * weakest {
                return Verdict::Noisy;
            }
        }
        let sensors = self.sensors.map(|(error, whole)| {
            // No such sensor.
            if whole == 0.0 && error == 0.0 {
                0.0
            } else {
                over(error, whole)
            }
        });
        let legs = self.legs.map(|(error, _)| error);
        let worst = |errors: &[f32]| errors.iter().copied().fold(0.0, f32::max);
        let [by_sensor, by_leg] = [worst(&sensors), worst(&legs)];
        if by_sensor <= square && by_leg <= square {
            return Verdict::Passed;
        }
        // With the loop closed every leg answers what one does wrong; theirs is the
        // smaller part.
        let bits = |errors: &[f32], worst: f32| {
            let mut bits = 0u16;
            for (i, error) in errors.iter().enumerate() {
                if *error > square && *error > 0.5 * worst {
                    bits |= 1 << i;
                }
            }
            bits
        };
        // A dead sensor is off by all it should give and every leg a little, and
        // the other way round.
        Verdict::Failed(if by_sensor >= by_leg {
            Cause::TestSensors(bits(&sensors, by_sensor))
        } else {
            Cause::TestLegs(bits(&legs, by_leg) as u8)
        })
    }
}

/// A NaN is as far off as can be.
fn over(error: f32, whole: f32) -> f32 {
    let ratio = error / whole;
    if ratio.is_nan() { f32::MAX } else { ratio }
}
