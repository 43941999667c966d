//! The self-test: each leg in turn pushes a small sine with the loop open, and
//! what every sensor answers at that frequency is compared with what the model
//! says. A sensor that is dead, inverted, swapped with another or of the wrong
//! gain shows, and so does a leg.

use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::{Calibration, LegForces, Samples};
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

    fn square(self) -> f32 {
        self.re * self.re + self.im * self.im
    }
}

/// What is asked and what must be answered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SelfTest {
    /// The sine's turns per sample, in 2³² parts.
    pub step: u32,
    /// Its size, N.
    pub amplitude: f32,
    /// Samples before a leg is measured: its first swing dies out.
    pub settle: u32,
    /// Samples a leg is measured: whole periods.
    pub measure: u32,
    /// How far an answer may be off, of what it should be: root of the sum of
    /// squares over all legs for a sensor, over the sensors of a kind for a leg.
    pub tolerance: f32,
    /// By leg: each sensor's answer.
    pub sensors: [[Phasor; LEGS]; LEGS],
    /// By leg: that of each force sensor beside them.
    pub forces: [[Phasor; LEGS]; LEGS],
}

impl SelfTest {
    /// Samples that the whole test takes.
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
        let sizes = self.amplitude > 0.0 && self.amplitude.is_finite();
        if finite && sizes && self.step > 0 && self.measure > 0 && self.tolerance > 0.0 {
            Ok(())
        } else {
            Err(TableError::SelfTest)
        }
    }
}

/// A test under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    leg: usize,
    at: u32,
    phase: u32,
    /// By kind, leg and sensor.
    answers: [[[Phasor; LEGS]; LEGS]; 2],
}

/// How a test goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// The forces of this sample.
    Push(LegForces),
    /// All is well.
    Passed,
    /// It is not.
    Failed(Cause),
}

impl Probe {
    /// From the start.
    pub const fn new() -> Self {
        Self {
            leg: 0,
            at: 0,
            phase: 0,
            answers: [[[Phasor::ZERO; LEGS]; LEGS]; 2],
        }
    }

    /// One sample, which answers the push before it.
    pub fn advance(&mut self, table: &Table, samples: Samples) -> Progress {
        let test = &table.self_test;
        if self.leg >= LEGS {
            return self.verdict(table);
        }
        if self.at >= test.settle {
            // The phase is that of this sample's push; a quarter turn ahead for
            // the cosine. Lock-in: the conjugate of the phasor, times 2/n.
            let (sin, cos) = (sine(self.phase), sine(self.phase.wrapping_add(1 << 30)));
            let scale = 2.0 / (test.amplitude * test.measure as f32);
            let beside = table.complement().map(|complement| &complement.sensors);
            let kinds: [(Option<&[Calibration; LEGS]>, _); 2] = [
                (Some(&table.sensors), samples.sensors),
                (beside, samples.forces),
            ];
            for (answers, (sensors, codes)) in self.answers.iter_mut().zip(kinds) {
                let (Some(sensors), Some(answers)) = (sensors, answers.get_mut(self.leg)) else {
                    continue;
                };
                for i in 0..LEGS {
                    let value = scale * sensors[i].value(codes[i]);
                    answers[i].re += value * sin;
                    answers[i].im += value * cos;
                }
            }
        }
        let mut push = LegForces::ZERO;
        if let Some(force) = push.0.get_mut(self.leg) {
            *force = test.amplitude * sine(self.phase);
        }
        self.phase = self.phase.wrapping_add(test.step);
        self.at += 1;
        if self.at >= test.settle.saturating_add(test.measure) {
            (self.leg, self.at, self.phase) = (self.leg + 1, 0, 0);
        }
        Progress::Push(push)
    }

    #[inline(never)]
    fn verdict(&self, table: &Table) -> Progress {
        let test = &table.self_test;
        let square = test.tolerance * test.tolerance;
        // Squared errors of what they should be, by sensor and by leg.
        let mut sensors = [0.0f32; 2 * LEGS];
        let mut legs = [0.0f32; LEGS];
        let kinds = if table.complement().is_some() { 2 } else { 1 };
        let expected = [&test.sensors, &test.forces];
        for kind in 0..kinds {
            let (found, expected) = (&self.answers[kind], expected[kind]);
            let off = |leg: usize, sensor: usize| {
                let (a, b) = (found[leg][sensor], expected[leg][sensor]);
                let difference = Phasor {
                    re: a.re - b.re,
                    im: a.im - b.im,
                };
                (difference.square(), b.square())
            };
            let over = |pairs: &mut dyn Iterator<Item = (f32, f32)>| {
                let (error, whole) = pairs.fold((0.0, 0.0), |(e, w), (a, b)| (e + a, w + b));
                // A NaN is as far off as can be.
                let ratio = error / whole;
                if ratio.is_nan() { f32::MAX } else { ratio }
            };
            for i in 0..LEGS {
                sensors[kind * LEGS + i] = over(&mut (0..LEGS).map(|leg| off(leg, i)));
                let leg = over(&mut (0..LEGS).map(|sensor| off(i, sensor)));
                legs[i] = legs[i].max(leg);
            }
        }
        let worst = |errors: &[f32]| errors.iter().copied().fold(0.0, f32::max);
        let [by_sensor, by_leg] = [worst(&sensors), worst(&legs)];
        if by_sensor <= square && by_leg <= square {
            return Progress::Passed;
        }
        let bits = |errors: &[f32]| {
            let mut bits = 0u16;
            for (i, error) in errors.iter().enumerate() {
                if *error > square {
                    bits |= 1 << i;
                }
            }
            bits
        };
        // A dead sensor is off by all it should give and every leg a little, and
        // the other way round.
        Progress::Failed(if by_sensor >= by_leg {
            Cause::TestSensors(bits(&sensors))
        } else {
            Cause::TestLegs(bits(&legs) as u8)
        })
    }
}

impl Default for Probe {
    fn default() -> Self {
        Self::new()
    }
}
