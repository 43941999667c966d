//! Validation of a table, once, so that the step never has to check a number.

use nalgebra::Matrix6;

use super::{
    Complement, Direct, DirectPath, FORMAT_VERSION, Feedback, Modal, Paths, SECTIONS, Section,
    SelfTest, Supervision, Table, TableError,
};
use crate::LEGS;
use crate::codes::DacCode;

/// A validated table, the only kind that the step accepts, with what follows from it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValidTable {
    table: Table,
    direct_path: DirectPath,
}

impl ValidTable {
    /// The table itself.
    #[inline]
    pub const fn get(&self) -> &Table {
        &self.table
    }

    /// The path of the law straight through.
    #[inline]
    pub const fn direct_path(&self) -> &DirectPath {
        &self.direct_path
    }

    /// The DAC code of zero force for each leg: a board's outputs while nothing drives
    /// the legs.
    pub fn safe_codes(&self) -> [DacCode; LEGS] {
        self.table.actuators.map(|drive| drive.code(0.0))
    }
}

const fn fraction(x: f32) -> bool {
    x >= 0.0 && x <= 1.0
}

impl Table {
    /// Checks every number.
    ///
    /// # Errors
    /// The first number that is outside its range.
    pub const fn validate(self) -> Result<ValidTable, TableError> {
        if self.version != FORMAT_VERSION {
            return Err(TableError::Version);
        }
        if !(self.sample_rate.is_finite() && self.sample_rate > 0.0) {
            return Err(TableError::SampleRate);
        }
        if !(self.latch.is_finite() && self.latch >= 0.0) {
            return Err(TableError::Latch);
        }
        if self.adc_max.0 <= 0 {
            return Err(TableError::AdcRange);
        }
        if !(fraction(self.ac_coupling) && self.ac_limit > 0.0) {
            return Err(TableError::Shaping);
        }
        if !(fraction(self.law.leak) && fraction(self.law.anti_windup)) {
            return Err(TableError::Integral);
        }
        let paths = match &self.law.paths {
            Paths::Direct(direct) => direct.validate(),
            Paths::Modal(modal) => {
                if modal.complement.is_some() && matches!(self.feedback, Feedback::Force) {
                    return Err(TableError::Complement);
                }
                modal.validate()
            }
        };
        if let Err(error) = paths {
            return Err(error);
        }
        if let Err(error) = self.supervision.validate() {
            return Err(error);
        }
        if let Err(error) = self.self_test.validate() {
            return Err(error);
        }
        // `while`, because `for` is not const.
        let mut i = 0;
        while i < LEGS {
            if !self.sensors[i].is_usable() {
                return Err(TableError::Sensor(i));
            }
            let a = &self.actuators[i];
            let stroke = a.limit * a.gain.abs();
            let finite = a.zero.is_finite() && a.gain.is_finite() && a.limit.is_finite();
            if !(finite
                && a.gain != 0.0
                && a.limit > 0.0
                && a.zero - stroke >= 0.0
                && a.zero + stroke <= self.dac_max.0 as f32)
            {
                return Err(TableError::Actuator(i));
            }
            i += 1;
        }
        Ok(ValidTable {
            direct_path: DirectPath::new(&self.law),
            table: self,
        })
    }
}

/// The first row with an entry that is not finite.
const fn bad_row(matrix: &Matrix6<f32>) -> Option<usize> {
    let mut i = 0;
    while i < LEGS {
        let mut j = 0;
        while j < LEGS {
            if !matrix.data.0[j][i].is_finite() {
                return Some(i);
            }
            j += 1;
        }
        i += 1;
    }
    None
}

impl Direct {
    const fn validate(&self) -> Result<(), TableError> {
        if !(fraction(self.roll_off) && self.roll_off > 0.0) {
            return Err(TableError::Shaping);
        }
        match (bad_row(&self.proportional), bad_row(&self.integral)) {
            (None, None) => Ok(()),
            (Some(row), _) | (None, Some(row)) => Err(TableError::Gain(row)),
        }
    }
}

impl Modal {
    const fn validate(&self) -> Result<(), TableError> {
        if self.sections > SECTIONS {
            return Err(TableError::Sections);
        }
        match (bad_row(&self.input), bad_row(&self.output)) {
            (None, None) => {}
            (Some(row), _) | (None, Some(row)) => return Err(TableError::Gain(row)),
        }
        if let Some(complement) = &self.complement
            && let Err(error) = complement.validate()
        {
            return Err(error);
        }
        let mut i = 0;
        while i < LEGS {
            let channel = &self.channels[i];
            if !(channel.proportional.is_finite() && channel.integral.is_finite()) {
                return Err(TableError::Gain(i));
            }
            let mut j = 0;
            while j < SECTIONS {
                if !channel.sections[j].is_stable() {
                    return Err(TableError::Section(i));
                }
                j += 1;
            }
            i += 1;
        }
        Ok(())
    }
}

impl Complement {
    const fn validate(&self) -> Result<(), TableError> {
        if let Some(row) = bad_row(&self.input) {
            return Err(TableError::Gain(row));
        }
        let mut i = 0;
        while i < LEGS {
            if !self.sensors[i].is_usable() {
                return Err(TableError::ForceSensor(i));
            }
            if !(fraction(self.split[i]) && self.split[i] > 0.0) {
                return Err(TableError::Shaping);
            }
            i += 1;
        }
        Ok(())
    }
}

impl Section {
    /// Whether all numbers are finite and both poles lie inside the unit circle (Jury's
    /// criterion).
    const fn is_stable(&self) -> bool {
        let gains = self.direct.is_finite() && self.band.is_finite() && self.low.is_finite();
        let (c, d) = (self.rate, self.damping);
        gains && c > 0.0 && d > c && 2.0 * c * d < 4.0 + c * c
    }
}

impl Supervision {
    const fn validate(&self) -> Result<(), TableError> {
        let counts = self.safe_ramp > 0
            && self.settle > 0
            && self.rail > 0
            && self.lost > 0
            && self.spikes > 0
            && self.saturated > 0
            // Longer than the evaluation of a window, which takes one sample per part.
            && self.window >= 16
            // The sums of a window must not overflow.
            && self.window < 1 << 20
            && self.grown > 0
            && self.strange > 0;
        let factors = self.ramp > 1.0
            && self.growth > 1.0
            && self.level > 0.0
            && self.wild > 1.0
            && self.dull > 1.0;
        let finite = self.ramp.is_finite()
            && self.growth.is_finite()
            && self.level.is_finite()
            && self.wild.is_finite()
            && self.dull.is_finite();
        if counts && factors && finite {
            Ok(())
        } else {
            Err(TableError::Supervision)
        }
    }
}

impl SelfTest {
    const fn validate(&self) -> Result<(), TableError> {
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
        // Longer than the evaluation of a leg, which takes one sample per sensor.
        let lengths = self.step > 0 && self.measure >= 16 && self.watch >= 16;
        if finite && sizes && lengths && self.tolerance > 0.0 {
            Ok(())
        } else {
            Err(TableError::SelfTest)
        }
    }
}
