//! What can be wrong with a table.

use serde::{Deserialize, Serialize};

use super::{FORMAT_VERSION, SECTIONS};

/// What is wrong with a table. The order is part of the wire format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TableError {
    /// The table's layout is not [`FORMAT_VERSION`].
    Version,
    /// The sample rate is not positive and finite.
    SampleRate,
    /// The latch delay is negative or not finite.
    Latch,
    /// The sample rate is higher than the board can run.
    BoardRate,
    /// The latch comes before the board's outputs are written, or after they are
    /// overwritten by those of the next sample.
    BoardLatch,
    /// The table uses force sensors together with accelerometers, and the board has no
    /// inputs for both.
    BoardInputs,
    /// The highest codes of the table are not those of the board's converters.
    BoardCodes,
    /// The bytes are not an encoded table, or their number is wrong.
    Encoding,
    /// The checksum of the table is not the one given with it.
    Checksum,
    /// A sensor's calibration is not finite, or its gain is zero; the channel.
    Sensor(usize),
    /// The calibration of a force sensor used together with accelerometers is not finite,
    /// or its gain is zero; the channel.
    ForceSensor(usize),
    /// The law adds force sensors to a table whose sensors are force sensors already.
    Complement,
    /// The ADC's highest code is not positive.
    AdcRange,
    /// A coefficient of AC coupling, roll-off or split is outside 0 to 1, a roll-off or
    /// split is 0, or the limit of the AC coupling is not positive.
    Shaping,
    /// A channel has more than [`SECTIONS`] sections.
    Sections,
    /// A section of a channel is unstable or not finite; the channel.
    Section(usize),
    /// A gain is not finite; the matrix row, or the channel.
    Gain(usize),
    /// Leak or anti-windup is outside 0 to 1.
    Integral,
    /// A threshold or time of the supervisor is outside its range.
    Supervision,
    /// A number of the self-test is outside its range or not finite.
    SelfTest,
    /// An actuator's drive is not finite, its gain is zero, or its force limit is not
    /// positive or needs codes that the DAC does not have; the channel.
    Actuator(usize),
}

impl core::fmt::Display for TableError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Version => write!(f, "the table's layout is not version {FORMAT_VERSION}"),
            Self::SampleRate => f.write_str("the sample rate is not positive and finite"),
            Self::Latch => f.write_str("the latch delay is negative or not finite"),
            Self::BoardRate => f.write_str("the sample rate is higher than the board can run"),
            Self::BoardLatch => {
                f.write_str("the board cannot latch its outputs at that time after a sample")
            }
            Self::BoardInputs => {
                f.write_str("the board has no inputs for both accelerometers and force sensors")
            }
            Self::BoardCodes => {
                f.write_str("the table is for converters with other code ranges than the board's")
            }
            Self::Encoding => f.write_str("the bytes are not a table"),
            Self::Checksum => f.write_str("the table does not match its checksum"),
            Self::Sensor(i) => {
                write!(
                    f,
                    "sensor channel {i}: calibration not finite, or its gain is zero"
                )
            }
            Self::ForceSensor(i) => {
                write!(
                    f,
                    "force sensor channel {i}: calibration not finite, or its gain is zero"
                )
            }
            Self::Complement => f.write_str("force sensors can be added to accelerometers only"),
            Self::AdcRange => f.write_str("the ADC's highest code is not positive"),
            Self::Shaping => f.write_str("AC coupling, roll-off or split is outside its range"),
            Self::Sections => write!(f, "a channel has more than {SECTIONS} sections"),
            Self::Section(i) => write!(f, "channel {i} has an unstable section"),
            Self::Gain(i) => write!(f, "gain row {i} is not finite"),
            Self::Integral => f.write_str("leak or anti-windup is outside 0 to 1"),
            Self::Supervision => {
                f.write_str("a threshold or time of the supervisor is outside its range")
            }
            Self::SelfTest => f.write_str("a number of the self-test is outside its range"),
            Self::Actuator(i) => write!(
                f,
                "actuator channel {i}: not finite, zero gain, or a force limit outside the \
                 DAC's range"
            ),
        }
    }
}

impl core::error::Error for TableError {}
