//! Drivers of the reference board's converters, on embedded-hal traits. Encoding and decoding
//! of the bytes on the bus are separate functions that need no hardware.

pub mod ad5676r;
pub mod ad7606;
