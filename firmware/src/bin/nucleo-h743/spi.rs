//! The converters' buses, polled, with few accesses to registers: a [`Receiver`] for the ADC, a
//! [`Transmitter`] for the DAC (STM32H742, H743 reference manual RM0433, chapter 50).
//!
//! Both use mode 2: SCLK idles high, data is valid on its falling edges.

use cortex_m::peripheral::DWT;
use embassy_stm32::gpio::Output;
use embassy_stm32::pac::spi::Spi as Registers;
use embassy_stm32::pac::spi::regs::Cfg2;
use embassy_stm32::pac::spi::vals::{Comm, Cpha, Cpol, Master, Mbr};
use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};
use firmware::converters::{ad5676r, ad7606};

use crate::clocks::{CORE, KERNEL};

/// Words in the ADC's frame.
const WORDS: usize = ad7606::FRAME / 4;

/// A frame that takes this many times as long as its bits has failed.
const PATIENCE: u32 = 3;

/// Core cycles per bit at this divider of the kernel clock.
fn bit(divider: Mbr) -> u32 {
    // The fields of MBR are powers of two: 0 is 2, 7 is 256.
    CORE.div_ceil(KERNEL) * (2 << divider.to_bits())
}

/// Master in mode 2 in these directions, the select line set by software.
fn configuration(directions: Comm) -> Cfg2 {
    let mut w = Cfg2::default();
    w.set_master(Master::MASTER);
    w.set_comm(directions);
    w.set_cpol(Cpol::IDLE_HIGH);
    w.set_cpha(Cpha::FIRST_EDGE);
    w.set_ssm(true);
    // The pins keep their level between frames.
    w.set_afcntr(true);
    w
}

/// Waits until `done`, at most until `longest` core cycles after `start`.
fn wait(start: u32, longest: u32, done: impl Fn() -> bool) -> Result<(), ErrorKind> {
    loop {
        // In this order: what is done is never late.
        let late = DWT::cycle_count().wrapping_sub(start) > longest;
        if done() {
            return Ok(());
        }
        if late {
            return Err(ErrorKind::Other);
        }
    }
}

/// A bus that only reads frames of [`ad7606::FRAME`] bytes, in words of 32 bits.
pub struct Receiver {
    registers: Registers,
    select: Output<'static>,
    /// The longest time of a frame, core cycles.
    longest: u32,
}

impl Receiver {
    /// The kernel clock is divided by `divider`. The pins and the clock of the peripheral must
    /// be on.
    pub fn new(registers: Registers, select: Output<'static>, divider: Mbr) -> Self {
        registers.cr1().write(|w| w.set_ssi(true));
        registers.cfg1().write(|w| {
            w.set_dsize(31);
            w.set_mbr(divider);
        });
        registers.cfg2().write_value(configuration(Comm::RECEIVER));
        registers.cr2().write(|w| w.set_tsize(WORDS as u16));
        Self {
            registers,
            select,
            longest: PATIENCE * 32 * WORDS as u32 * bit(divider),
        }
    }

    fn read(&mut self, bytes: &mut [u8; ad7606::FRAME]) -> Result<(), ErrorKind> {
        let r = self.registers;
        let enabled = |start| {
            r.cr1().write(|w| {
                w.set_ssi(true);
                w.set_spe(true);
                w.set_cstart(start);
            });
        };
        enabled(false);
        enabled(true);
        let ended = wait(DWT::cycle_count(), self.longest, || r.sr().read().eot());
        if ended.is_ok() {
            for word in bytes.as_chunks_mut().0 {
                *word = r.rxdr32().read().to_be_bytes();
            }
        }
        r.ifcr().write(|w| {
            w.set_eotc(true);
            w.set_txtfc(true);
            w.set_ovrc(true);
            w.set_modfc(true);
        });
        r.cr1().write(|w| w.set_ssi(true));
        ended
    }
}

impl ErrorType for Receiver {
    type Error = ErrorKind;
}

impl SpiDevice for Receiver {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        // The driver of the ADC uses no other.
        let [Operation::Read(bytes)] = operations else {
            return Err(ErrorKind::Other);
        };
        let Ok(bytes) = <&mut [u8; ad7606::FRAME]>::try_from(&mut **bytes) else {
            return Err(ErrorKind::Other);
        };
        self.select.set_low();
        let outcome = self.read(bytes);
        self.select.set_high();
        outcome
    }
}

