//! Clocks and caches.
//!
//! | | MHz | why |
//! |---|---|---|
//! | HSE | 8 | from the ST-LINK on the board |
//! | core | 480 | PLL1 P; revision V silicon |
//! | AHB | 240 | half the core |
//! | APB | 120 | half of AHB |
//! | TIM1 | 240 | twice its APB: 4 ns a count |
//! | SPI1, SPI3 | 112 | PLL2 P: 14 MHz for the ADC, which takes 14.5; 28 for the DAC, 50 |
//!
//! The instruction cache is on, for the link and the other code that runs from flash. The
//! data cache is off: the loop's data are in DTCM, which has no cache, and without a data
//! cache nothing has to be kept coherent.

use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllDiv, PllMul, PllPreDiv, PllSource, Sysclk,
    VoltageScale, mux,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Config, Peripherals};

/// Clock of the core, Hz.
pub const CORE: u32 = firmware::budget::CORE as u32;

/// Clock of TIM1, Hz.
pub const TIMER: u32 = 240_000_000;

/// Sets all clocks.
pub fn start() -> Peripherals {
    let mut config = Config::default();
    let rcc = &mut config.rcc;
    rcc.hse = Some(Hse {
        freq: Hertz(8_000_000),
        mode: HseMode::Bypass,
    });
    rcc.pll1 = Some(Pll {
        source: PllSource::HSE,
        prediv: PllPreDiv::DIV1,
        mul: PllMul::MUL120,
        fracn: None,
        divp: Some(PllDiv::DIV2),
        divq: None,
        divr: None,
    });
    rcc.pll2 = Some(Pll {
        source: PllSource::HSE,
        prediv: PllPreDiv::DIV1,
        mul: PllMul::MUL56,
        fracn: None,
        divp: Some(PllDiv::DIV4),
        divq: None,
        divr: None,
    });
    rcc.sys = Sysclk::PLL1_P;
    rcc.voltage_scale = VoltageScale::Scale0;
    rcc.d1c_pre = AHBPrescaler::DIV1;
    rcc.ahb_pre = AHBPrescaler::DIV2;
    rcc.apb1_pre = APBPrescaler::DIV2;
    rcc.apb2_pre = APBPrescaler::DIV2;
    rcc.apb3_pre = APBPrescaler::DIV2;
    rcc.apb4_pre = APBPrescaler::DIV2;
    rcc.mux.spi123sel = mux::Saisel::PLL2_P;
    embassy_stm32::init(config)
}
