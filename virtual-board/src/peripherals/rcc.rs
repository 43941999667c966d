//! Reset and clock control (RM0433, chapter 8).

use super::{Refusal, Register, only, unknown};
use crate::time::{MICROSECOND, Ticks};

/// Registers (8.7).
pub const REGISTERS: [Register; 55] = [
    (0x00, "RCC_CR"),
    (0x04, "RCC_HSICFGR"),
    (0x08, "RCC_CRRCR"),
    (0x0C, "RCC_CSICFGR"),
    (0x10, "RCC_CFGR"),
    (0x18, "RCC_D1CFGR"),
    (0x1C, "RCC_D2CFGR"),
    (0x20, "RCC_D3CFGR"),
    (0x28, "RCC_PLLCKSELR"),
    (0x2C, "RCC_PLLCFGR"),
    (0x30, "RCC_PLL1DIVR"),
    (0x34, "RCC_PLL1FRACR"),
    (0x38, "RCC_PLL2DIVR"),
    (0x3C, "RCC_PLL2FRACR"),
    (0x40, "RCC_PLL3DIVR"),
    (0x44, "RCC_PLL3FRACR"),
    (0x4C, "RCC_D1CCIPR"),
    (0x50, "RCC_D2CCIP1R"),
    (0x54, "RCC_D2CCIP2R"),
    (0x58, "RCC_D3CCIPR"),
    (0x60, "RCC_CIER"),
    (0x64, "RCC_CIFR"),
    (0x68, "RCC_CICR"),
    (0x70, "RCC_BDCR"),
    (0x74, "RCC_CSR"),
    (0x7C, "RCC_AHB3RSTR"),
    (0x80, "RCC_AHB1RSTR"),
    (0x84, "RCC_AHB2RSTR"),
    (0x88, "RCC_AHB4RSTR"),
    (0x8C, "RCC_APB3RSTR"),
    (0x90, "RCC_APB1LRSTR"),
    (0x94, "RCC_APB1HRSTR"),
    (0x98, "RCC_APB2RSTR"),
    (0x9C, "RCC_APB4RSTR"),
    (0xA0, "RCC_GCR"),
    (0xA8, "RCC_D3AMR"),
    (0xD0, "RCC_RSR"),
    (0xD4, "RCC_AHB3ENR"),
    (0xD8, "RCC_AHB1ENR"),
    (0xDC, "RCC_AHB2ENR"),
    (0xE0, "RCC_AHB4ENR"),
    (0xE4, "RCC_APB3ENR"),
    (0xE8, "RCC_APB1LENR"),
    (0xEC, "RCC_APB1HENR"),
    (0xF0, "RCC_APB2ENR"),
    (0xF4, "RCC_APB4ENR"),
    (0xFC, "RCC_AHB3LPENR"),
    (0x100, "RCC_AHB1LPENR"),
    (0x104, "RCC_AHB2LPENR"),
    (0x108, "RCC_AHB4LPENR"),
    (0x10C, "RCC_APB3LPENR"),
    (0x110, "RCC_APB1LLPENR"),
    (0x114, "RCC_APB1HLPENR"),
    (0x118, "RCC_APB2LPENR"),
    (0x11C, "RCC_APB4LPENR"),
];

/// Frequency of the internal oscillator, Hz.
const HSI: u64 = 64_000_000;

/// Frequency at HSE, from the ST-LINK, Hz.
pub const HSE: u64 = 8_000_000;

/// HSECSSON: a failure of HSE is an NMI.
const CSS: u32 = 1 << 19;

/// Until HSE is ready: in bypass it only has to be counted. A model's figure.
const HSE_START: Ticks = 20 * MICROSECOND;

/// Until a PLL has locked (data sheet: typically 50 µs).
const PLL_LOCK: Ticks = 50 * MICROSECOND;

/// A cause of a reset, with the flags that it leaves in RCC_RSR (8.4.4, table 56).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// Power came on.
    Power,
    /// The supply fell below the brown-out level, not so far that memory was lost.
    BrownOut,
    /// The reset pin.
    Pin,
    /// SYSRESETREQ.
    Software,
    /// The independent watchdog.
    Watchdog,
}

