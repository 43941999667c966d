//! Drivers of the reference board's converters, over embedded-hal traits. What goes
//! over the wire is in functions of its own, without any hardware.

pub mod ad5676r;
pub mod ad7606;
