//! How long a sample takes on the reference board: from the data sheets' figures, the
//! buses' clocks and the controller's instructions. `docs/board.md` says it in words.

use shared::codes::{AdcCode, DacCode};
use shared::table::Limits;

use crate::converters::{ad5676r, ad7606};

/// Of the core, Hz.
pub const CORE: f64 = 480e6;

/// The ADC's bus, Hz.
pub const ADC_CLOCK: f64 = 14e6;

/// The DAC's bus, Hz.
pub const DAC_CLOCK: f64 = 28e6;

/// From CONVST to the interrupt, s: the longest conversion and a little.
pub const READ: f64 = 4.5e-6;

/// From interrupt to handler, s: twelve cycles, and as many for what is under way.
const ENTRY: f64 = 24.0 / CORE;

/// Of a frame on a bus, beside its bits: select, queue, status, over a bridge to
/// registers at a quarter of the core's clock. Some fifteen accesses of ten cycles.
const FRAME: f64 = 150.0 / CORE;

/// Core cycles for an instruction: a Cortex-M7 with code and data in its tightly coupled
/// memories issues up to two; waiting for the floating-point unit takes most of that
/// away. The board measures it.
const CYCLES: f64 = 1.0;

/// From the last code written to LDAC, s. The data sheet wants less.
pub const SETUP: f32 = 1.5e-6;

/// What a sample takes, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Reading six channels.
    pub read: f64,
    /// The controller.
    pub compute: f64,
    /// Writing six channels.
    pub write: f64,
}

impl Budget {
    /// With so many instructions for the controller.
    pub fn new(instructions: f64) -> Self {
        let bits = |bytes: usize| 8.0 * bytes as f64;
        Self {
            read: ENTRY + FRAME + bits(ad7606::FRAME) / ADC_CLOCK,
            compute: instructions * CYCLES / CORE,
            write: 6.0 * (FRAME + bits(ad5676r::FRAME) / DAC_CLOCK),
        }
    }

    /// The processor is busy with it so long.
    pub fn busy(&self) -> f64 {
        self.read + self.compute + self.write
    }

    /// From the sample until its codes can be latched.
    pub fn ready(&self) -> f64 {
        READ + self.busy() + f64::from(SETUP)
    }
}

/// What tables the reference board can run.
pub const LIMITS: Limits = Limits {
    rate: 50e3,
    written: (11e-6, 27e-6),
    beside: false,
    codes: (AdcCode(i16::MAX), DacCode(u16::MAX)),
};
