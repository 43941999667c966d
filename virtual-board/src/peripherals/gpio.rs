//! General-purpose I/O, one port (RM0433, chapter 11).

use super::{Refusal, Register, only, unknown};
use crate::wires::Level;

/// Registers (11.4).
pub const REGISTERS: [Register; 10] = [
    (0x00, "GPIO_MODER"),
    (0x04, "GPIO_OTYPER"),
    (0x08, "GPIO_OSPEEDR"),
    (0x0C, "GPIO_PUPDR"),
    (0x10, "GPIO_IDR"),
    (0x14, "GPIO_ODR"),
    (0x18, "GPIO_BSRR"),
    (0x1C, "GPIO_LCKR"),
    (0x20, "GPIO_AFRL"),
    (0x24, "GPIO_AFRH"),
];

/// What a pin is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// Input or analogue: nothing drives it.
    Input,
    /// Driven with a level.
    Output(Level),
    /// An alternate function, by its number.
    Alternate(u8),
}

/// A port.
#[derive(Clone, Copy)]
pub struct Gpio {
    moder: u32,
    otyper: u32,
    ospeedr: u32,
    pupdr: u32,
    odr: u32,
    afr: [u32; 2],
}

impl Gpio {
    /// A port after reset: all pins analogue, but those of the debugger on ports A and B.
    pub fn new(port: usize) -> Self {
        let (moder, ospeedr, pupdr) = match port {
            0 => (0xABFF_FFFF, 0x0C00_0000, 0x6400_0000),
            1 => (0xFFFF_FEBF, 0x0000_00C0, 0x0000_0100),
            _ => (0xFFFF_FFFF, 0, 0),
        };
        Self {
            moder,
            otyper: 0,
            ospeedr,
            pupdr,
            odr: 0,
            afr: [0; 2],
        }
    }

    /// What a pin is.
    pub fn function(&self, pin: u8) -> Function {
        match self.moder >> (2 * pin) & 3 {
            1 => {
                let high = self.odr >> pin & 1 != 0;
                let open_drain = self.otyper >> pin & 1 != 0;
                Function::Output(if high && open_drain {
                    Level::Floating
                } else {
                    Level::of(high)
                })
            }
            2 => {
                let afr = self.afr[usize::from(pin / 8)];
                Function::Alternate((afr >> (4 * (pin % 8)) & 0xF) as u8)
            }
            _ => Function::Input,
        }
    }

    /// The level that the pin's own pull-up or pull-down gives.
    pub fn pull(&self, pin: u8) -> Level {
        match self.pupdr >> (2 * pin) & 3 {
            1 => Level::High,
            2 => Level::Low,
            _ => Level::Floating,
        }
    }

    /// Reads a register; `levels` are those on the pins. A floating pin reads low, and an
    /// analogue one too.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32, levels: impl Fn(u8) -> Level) -> Result<u32, Refusal> {
        Ok(match offset {
            0x00 => self.moder,
            0x04 => self.otyper,
            0x08 => self.ospeedr,
            0x0C => self.pupdr,
            0x10 => (0..16).fold(0, |word, pin| {
                let analogue = self.moder >> (2 * pin) & 3 == 3;
                word | u32::from(!analogue && levels(pin) == Level::High) << pin
            }),
            0x14 => self.odr,
            0x20 | 0x24 => self.afr[((offset - 0x20) / 4) as usize],
            _ => return unknown(),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Refusal> {
        match offset {
            0x00 => self.moder = value,
            0x04 => self.otyper = only(value, 0xFFFF)?,
            0x08 => self.ospeedr = value,
            0x0C => self.pupdr = value,
            0x14 => self.odr = only(value, 0xFFFF)?,
            // Where both are set, set wins (11.4.7).
            0x18 => self.odr = self.odr & !(value >> 16) | value & 0xFFFF,
            0x20 | 0x24 => self.afr[((offset - 0x20) / 4) as usize] = value,
            _ => return unknown(),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_and_set_reset() -> Result<(), Refusal> {
        let mut port = Gpio::new(6);
        assert_eq!(port.function(14), Function::Input);
        port.write(0x00, 1 << 28)?;
        assert_eq!(port.function(14), Function::Output(Level::Low));
        port.write(0x18, 1 << 14 | 1 << 30)?;
        assert_eq!(port.function(14), Function::Output(Level::High));
        port.write(0x04, 1 << 14)?;
        assert_eq!(port.function(14), Function::Output(Level::Floating));
        port.write(0x18, 1 << 30)?;
        assert_eq!(port.function(14), Function::Output(Level::Low));
        port.write(0x00, 2 << 28)?;
        port.write(0x24, 6 << 24)?;
        assert_eq!(port.function(14), Function::Alternate(6));
        let high = |_| Level::High;
        assert_eq!(port.read(0x10, high)?, 0xFFFF);
        Ok(())
    }
}
