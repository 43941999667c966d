//! What a board can run.

use super::{TableError, ValidTable};
use crate::codes::{AdcCode, DacCode};

/// The tables that a board can run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Highest sample rate, Hz.
    pub rate: f32,
    /// Earliest time after a sample at which the first of its codes is written to the
    /// DAC, s, and time at which all of them can be latched, s.
    pub written: (f32, f32),
    /// Whether the board has inputs for six force sensors besides those for six
    /// accelerometers.
    pub beside: bool,
    /// Highest codes of the converters.
    pub codes: (AdcCode, DacCode),
}

impl Limits {
    /// A board with 16-bit converters and no other limits: the simulation.
    pub const NONE: Self = Self {
        rate: f32::MAX,
        written: (f32::MAX, 0.0),
        beside: true,
        codes: (AdcCode(i16::MAX), DacCode(u16::MAX)),
    };

    /// Checks that the board can run `table`.
    ///
    /// # Errors
    /// The first limit that the table exceeds.
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
