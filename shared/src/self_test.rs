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
        // Longer than it takes to conclude a leg, a sensor a sample.
        let lengths = self.step > 0 && self.measure >= 16 && self.watch >= 16;
        if finite && sizes && lengths && self.tolerance > 0.0 {
            Ok(())
        } else {
            Err(TableError::SelfTest)
        }
    }
}

/// What a leg's window has shown: by kind and sensor, units; by leg, N.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Window {
    shown: [[Phasor; LEGS]; 2],
    given: [Phasor; LEGS],
}

impl Window {
    const EMPTY: Self = Self {
        shown: [[Phasor::ZERO; LEGS]; 2],
        given: [Phasor::ZERO; LEGS],
    };
}

/// A probe of all legs under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// The leg that pushes; one past the last while it listens, or waits for the
    /// verdict.
    leg: usize,
    at: u32,
    phase: u32,
    window: Window,
    /// The last one that ended, and how many of its sensors were looked at: one a
    /// sample, for all at once would be the longest sample of all.
    ended: Window,
    stage: usize,
    /// By kind, squared: how far it was off, and what it should have been.
    off: [(f32, f32); 2],
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
        window: Window::EMPTY,
        ended: Window::EMPTY,
        stage: usize::MAX,
        off: [(0.0, 0.0); 2],
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
        let last = if course.listens { LEGS } else { LEGS - 1 };
        if self.leg <= last {
            if self.at >= test.settle {
                self.add(table, course, samples, dac);
            }
            self.phase = self.phase.wrapping_add(test.step);
            self.at += 1;
            if self.at >= test.settle.saturating_add(course.measure) {
                self.leg += 1;
                (self.at, self.phase) = (0, 0);
                self.ended = core::mem::replace(&mut self.window, Window::EMPTY);
                (self.stage, self.off) = (0, [(0.0, 0.0); 2]);
                return None;
            }
        }
        let stage = self.stage;
        self.stage = stage.saturating_add(1);
        if stage < 2 * LEGS {
            self.look(table, stage);
        } else if stage == 2 * LEGS {
            self.close();
            if self.leg > last {
                let noise = if course.listens {
                    self.off.map(|(error, _)| error)
                } else {
                    [0.0; 2]
                };
                let verdict = self.verdict(test, noise);
                *self = Self::NEW;
                return Some(verdict);
            }
        }
        None
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
        for (shown, (sensors, codes)) in self.window.shown.iter_mut().zip(kinds) {
            let Some(sensors) = sensors else { continue };
            for i in 0..LEGS {
                let value = sensors[i].value(codes[i]);
                shown[i].re += value * sin;
                shown[i].im += value * cos;
            }
        }
        let given = self.window.given.iter_mut();
        for ((given, drive), code) in given.zip(&table.actuators).zip(dac) {
            let force = drive.force(code);
            given.re += force * sin;
            given.im += force * cos;
        }
    }

    /// One sensor in the window that has ended.
    fn look(&mut self, table: &Table, sensor: usize) {
        let (kind, i) = (sensor / LEGS, sensor % LEGS);
        if kind > 0 && table.complement().is_none() {
            return;
        }
        let plant = if kind == 0 {
            &table.self_test.sensors
        } else {
            &table.self_test.forces
        };
        let mut expected = Phasor::ZERO;
        for (answers, given) in plant.iter().zip(self.ended.given) {
            let part = answers[i].times(given);
            expected.re += part.re;
            expected.im += part.im;
        }
        let shown = self.ended.shown.as_flattened();
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
        // The window before this one's leg; what is only listened to is nobody's.
        if self.leg <= LEGS {
            *sums = (sums.0 + error, sums.1 + whole);
        }
    }

    /// All sensors of a window were looked at.
    fn close(&mut self) {
        let pushed = self.leg.checked_sub(1);
        if let Some(leg) = pushed.and_then(|leg| self.legs.get_mut(leg)) {
            let worst = self.off.map(|(error, whole)| {
                // No such kind.
                if error == 0.0 && whole == 0.0 {
                    0.0
                } else {
                    over(error, whole)
                }
            });
            *leg = (worst[0].max(worst[1]), self.off.map(|(_, whole)| whole));
        }
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
