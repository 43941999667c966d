//! The controller table: everything the step is configured by.
//!
//! `host-gen` fills a [`Table`], the firmware links it as a constant, the
//! simulation uses the same value. A [`ValidTable`] is one that was checked
//! whole; only that can be run. The check is `const`, so a table compiled into
//! the firmware is checked by the compiler.

use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use crate::codes::{AdcCode, Calibration, DacCode, Drive};
use crate::self_test::SelfTest;
use crate::supervisor::Supervision;
use crate::{CRC_32, LEGS};

/// The table layout this code reads.
pub const FORMAT_VERSION: u16 = 6;

/// SHA-256 of the machine description a table was made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelDigest(pub [u8; 32]);

/// What a table's six sensors measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Feedback {
    /// Absolute accelerations of the frame, m/s² (Eq. 12).
    Acceleration,
    /// Whole leg forces, N (Eq. 11).
    Force,
}

/// The proportional-integral law of Eqs. (14), (21) and (22).
///
/// First-order coefficients are in increment form, `state += c·(input − state)`,
/// which in `f32` keeps poles far below the sample rate that `1 − c` would
/// lose. A corner at `f` Hz has c = 1 − exp(−2π·f/rate).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Law {
    /// How sensors become forces.
    pub paths: Paths,
    /// The part of the integrals that leaks away in one period, 0 to 1.
    pub leak: f32,
    /// The part of the clamp's excess force that is taken back out of the
    /// integrals in one period, 0 to 1.
    pub anti_windup: f32,
}

/// How sensors become forces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[allow(
    clippy::large_enum_variant,
    reason = "there is one table, and nothing to allocate a box from"
)]
pub enum Paths {
    /// Every sensor to every leg, all shaped alike.
    Direct(Direct),
    /// Through the modes of the design model, each shaped by itself.
    Modal(Modal),
}

/// The matrices of Eq. (14) as they stand.
///
/// Rows are actuators, columns sensors. Units are N per unit of the sensor:
/// N/(m/s²) for accelerations, 1 for forces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Direct {
    /// Roll-off: a first-order low-pass with this coefficient, 1 to leave it
    /// out.
    pub roll_off: f32,
    /// K_a or K_P.
    pub proportional: Matrix6<f32>,
    /// K_v·T/2 or K_I·T/2: the integral is trapezoidal, so this times the sum
    /// of two neighbouring samples is one period's increment in N.
    pub integral: Matrix6<f32>,
}

/// Sensors to modes, six channels, modes to legs.
///
/// With all sections the same this is the direct law, K = output·diag·input:
/// S of Eq. (17) makes the gains of Eqs. (19) to (22) diagonal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Modal {
    /// T_in. Accelerations: S⁻¹·T_c⁻¹, to modal accelerations, √kg·m/s².
    /// Forces: Sᵀ, to modal forces, N/√kg.
    pub input: Matrix6<f32>,
    /// Force sensors beside accelerometers.
    pub complement: Option<Complement>,
    /// By mode.
    pub channels: [Channel; LEGS],
    /// How many of the sections run, the same for all channels.
    pub sections: usize,
    /// T_out = S⁻ᵀ, from modal forces, N/√kg, to leg forces, N.
    pub output: Matrix6<f32>,
}

/// Force sensors that take over from accelerometers at high frequency.
///
/// The legs' forces are all that accelerates the machine as a rigid whole, so
/// Sᵀ times the forces is what T_in makes of the accelerations, S⁻¹·T_c⁻¹·y:
/// N/√kg is √kg·m/s². In each channel a first-order low-pass of the one and the
/// high-pass that complements it of the other add up:
///
/// ```text
/// d += split·(a − f − d)
/// r  = f + d
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Complement {
    /// Force sensor channels, in the order of `input`'s columns.
    pub sensors: [Calibration; LEGS],
    /// Sᵀ, N to N/√kg.
    pub input: Matrix6<f32>,
    /// By mode: coefficient of the low-pass.
    pub split: [f32; LEGS],
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

/// Room for second-order sections in a channel.
pub const SECTIONS: usize = 3;

/// One mode: sections in series, then proportional plus integral.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Channel {
    /// Shaping.
    pub sections: [Section; SECTIONS],
    /// ω²/ω_n² − 1.
    pub proportional: f32,
    /// 2ζ_n·ω²/ω_n·T/2, trapezoidal as in [`Direct::integral`].
    pub integral: f32,
}

