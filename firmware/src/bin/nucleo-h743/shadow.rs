//! Critical sections that the loop never waits for.
//!
//! A critical section masks every interrupt, so one that is still held when the sample's
//! interrupt is due delays the loop. Below the loop's priority, a critical section therefore
//! begins only if the interrupt is at least [`GUARD`](firmware::budget::GUARD) away, else after the sample. Every one of
//! the image is shorter than that: requests of the link, the copy of the table once a second,
//! reading an output back, one word of flash, a line of the log. A scene of the virtual
//! board measures the longest: reading an output back.

use core::arch::asm;

use cortex_m::interrupt;
use cortex_m::register::primask;
use critical_section::RawRestoreState;

use crate::period;

struct Shadow;

critical_section::set_impl!(Shadow);

// SAFETY: interrupts are masked from acquire to release, on a processor with one core.
unsafe impl critical_section::Impl for Shadow {
    unsafe fn acquire() -> RawRestoreState {
        let enabled = primask::read().is_active();
        loop {
            interrupt::disable();
            if !enabled || in_handler() || period::is_far() {
                return enabled;
            }
            // SAFETY: they were enabled when this began. Here the sample's interrupt is taken.
            unsafe { interrupt::enable() };
        }
    }

    unsafe fn release(enabled: RawRestoreState) {
        if enabled {
            // SAFETY: they were enabled when the critical section began.
            unsafe { interrupt::enable() };
        }
    }
}

/// Whether an exception or an interrupt is being handled.
pub fn in_handler() -> bool {
    let ipsr: u32;
    // SAFETY: reads a register and has no other effect.
    unsafe { asm!("mrs {}, IPSR", out(reg) ipsr, options(nomem, nostack, preserves_flags)) };
    ipsr & 0x1FF != 0
}
