//! The wires between the processor's pins and the chips: levels, and frames of the buses.

use super::Bus;
use crate::peripherals::Refusal;
use crate::peripherals::gpio::Function;
use crate::peripherals::spi::Frame;
use crate::time::Ticks;
use crate::wires::{Level, Pin, pins};

/// Fastest clock of the AD7606 with VDRIVE at 3.3 V, Hz (data sheet, f_SCLK).
const ADC_CLOCK: u64 = 14_500_000;

/// Fastest clock of the AD5676R, Hz (data sheet, t1).
const DAC_CLOCK: u64 = 50_000_000;

/// The level of a select line.
fn selected(low: Option<bool>) -> Level {
    low.map_or(Level::Floating, |low| Level::of(!low))
}

impl Bus {
    /// Whether a pin has an alternate function.
    fn is_alternate(&self, pin: Pin, number: u8) -> bool {
        self.gpio[usize::from(pin.0)].function(pin.1) == Function::Alternate(number)
    }

    /// A chip takes or gives data at falling edges, so its clock must rise before them.
    fn check_frame(&mut self, frame: Frame, chip: &str, modes: &[(bool, bool)], fastest: u64) {
        if !modes.contains(&(frame.cpol, frame.cpha)) {
            self.refuse(format!(
                "{chip} with CPOL {} and CPHA {}",
                u8::from(frame.cpol),
                u8::from(frame.cpha)
            ));
        }
        if frame.bit < crate::time::cycles(1, fastest) {
            self.refuse(format!("{chip} clocked faster than {fastest} Hz"));
        }
    }

    pub(super) fn exchange_adc(&mut self, frame: Frame) -> u32 {
        if !self.adc.is_selected() || !self.is_alternate(pins::ADC_SCLK, 5) {
            return 0;
        }
        self.check_frame(frame, "AD7606", &[(true, false)], ADC_CLOCK);
        let connected = self.is_alternate(pins::DOUTA, 5);
        let other = self.is_alternate(pins::DOUTB_SCLK, 5);
        let other_data = self.is_alternate(pins::DOUTB, 5);
        let mut word = 0;
        for _ in 0..frame.bits {
            let (douta, doutb) = self.adc.clock();
            word = word << 1 | u32::from(douta && connected);
            if other {
                let mode = (frame.cpol, frame.cpha);
                if let Err(why) = self.spi5.clock(mode, doutb && other_data) {
                    self.refuse(format!("SPI5: {why}"));
                }
            }
        }
        word
    }

    pub(super) fn exchange_dac(&mut self, frame: Frame) -> u32 {
        if !self.dac.is_selected() || !self.is_alternate(pins::DAC_SCLK, 6) {
            return 0;
        }
        let modes = [(true, false), (false, true)];
        self.check_frame(frame, "AD5676R", &modes, DAC_CLOCK);
        let sdi = self.is_alternate(pins::SDI, 6);
        let sdo = self.is_alternate(pins::SDO, 6);
        (0..frame.bits).rev().fold(0, |word, bit| {
            let out = self.dac.clock(sdi && frame.data >> bit & 1 != 0);
            word << 1 | u32::from(out && sdo)
        })
    }

    /// The level on a pin.
    pub fn level(&self, pin: Pin) -> Level {
        if let Some(level) = self.held.get(&pin) {
            return *level;
        }
        let port = &self.gpio[usize::from(pin.0)];
        let driven = match port.function(pin.1) {
            Function::Output(level) => level,
            Function::Alternate(1) if pin == pins::CONVST => self.tim1.output(0),
            Function::Alternate(1) if pin == pins::LDAC => self.tim1.output(2),
            Function::Alternate(5) if pin == pins::CS => selected(self.spi4.select()),
            Function::Alternate(6) if pin == pins::SYNC => selected(self.spi3.select()),
            _ => Level::Floating,
        };
        let outside = match pin {
            pins::BUSY => Level::of(self.adc.busy()),
            // The resistor to ground.
            pins::DAC_RESET => Level::Low,
            _ => Level::Floating,
        };
        let levels = [driven, outside, port.pull(pin.1)];
        levels
            .into_iter()
            .find(|level| *level != Level::Floating)
            .unwrap_or(Level::Floating)
    }

    pub(super) fn note(&mut self, pin: Pin, at: Ticks) {
        if self.recorder.watches(pin) {
            let level = self.level(pin);
            self.recorder.note(pin, at, level);
        }
    }

    /// Records a pin's level from now on.
    pub fn watch(&mut self, pin: Pin) {
        let level = self.level(pin);
        self.recorder.watch(pin, self.now, level);
    }

    /// A wire between processor and chip may have another level. A floating one counts as
    /// low: for CONVST, SYNC and CS nothing happens then, and LDAC low is the worse case,
    /// because every write to the DAC is at once on its output.
    pub fn drive(&mut self, pin: Pin, at: Ticks) {
        let high = self.level(pin).is_high(false);
        self.note(pin, at);
        match pin {
            pins::CONVST => {
                self.adc.convst(high, at);
                self.note(pins::BUSY, at);
            }
            pins::ADC_RESET => self.adc.reset(high),
            pins::CS => self.adc.select(!high && self.is_driven(pin)),
            pins::LDAC => {
                let latched = self.dac.ldac(!high, at);
                self.counts.latched(latched);
            }
            pins::SYNC => {
                if let Err(why) = self.dac.sync(!high && self.is_driven(pin), at) {
                    self.refuse(format!("AD5676R: {why}"));
                }
            }
            pins::DAC_RESET => self.dac.reset(!high, at),
            _ => {}
        }
    }

    fn is_driven(&self, pin: Pin) -> bool {
        self.level(pin) != Level::Floating
    }

    /// All wires between processor and chips, and all recorded pins.
    pub fn wires(&mut self) {
        let now = self.now;
        for pin in [
            pins::DAC_RESET,
            pins::CONVST,
            pins::ADC_RESET,
            pins::CS,
            pins::LDAC,
            pins::SYNC,
        ] {
            self.drive(pin, now);
        }
        let watched: Vec<Pin> = self.recorder.pins().collect();
        for pin in watched {
            self.note(pin, now);
        }
    }

    /// The alternate functions that the model has.
    pub(super) fn check_alternates(&self, port: u8) -> Result<(), Refusal> {
        for number in 0..16 {
            let pin = Pin(port, number);
            let Function::Alternate(function) = self.gpio[usize::from(port)].function(number)
            else {
                continue;
            };
            let known = match pin {
                pins::CONVST | pins::LDAC => function == 1,
                pins::CS | pins::ADC_SCLK | pins::DOUTA => function == 5,
                pins::DOUTB_SCLK | pins::DOUTB => function == 5,
                pins::SYNC | pins::DAC_SCLK | pins::SDI | pins::SDO => function == 6,
                pins::LINK_TX | pins::LINK_RX => function == 7,
                // The debugger's.
                Pin(0, 13..=15) | Pin(1, 3..=4) => function == 0,
                _ => false,
            };
            if !known {
                return Err(format!("alternate function {function} of {pin:?}"));
            }
        }
        Ok(())
    }
}