impl Reset {
    /// Every system reset pulls the reset pin too.
    fn flags(self) -> u32 {
        match self {
            Self::Power => 0x00E8_0000,
            Self::BrownOut => 1 << 21 | 1 << 22 | 1 << 17,
            Self::Pin => 1 << 22 | 1 << 17,
            Self::Software => 1 << 24 | 1 << 22 | 1 << 17,
            Self::Watchdog => 1 << 26 | 1 << 22 | 1 << 17,
        }
    }
}

/// What has a clock of its own to be switched on, and a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Domain {
    /// A GPIO port, 0 is A.
    Gpio(u8),
    /// DMA1, and DMAMUX1.
    Dma1,
    /// SPI3.
    Spi3,
    /// SPI4.
    Spi4,
    /// SPI5.
    Spi5,
    /// SYSCFG.
    Syscfg,
    /// TIM1.
    Tim1,
    /// USART3.
    Usart3,
}

impl Domain {
    /// Every one of them.
    pub fn all() -> impl Iterator<Item = Self> {
        let others = [
            Self::Dma1,
            Self::Spi3,
            Self::Spi4,
            Self::Spi5,
            Self::Syscfg,
            Self::Tim1,
            Self::Usart3,
        ];
        (0..11).map(Self::Gpio).chain(others)
    }

    /// Offset of its enable register, and its bit there and in the reset register.
    fn enable(self) -> (u32, u32) {
        match self {
            Self::Gpio(port) => (0xE0, u32::from(port)),
            Self::Dma1 => (0xD8, 0),
            Self::Spi4 => (0xF0, 13),
            Self::Spi5 => (0xF0, 20),
            Self::Spi3 => (0xE8, 15),
            Self::Syscfg => (0xF4, 1),
            Self::Tim1 => (0xF0, 0),
            Self::Usart3 => (0xE8, 18),
        }
    }
}

/// Bits of an enable register that may be set: those of [`Domain`]s, and of others, whose
/// clocks do no harm as long as nothing accesses their registers.
fn enables(offset: u32) -> u32 {
    let modelled = Domain::all()
        .map(Domain::enable)
        .filter(|(register, _)| *register == offset)
        .fold(0, |bits, (_, bit)| bits | 1 << bit);
    let others = match offset {
        // MDMA; DMA2; BDMA.
        0xD4 => 1,
        0xD8 => 2,
        0xE0 => 1 << 21,
        _ => 0,
    };
    modelled | others
}

/// From an enable register's offset to that of the reset register.
const TO_RESETS: u32 = 0xD4 - 0x7C;

/// Frequencies, Hz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clocks {
    /// The core; 0 if its source has stopped.
    pub core: u64,
    /// APB1.
    pub pclk1: u64,
    /// Timers on APB2.
    pub timer2: u64,
    /// Kernel of SPI1 to SPI3, if it runs.
    pub spi123: Option<u64>,
    /// Kernel of SPI4 and SPI5, if it runs.
    pub spi45: Option<u64>,
}

/// The peripheral.
pub struct Rcc {
    /// Whether there is a clock at HSE.
    pub hse_present: bool,
    cr: u32,
    cfgr: u32,
    dcfgr: [u32; 3],
    pllckselr: u32,
    pllcfgr: u32,
    /// DIVR and FRACR of the three PLLs.
    pll: [(u32, u32); 3],
    ccipr: [u32; 4],
    rsr: u32,
    csr: u32,
    bdcr: u32,
    enr: [u32; 9],
    rstr: [u32; 9],
    /// When HSE and the PLLs are ready, if they are on.
    ready: [Option<Ticks>; 4],
}

impl Default for Rcc {
    fn default() -> Self {
        Self {
            hse_present: true,
            // HSI on.
            cr: 1,
            cfgr: 0,
            dcfgr: [0; 3],
            pllckselr: 0x0202_0200,
            pllcfgr: 0x01FF_0000,
            pll: [(0x0101_0280, 0); 3],
            ccipr: [0; 4],
            rsr: 0,
            csr: 0,
            bdcr: 0,
            enr: [0; 9],
            rstr: [0; 9],
            ready: [None; 4],
        }
    }
}

impl Rcc {
    /// A reset: all registers but the flags of what caused it, which add up until they are
    /// cleared.
    pub fn reset(&mut self, cause: Reset) {
        let kept = if cause == Reset::Power { 0 } else { self.rsr };
        *self = Self {
            hse_present: self.hse_present,
            // The backup domain keeps its power.
            bdcr: if cause == Reset::Power { 0 } else { self.bdcr },
            rsr: kept | cause.flags(),
            ..Self::default()
        };
    }

