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

/// Bits until the end of a frame on the DAC's bus is seen.
const WAIT: f64 = 1.0;

/// Accesses to registers that a frame of the ADC costs beside its bits, and one of the DAC: as
/// counted on the virtual board, whose scenes fail if they become others. Waiting for the end of a
/// frame is not among them.
pub const ACCESSES: [u32; 2] = [11, 4];

/// Core cycles for an access to a register of the converters' buses: two bridges and registers
/// at a quarter of the core's clock. The board measures it.
const ACCESS: f64 = 20.0;

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
    /// The first half of the controller: from codes to codes.
    pub latch: f64,
    /// Writing six channels.
    pub write: f64,
    /// The second half of the controller.
    pub follow: f64,
}

impl Budget {
    /// With so many instructions for a whole sample, and of these for its first half.
    pub fn new(sample: f64, latch: f64) -> Self {
        let bits = |bytes: usize| 8.0 * bytes as f64;
        let [read, write] = ACCESSES.map(|accesses| f64::from(accesses) * ACCESS / CORE);
        Self {
            read: ENTRY + read + bits(ad7606::FRAME) / ADC_CLOCK,
            latch: latch * CYCLES / CORE,
            write: 6.0 * (write + (bits(ad5676r::FRAME) + WAIT) / DAC_CLOCK),
            follow: (sample - latch) * CYCLES / CORE,
        }
    }

    /// The processor is busy with it so long.
    pub fn busy(&self) -> f64 {
        self.read + self.latch + self.write + self.follow
    }

    /// From the sample until its codes can be latched.
    pub fn ready(&self) -> f64 {
        READ + self.read + self.latch + self.write + f64::from(SETUP)
    }
}

/// Time before a sample's interrupt in which nothing begins that masks interrupts, s: longer
/// than each of the firmware's critical sections. The longest, reading an output of the DAC back,
/// takes 11.4 µs on the virtual board.
pub const GUARD: f32 = 12e-6;

/// What tables the reference board can run. At a higher rate, no time would be left between the
/// end of a sample and [`GUARD`]: the longest sample ends 23.2 µs after its interrupt on the virtual
/// board, which counts what [`Budget`] leaves out.
pub const LIMITS: Limits = Limits {
    rate: 27e3,
    written: (11e-6, 27e-6),
    beside: false,
    codes: (AdcCode(i16::MAX), DacCode(u16::MAX)),
};
