//! The converters' buses (RM0433, chapter 50): a [`Receiver`] for the ADC, a [`Transmitter`] for
//! the DAC. Neither keeps the processor waiting, and both drive their select lines by hardware.
//!
//! Both use mode 2: SCLK idles high, data is valid on its falling edges.

use cortex_m::peripheral::DWT;
use embassy_stm32::gpio::Input;
use embassy_stm32::pac::spi::Spi as Registers;
use embassy_stm32::pac::spi::regs::{Cfg1, Cfg2, Cr1, Ifcr};
use embassy_stm32::pac::spi::vals::{Comm, Cpha, Cpol, Master, Mbr, Ssom};
use embassy_stm32::pac::{SPI3, SPI4, SPI5};
use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};
use firmware::budget::{LEAD, PAUSE};
use firmware::converters::ad5676r::FRAME;
use firmware::converters::ad7606::{self, Lines};
use shared::LEGS;

use crate::clocks::{CORE, DAC_KERNEL};
use crate::dma;

/// Mode 2, as master or slave, in these directions.
fn mode(master: Master, directions: Comm) -> Cfg2 {
    let mut w = Cfg2::default();
    w.set_master(master);
    w.set_comm(directions);
    w.set_cpol(Cpol::IDLE_HIGH);
    w.set_cpha(Cpha::FIRST_EDGE);
    // The pins keep their level between frames.
    w.set_afcntr(true);
    w
}

/// [`mode`] of a master that drives its select line.
fn selecting(directions: Comm) -> Cfg2 {
    let mut w = mode(Master::MASTER, directions);
    w.set_ssoe(true);
    w.set_mssi(LEAD as u8);
    w
}

/// Enabled, and begun or not.
fn enabled(begun: bool) -> Cr1 {
    let mut w = Cr1::default();
    w.set_spe(true);
    w.set_cstart(begun);
    w
}

/// Stops a bus, which empties its queues, and clears its flags.
fn stop(bus: Registers) {
    bus.cr1().write_value(Cr1::default());
    let mut w = Ifcr::default();
    w.set_eotc(true);
    w.set_txtfc(true);
    w.set_ovrc(true);
    w.set_modfc(true);
    bus.ifcr().write_value(w);
}

/// Waits until the bus has ended its transfer, at most for so many core cycles.
fn wait(bus: Registers, longest: u32) -> Result<(), ErrorKind> {
    let start = DWT::cycle_count();
    loop {
        // In this order: what has ended is never late.
        let late = DWT::cycle_count().wrapping_sub(start) > longest;
        if bus.sr().read().eot() {
            return Ok(());
        }
        if late {
            return Err(ErrorKind::Other);
        }
    }
}

/// Divider of the kernel clock of the ADC's buses, 57 MHz.
const ADC_DIVIDER: Mbr = Mbr::DIV4;

/// Core cycles after which the ADC's frame has failed. It ends about when it is waited for.
const ADC_PATIENCE: u32 = 2 * (CORE / 1_000_000);

/// The ADC's buses: SPI4 reads DOUTA and drives clock and select line, SPI5 reads DOUTB with
/// the same clock. TIM1 begins a frame.
pub struct Receiver {
    busy: Input<'static>,
}

impl Receiver {
    /// Both peripherals' clocks must be on, and the DMA's. `busy` is the BUSY pin.
    pub fn new(busy: Input<'static>) -> Self {
        for (bus, w) in [
            (SPI4, selecting(Comm::RECEIVER)),
            (SPI5, {
                // Selected by SSI, which is low.
                let mut w = mode(Master::SLAVE, Comm::RECEIVER);
                w.set_ssm(true);
                w
            }),
        ] {
            bus.cfg1().write(|w| {
                w.set_dsize(15);
                w.set_mbr(ADC_DIVIDER);
            });
            bus.cfg2().write_value(w);
            bus.cr2().write(|w| w.set_tsize(ad7606::LINE as u16));
        }
        dma::begin_with(enabled(true).0, SPI4.cr1().as_ptr().cast());
        Self { busy }
    }

    /// Makes both buses ready for the next frame.
    pub fn arm(&self) {
        for bus in [SPI5, SPI4] {
            stop(bus);
            bus.cr1().write_value(enabled(false));
        }
    }

    /// The codes of the frame that ends about now. None if the conversion has not ended, or a
    /// bus has not.
    pub fn read(&self) -> Option<Lines> {
        if self.busy.is_high() {
            return None;
        }
        wait(SPI4, ADC_PATIENCE).ok()?;
        wait(SPI5, ADC_PATIENCE).ok()?;
        Some([SPI4, SPI5].map(|bus| [(); ad7606::LINE].map(|()| bus.rxdr16().read())))
    }
}

/// Bits in the DAC's frame.
const BITS: u32 = 8 * FRAME as u32;

