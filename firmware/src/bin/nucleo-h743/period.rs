//! The sample period: TIM1 alone determines when things happen.
//!
//! ```text
//!            0      BEGIN   DUE                  latch               T
//! CH1  ──┐▔▔▔▔▔▔▔▔▔▔▔▔▔└────────────────────────────────────────────┐▔▔▔  CONVST
//! CC1                  ▲ request: the DMA begins the ADC's frame
//! CC2                      ▲ interrupt: read, step, write
//! CH3  ▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔└──┘▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔▔  LDAC
//! CC5                                                      ▲ flag: near the interrupt
//! ```
//!
//! CONVST is high until the conversion has ended, so that its end is the begin of the read. CH3
//! and CH4 together make the LDAC pulse (combined PWM mode 2: both references; RM0433,
//! chapter 38), so that it may be anywhere in the period. A latch later than T is in the next
//! period, before the codes of that one are written.

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_stm32::pac::timer::{regs, vals};
use embassy_stm32::pac::{RCC, TIM1};
use firmware::budget::{self, BEGIN, GUARD};

use crate::clocks::TIMER;

/// Length of the LDAC pulse, s. The DAC accepts 25 ns.
const PULSE: f32 = 1e-6;

/// Shortest LDAC pulse, s: a latch that is later than this before the end of a period is moved
/// there.
const SHORTEST: f32 = 50e-9;

/// Flag of CC2, the interrupt.
const DUE: u32 = 1 << 2;

/// Flag of CC5: the interrupt is less than [`GUARD`] away.
const NEAR: u32 = 1 << 16;

/// Whether the timer runs.
static RUNS: AtomicBool = AtomicBool::new(false);

fn counts(seconds: f32) -> u32 {
    // The cast saturates.
    (seconds * TIMER as f32 + 0.5) as u32
}

/// Counts in a period of `rate` Hz, and the prescaler.
fn division(rate: f32) -> (u32, u32) {
    let whole = counts(1.0 / rate);
    // The counter has sixteen bits.
    let prescaler = whole / 65_536;
    (whole / (prescaler + 1), prescaler)
}

/// Restarts the timer with this sample rate, Hz, and latch, s after the sample. Nothing is
/// converted or latched, and no interrupt occurs, until it runs again.
pub fn start(rate: f32, latch: f32) {
    RCC.apb2enr().modify(|w| w.set_tim1en(true));
    let (period, prescaler) = division(rate);
    let at = |seconds: f32| (counts(seconds) / (prescaler + 1)) as u16;
    let t = TIM1;
    RUNS.store(false, Ordering::Relaxed);
    t.cr1().write(|w| w.set_cen(false));
    t.dier().write(|_| {});
    // At most 65,536.
    t.arr().write(|w| w.set_arr((period - 1) as u16));
    t.psc().write_value(prescaler as u16);
    t.ccr(0).write(|w| w.set_ccr(at(BEGIN as f32)));
    t.ccr(1).write(|w| w.set_ccr(at(budget::DUE as f32)));
    let latest = period - 1 - u32::from(at(SHORTEST)).max(1);
    let latch = ((counts(latch) / (prescaler + 1)) % period).min(latest);
    let end = (latch + u32::from(at(PULSE))).min(period - 1);
    t.ccr(2).write(|w| w.set_ccr(latch as u16));
    t.ccr(3).write(|w| w.set_ccr(end as u16));
    let guard = u32::from(at(budget::DUE as f32)) + period - u32::from(at(GUARD)).min(period);
    t.ccr5().write(|w| w.set_ccr((guard % period) as u16));
    // CH1: PWM mode 1. CH2: its flag only.
    t.ccmr_output(0)
        .write(|w| w.set_ocm(0, vals::OcmGp::PWM_MODE1));
    // CH3: from its own compare value until CH4's.
    t.ccmr_output(1).write(|w| {
        w.set_ocm(0, vals::OcmGp::COMBINED_PWM_MODE_2);
        w.set_ocm(1, vals::OcmGp::PWM_MODE1);
    });
    t.ccer().write(|w| {
        w.set_cce(0, true);
        w.set_cce(2, true);
        // The pulse is low.
        w.set_ccp(2, true);
    });
    t.bdtr().write(|w| w.set_moe(true));
    // Loads the prescaler.
    t.egr().write(|w| w.set_ug(true));
    // The first sample is a whole interrupt away: what the link does meanwhile does not wait.
    t.cnt().write(|w| w.set_cnt(end as u16));
    t.sr().write_value(regs::SrAdv(0));
    t.dier().write(|w| {
        w.set_ccde(0, true);
        w.set_ccie(1, true);
    });
    t.cr1().write(|w| w.set_cen(true));
    RUNS.store(true, Ordering::Relaxed);
}

/// Whether the interrupt is at least [`GUARD`] away, or the timer stands.
pub fn is_far() -> bool {
    !RUNS.load(Ordering::Relaxed) || TIM1.sr().read().0 & (DUE | NEAR) == 0
}

/// Clears both flags. Returns the time since the sample in counts of TIM1's clock.
pub fn acknowledge() -> u32 {
    TIM1.sr().write_value(regs::SrAdv(!(DUE | NEAR)));
    let prescaler = u32::from(TIM1.psc().read()) + 1;
    u32::from(TIM1.cnt().read().cnt()) * prescaler
}
