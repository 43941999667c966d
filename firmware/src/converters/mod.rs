//! The reference board's converters: encoding and decoding of what is on their buses, which need
//! no hardware, and what the DAC needs on an embedded-hal bus when it starts.

pub mod ad5676r;
pub mod ad7606;