/// A second-order section as two integrators in increment form, which keeps
/// slow poles and zeros exact in `f32` whatever the sample rate:
///
/// ```text
/// y  = direct·u + band·x1 + low·x2     with the states before
/// x1 += rate·(u − damping·x1 − x2)     band-pass
/// x2 += rate·x1                        low-pass, x1 before; at rest x2 = u
/// ```
///
/// Poles at z = 1 + δ, δ² + rate·damping·δ + rate² = 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Section {
    /// The geometric mean of the poles' distances from z = 1.
    pub rate: f32,
    /// Twice the relative damping.
    pub damping: f32,
    /// Gain of the input; at half the sample rate and above all poles, all of
    /// it.
    pub direct: f32,
    /// Gain of the band-pass.
    pub band: f32,
    /// Gain of the low-pass; `direct` + `low` is the gain at rest.
    pub low: f32,
}

impl Section {
    /// Lets everything through.
    pub const PASS: Self = Self {
        rate: 0.5,
        damping: 2.0,
        direct: 1.0,
        band: 0.0,
        low: 0.0,
    };

    /// Whether all is finite and both poles lie inside the unit circle
    /// (Jury's criterion).
    const fn is_stable(&self) -> bool {
        let gains = self.direct.is_finite() && self.band.is_finite() && self.low.is_finite();
        let (c, d) = (self.rate, self.damping);
        gains && c > 0.0 && d > c && 2.0 * c * d < 4.0 + c * c
    }
}

/// Everything the step is configured by. Plain data; see [`Table::validate`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// [`FORMAT_VERSION`] when it was made.
    pub version: u16,
    /// The machine description it was made from.
    pub model: ModelDigest,
    /// Steps per second, Hz.
    pub sample_rate: f32,
    /// From the sampling instant to the latch of the outputs made from it, s: what the
    /// loop was designed for.
    pub latch: f32,
    /// What the sensors measure.
    pub feedback: Feedback,
    /// Sensor channels, in the order of the law's columns.
    pub sensors: [Calibration; LEGS],
    /// The highest ADC code; the lowest is its negative less one.
    pub adc_max: AdcCode,
    /// AC coupling of every sensor: two first-order high-passes with this
    /// coefficient, 0 to leave it out.
    pub ac_coupling: f32,
    /// The averages that the AC coupling takes off follow no deviation larger
    /// than this, sensor units: a shock does not become an offset that the
    /// legs then push against for the coupling's time constant.
    pub ac_limit: f32,
    /// The law.
    pub law: Law,
    /// Actuator channels, in the order of the law's rows.
    pub actuators: [Drive; LEGS],
    /// The highest DAC code; the lowest is 0.
    pub dac_max: DacCode,
    /// When the supervisor acts.
    pub supervision: Supervision,
    /// How sensors and legs are tested.
    pub self_test: SelfTest,
}

/// The most bytes that a table takes as postcard writes it.
pub const TABLE_ROOM: usize = 4096;

/// What tables a board can run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// The highest sample rate, Hz.
    pub rate: f32,
    /// From a sample until the first of its codes is written into the DAC, and until
    /// all of them can be latched, s.
    pub written: (f32, f32),
    /// Whether it has inputs for force sensors beside accelerometers.
    pub beside: bool,
    /// Its converters' highest codes.
    pub codes: (AdcCode, DacCode),
}

impl Limits {
    /// A board that takes what comes, with 16-bit converters: the simulation.
    pub const NONE: Self = Self {
        rate: f32::MAX,
        written: (f32::MAX, 0.0),
        beside: true,
        codes: (AdcCode(i16::MAX), DacCode(u16::MAX)),
    };

    /// Whether the board can run `table`.
    ///
    /// # Errors
    /// What it cannot.
    pub fn admit(&self, table: &ValidTable) -> Result<(), TableError> {
        let t = table.get();
        if t.sample_rate > self.rate {
            return Err(TableError::BoardRate);
        }
        // The codes of one sample wait in the DAC until those of the next are written.
        let (begun, ended) = self.written;
        if t.latch < ended || t.latch > 1.0 / t.sample_rate + begun {
            return Err(TableError::BoardLatch);
        }
        if t.complement().is_some() && !self.beside {
            return Err(TableError::BoardInputs);
        }
        if (t.adc_max, t.dac_max) != self.codes {
            return Err(TableError::BoardCodes);
        }
        Ok(())
    }
}

/// What is wrong with a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TableError {
    /// Made for another layout.
    Version,
    /// Sample rate not positive and finite.
    SampleRate,
    /// The latch's delay negative or not finite.
    Latch,
    /// The board takes no such sample rate.
    BoardRate,
    /// The board's outputs are not ready at that latch, or it cannot wait so long.
    BoardLatch,
    /// The board has no inputs for force sensors beside accelerometers.
    BoardInputs,
    /// The board's converters have other ranges of codes.
    BoardCodes,
    /// Not as long as it was said to be, or no table.
    Encoding,
    /// Its checksum is another.
    Checksum,
    /// A sensor's calibration is not finite or its gain is zero; the channel.
    Sensor(usize),
    /// The same of a force sensor beside accelerometers.
    ForceSensor(usize),
    /// Force sensors beside force sensors.
    Complement,
    /// The ADC's highest code is not positive.
    AdcRange,
    /// AC coupling, roll-off or split outside 0 to 1, a roll-off or split that
    /// passes nothing, or an AC coupling that follows nothing.
    Shaping,
    /// More sections than there is room for.
    Sections,
    /// A channel's section has a pole outside the unit circle or is not
    /// finite; the channel.
    Section(usize),
    /// A gain is not finite; the row, or the channel.
    Gain(usize),
    /// Leak or anti-windup outside 0 to 1.
    Integral,
    /// A count that must not be 0 is, or a factor makes no sense.
    Supervision,
    /// The self-test's numbers are not finite, or it pushes with nothing.
    SelfTest,
    /// A drive is not finite, its gain is zero, or its limit is not positive
    /// or reaches past the DAC's codes; the channel.
    Actuator(usize),
}

