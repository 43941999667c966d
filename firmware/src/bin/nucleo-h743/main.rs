//! The controller on the reference board of `docs/board.md`: NUCLEO-H743ZI2, AD7606,
//! AD5676R.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod clocks;
#[cfg(target_os = "none")]
mod dma;
#[cfg(target_os = "none")]
mod flash;
#[cfg(target_os = "none")]
mod guard;
#[cfg(target_os = "none")]
mod period;
#[cfg(target_os = "none")]
mod port;
#[cfg(target_os = "none")]
mod sample;
#[cfg(target_os = "none")]
mod shadow;
#[cfg(target_os = "none")]
mod spi;

#[cfg(target_os = "none")]
#[cortex_m_rt::entry]
fn main() -> ! {
    board::run()
}

#[cfg(not(target_os = "none"))]
fn main() {
    println!("this is the board's image; cd firmware && cargo run, or cargo xtask flash");
}
