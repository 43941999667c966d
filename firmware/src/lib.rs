//! The parts of the firmware that do not depend on a board, which are tested on the host.
//! Each binary is a board.
#![no_std]
#![forbid(unsafe_code)]

pub mod budget;
pub mod converters;
pub mod exchange;
pub mod link_task;
pub mod loop_task;
pub mod ram_flash;
pub mod store;
pub mod tables;
