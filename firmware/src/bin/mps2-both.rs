//! The same board with both kinds of sensors.
#![no_std]
#![no_main]

#[path = "mps2/board.rs"]
mod board;

use cortex_m_rt::entry;
use firmware::tables::both_sensors;

#[entry]
fn main() -> ! {
    board::run(&both_sensors::TABLE)
}
