//! How long a sample takes on the reference board: from the data sheets' figures, the
//! buses' clocks and the controller's instructions. `docs/board.md` says it in words.

use shared::LEGS;
use shared::codes::{AdcCode, DacCode};
use shared::table::Limits;

use crate::converters::{ad5676r, ad7606};

/// Of the core, Hz.
pub const CORE: f64 = 480e6;

/// The ADC's buses, Hz.
pub const ADC_CLOCK: f64 = 14.25e6;

/// The DAC's bus, Hz.
pub const DAC_CLOCK: f64 = 45.6e6;

/// From CONVST to the begin of the ADC's frame, s: the longest conversion and a little.
pub const BEGIN: f64 = 4.3e-6;

/// From CONVST to the interrupt, s: so early that the handler is ready when the ADC's frame ends.
pub const DUE: f64 = 7e-6;

/// Bits by which a select line leads the clock: 22 ns for the DAC, 70 ns for the ADC.
pub const LEAD: u32 = 1;

/// Bits between two frames of the DAC, with SYNC high for two of them at least: 44 ns. Other
/// converters of its family want 20 to 30 ns.
pub const PAUSE: u32 = 3;

/// From interrupt to handler, s: twelve cycles, and as many for what is under way.
const ENTRY: f64 = 24.0 / CORE;

/// Accesses to registers of a sample, as counted on the virtual board (its scene `accesses`):
/// until the ADC's frame is waited for, from its end until all codes are read, until the DAC's
/// frames are begun, and after that.
pub const ACCESSES: [u32; 4] = [10, 8, 4, 6];

/// Instructions of the handler beside the controller's, in the same order.
const OWN: [u32; 4] = [106, 26, 142, 60];

/// Core cycles for an access to a register of the buses: two bridges and registers at a quarter
/// of the core's clock. The board measures it.
const ACCESS: f64 = 20.0;

/// Core cycles for an instruction: a Cortex-M7 with code and data in its tightly coupled
/// memories issues up to two; waiting for the floating-point unit takes most of that
/// away. The board measures it.
const CYCLES: f64 = 1.0;

/// From the end of the last of the DAC's frames to LDAC, s. The data sheet wants some tens of
/// nanoseconds.
pub const SETUP: f64 = 0.2e-6;

/// The frames of the DAC, s, from their begin to the end of the last.
pub const WRITE: f64 = LEGS as f64 * (8 * ad5676r::FRAME as u32 + LEAD + PAUSE) as f64 / DAC_CLOCK;

/// What a sample takes, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// The ADC's frame, from its begin.
    pub read: f64,
    /// From the end of the ADC's frame to the codes.
    pub fetch: f64,
    /// The first half of the controller: from codes to codes.
    pub latch: f64,
    /// From the codes to the begin of the DAC's frames.
    pub begin: f64,
    /// The DAC's frames, for which nobody waits.
    pub write: f64,
    /// The second half of the controller.
    pub follow: f64,
}

impl Budget {
    /// With so many instructions for a whole sample, and of these for its first half.
    pub fn new(sample: f64, latch: f64) -> Self {
        let own = |part: usize| {
            (f64::from(ACCESSES[part]) * ACCESS + f64::from(OWN[part]) * CYCLES) / CORE
        };
        // The DMA makes one access to begin it.
        let frame = ACCESS / CORE + (ad7606::BITS as f64 + f64::from(LEAD)) / ADC_CLOCK;
        // If the frame ends before the handler is ready, it waits.
        let ready = DUE - BEGIN + ENTRY + own(0);
        Self {
            read: frame.max(ready),
            fetch: own(1),
            latch: latch * CYCLES / CORE,
            begin: own(2),
            write: WRITE,
            follow: (sample - latch) * CYCLES / CORE + own(3),
        }
    }

    /// The processor is busy with it so long.
    pub fn busy(&self) -> f64 {
        BEGIN + self.read - DUE + self.fetch + self.latch + self.begin + self.follow
    }

    /// From the sample until its codes can be latched.
    pub fn ready(&self) -> f64 {
        BEGIN + self.read + self.fetch + self.latch + self.begin + self.write + SETUP
    }
}

/// Time before a sample's interrupt in which nothing begins that masks interrupts, s: longer
/// than each of the firmware's critical sections. The longest takes 7.3 µs on the virtual board, at
/// one cycle for an instruction and 20 for an access (its scene `critical_sections_are_short`).
pub const GUARD: f32 = 11e-6;

/// What tables the reference board can run.
pub const LIMITS: Limits = Limits {
    rate: 50e3,
    written: (7.5e-6, 14.5e-6),
    beside: false,
    codes: (AdcCode(i16::MAX), DacCode(u16::MAX)),
};
