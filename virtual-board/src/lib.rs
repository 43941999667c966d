//! The reference board (`docs/board.md`) in software: its processor, an STM32H743ZI, and its
//! converters, running the image that is flashed.
//!
//! | module | what is in it |
//! |---|---|
//! | [`time`] | virtual time, and what instructions cost |
//! | [`wires`] | levels on pins, and their histories |
//! | [`memory`] | memories |
//! | [`image`] | the image and its symbols |
//! | [`chips`] | the converters |
//! | [`peripherals`] | the processor's peripherals, a file each |
//! | [`gate`] | sampling waits for a simulated plant |
//! | [`counts`] | counters of the sample interrupt |
//! | [`bus`] | all of these together |
//! | [`idle`] | skipping passes in which nothing happens |
//! | [`machine`] | the core |
//! | [`board`] | a board to run, disturb and look at |
//! | [`serve`] | its converters and link over sockets |

pub mod board;
pub mod bus;
pub mod chips;
pub mod counts;
pub mod gate;
pub mod idle;
pub mod image;
pub mod machine;
pub mod memory;
pub mod peripherals;
pub mod serve;
pub mod time;
pub mod wires;
