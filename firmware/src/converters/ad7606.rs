//! AD7606, eight channels sampled at one instant, 16 bits, ±10 V, in serial mode.
//!
//! Pins set by hardware: PAR/SER high (serial), RANGE high (±10 V), OS0 to OS2 low
//! (no oversampling), STBY high. A rising edge on CONVST A and B, tied together,
//! samples all channels; BUSY is high until the results can be read. The data sheet
//! (rev. C) gives 3.45 to 4.15 µs for that.
//!
//! Serial: SCLK idles high, data is valid on its falling edges (SPI mode 2), each channel
//! from its highest bit down, two's complement. DOUTA begins with V1, DOUTB with V5, so 48
//! clocks give six channels: V1 to V3 on the one line, V5 to V7 on the other.

use shared::LEGS;
use shared::codes::AdcCode;

/// Channels read from each of the two data lines.
pub const LINE: usize = LEGS / 2;

/// Clocks of a frame.
pub const BITS: usize = 16 * LINE;

/// Longest conversion time, s (data sheet, t_CONV without oversampling).
pub const CONVERSION: f64 = 4.15e-6;

/// Highest clock frequency with VDRIVE at 3.3 V ± 10 %, Hz (data sheet, f_SCLK above 2.7 V).
pub const CLOCK: u32 = 14_500_000;

/// What was read from DOUTA and DOUTB.
pub type Lines = [[u16; LINE]; 2];

/// The codes of V1, V2, V3, V5, V6 and V7.
pub fn decode(lines: Lines) -> [AdcCode; LEGS] {
    let [[v1, v2, v3], [v5, v6, v7]] = lines;
    [v1, v2, v3, v5, v6, v7].map(|code| AdcCode(code.cast_signed()))
}
