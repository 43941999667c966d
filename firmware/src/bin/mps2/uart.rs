//! UARTs 0 and 1 of the MPS2 board, Arm's CMSDK APB UART (Cortex-M System Design
//! Kit technical reference manual, section 4.3).

use cortex_m::interrupt::InterruptNumber;

const DATA: usize = 0x00;
const STATE: usize = 0x04;
const CONTROL: usize = 0x08;
const INTERRUPT: usize = 0x0C;
const BAUD_DIVISOR: usize = 0x10;

const TRANSMIT_FULL: u32 = 1 << 0;
const RECEIVE_FULL: u32 = 1 << 1;
/// In [`INTERRUPT`]; written to clear the interrupt.
const RECEIVED: u32 = 1 << 1;
/// Enables the transmitter, the receiver and the receiver's interrupt.
const ENABLE: u32 = 0b1011;
/// Smallest baud divisor that the hardware accepts.
const FASTEST: u32 = 16;

/// Number of a receiver's interrupt.
#[derive(Clone, Copy)]
pub struct ReceiveInterrupt(pub i16);

// SAFETY: the only values are 0 and 2 below, the receivers of UARTs 0 and 1 on both boards
// (Arm application notes 386 and 500, interrupt assignments), within the NVIC's range.
unsafe impl InterruptNumber for ReceiveInterrupt {
    fn number(self) -> u16 {
        self.0.cast_unsigned()
    }
}

/// A UART at its address.
#[derive(Clone, Copy)]
pub struct Uart {
    base: usize,
    /// Interrupt of the receiver.
    pub interrupt: ReceiveInterrupt,
}

/// The UART in place of the converters.
pub const CONVERTERS: Uart = Uart {
    base: 0x4000_4000,
    interrupt: ReceiveInterrupt(0),
};

/// The UART of the link.
pub const LINK: Uart = Uart {
    base: 0x4000_5000,
    interrupt: ReceiveInterrupt(2),
};

/// The transmitter of a UART.
pub struct Transmitter(Uart);

/// The receiver of a UART.
pub struct Receiver(Uart);

/// An open UART.
pub struct SerialPort {
    /// The transmitter.
    pub send: Transmitter,
    /// The receiver.
    pub receive: Receiver,
}

impl Uart {
    /// Switches the UART on. To be called once.
    pub fn open(self) -> SerialPort {
        self.set(BAUD_DIVISOR, FASTEST);
        self.set(CONTROL, ENABLE);
        SerialPort {
            send: Transmitter(self),
            receive: Receiver(self),
        }
    }

    fn get(self, register: usize) -> u32 {
        // SAFETY: an aligned register of a peripheral that both emulated boards have at this
        // address. Reading has one side effect, it removes a received byte, and only the
        // receiver reads the data register.
        unsafe { core::ptr::with_exposed_provenance::<u32>(self.base + register).read_volatile() }
    }

    fn set(self, register: usize, value: u32) {
        // SAFETY: as in `get`. Only the transmitter writes the data register, and only the
        // receiver the interrupt register.
        unsafe {
            core::ptr::with_exposed_provenance_mut::<u32>(self.base + register)
                .write_volatile(value);
        }
    }
}

impl SerialPort {
    /// Splits it into transmitter and receiver.
    pub fn split(self) -> (Transmitter, Receiver) {
        (self.send, self.receive)
    }
}

impl Transmitter {
    /// Sends all of `bytes`.
    pub fn write(&mut self, bytes: &[u8]) {
        for byte in bytes {
            while self.0.get(STATE) & TRANSMIT_FULL != 0 {}
            self.0.set(DATA, u32::from(*byte));
        }
    }
}

impl Receiver {
    /// The received byte, if there is one. Clears the interrupt.
    pub fn read(&mut self) -> Option<u8> {
        self.0.set(INTERRUPT, RECEIVED);
        // The register holds one byte.
        (self.0.get(STATE) & RECEIVE_FULL != 0).then(|| self.0.get(DATA) as u8)
    }
}
