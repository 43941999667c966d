//! UART 0 of the MPS2 board, Arm's CMSDK APB UART (Cortex-M System Design Kit
//! technical reference manual, section 4.3), polled.

const BASE: usize = 0x4000_4000;
const DATA: usize = 0x00;
const STATE: usize = 0x04;
const CONTROL: usize = 0x08;
const BAUD_DIVISOR: usize = 0x10;

const TRANSMIT_FULL: u32 = 1 << 0;
const RECEIVE_FULL: u32 = 1 << 1;
const ENABLE_BOTH: u32 = 0b11;
/// The smallest the hardware accepts.
const FASTEST: u32 = 16;

/// The only handle to UART 0.
pub struct Uart(());

impl Uart {
    /// Switches the UART on. Call once.
    pub fn take() -> Self {
        let uart = Self(());
        uart.set(BAUD_DIVISOR, FASTEST);
        uart.set(CONTROL, ENABLE_BOTH);
        uart
    }

    /// Waits for as many bytes as `bytes` holds.
    pub fn read(&mut self, bytes: &mut [u8]) {
        for byte in bytes {
            while self.get(STATE) & RECEIVE_FULL == 0 {}
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