/// A bus that writes frames of [`ad5676r::FRAME`] bytes, each as one word, in a transfer without
/// end; and reads such frames, at leisure.
pub struct Transmitter {
    registers: Registers,
    select: Output<'static>,
    /// Core cycles per bit.
    bit: u32,
}

/// Bits in the DAC's frame.
const BITS: u32 = 8 * ad5676r::FRAME as u32;

/// Bits after which TXC has certainly fallen; less than half a frame.
const FALLEN: u32 = 8;

/// Core cycles per bit above which a frame that is read begins with a pause of one bit: at a
/// slow clock, SCLK reaches its idle level late after SPE.
const SLOW: u32 = CORE / 10_000_000;

impl Transmitter {
    /// The kernel clock is divided by `divider`. The pins and the clock of the peripheral must
    /// be on.
    pub fn new(registers: Registers, select: Output<'static>, divider: Mbr) -> Self {
        let mut bus = Self {
            registers,
            select,
            bit: bit(divider),
        };
        bus.set_divider(divider);
        bus
    }

    /// Changes the divider of the clock.
    pub fn set_divider(&mut self, divider: Mbr) {
        self.stop();
        self.registers.cfg1().write(|w| {
            w.set_dsize(BITS as u8 - 1);
            w.set_mbr(divider);
        });
        self.bit = bit(divider);
        self.restart();
    }

    fn stop(&self) {
        self.registers.cr1().write(|w| w.set_ssi(true));
    }

    /// Enables the bus for this number of frames; 0 is no end.
    fn start(&self, directions: Comm, frames: u16) {
        self.registers.cfg2().write_value(configuration(directions));
        self.registers.cr2().write(|w| w.set_tsize(frames));
        self.registers.cr1().write(|w| {
            w.set_ssi(true);
            w.set_spe(true);
        });
    }

    /// Sends one frame.
    fn send(&mut self, word: u32) -> Result<(), ErrorKind> {
        let r = self.registers;
        self.select.set_low();
        r.txdr32().write_value(word);
        let start = DWT::cycle_count();
        // TXC falls some cycles of the kernel clock after the word was written, and rises with
        // its end: until then it says nothing. The delay may take half of its cycles.
        cortex_m::asm::delay(2 * FALLEN * self.bit);
        let outcome = wait(start, PATIENCE * BITS * self.bit, || r.sr().read().txc());
        self.select.set_high();
        if outcome.is_err() {
            // Empties the queue.
            self.restart();
        }
        outcome
    }

    /// Back to transfers without end.
    fn restart(&self) {
        self.stop();
        self.start(Comm::TRANSMITTER, 0);
        self.registers.cr1().modify(|w| w.set_cstart(true));
    }

    /// Sends one frame and returns what came back.
    fn exchange(&mut self, word: u32) -> Result<u32, ErrorKind> {
        let r = self.registers;
        self.stop();
        self.start(Comm::FULL_DUPLEX, 1);
        if self.bit > SLOW {
            cortex_m::asm::delay(self.bit);
        }
        self.select.set_low();
        r.txdr32().write_value(word);
        r.cr1().modify(|w| w.set_cstart(true));
        let longest = PATIENCE * BITS * self.bit;
        let ended = wait(DWT::cycle_count(), longest, || r.sr().read().eot());
        let found = ended.map(|()| r.rxdr32().read());
        r.ifcr().write(|w| {
            w.set_eotc(true);
            w.set_txtfc(true);
            w.set_ovrc(true);
            w.set_modfc(true);
        });
        self.select.set_high();
        self.restart();
        found
    }
}

impl ErrorType for Transmitter {
    type Error = ErrorKind;
}

/// A frame as the word that is sent from its highest bit.
fn word([a, b, c]: [u8; ad5676r::FRAME]) -> u32 {
    u32::from_be_bytes([0, a, b, c])
}

impl SpiDevice for Transmitter {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        // The driver of the DAC uses no other.
        match operations {
            [Operation::Write(bytes)] => match <[u8; ad5676r::FRAME]>::try_from(*bytes) {
                Ok(frame) => self.send(word(frame)),
                Err(_) => Err(ErrorKind::Other),
            },
            [Operation::TransferInPlace(bytes)] => {
                let Ok(frame) = <&mut [u8; ad5676r::FRAME]>::try_from(&mut **bytes) else {
                    return Err(ErrorKind::Other);
                };
                let [_, a, b, c] = self.exchange(word(*frame))?.to_be_bytes();
                *frame = [a, b, c];
                Ok(())
            }
            _ => Err(ErrorKind::Other),
        }
    }
}
