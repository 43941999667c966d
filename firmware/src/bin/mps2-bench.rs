//! Instructions per controller step, counted on the emulated MPS2 board.
//!
//! Under `-icount shift=8` an instruction takes 256 ns of the board's time and
//! its 25 MHz SysTick moves on by 6.4. `cargo xtask bench` starts it so.
#![no_std]
#![no_main]

#[path = "mps2/stop.rs"]
mod stop;

use core::hint::black_box;

use cortex_m::Peripherals;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::entry;
use cortex_m_semihosting::hprintln;
use firmware::tables::metrology_frame;
use shared::LEGS;
use shared::codes::{AdcCode, LegForces};
use shared::step::{Clamp, Output, PiState, State, Status, pi, step};
use shared::table::Law;

type Six = [f32; LEGS];

/// SysTick counts for five instructions.
const TICKS_PER_FIVE: u32 = 32;

/// Calls per measurement; the counter's 24 bits hold 1,000 of 2,600
/// instructions.
const CALLS: u32 = 1000;

// Not inlined, so that each is a call with arguments and result as the empty
// ones are.

#[inline(never)]
fn empty_pi(_: &Law, _: &Six, _: &mut PiState, _: &Six, _: &Six) -> (Six, Clamp) {
    (black_box([0.0; LEGS]), Clamp::Idle)
}

#[inline(never)]
fn whole_pi(law: &Law, limits: &Six, state: &mut PiState, y: &Six, inject: &Six) -> (Six, Clamp) {
    pi(law, limits, state, y, inject)
}

#[inline(never)]
fn empty_step(_: &mut State, _: [AdcCode; LEGS]) -> Output {
    Output {
        dac: metrology_frame::TABLE.safe_codes(),
        status: Status {
            sensors_at_rail: 0,
            clamped: false,
            not_finite: false,
        },
    }
}

#[inline(never)]
fn whole_step(state: &mut State, adc: [AdcCode; LEGS]) -> Output {
    step(&metrology_frame::TABLE, state, adc, LegForces::ZERO)
}

/// Instructions per call, the loop around it included.
fn instructions(mut call: impl FnMut()) -> u32 {
    let start = SYST::get_current();
    for _ in 0..CALLS {
        call();
    }
    // Counts down, 24 bits.
    let ticks = start.wrapping_sub(SYST::get_current()) & 0x00FF_FFFF;
    (ticks * 5 + TICKS_PER_FIVE * CALLS / 2) / (TICKS_PER_FIVE * CALLS)
}

#[entry]
fn main() -> ! {
    let Some(mut peripherals) = Peripherals::take() else {
        panic!("the peripherals are taken once");
    };
    peripherals.SYST.set_clock_source(SystClkSource::Core);
    peripherals.SYST.set_reload(0x00FF_FFFF);
    peripherals.SYST.clear_current();
    peripherals.SYST.enable_counter();

    let table = metrology_frame::TABLE.get();
    let limits = table.actuators.map(|drive| drive.limit);
    // Small enough to stay clear of the clamp.
    let y = [1e-7; LEGS];
    let mut state = PiState::REST;
    let mut measure = |call: fn(&Law, &Six, &mut PiState, &Six, &Six) -> (Six, Clamp)| {
        instructions(|| {
            let (law, limits, y) = black_box((&table.law, &limits, &y));
            black_box(call(law, limits, &mut state, y, &LegForces::ZERO.0));
        })
    };
    let [empty, whole] = [empty_pi, whole_pi].map(&mut measure);
    hprintln!("  matrices, integrator and clamp  {:>4}", whole - empty);

    let mut state = State::settled_on(&metrology_frame::TABLE, [AdcCode(0); LEGS]);
    let adc = [AdcCode(1); LEGS];
    let mut measure = |call: fn(&mut State, [AdcCode; LEGS]) -> Output| {
        instructions(|| {
            black_box(call(&mut state, black_box(adc)));
        })
    };
    let [empty, whole] = [empty_step, whole_step].map(&mut measure);
    hprintln!("  whole step, codes to codes      {:>4}", whole - empty);
    stop::done()
}
