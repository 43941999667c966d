//! The converters, as chips on their wires.

pub mod ad5676r;
pub mod ad7606;
