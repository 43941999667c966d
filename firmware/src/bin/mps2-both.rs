//! The controller of the machine with accelerometers and force sensors, on the emulated MPS2
//! board.
#![no_std]
#![no_main]

#[path = "mps2/board.rs"]
mod board;

use cortex_m_rt::entry;
use firmware::tables;

#[entry]
fn main() -> ! {
    board::run(&tables::BOTH_SENSORS)
}
