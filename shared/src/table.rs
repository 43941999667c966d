//! The controller table: everything the step is configured by.
//!
//! `host-gen` fills a [`Table`], the firmware links it as a constant, the
//! simulation uses the same value. A [`ValidTable`] is one that was checked
//! whole; only that can be run. The check is `const`, so a table compiled into
//! the firmware is checked by the compiler.

use nalgebra::Matrix6;

use crate::LEGS;
use crate::codes::{AdcCode, Calibration, DacCode, Drive};

/// The table layout this code reads.
pub const FORMAT_VERSION: u16 = 1;

/// SHA-256 of the machine description a table was made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModelDigest(pub [u8; 32]);

/// What the six sensors measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feedback {
    /// Absolute accelerations of the frame, m/s² (Eq. 12).
    Acceleration,
    /// Whole leg forces, N (Eq. 11).
    Force,
}

/// First-order coefficients in increment form, `state += c·(input − state)`,
/// which in `f32` keeps poles far below the sample rate that `1 − c` would
/// lose. A corner at `f` Hz has c = 1 − exp(−2π·f/rate).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaping {
    /// AC coupling: two first-order high-passes with this coefficient, 0 to
    /// leave it out.
    pub ac_coupling: f32,
    /// Roll-off: a first-order low-pass with this coefficient, 1 to leave it
    /// out.
    pub roll_off: f32,
}

/// The proportional-integral law of Eqs. (14), (21) and (22).
///
/// Rows are actuators, columns sensors. Units are N per unit of the sensor:
/// N/(m/s²) for accelerations, 1 for forces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    /// K_a or K_P.
    pub proportional: Matrix6<f32>,
    /// K_v·T/2 or K_I·T/2: the integral is trapezoidal, so this times the sum
    /// of two neighbouring samples is one period's increment in N.
    pub integral: Matrix6<f32>,
    /// The part of the integral that leaks away in one period, 0 to 1.
    pub leak: f32,
    /// The part of the clamp's excess force that is taken back out of the
    /// integral in one period, 0 to 1.
    pub anti_windup: f32,
}

/// Everything the step is configured by. Plain data; see [`Table::validate`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Table {
    /// [`FORMAT_VERSION`] when it was made.
    pub version: u16,
    /// The machine description it was made from.
    pub model: ModelDigest,
    /// Steps per second, Hz.
    pub sample_rate: f32,
    /// What the sensors measure.
    pub feedback: Feedback,
    /// Sensor channels, in the order of the law's columns.
    pub sensors: [Calibration; LEGS],
    /// The highest ADC code; the lowest is its negative less one.
    pub adc_max: AdcCode,
    /// AC coupling and roll-off, the same for all channels.
    pub shaping: Shaping,
    /// The law.
    pub law: Law,
    /// Actuator channels, in the order of the law's rows.
    pub actuators: [Drive; LEGS],
    /// The highest DAC code; the lowest is 0.
    pub dac_max: DacCode,
}

/// What is wrong with a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableError {
    /// Made for another layout.
    Version,
    /// Sample rate not positive and finite.
    SampleRate,
    /// A sensor's calibration is not finite or its gain is zero; the channel.
    Sensor(usize),
    /// The ADC's highest code is not positive.
    AdcRange,
    /// A shaping coefficient outside 0 to 1, or a roll-off that passes nothing.
    Shaping,
    /// A gain is not finite; the row.
    Gain(usize),
    /// Leak or anti-windup outside 0 to 1.
    Integral,
    /// A drive is not finite, its gain is zero, or its limit is not positive
    /// or reaches past the DAC's codes; the channel.
    Actuator(usize),
}

impl core::fmt::Display for TableError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Version => write!(f, "the table's layout is not version {FORMAT_VERSION}"),
            Self::SampleRate => f.write_str("the sample rate is not positive and finite"),
            Self::Sensor(i) => write!(f, "sensor channel {i}: calibration not finite or zero"),
            Self::AdcRange => f.write_str("the ADC's highest code is not positive"),
            Self::Shaping => f.write_str("a shaping coefficient lies outside 0 to 1"),
            Self::Gain(i) => write!(f, "gain row {i} is not finite"),
            Self::Integral => f.write_str("leak or anti-windup lies outside 0 to 1"),
            Self::Actuator(i) => write!(
                f,
                "actuator channel {i}: not finite, no gain, or a limit the DAC cannot give"
            ),
        }
    }
}

impl core::error::Error for TableError {}

/// A table that was checked whole. The only one the step accepts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValidTable(Table);

impl ValidTable {
    /// The checked table.
    #[inline]
    pub const fn get(&self) -> &Table {
        &self.0
    }

    /// The DAC codes of no force: what a board gives when nothing is to move.
    pub fn safe_codes(&self) -> [DacCode; LEGS] {
        self.0.actuators.map(|drive| drive.code(0.0))
    }
}

const fn fraction(x: f32) -> bool {
    x >= 0.0 && x <= 1.0
}

impl Table {
    /// Checks every number once, so that the step never has to.
    pub const fn validate(self) -> Result<ValidTable, TableError> {
        if self.version != FORMAT_VERSION {
            return Err(TableError::Version);
        }
        if !(self.sample_rate.is_finite() && self.sample_rate > 0.0) {
            return Err(TableError::SampleRate);
        }
        if self.adc_max.0 <= 0 {
            return Err(TableError::AdcRange);
        }
        if !(fraction(self.shaping.ac_coupling)
            && fraction(self.shaping.roll_off)
            && self.shaping.roll_off > 0.0)
        {
            return Err(TableError::Shaping);
        }
        if !(fraction(self.law.leak) && fraction(self.law.anti_windup)) {
            return Err(TableError::Integral);
        }
        // `while`, because `for` is not const.
        let mut i = 0;
        while i < LEGS {
            let s = &self.sensors[i];
            if !(s.zero.is_finite() && s.gain.is_finite() && s.gain != 0.0) {
                return Err(TableError::Sensor(i));
            }
            let mut j = 0;
            while j < LEGS {
                let kp = self.law.proportional.data.0[j][i];
                let ki = self.law.integral.data.0[j][i];
                if !(kp.is_finite() && ki.is_finite()) {
                    return Err(TableError::Gain(i));
                }
                j += 1;
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
        Ok(ValidTable(self))
    }
}
