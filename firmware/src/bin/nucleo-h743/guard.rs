//! What holds when all else fails: a panic, a hard fault or the watchdog takes the
//! forces away first, then notes why, then starts over.

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use embassy_stm32::pac::{GPIOG, IWDG1, RCC, iwdg};
use shared::controller::Restart;

/// DAC RESET, PG14: low while nobody drives it, by a resistor.
pub const DAC_RESET: usize = 14;

/// Survives a restart, not the loss of power.
#[unsafe(link_section = ".uninit.note")]
static NOTE: AtomicU32 = AtomicU32::new(0);

/// Not what memory holds by chance when power comes.
const PANIC: u32 = 0x5AFE_0001;
const HARD_FAULT: u32 = 0x5AFE_0002;

/// Takes all forces away: the DAC goes to the middle of its range by itself, and stays
/// there until it is started again.
pub fn hold_safe() {
    GPIOG.bsrr().write(|w| w.set_br(DAC_RESET, true));
}

fn stop(why: u32) -> ! {
    hold_safe();
    NOTE.store(why, Ordering::SeqCst);
    SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    hold_safe();
    let (file, line) = info
        .location()
        .map_or(("?", 0), |at| (at.file(), at.line()));
    defmt::error!("panic at {=str}:{=u32}", file, line);
    stop(PANIC)
}

#[exception]
// SAFETY: cortex-m-rt wants it marked so; it touches one register and one atomic.
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    hold_safe();
    defmt::error!("hard fault at {=u32:#x}", frame.pc());
    stop(HARD_FAULT)
}

/// Why the processor started; asked once.
pub fn restart() -> Restart {
    let flags = RCC.rsr().read();
    RCC.rsr().modify(|w| w.set_rmvf(true));
    match NOTE.swap(0, Ordering::SeqCst) {
        _ if flags.porrstf() => Restart::Power,
        _ if flags.iwdg1rstf() => Restart::Watchdog,
        PANIC => Restart::Panic,
        HARD_FAULT => Restart::HardFault,
        _ => Restart::Pin,
    }
}

/// The independent watchdog. Once started it cannot be stopped.
pub struct Watchdog(());

impl Watchdog {
    /// Starts it: 50 ms, a thousand samples at 20 kHz.
    pub fn start() -> Self {
        let watchdog = Self(());
        IWDG1.kr().write(|w| w.set_key(iwdg::vals::Key::START));
        watchdog.set(NORMAL);
        watchdog
    }

    /// Loop and link are both alive.
    pub fn feed(&self) {
        IWDG1.kr().write(|w| w.set_key(iwdg::vals::Key::RESET));
    }

    /// Waits for something that takes seconds, legs at rest.
    pub fn while_slow<T>(act: impl FnOnce() -> T) -> T {
        let watchdog = Self(());
        watchdog.set(SLOW);
        let result = act();
        watchdog.set(NORMAL);
        result
    }

    /// `reload` counts of 32 kHz/64.
    fn set(&self, reload: u16) {
        while IWDG1.sr().read().0 != 0 {}
        IWDG1.kr().write(|w| w.set_key(iwdg::vals::Key::ENABLE));
        IWDG1.pr().write(|w| w.set_pr(iwdg::vals::Pr::DIVIDE_BY64));
        IWDG1.rlr().write(|w| w.set_rl(reload));
        while IWDG1.sr().read().0 != 0 {}
        self.feed();
    }
}

/// 50 ms, and 8 s for the erasing of a sector, of 128 KiB: 4 s at the most (data sheet).
const NORMAL: u16 = 25;
const SLOW: u16 = 4000;

unsafe extern "C" {
    static mut _stack_end: u32;
    static mut _stack_start: u32;
}

/// What the stack is painted with.
const PAINT: u32 = 0xC0DE_C0DE;

/// Paints what is not in use of the stack yet.
pub fn paint_stack() {
    let mut at = &raw mut _stack_end;
    let here = cortex_m::register::msp::read() as usize;
    // Below what this function itself may use.
    while (at as usize) < here.saturating_sub(512) {
        // SAFETY: between the stack's end and its pointer, where nothing lives.
        unsafe {
            at.write_volatile(PAINT);
            at = at.add(1);
        }
    }
}

/// Bytes of the stack that were never used.
pub fn unused_stack() -> u32 {
    let (mut at, top) = (&raw const _stack_end, &raw const _stack_start);
    let mut unused = 0;
    while at < top {
        // SAFETY: within the stack; words are read whole.
        let word = unsafe { at.read_volatile() };
        if word != PAINT {
            break;
        }
        unused += 4;
        // SAFETY: up to one past its top.
        at = unsafe { at.add(1) };
    }
    unused
}

// Copies the loop's code to where it runs, before anything of it is called: cortex-m-rt
// calls this first. The linker script gives both ends, aligned to words.
core::arch::global_asm!(
    ".section .text.__pre_init, \"ax\"",
    ".global __pre_init",
    ".type __pre_init, %function",
    ".thumb_func",
    "__pre_init:",
    "ldr r0, =__sitcm",
    "ldr r1, =__eitcm",
    "ldr r2, =__litcm",
    "0:",
    "cmp r0, r1",
    "beq 1f",
    "ldr r3, [r2], #4",
    "str r3, [r0], #4",
    "b 0b",
    "1:",
    "dsb",
    "isb",
    "bx lr",
);
