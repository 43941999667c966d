//! The end of an image on the emulated board.

use core::panic::PanicInfo;

use cortex_m_semihosting::debug::{EXIT_FAILURE, EXIT_SUCCESS, ExitStatus, exit};
use cortex_m_semihosting::hprintln;

/// Ends the emulation with success.
#[allow(dead_code, reason = "only the bench ends")]
pub fn done() -> ! {
    stop(EXIT_SUCCESS)
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    hprintln!("{}", info);
    stop(EXIT_FAILURE)
}

fn stop(status: ExitStatus) -> ! {
    exit(status);
    loop {
        cortex_m::asm::wfi();
    }
}