impl core::fmt::Display for TableError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Version => write!(f, "the table's layout is not version {FORMAT_VERSION}"),
            Self::SampleRate => f.write_str("the sample rate is not positive and finite"),
            Self::Latch => f.write_str("the latch's delay is not a time"),
            Self::BoardRate => f.write_str("the board takes no such sample rate"),
            Self::BoardLatch => {
                f.write_str("the board's outputs cannot be latched at that time after a sample")
            }
            Self::BoardInputs => {
                f.write_str("the board has no inputs for force sensors beside accelerometers")
            }
            Self::BoardCodes => f.write_str("the board's converters have other codes"),
            Self::Encoding => f.write_str("the bytes are no table"),
            Self::Checksum => f.write_str("the table's checksum is another"),
            Self::Sensor(i) => write!(f, "sensor channel {i}: calibration not finite or zero"),
            Self::ForceSensor(i) => {
                write!(
                    f,
                    "force sensor channel {i}: calibration not finite or zero"
                )
            }
            Self::Complement => f.write_str("only accelerometers have force sensors beside them"),
            Self::AdcRange => f.write_str("the ADC's highest code is not positive"),
            Self::Shaping => f.write_str("AC coupling, roll-off or split lies outside its range"),
            Self::Sections => write!(f, "a channel has room for {SECTIONS} sections"),
            Self::Section(i) => write!(f, "channel {i} has a section that is not stable"),
            Self::Gain(i) => write!(f, "gain row {i} is not finite"),
            Self::Integral => f.write_str("leak or anti-windup lies outside 0 to 1"),
            Self::Supervision => f.write_str("the supervisor's numbers make no sense"),
            Self::SelfTest => f.write_str("the self-test's numbers make no sense"),
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

    /// The table in `bytes`, as postcard writes it, checked whole.
    ///
    /// # Errors
    /// Where it is none, not valid, or `checksum` is not its own.
    pub fn decode(bytes: &[u8], checksum: u32) -> Result<Self, TableError> {
        let Ok((table, [])) = postcard::take_from_bytes::<Table>(bytes) else {
            return Err(TableError::Encoding);
        };
        let table = table.validate()?;
        if table.checksum() == checksum {
            Ok(table)
        } else {
            Err(TableError::Checksum)
        }
    }

    /// The table as postcard writes it, at the start of `room`. None if there is too
    /// little.
    pub fn encode<'a>(&self, room: &'a mut [u8; TABLE_ROOM]) -> Option<&'a [u8]> {
        postcard::to_slice(&self.0, room).ok().map(|bytes| &*bytes)
    }

    /// CRC-32 (ISO-HDLC) of the table as postcard writes it: what a table is
    /// known by, and what shows that a bit of it has changed.
    pub fn checksum(&self) -> u32 {
        // Numbers, options and arrays of known length: nothing that postcard
        // cannot write, and the sum takes it all.
        postcard::serialize_with_flavor(&self.0, Sum(CRC_32.digest())).unwrap_or(0)
    }
}

/// Sums up instead of storing.
struct Sum(crc::Digest<'static, u32>);

impl postcard::ser_flavors::Flavor for Sum {
    type Output = u32;

    fn try_push(&mut self, data: u8) -> postcard::Result<()> {
        self.0.update(&[data]);
        Ok(())
    }

    fn try_extend(&mut self, data: &[u8]) -> postcard::Result<()> {
        self.0.update(data);
        Ok(())
    }

    fn finalize(self) -> postcard::Result<u32> {
        Ok(self.0.finalize())
    }
}

const fn fraction(x: f32) -> bool {
    x >= 0.0 && x <= 1.0
}

impl Table {
    /// The force sensors beside accelerometers, if there are any.
    #[inline]
    pub const fn complement(&self) -> Option<&Complement> {
        match &self.law.paths {
            Paths::Direct(_) => None,
            Paths::Modal(modal) => modal.complement.as_ref(),
        }
    }

    /// Checks every number once, so that the step never has to.
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
        Ok(ValidTable(self))
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