    /// HSE stops. Whether the clock security system notices (8.5.3): then HSE and the PLLs
    /// that it feeds are off, and the core runs on HSI.
    pub fn lose_hse(&mut self) -> bool {
        self.hse_present = false;
        let notices = self.cr & CSS != 0;
        if notices {
            self.cr &= !(1 << 16);
            self.ready[0] = None;
            if self.pllckselr & 3 == 2 {
                self.cr &= !(1 << 24 | 1 << 26 | 1 << 28);
                self.ready = [None; 4];
            }
            self.cfgr = 0;
        }
        notices
    }

    fn ready(&self, source: usize, now: Ticks) -> bool {
        self.ready[source].is_some_and(|at| at <= now) && (source != 0 || self.hse_present)
    }

    /// Output of a PLL's divider: 0 P, 1 Q, 2 R.
    fn pll(&self, number: usize, divider: u32) -> Option<u64> {
        let input = match self.pllckselr & 3 {
            0 => HSI,
            2 if self.hse_present => HSE,
            _ => return None,
        };
        let m = u64::from(self.pllckselr >> (4 + 8 * number) & 0x3F);
        let on = self.cr >> (24 + 2 * number) & 1 != 0;
        let enabled = self.pllcfgr >> (16 + 3 * number as u32 + divider) & 1 != 0;
        if m == 0 || !on || !enabled {
            return None;
        }
        let divr = self.pll[number].0;
        let n = u64::from(divr & 0x1FF) + 1;
        let by = match divider {
            0 => divr >> 9 & 0x7F,
            1 => divr >> 16 & 0x7F,
            _ => divr >> 24 & 0x7F,
        };
        Some(input * n / m / (u64::from(by) + 1))
    }

    /// All frequencies now.
    pub fn clocks(&self) -> Clocks {
        let system = match self.cfgr & 7 {
            0 => HSI,
            2 => HSE * u64::from(self.hse_present),
            3 => self.pll(0, 0).unwrap_or(0),
            _ => 0,
        };
        let prescaled = |clock: u64, bits: u32, code: u32| {
            // 0xxx: not divided; for AHB 1000 to 1111: 2 to 16, 64 to 512.
            let code = code & ((1 << bits) - 1);
            let step = code & ((1 << (bits - 1)) - 1);
            let shift = match (code >> (bits - 1), bits) {
                (0, _) => 0,
                (_, 4) if step >= 4 => step + 2,
                _ => step + 1,
            };
            clock >> shift
        };
        let core = prescaled(system, 4, self.dcfgr[0] >> 8);
        let hclk = prescaled(core, 4, self.dcfgr[0]);
        let pclk1 = prescaled(hclk, 3, self.dcfgr[1] >> 4);
        let pclk2 = prescaled(hclk, 3, self.dcfgr[1] >> 8);
        // TIMPRE = 0 (8.5.8): twice the bus, if that is divided.
        let timer2 = if pclk2 == hclk { hclk } else { 2 * pclk2 };
        let spi123 = match self.ccipr[1] >> 12 & 7 {
            0 => self.pll(0, 1),
            1 => self.pll(1, 0),
            2 => self.pll(2, 0),
            _ => None,
        };
        let spi45 = match self.ccipr[1] >> 16 & 7 {
            0 => Some(pclk2).filter(|clock| *clock > 0),
            1 => self.pll(1, 1),
            2 => self.pll(2, 1),
            _ => None,
        };
        Clocks {
            core,
            pclk1,
            timer2,
            spi123,
            spi45,
        }
    }

    /// Whether a peripheral's clock is on and it is not held in reset.
    pub fn is_on(&self, domain: Domain) -> bool {
        let (offset, bit) = domain.enable();
        let at = ((offset - 0xD4) / 4) as usize;
        self.enr[at] >> bit & 1 != 0 && self.rstr[at] >> bit & 1 == 0
    }

    /// Whether a peripheral is held in reset.
    pub fn is_reset(&self, domain: Domain) -> bool {
        let (offset, bit) = domain.enable();
        self.rstr[((offset - 0xD4) / 4) as usize] >> bit & 1 != 0
    }

