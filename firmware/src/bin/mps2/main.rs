//! The controller of the metrology frame, or of the machine whose table the build
//! names, on the emulated MPS2 board (AN386 or AN500).
#![no_std]
#![no_main]

#[path = "board.rs"]
mod board;

use cortex_m_rt::entry;
use firmware::tables;

#[entry]
fn main() -> ! {
    board::run(tables::compiled(&tables::METROLOGY_FRAME))
}