/// Divider of the DAC's clock for writing: 45.6 MHz.
const FAST: Mbr = Mbr::DIV2;

/// Divider of the DAC's clock for reading back: 5.7 MHz.
const SLOW: Mbr = Mbr::DIV16;

/// A frame that takes this many times as long as its bits has failed.
const PATIENCE: u32 = 3;

/// The DAC's bus, SPI3. The frames of a sample are sent by the DMA, those for starting and
/// reading back one by one.
pub struct Transmitter {
    /// Whether frames of a sample were begun, and nobody has asked for their end.
    begun: bool,
}

impl Transmitter {
    /// The peripheral's clock must be on, and the DMA's.
    pub fn new() -> Self {
        dma::feed_to(SPI3.txdr32().as_ptr());
        Self::prepare();
        Self { begun: false }
    }

    /// 24 bits a frame at this divider; with or without DMA.
    fn format(divider: Mbr, dma: bool) -> Cfg1 {
        let mut w = Cfg1::default();
        w.set_dsize(BITS as u8 - 1);
        w.set_mbr(divider);
        w.set_txdmaen(dma);
        w
    }

    /// For the frames of a sample, with the select line high in between.
    fn prepare() {
        let mut w = selecting(Comm::TRANSMITTER);
        w.set_ssom(Ssom::NOT_ASSERTED);
        w.set_midi(PAUSE as u8);
        SPI3.cfg2().write_value(w);
        SPI3.cr2().write(|w| w.set_tsize(LEGS as u16));
        SPI3.cfg1().write_value(Self::format(FAST, false));
    }

    /// Begins to send the frames of a sample. Those of the last must have ended
    /// ([`Transmitter::end`]).
    pub fn begin(&mut self, frames: [u32; LEGS]) {
        dma::feed(frames);
        // In the manual's order: the stream, TXDMAEN, SPE, CSTART.
        SPI3.cfg1().write_value(Self::format(FAST, true));
        SPI3.cr1().write_value(enabled(false));
        SPI3.cr1().write_value(enabled(true));
        self.begun = true;
    }

    /// Whether frames are still being sent.
    pub fn is_sending(&self) -> bool {
        self.begun && !SPI3.sr().read().eot()
    }

    /// Ends the sending of a sample's frames, and makes ready for the next.
    ///
    /// # Errors
    /// If not all have been sent.
    pub fn end(&mut self) -> Result<(), ErrorKind> {
        if !self.begun {
            return Ok(());
        }
        let ended = SPI3.sr().read().eot();
        self.begun = false;
        stop(SPI3);
        SPI3.cfg1().write_value(Self::format(FAST, false));
        if !ended {
            dma::abort();
        }
        dma::rearm();
        if ended { Ok(()) } else { Err(ErrorKind::Other) }
    }

    /// Sends one frame and returns what came back.
    fn exchange(&mut self, frame: u32, divider: Mbr) -> Result<u32, ErrorKind> {
        self.end()?;
        SPI3.cfg1().write_value(Self::format(divider, false));
        SPI3.cfg2().write_value(selecting(Comm::FULL_DUPLEX));
        SPI3.cr2().write(|w| w.set_tsize(1));
        SPI3.cr1().write_value(enabled(false));
        // The fields of MBR are powers of two: 0 is 2, 7 is 256.
        let bit = CORE.div_ceil(DAC_KERNEL) * (2 << divider.to_bits());
        // At a slow clock, SCLK may reach its idle level late after SPE.
        cortex_m::asm::delay(bit);
        SPI3.txdr32().write_value(frame);
        SPI3.cr1().write_value(enabled(true));
        let found = wait(SPI3, PATIENCE * BITS * bit).map(|()| SPI3.rxdr32().read());
        stop(SPI3);
        Self::prepare();
        found
    }
}

/// A frame as the word that is sent from its highest bit.
fn word([a, b, c]: [u8; FRAME]) -> u32 {
    u32::from_be_bytes([0, a, b, c])
}

impl ErrorType for Transmitter {
    type Error = ErrorKind;
}

impl SpiDevice for Transmitter {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        // The driver of the DAC uses no other.
        match operations {
            [Operation::Write(bytes)] => match <[u8; FRAME]>::try_from(*bytes) {
                Ok(frame) => self.exchange(word(frame), FAST).map(|_| ()),
                Err(_) => Err(ErrorKind::Other),
            },
            [Operation::TransferInPlace(bytes)] => {
                let Ok(frame) = <&mut [u8; FRAME]>::try_from(&mut **bytes) else {
                    return Err(ErrorKind::Other);
                };
                let [_, a, b, c] = self.exchange(word(*frame), SLOW)?.to_be_bytes();
                *frame = [a, b, c];
                Ok(())
            }
            _ => Err(ErrorKind::Other),
        }
    }
}
