//! UART 0 of the MPS2 board, Arm's CMSDK APB UART (Cortex-M System Design Kit
//! technical reference manual, section 4.3).

use cortex_m::asm;
use cortex_m::interrupt::{self, InterruptNumber};
use cortex_m::peripheral::NVIC;

const BASE: usize = 0x4000_4000;
const DATA: usize = 0x00;
const STATE: usize = 0x04;
const CONTROL: usize = 0x08;
const INTERRUPT: usize = 0x0C;
const BAUD_DIVISOR: usize = 0x10;

const TRANSMIT_FULL: u32 = 1 << 0;
const RECEIVE_FULL: u32 = 1 << 1;
/// In [`INTERRUPT`]; written to clear it.
const RECEIVED: u32 = 1 << 1;
/// Transmitter, receiver, and the receiver's interrupt.
const ENABLE: u32 = 0b1011;
/// The smallest the hardware accepts.
const FASTEST: u32 = 16;

/// The receiver's interrupt.
#[derive(Clone, Copy)]
struct ReceiveInterrupt;

// SAFETY: number 0 is UART 0's receiver on both boards (Arm application notes
// 386 and 500, interrupt assignments), within the NVIC's range.
unsafe impl InterruptNumber for ReceiveInterrupt {
    fn number(self) -> u16 {
        0
    }
}

/// The only handle to UART 0.
pub struct Uart(());

impl Uart {
    /// Switches the UART on. Call once.
    ///
    /// Interrupts are masked from here on: a received byte wakes the processor
    /// from its sleep and no handler runs.
    pub fn take() -> Self {
        interrupt::disable();
        let uart = Self(());
        uart.set(BAUD_DIVISOR, FASTEST);
        uart.set(CONTROL, ENABLE);
        // SAFETY: there is no handler that the mask would protect anything
        // from, and PRIMASK is set.
        unsafe { NVIC::unmask(ReceiveInterrupt) };
        uart
    }

    /// Waits for as many bytes as `bytes` holds.
    pub fn read(&mut self, bytes: &mut [u8]) {
        for byte in bytes {
            // Asleep, not polling: the emulator then has the host's core for
            // the line.
            while self.get(STATE) & RECEIVE_FULL == 0 {
                asm::wfi();
                self.set(INTERRUPT, RECEIVED);
                NVIC::unpend(ReceiveInterrupt);
            }
            // The register holds one byte.
            *byte = self.get(DATA) as u8;
        }
    }

    /// Sends all of `bytes`.
    pub fn write(&mut self, bytes: &[u8]) {
        for byte in bytes {
            while self.get(STATE) & TRANSMIT_FULL != 0 {}
            self.set(DATA, u32::from(*byte));
        }
    }

    fn get(&self, register: usize) -> u32 {
        // SAFETY: an aligned register of a peripheral that both emulated
        // boards have at this address; `self` is its only user.
        unsafe { core::ptr::with_exposed_provenance::<u32>(BASE + register).read_volatile() }
    }

    fn set(&self, register: usize, value: u32) {
        // SAFETY: as in `get`.
        unsafe {
            core::ptr::with_exposed_provenance_mut::<u32>(BASE + register).write_volatile(value);
        }
    }
}
