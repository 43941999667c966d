//! The SPI of the loop: frames of up to sixteen bytes, polled, with little overhead
//! (STM32H742, H743 reference manual RM0433, chapter 50).

use cortex_m::peripheral::DWT;
use embassy_stm32::gpio::Output;
use embassy_stm32::pac::spi::{Spi as Registers, vals};
use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};

use crate::clocks::{CORE, KERNEL};

/// Size of the peripheral's FIFO and so the largest frame, bytes.
const QUEUE: usize = 16;

/// A frame that takes this many times as long as its bits has failed.
const PATIENCE: u32 = 3;

/// A device on an SPI bus, with its own select line.
pub struct Spi {
    registers: Registers,
    select: Output<'static>,
    /// Core cycles per bit.
    bit: u32,
}

impl Spi {
    /// Sets mode 2 (SCLK idles high, sampled on the falling edge) and the kernel clock divided
    /// by `divider`. The pins and the clock of the peripheral must be on.
    pub fn new(registers: Registers, select: Output<'static>, divider: vals::Mbr) -> Self {
        registers.cr1().write(|w| w.set_ssi(true));
        registers.cfg1().write(|w| {
            w.set_dsize(7);
            w.set_mbr(divider);
        });
        registers.cfg2().write(|w| {
            w.set_master(vals::Master::MASTER);
            w.set_cpol(vals::Cpol::IDLE_HIGH);
            w.set_cpha(vals::Cpha::FIRST_EDGE);
            w.set_ssm(true);
            // The pins keep their level between frames.
            w.set_afcntr(true);
        });
        Self {
            registers,
            select,
            bit: bit(divider),
        }
    }

    /// Changes the divider of the clock.
    pub fn set_divider(&mut self, divider: vals::Mbr) {
        self.registers.cfg1().modify(|w| w.set_mbr(divider));
        self.bit = bit(divider);
    }

    /// Sends `bytes` and replaces them with the received ones.
    fn exchange(&mut self, bytes: &mut [u8]) -> Result<(), ErrorKind> {
        let r = self.registers;
        if bytes.is_empty() || bytes.len() > QUEUE {
            return Err(ErrorKind::Other);
        }
        r.cr2().write(|w| w.set_tsize(bytes.len() as u16));
        r.cr1().modify(|w| w.set_spe(true));
        if self.bit > SLOW {
            // At a slow clock, SCLK reaches its idle level late after SPE.
            cortex_m::asm::delay(self.bit);
        }
        for byte in &*bytes {
            r.txdr8().write_value(*byte);
        }
        r.cr1().modify(|w| w.set_cstart(true));
        let start = DWT::cycle_count();
        // The frame's length is checked above.
        let longest = PATIENCE * 8 * bytes.len() as u32 * self.bit;
        let ended = loop {
            // In this order: a frame that has ended is never late.
            let late = DWT::cycle_count().wrapping_sub(start) > longest;
            if r.sr().read().eot() {
                break true;
            }
            if late {
                break false;
            }
        };
        if ended {
            for byte in bytes {
                *byte = r.rxdr8().read();
            }
        }
        let status = r.sr().read();
        r.ifcr().write(|w| {
            w.set_eotc(true);
            w.set_txtfc(true);
            w.set_ovrc(true);
            w.set_modfc(true);
        });
        r.cr1().modify(|w| w.set_spe(false));
        if ended && !status.ovr() && !status.modf() {
            Ok(())
        } else {
            Err(ErrorKind::Other)
        }
    }
}

/// Core cycles per bit above which a frame begins with a pause of one bit.
const SLOW: u32 = CORE / 10_000_000;

/// Core cycles per bit at this divider of the kernel clock.
fn bit(divider: vals::Mbr) -> u32 {
    // The fields of MBR are powers of two: 0 is 2, 7 is 256.
    CORE.div_ceil(KERNEL) * (2 << divider.to_bits())
}

impl ErrorType for Spi {
    type Error = ErrorKind;
}

impl SpiDevice for Spi {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        self.select.set_low();
        let mut outcome = Ok(());
        for operation in operations {
            outcome = outcome.and(match operation {
                Operation::Read(bytes) | Operation::TransferInPlace(bytes) => self.exchange(bytes),
                Operation::Write(bytes) => {
                    let mut queue = [0; QUEUE];
                    match queue.get_mut(..bytes.len()) {
                        Some(copy) => {
                            copy.copy_from_slice(bytes);
                            self.exchange(copy)
                        }
                        None => Err(ErrorKind::Other),
                    }
                }
                // The drivers of the converters use neither.
                Operation::Transfer(..) | Operation::DelayNs(_) => Err(ErrorKind::Other),
            });
        }
        self.select.set_high();
        outcome
    }
}
