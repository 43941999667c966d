//! Clocks and caches.
//!
//! | | MHz | why |
//! |---|---|---|
//! | source | 8 | HSE, [`SOURCE`]; without it the internal oscillator, divided by 8 |
//! | core | 480 | PLL1 P; revision V silicon |
//! | AHB | 240 | half the core |
//! | APB | 120 | half of AHB |
//! | TIM1 | 240 | twice its APB: 4 ns a count |
//! | SPI4, SPI5 | 57 | PLL2 Q: 14.25 MHz for the ADC, which takes 14.5 |
//! | SPI3 | 91.2 | PLL2 P: 45.6 MHz for the DAC, which takes 50 |
//!
//! The converters' clocks stay below their limits on the internal oscillator too.
//!
//! The instruction cache is on, for the link and the other code that runs from flash. The
//! data cache is off: the loop's data are in DTCM, which has no cache, and without a data
//! cache nothing has to be kept coherent.

use embassy_stm32::pac::RCC;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, HSIPrescaler, Hse, HseMode, Pll, PllDiv, PllMul, PllPreDiv,
    PllSource, Sysclk, VoltageScale, mux,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Config, Peripherals};

/// What is connected to the processor's HSE input: `Bypass` is the clock of 8 MHz from the
/// ST-LINK, as the board is delivered. It stops when the ST-LINK loses its USB supply; for a
/// board that must run without, fit the crystal X3 and set `Oscillator` (docs/board.md).
const SOURCE: HseMode = HseMode::Bypass;

/// Frequency of HSE, Hz.
const HSE: u32 = 8_000_000;

/// Clock of the core, Hz.
pub const CORE: u32 = firmware::budget::CORE as u32;

/// Clock of the peripheral buses, Hz.
pub const APB: u32 = 120_000_000;

/// Clock of TIM1, Hz.
pub const TIMER: u32 = 240_000_000;

/// Kernel clock of the DAC's bus, Hz.
pub const DAC_KERNEL: u32 = 91_200_000;

/// Reads of the clock's status, several cycles of 64 MHz each, after which HSE does not start: more
/// than 20 ms. A crystal takes 2 ms (data sheet).
const PATIENCE: u32 = 400_000;

/// The source of all clocks.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// HSE. The clock security system restarts the board if it fails.
    External,
    /// The internal oscillator, since HSE does not start. It is exact to 1 % only.
    Internal,
}

/// Sets all clocks.
pub fn start() -> (Peripherals, Source) {
    RCC.cr()
        .modify(|w| w.set_hsebyp(SOURCE != HseMode::Oscillator));
    RCC.cr().modify(|w| w.set_hseon(true));
    let external = (0..PATIENCE).any(|_| RCC.cr().read().hserdy());
    let source = if external {
        Source::External
    } else {
        Source::Internal
    };
    let (input, prediv) = match source {
        Source::External => (PllSource::HSE, PllPreDiv::DIV1),
        Source::Internal => (PllSource::HSI, PllPreDiv::DIV8),
    };
    let mut config = Config::default();
    let rcc = &mut config.rcc;
    rcc.hsi = Some(HSIPrescaler::DIV1);
    rcc.hse = external.then_some(Hse {
        freq: Hertz(HSE),
        mode: SOURCE,
    });
    let pll = |mul, divp, divq| Pll {
        source: input,
        prediv,
        mul,
        fracn: None,
        divp: Some(divp),
        divq,
        divr: None,
    };
    rcc.pll1 = Some(pll(PllMul::MUL120, PllDiv::DIV2, None));
    rcc.pll2 = Some(pll(PllMul::MUL57, PllDiv::DIV5, Some(PllDiv::DIV8)));
    rcc.sys = Sysclk::PLL1_P;
    rcc.voltage_scale = VoltageScale::Scale0;
    rcc.d1c_pre = AHBPrescaler::DIV1;
    rcc.ahb_pre = AHBPrescaler::DIV2;
    rcc.apb1_pre = APBPrescaler::DIV2;
    rcc.apb2_pre = APBPrescaler::DIV2;
    rcc.apb3_pre = APBPrescaler::DIV2;
    rcc.apb4_pre = APBPrescaler::DIV2;
    rcc.mux.spi123sel = mux::Saisel::PLL2_P;
    rcc.mux.spi45sel = mux::Spi45sel::PLL2_Q;
    let peripherals = embassy_stm32::init(config);
    if external {
        RCC.cr().modify(|w| w.set_hsecsson(true));
    }
    (peripherals, source)
}
