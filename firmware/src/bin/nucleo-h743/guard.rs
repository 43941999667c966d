//! The response to a panic or a fault: remove the forces, store the cause, restart. And the
//! watchdog, whose reset removes the forces too.

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;
use embassy_stm32::pac::{GPIOE, GPIOG, IWDG1, RCC, iwdg};
use shared::controller::Restart;

use crate::sample;
use crate::shadow::in_handler;

/// Pin of the DAC's RESET, PG14. A resistor holds it low while the processor does not drive
/// it.
const DAC_RESET: usize = 14;

/// Pin that enables the amplifiers, PE11. A resistor holds it low, which is off, while the
/// processor does not drive it.
const AMPLIFIERS: usize = 11;

/// The stored cause of a restart; 0 for none. It survives a restart, but not a loss of power.
#[unsafe(link_section = ".uninit.note")]
#[unsafe(export_name = "NOTE")]
static NOTE: AtomicU32 = AtomicU32::new(0);

/// Stored for a panic. Memory is unlikely to hold this value by chance at power-up.
const PANIC: u32 = 0x5AFE_0001;

/// Stored for a hard fault.
const HARD_FAULT: u32 = 0x5AFE_0002;

/// Stored for a failure of the external clock.
const CLOCK: u32 = 0x5AFE_0003;

/// Removes all forces: switches the amplifiers off and holds the DAC in reset, so that its
/// outputs are in the middle of their range until it is started again.
pub fn hold_safe() {
    GPIOE.bsrr().write(|w| w.set_br(AMPLIFIERS, true));
    GPIOG.bsrr().write(|w| w.set_br(DAC_RESET, true));
}

/// Switches the amplifiers on.
pub fn enable_amplifiers() {
    GPIOE.bsrr().write(|w| w.set_bs(AMPLIFIERS, true));
}

