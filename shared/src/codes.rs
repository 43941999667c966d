//! Converter codes and every conversion between codes, volts, m/s² and N.
//!
//! The `f64` types [`Adc`] and [`Dac`] describe the converters for the host, which
//! simulates them and makes tables. The step runs the `f32` types [`Calibration`] and
//! [`Drive`].

use serde::{Deserialize, Serialize};

use crate::LEGS;

/// A raw ADC sample: two's complement, full scale symmetric about 0 V.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AdcCode(pub i16);

/// The ADC codes of one sampling instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
// Copied in words of 32 bits.
#[repr(align(4))]
pub struct Samples {
    /// Codes of the table's sensors.
    pub sensors: [AdcCode; LEGS],
    /// Codes of the force sensors of a [`Complement`](crate::table::Complement); ignored
    /// by tables without one.
    pub forces: [AdcCode; LEGS],
}

impl Samples {
    /// All codes zero.
    pub const NONE: Self = Self {
        sensors: [AdcCode(0); LEGS],
        forces: [AdcCode(0); LEGS],
    };
}

impl From<[AdcCode; LEGS]> for Samples {
    /// The codes of a board with six sensors; the force sensors' codes are zero.
    fn from(sensors: [AdcCode; LEGS]) -> Self {
        Self {
            sensors,
            forces: [AdcCode(0); LEGS],
        }
    }
}

/// A raw DAC code: straight binary, 0 is the low end of the range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DacCode(pub u16);

/// One force per leg, N, positive when it pushes the frame away from its foot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LegForces(pub [f32; LEGS]);

impl LegForces {
    /// No force in any leg.
    pub const ZERO: Self = Self([0.0; LEGS]);
}

/// Why a description of a converter is not valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConverterError {
    /// The number of bits is outside 8 to 16.
    Bits,
    /// The range is not finite, or its high end is not above its low end.
    Range,
}

impl core::fmt::Display for ConverterError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Bits => "a converter has 8 to 16 bits",
            Self::Range => {
                "a converter's range must be finite, with its high end above its low end"
            }
        })
    }
}

impl core::error::Error for ConverterError {}

/// An analogue-to-digital converter with range ±`range` V.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adc {
    bits: u32,
    range: f64,
}

impl Adc {
    /// A converter with range ±`range` V and 8 to 16 `bits`.
    ///
    /// # Errors
    /// If a number is outside its range.
    pub fn new(bits: u32, range: f64) -> Result<Self, ConverterError> {
        check(bits, -range, range)?;
        Ok(Self { bits, range })
    }

    /// Volts per code.
    pub fn lsb(&self) -> f64 {
        2.0 * self.range / f64::from(1u32 << self.bits)
    }

    /// The highest code. The lowest is −`max()` − 1.
    pub fn max(&self) -> AdcCode {
        // At most 2^15 − 1.
        AdcCode(((1i32 << (self.bits - 1)) - 1) as i16)
    }

    /// The code nearest to `volts`, limited to the ends of the range. NaN gives the
    /// lowest code.
    pub fn code(&self, volts: f64) -> AdcCode {
        let half = f64::from(1i32 << (self.bits - 1));
        // Offset to positive so that the cast's truncation rounds to nearest.
        let lifted = (volts / self.lsb() + half + 0.5).clamp(0.0, 2.0 * half - 1.0);
        AdcCode((lifted as i32 - half as i32) as i16)
    }

    /// Calibration for a sensor of `sensitivity` V per unit (m/s² or N).
    pub fn calibration(&self, sensitivity: f64) -> Calibration {
        Calibration {
            zero: 0.0,
            gain: (self.lsb() / sensitivity) as f32,
        }
    }
}

/// A digital-to-analogue converter with range `low` to `high` V.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dac {
    bits: u32,
    low: f64,
    high: f64,
}

impl Dac {
    /// A converter with 8 to 16 `bits`: code 0 gives `low` V, and one code past the
    /// highest would give `high` V.
    ///
    /// # Errors
    /// If a number is outside its range.
    pub fn new(bits: u32, low: f64, high: f64) -> Result<Self, ConverterError> {
        check(bits, low, high)?;
        Ok(Self { bits, low, high })
    }

    /// Volts per code.
    pub fn lsb(&self) -> f64 {
        (self.high - self.low) / f64::from(1u32 << self.bits)
    }

    /// The highest code.
    pub fn max(&self) -> DacCode {
        // At most 2^16 − 1.
        DacCode(((1u32 << self.bits) - 1) as u16)
    }

    /// The output voltage of a code, V.
    pub fn volts(&self, code: DacCode) -> f64 {
        self.low + f64::from(code.0) * self.lsb()
    }

    /// The code in the middle of the range, which is zero force.
    pub fn middle(&self) -> DacCode {
        // At most 2^15.
        DacCode((1u32 << (self.bits - 1)) as u16)
    }

    /// The force of a code, N, for an actuator of `gain` N/V, zero in the middle of the
    /// range.
    pub fn force(&self, code: DacCode, gain: f64) -> f64 {
        (self.volts(code) - self.volts(self.middle())) * gain
    }

    /// The largest force in both directions, N, that the codes can demand of an actuator
    /// of `gain` N/V.
    pub fn reach(&self, gain: f64) -> f64 {
        self.force(self.max(), gain.abs())
    }

