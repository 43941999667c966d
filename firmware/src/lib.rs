//! The parts of the firmware that do not depend on a board, which are tested on the host.
//! Each binary is a board.
//!
//! Each module imports only from modules above it in this table:
//!
//! | module | what is in it |
//! |---|---|
//! | [`converters`] | drivers of the reference board's converters |
//! | [`budget`] | the time that a sample takes on the reference board |
//! | [`exchange`] | samples over a serial line, in place of converters |
//! | [`tables`] | generated controller tables |
//! | [`loop_task`] | the controller, shared by loop and link |
//! | [`ram_flash`] | RAM that behaves like flash |
//! | [`store`] | non-volatile memory for a table that came over the link |
//! | [`link_task`] | frames in, frames out, and work that can wait |
#![no_std]
#![forbid(unsafe_code)]

// In the order of the table above; `tests/rooms.rs` checks it.
pub mod converters;
pub mod budget;
pub mod exchange;
pub mod tables;
pub mod loop_task;
pub mod ram_flash;
pub mod store;
pub mod link_task;