    /// Reads a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32, now: Ticks) -> Result<u32, Refusal> {
        Ok(match offset {
            0x00 => {
                let flags = [17, 25, 27, 29].iter().enumerate();
                // HSIRDY with HSION, HSI48RDY with HSI48ON; D1CKRDY and D2CKRDY.
                let own = (self.cr & 1) << 2 | (self.cr & 1 << 12) << 1 | 3 << 14;
                flags.fold(self.cr | own, |word, (source, bit)| {
                    word | u32::from(self.ready(source, now)) << bit
                })
            }
            0x10 => self.cfgr | (self.cfgr & 7) << 3,
            0x18 | 0x1C | 0x20 => self.dcfgr[((offset - 0x18) / 4) as usize],
            0x28 => self.pllckselr,
            0x2C => self.pllcfgr,
            0x30 | 0x38 | 0x40 => self.pll[((offset - 0x30) / 8) as usize].0,
            0x34 | 0x3C | 0x44 => self.pll[((offset - 0x34) / 8) as usize].1,
            0x4C..0x5C => self.ccipr[((offset - 0x4C) / 4) as usize],
            0x70 => self.bdcr,
            // LSIRDY with LSION.
            0x74 => self.csr | self.csr << 1,
            0x7C..0xA0 => self.rstr[((offset - 0x7C) / 4) as usize],
            0xD0 => self.rsr,
            0xD4..0xF8 => self.enr[((offset - 0xD4) / 4) as usize],
            _ => return unknown(),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled.
    pub fn write(&mut self, offset: u32, value: u32, now: Ticks) -> Result<(), Refusal> {
        let at = |first: u32| ((offset - first) / 4) as usize;
        match offset {
            0x00 => {
                // HSION, HSI48ON (used by nothing), HSEON, HSEBYP, HSECSSON (8.5.3), PLLxON; the
                // flags are read-only.
                let flags =
                    1 << 2 | 1 << 5 | 1 << 13 | 3 << 14 | 1 << 17 | 1 << 25 | 1 << 27 | 1 << 29;
                let known = 1 | 1 << 12 | 1 << 16 | 1 << 18 | CSS | 1 << 24 | 1 << 26 | 1 << 28;
                let value = only(value & !flags, known)?;
                if value & CSS != 0 && !self.ready(0, now) {
                    return Err("HSECSSON is set while HSE is not ready".to_owned());
                }
                // Once set, it stays until the next reset.
                self.cr = value | self.cr & CSS;
                for (source, (bit, time)) in [
                    (16, HSE_START),
                    (24, PLL_LOCK),
                    (26, PLL_LOCK),
                    (28, PLL_LOCK),
                ]
                .into_iter()
                .enumerate()
                {
                    let on = value >> bit & 1 != 0;
                    let ready = &mut self.ready[source];
                    *ready = on.then(|| ready.unwrap_or(now + time));
                }
            }
            0x10 => {
                let sw = only(value & !(7 << 3), 7)?;
                let ready = match sw {
                    0 => true,
                    2 => self.ready(0, now),
                    3 => self.ready(1, now),
                    _ => false,
                };
                if !ready {
                    return Err(format!("SW = {sw}: that clock is not ready"));
                }
                self.cfgr = sw;
            }
            0x18 => self.dcfgr[0] = only(value, 0xF7F)?,
            0x1C => self.dcfgr[1] = only(value, 0x770)?,
            0x20 => self.dcfgr[2] = only(value, 0x70)?,
            // DIVMx can be written only while PLLx is off, PLLSRC only while all are
            // (8.7.10): other fields keep their value. The start-up of the image relies on
            // it: it writes 0 here for PLL3 when the others run.
            0x28 => {
                only(value, 0x03F3_F3F3)?;
                let on = |pll: u32| self.cr >> (24 + 2 * pll) & 1 != 0;
                let open = (0..3).filter(|pll| !on(*pll));
                let mut mask = open.fold(0, |mask, pll| mask | 0x3F << (4 + 8 * pll));
                if !(0..3).any(on) {
                    mask |= 3;
                }
                self.pllckselr = self.pllckselr & !mask | value & mask;
            }
            // No fractional part.
            0x2C => self.pllcfgr = only(value, 0x01FF_0EEE)?,
            0x30 | 0x38 | 0x40 => {
                let number = ((offset - 0x30) / 8) as usize;
                if self.cr >> (24 + 2 * number) & 1 != 0 {
                    return Err("the PLL is on".to_owned());
                }
                self.pll[number].0 = only(value, 0x7F7F_FFFF)?;
            }
            // The kernel clocks of what is modelled: SPI1 to SPI3, SPI4 and SPI5, and the USARTs
            // from APB1.
            0x4C | 0x54 | 0x58 => self.ccipr[at(0x4C)] = only(value, 0)?,
            0x50 => self.ccipr[1] = only(value, 7 << 12 | 7 << 16)?,
            // RTCSEL, RTCEN, BDRST: a clock for the RTC, which nothing accesses.
            0x70 => self.bdcr = only(value, 3 << 8 | 1 << 15 | 1 << 16)?,
            // The watchdog starts LSI by itself.
            0x74 => self.csr = only(value & !2, 1)?,
            0x7C..0xA0 => self.rstr[at(0x7C)] = only(value, enables(offset + TO_RESETS))?,
            // RMVF clears the flags.
            0xD0 if value >> 16 & 1 != 0 => self.rsr = 0,
            0xD0 => {}
            0xD4..0xF8 => self.enr[at(0xD4)] = only(value, enables(offset))?,
            _ => return unknown(),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The board's tree by hand: 8 MHz · 120 / 2 = 480 MHz, AHB 240, APB 120, timers 240;
    /// 8 · 57 / 5 = 91.2 MHz, 8 · 57 / 8 = 57 MHz.
    #[test]
    fn the_board_s_clocks() -> Result<(), Refusal> {
        let mut rcc = Rcc::default();
        assert_eq!(rcc.clocks().core, 64_000_000);
        rcc.write(0x00, 1 | 1 << 16 | 1 << 18, 0)?;
        assert_eq!(rcc.read(0x00, HSE_START - 1)? >> 17 & 1, 0);
        assert_eq!(rcc.read(0x00, HSE_START)? >> 17 & 1, 1);
        rcc.write(0x28, 2 | 1 << 4 | 1 << 12, 0)?;
        rcc.write(0x30, 119 | 1 << 9, 0)?;
        rcc.write(0x38, 56 | 4 << 9 | 7 << 16, 0)?;
        rcc.write(0x2C, 1 << 16 | 1 << 19 | 1 << 20, 0)?;
        rcc.write(0x00, 1 | 1 << 16 | 1 << 18 | 1 << 24 | 1 << 26, 0)?;
        rcc.write(0x28, 0, 0)?;
        assert!(rcc.write(0x10, 3, 0).is_err());
        rcc.write(0x18, 8 | 4 << 4, 0)?;
        rcc.write(0x1C, 4 << 4 | 4 << 8, 0)?;
        rcc.write(0x50, 1 << 12 | 1 << 16, 0)?;
        rcc.write(0x10, 3, PLL_LOCK)?;
        let expected = Clocks {
            core: 480_000_000,
            pclk1: 120_000_000,
            timer2: 240_000_000,
            spi123: Some(91_200_000),
            spi45: Some(57_000_000),
        };
        assert_eq!(rcc.clocks(), expected);
        rcc.hse_present = false;
        assert_eq!(rcc.clocks().core, 0);
        Ok(())
    }

    /// Table 56: flags add up until RMVF; only power clears the older ones.
    #[test]
    fn flags_of_resets() -> Result<(), Refusal> {
        let mut rcc = Rcc::default();
        rcc.reset(Reset::Power);
        assert_eq!(rcc.read(0xD0, 0)? >> 23 & 1, 1);
        rcc.write(0xD0, 1 << 16, 0)?;
        rcc.reset(Reset::Watchdog);
        assert_eq!(rcc.read(0xD0, 0)?, 1 << 26 | 1 << 22 | 1 << 17);
        rcc.reset(Reset::Pin);
        assert_eq!(rcc.read(0xD0, 0)? >> 26 & 1, 1);
        Ok(())
    }

    #[test]
    fn unknown_bits_are_refused() {
        let mut rcc = Rcc::default();
        // HSECSSON without HSE.
        assert!(rcc.write(0x00, 1 | 1 << 19, 0).is_err());
        // CSION.
        assert!(rcc.write(0x00, 1 | 1 << 7, 0).is_err());
        // TIM8.
        assert!(rcc.write(0xF0, 2, 0).is_err());
        assert!(rcc.write(0xF0, 1, 0).is_ok());
        assert!(rcc.is_on(Domain::Tim1));
        assert!(!rcc.is_on(Domain::Spi4));
    }
}
