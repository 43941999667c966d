//! Where the blocks of registers are, and what is the same for every access to one: the names
//! of its registers, its clock, the sizes of accesses, and which registers only an event
//! changes.

use crate::peripherals::rcc::Domain;
use crate::peripherals::{
    dbgmcu, dma, dwt, flash, gpio, iwdg, mpu, name, nvic, pwr, rcc, scb, spi, syscfg, tim1, usart,
};

/// A block of registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Block {
    /// SPI3.
    Spi3,
    /// SPI4.
    Spi4,
    /// SPI5.
    Spi5,
    /// DMA1.
    Dma1,
    /// DMAMUX1.
    Dmamux1,
    /// USART3.
    Usart3,
    /// TIM1.
    Tim1,
    /// The flash's registers.
    Flash,
    /// SYSCFG.
    Syscfg,
    /// IWDG1.
    Iwdg1,
    /// A GPIO port, 0 is A.
    Gpio(u8),
    /// RCC.
    Rcc,
    /// PWR.
    Pwr,
    /// DBGMCU.
    Dbgmcu,
    /// DWT.
    Dwt,
    /// The core's system control space.
    Scs,
}

impl Block {
    /// The block at an address, and the offset in it (RM0433, 2.3.2, table 8).
    pub fn at(address: u32) -> Option<(Self, u32)> {
        let block = match address {
            0x4000_3C00..0x4000_4000 => Self::Spi3,
            0x4000_4800..0x4000_4C00 => Self::Usart3,
            0x4001_0000..0x4001_0400 => Self::Tim1,
            0x4001_3400..0x4001_3800 => Self::Spi4,
            0x4001_5000..0x4001_5400 => Self::Spi5,
            0x4002_0000..0x4002_0400 => Self::Dma1,
            0x4002_0800..0x4002_0C00 => Self::Dmamux1,
            0x5200_2000..0x5200_2400 => Self::Flash,
            0x5800_0400..0x5800_0800 => Self::Syscfg,
            0x5800_4800..0x5800_4C00 => Self::Iwdg1,
            0x5802_0000..0x5802_2C00 => Self::Gpio((address >> 10 & 0xF) as u8),
            0x5802_4400..0x5802_4800 => Self::Rcc,
            0x5802_4800..0x5802_4C00 => Self::Pwr,
            0x5C00_1000..0x5C00_1400 => Self::Dbgmcu,
            0xE000_1000..0xE000_2000 => return Some((Self::Dwt, address & 0xFFF)),
            0xE000_E000..0xE000_F000 => return Some((Self::Scs, address & 0xFFF)),
            _ => return None,
        };
        Some((block, address & 0x3FF))
    }

    /// The name of a register in it.
    pub fn register(self, offset: u32) -> String {
        let plain = |registers| name(registers, offset);
        match self {
            Self::Spi3 => plain(&spi::REGISTERS).replace("SPI", "SPI3"),
            Self::Spi4 => plain(&spi::REGISTERS).replace("SPI", "SPI4"),
            Self::Spi5 => plain(&spi::REGISTERS).replace("SPI", "SPI5"),
            Self::Dma1 => dma::register(offset),
            Self::Dmamux1 => dma::mux_register(offset),
            Self::Usart3 => plain(&usart::REGISTERS),
            Self::Tim1 => plain(&tim1::REGISTERS),
            Self::Flash => plain(&flash::REGISTERS),
            Self::Syscfg => plain(&syscfg::REGISTERS),
            Self::Iwdg1 => plain(&iwdg::REGISTERS).replace("IWDG", "IWDG1"),
            Self::Gpio(port) => {
                let letter = char::from(b'A' + port);
                plain(&gpio::REGISTERS).replace("GPIO", &format!("GPIO{letter}"))
            }
            Self::Rcc => plain(&rcc::REGISTERS),
            Self::Pwr => plain(&pwr::REGISTERS),
            Self::Dbgmcu => plain(&dbgmcu::REGISTERS),
            Self::Dwt => plain(&dwt::REGISTERS),
            Self::Scs if offset == dwt::DEMCR.0 => dwt::DEMCR.1.to_owned(),
            Self::Scs if (0x100..0xD00).contains(&offset) => {
                // A register of many: by its first and a number.
                let first = nvic::REGISTERS.iter().rfind(|(at, _)| *at <= offset);
                first.map_or_else(String::new, |(at, name)| {
                    let size = if *at == 0x400 { 1 } else { 4 };
                    format!("{}{}", name.trim_end_matches('0'), (offset - at) / size)
                })
            }
            Self::Scs if (0xD90..0xDBC).contains(&offset) => plain(&mpu::REGISTERS),
            Self::Scs => plain(&scb::REGISTERS),
        }
    }

    /// Whether a register is read without an effect, and changes with an event alone.
    pub(crate) fn is_steady(self, offset: u32) -> bool {
        match self {
            Self::Flash => true,
            Self::Spi3 | Self::Spi4 | Self::Spi5 => offset == 0x14,
            Self::Usart3 => offset == 0x1C,
            // All but the counter.
            Self::Tim1 => offset != 0x24,
            Self::Gpio(_) => true,
            _ => false,
        }
    }

    /// Whether it is reached over a bridge; the core's own blocks are not.
    pub(crate) fn is_behind_bridge(self) -> bool {
        !matches!(self, Self::Dwt | Self::Scs)
    }

    /// The block's clock, if it has one of its own.
    pub(super) fn domain(self) -> Option<Domain> {
        match self {
            Self::Spi3 => Some(Domain::Spi3),
            Self::Spi4 => Some(Domain::Spi4),
            Self::Spi5 => Some(Domain::Spi5),
            // DMAMUX1 has the clock of DMA1 (8.5.14).
            Self::Dma1 | Self::Dmamux1 => Some(Domain::Dma1),
            Self::Usart3 => Some(Domain::Usart3),
            Self::Tim1 => Some(Domain::Tim1),
            Self::Syscfg => Some(Domain::Syscfg),
            Self::Gpio(port) => Some(Domain::Gpio(port)),
            Self::Flash
            | Self::Iwdg1
            | Self::Rcc
            | Self::Pwr
            | Self::Dbgmcu
            | Self::Dwt
            | Self::Scs => None,
        }
    }

    /// Whether an access may have this size, bytes.
    pub(super) fn takes(self, offset: u32, size: usize) -> bool {
        match self {
            Self::Spi3 | Self::Spi4 | Self::Spi5 | Self::Scs => true,
            // RDR and TDR.
            Self::Usart3 => size == 4 || matches!(offset, 0x24 | 0x28),
            // Registers of sixteen bits.
            Self::Tim1 => size >= 2,
            _ => size == 4,
        }
    }
}