/// Stores the cause, unless there is an earlier one.
fn note(why: u32) {
    if NOTE.load(Ordering::SeqCst) == 0 {
        NOTE.store(why, Ordering::SeqCst);
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    hold_safe();
    note(PANIC);
    // An interrupt may have come in the middle of a line of the log.
    if !in_handler() {
        let (file, line) = info
            .location()
            .map_or(("?", 0), |at| (at.file(), at.line()));
        defmt::error!("panic at {=str}:{=u32}", file, line);
    }
    SCB::sys_reset()
}

/// The clock security system has found that the external clock stands.
#[exception]
// SAFETY: cortex-m-rt requires `unsafe` here. The handler uses registers and one atomic.
unsafe fn NonMaskableInt() -> ! {
    hold_safe();
    note(CLOCK);
    SCB::sys_reset()
}

// A hard fault may be a stack that has overflowed, so nothing is pushed before the forces are
// removed, the cause is stored and the stack pointer is valid again. The order and the addresses
// are those of `hold_safe`.
core::arch::global_asm!(
    ".section .HardFault.user, \"ax\"",
    ".global HardFault",
    ".type HardFault, %function",
    ".thumb_func",
    "HardFault:",
    "ldr r0, ={gpioe}",
    "ldr r1, ={amplifiers}",
    "str r1, [r0, #0x18]",
    "ldr r0, ={gpiog}",
    "ldr r1, ={dac_reset}",
    "str r1, [r0, #0x18]",
    "ldr r0, =NOTE",
    "ldr r1, [r0]",
    "cbnz r1, 0f",
    "ldr r1, ={hard_fault}",
    "str r1, [r0]",
    "0:",
    "ldr r0, =_stack_start",
    "mov sp, r0",
    "b {restart}",
    ".ltorg",
    ".size HardFault, . - HardFault",
    gpioe = const 0x5802_1000_u32,
    gpiog = const 0x5802_1800_u32,
    amplifiers = const 1_u32 << (16 + AMPLIFIERS),
    dac_reset = const 1_u32 << (16 + DAC_RESET),
    hard_fault = const HARD_FAULT,
    restart = sym sys_reset,
);

extern "C" fn sys_reset() -> ! {
    SCB::sys_reset()
}

/// The cause of the start. To be called once: it clears the flags.
pub fn restart() -> Restart {
    let flags = RCC.rsr().read();
    RCC.rsr().modify(|w| w.set_rmvf(true));
    // The reset by a low supply voltage is also a part of every power-up. A stored cause came
    // before a watchdog that found the processor still at it.
    match NOTE.swap(0, Ordering::SeqCst) {
        _ if flags.porrstf() => Restart::Power,
        _ if flags.borrstf() => Restart::BrownOut,
        PANIC => Restart::Panic,
        HARD_FAULT => Restart::HardFault,
        CLOCK => Restart::Clock,
        _ if flags.iwdg1rstf() => Restart::Watchdog,
        _ => Restart::Pin,
    }
}

/// The independent watchdog. Once started it cannot be stopped.
pub struct Watchdog(());

impl Watchdog {
    /// Starts the watchdog with a time-out of 2 s, for clocks and converters that do not start.
    pub fn start() -> Self {
        let watchdog = Self(());
        IWDG1.kr().write(|w| w.set_key(iwdg::vals::Key::START));
        watchdog.set(START);
        watchdog
    }

    /// Sets the time-out to 50 ms, which is 1000 samples at 20 kHz.
    pub fn watch(&self) {
        self.set(NORMAL);
    }

    /// Restarts the time-out. To be called when both loop and link have run.
    pub fn feed(&self) {
        IWDG1.kr().write(|w| w.set_key(iwdg::vals::Key::RESET));
    }

    /// Restarts the time-out if the loop has run since the last call. For work of the link that
    /// takes long, after each of its many short steps.
    pub fn feed_if_sampled() {
        static SEEN: AtomicU32 = AtomicU32::new(0);
        let samples = sample::count();
        if SEEN.swap(samples, Ordering::Relaxed) != samples {
            Self(()).feed();
        }
    }

    /// Runs `act`, which may take seconds, with a longer time-out. The legs must be at rest.
    pub fn while_slow<T>(act: impl FnOnce() -> T) -> T {
        let watchdog = Self(());
        watchdog.set(SLOW);
        let result = act();
        watchdog.set(NORMAL);
        result
    }

    /// Sets the time-out to `reload` counts of 32 kHz/64.
    fn set(&self, reload: u16) {
        while IWDG1.sr().read().0 != 0 {}
        IWDG1.kr().write(|w| w.set_key(iwdg::vals::Key::ENABLE));
        IWDG1.pr().write(|w| w.set_pr(iwdg::vals::Pr::DIVIDE_BY64));
        IWDG1.rlr().write(|w| w.set_rl(reload));
        while IWDG1.sr().read().0 != 0 {}
        self.feed();
    }
}

/// Time-out of 2 s.
const START: u16 = 1000;

/// Time-out of 50 ms.
const NORMAL: u16 = 25;

/// Time-out of 8 s. Erasing a sector of 128 KiB takes up to 4 s (data sheet).
const SLOW: u16 = 4000;

unsafe extern "C" {
    static mut _stack_end: u32;
    static mut _stack_start: u32;
}

/// The value of stack words that were never used.
const PAINT: u32 = 0xC0DE_C0DE;

/// Fills the unused stack with [`PAINT`].
pub fn paint_stack() {
    let mut at = &raw mut _stack_end;
    let here = cortex_m::register::msp::read() as usize;
    // Leaves room for this function's own stack frame.
    while (at as usize) < here.saturating_sub(512) {
        // SAFETY: between the end of the stack and the stack pointer, which is unused.
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
        // SAFETY: an aligned word within the stack.
        let word = unsafe { at.read_volatile() };
        if word != PAINT {
            break;
        }
        unused += 4;
        // SAFETY: at most one past the top of the stack.
        at = unsafe { at.add(1) };
    }
    unused
}

// Copies the loop's code to ITCM before any of it is called: cortex-m-rt calls this first.
// The linker script defines both ends, aligned to words.
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