    /// Drive for an actuator of `gain` N/V, limited to ±`limit` N and to slightly less
    /// than [`Dac::reach`], so that rounding to `f32` cannot exceed it.
    pub fn drive(&self, gain: f64, limit: f64) -> Drive {
        let limit = limit.min(self.reach(gain) * (1.0 - 1e-6));
        Drive {
            zero: f32::from(self.middle().0),
            gain: (1.0 / (self.lsb() * gain)) as f32,
            limit: limit as f32,
        }
    }
}

fn check(bits: u32, low: f64, high: f64) -> Result<(), ConverterError> {
    if !(8..=16).contains(&bits) {
        return Err(ConverterError::Bits);
    }
    if !(low.is_finite() && high.is_finite() && low < high) {
        return Err(ConverterError::Range);
    }
    Ok(())
}

/// One sensor channel, from code to m/s² or N.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// The code at a value of zero.
    pub zero: f32,
    /// Units (m/s² or N) per code; negative for an inverted sensor.
    pub gain: f32,
}

impl Calibration {
    /// Whether both numbers are finite and the gain is not zero.
    pub(crate) const fn is_usable(&self) -> bool {
        self.zero.is_finite() && self.gain.is_finite() && self.gain != 0.0
    }

    /// The value of a code, m/s² or N.
    #[inline]
    pub fn value(&self, code: AdcCode) -> f32 {
        (f32::from(code.0) - self.zero) * self.gain
    }
}

/// One actuator channel, from N to code.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Drive {
    /// The code of zero force.
    pub zero: f32,
    /// Codes per N; negative for an inverting amplifier.
    pub gain: f32,
    /// The largest force in both directions, N.
    pub limit: f32,
}

impl Drive {
    /// The code nearest to `force` N, which must be within the limit: that of a valid table is
    /// inside the DAC's range.
    #[inline]
    pub fn code(&self, force: f32) -> DacCode {
        // Within the range, so that nothing is cut off; a limit to it would take two more
        // instructions per leg.
        DacCode((self.zero + force * self.gain + 0.5) as u32 as u16)
    }

    /// The force of a code, N.
    #[inline]
    pub fn force(&self, code: DacCode) -> f32 {
        (f32::from(code.0) - self.zero) / self.gain
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// AD7606 data sheet, ±10 V range: 1 LSB = 305 µV, codes −32768 to 32767.
    #[test]
    fn adc_codes_are_the_data_sheets() {
        let adc = Adc::new(16, 10.0).unwrap();
        assert!((adc.lsb() - 305.175_781_25e-6).abs() < 1e-12);
        assert_eq!(adc.code(0.0), AdcCode(0));
        assert_eq!(adc.code(adc.lsb()), AdcCode(1));
        assert_eq!(adc.code(-adc.lsb()), AdcCode(-1));
        assert_eq!(adc.code(11.0), AdcCode(32767));
        assert_eq!(adc.code(-11.0), AdcCode(-32768));
        assert_eq!(adc.code(0.49 * adc.lsb()), AdcCode(0));
        assert_eq!(adc.code(0.51 * adc.lsb()), AdcCode(1));
        assert_eq!(adc.code(-0.49 * adc.lsb()), AdcCode(0));
        assert_eq!(adc.code(-0.51 * adc.lsb()), AdcCode(-1));
        assert_eq!(Adc::new(12, 10.0).unwrap().code(11.0), AdcCode(2047));
    }

    /// AD5676R data sheet: V_out = V_ref·gain·D/65536.
    #[test]
    fn dac_volts_are_the_data_sheets() {
        let dac = Dac::new(16, 0.0, 5.0).unwrap();
        assert_eq!(dac.volts(DacCode(0)), 0.0);
        assert_eq!(dac.volts(DacCode(32768)), 2.5);
        assert!((dac.volts(DacCode(65535)) - (5.0 - 5.0 / 65536.0)).abs() < 1e-15);
        assert_eq!(dac.middle(), DacCode(32768));
    }

    /// One volt more at the DAC is `gain` N more force, and a drive converts that force
    /// to that voltage.
    #[test]
    fn a_push_is_a_higher_voltage() {
        let dac = Dac::new(16, 0.0, 5.0).unwrap();
        let drive = dac.drive(100.0, 200.0);
        let code = drive.code(100.0);
        assert!((dac.volts(code) - 3.5).abs() <= dac.lsb());
        assert!((dac.force(code, 100.0) - 100.0).abs() <= 100.0 * dac.lsb());
        assert!((dac.reach(-100.0) - 250.0).abs() < 0.01);
        // With an inverting amplifier the same force is a lower voltage.
        assert!((dac.volts(dac.drive(-100.0, 200.0).code(100.0)) - 1.5).abs() <= dac.lsb());
    }

    #[test]
    fn a_sensor_reads_what_it_senses() {
        let adc = Adc::new(16, 10.0).unwrap();
        let sensitivity = -20.0;
        let calibration = adc.calibration(sensitivity);
        let value = calibration.value(adc.code(0.125 * sensitivity));
        assert!((f64::from(value) - 0.125).abs() <= 0.5 * adc.lsb() / 20.0 + 1e-8);
    }

    #[test]
    fn impossible_converters_are_refused() {
        assert_eq!(Adc::new(24, 10.0), Err(ConverterError::Bits));
        assert_eq!(Adc::new(16, 0.0), Err(ConverterError::Range));
        assert_eq!(Adc::new(16, f64::NAN), Err(ConverterError::Range));
        assert_eq!(Dac::new(7, 0.0, 5.0), Err(ConverterError::Bits));
        assert_eq!(Dac::new(16, 5.0, 5.0), Err(ConverterError::Range));
    }
}
