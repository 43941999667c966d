//! Instructions per controller step, counted on the emulated MPS2 board.
//!
//! With `-icount shift=8` the emulator counts 256 ns per instruction, which are 6.4 counts of
//! the board's 25 MHz SysTick. `cargo xtask bench` starts it this way.
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
use firmware::tables::{both_sensors, metrology_frame};
use nalgebra::Matrix6;
use shared::LEGS;
use shared::codes::{AdcCode, Samples};
use shared::controller::Controller;
use shared::step::{Clamp, Demand, LawState, Output, State, Status, Values, force, step};
use shared::supervisor::{Event, Mode};
use shared::table::{Direct, Law, Paths, ValidTable};

/// SysTick counts for five instructions.
const TICKS_PER_FIVE: u32 = 32;

/// Calls per measurement. The 24 bits of the counter are enough for 1,000 calls of 2,600
/// instructions.
const CALLS: u32 = 1000;

// Not inlined, so that each is a call with the same arguments and result as the empty
// function that is subtracted.

#[inline(never)]
fn empty_law(_: &Law, _: &Values, _: &mut LawState, _: &[Values; 2]) -> (Values, Clamp) {
    (black_box([0.0; LEGS]), Clamp::Idle)
}

#[inline(never)]
fn whole_law(
    law: &Law,
    limits: &Values,
    state: &mut LawState,
    [w, f]: &[Values; 2],
) -> (Values, Clamp) {
    force(law, limits, state, w, f, &Demand::LAW)
}

#[inline(never)]
fn empty_step(table: &ValidTable, _: &mut State, _: Samples) -> Output {
    Output {
        dac: table.safe_codes(),
        status: Status {
            sensors_at_rail: 0,
            forces_at_rail: 0,
            clamped: false,
            not_finite: false,
        },
    }
}

#[inline(never)]
fn whole_step(table: &ValidTable, state: &mut State, adc: Samples) -> Output {
    step(table, state, adc, Demand::LAW)
}

/// Instructions per call, including the loop around it.
fn instructions(mut call: impl FnMut()) -> u32 {
    let start = SYST::get_current();
    for _ in 0..CALLS {
        call();
    }
    // The counter has 24 bits and counts down.
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

    measure("modal", &metrology_frame::TABLE);
    measure("both", &both_sensors::TABLE);
    // The same machine's table with arbitrary matrices.
    let mut direct = *metrology_frame::TABLE.get();
    direct.law.paths = Paths::Direct(Direct {
        roll_off: 0.1,
        proportional: Matrix6::from_element(1.0),
        integral: Matrix6::from_element(0.1),
    });
    let Ok(direct) = direct.validate() else {
        panic!("a table of finite numbers");
    };
    measure("direct", &direct);
    controller("modal", &metrology_frame::TABLE);
    controller("both", &both_sensors::TABLE);
    stop::done()
}

/// Number of samples that includes everything the controller does only now and then: the end
/// of a leg's measurement by the pilot, the end of a window of the monitors.
const SAMPLES: u32 = 30_000;

/// Prints the instructions of the complete controller with the loop closed, average and
/// maximum.
fn controller(name: &str, table: &ValidTable) {
    // There is no machine: the self-test passes with any answer, and the start takes no time.
    let mut t = *table.get();
    t.self_test.tolerance = 1e6;
    t.self_test.settle = 1;
    t.self_test.measure = 16;
    t.supervision.settle = 1;
    t.supervision.ramp = 2.0;
    t.supervision.stuck = 0;
    let Ok(table) = t.validate() else {
        panic!("a table that is one");
    };
    let mut controller = Controller::new(table, table.checksum(), &mut []);
    let samples = Samples {
        sensors: [AdcCode(1); LEGS],
        forces: [AdcCode(1); LEGS],
    };
    for event in [Event::SelfTest, Event::Start] {
        let _ = controller.ask(event);
        for _ in 0..200 {
            black_box(controller.on_sample(samples.into()));
        }
    }
    if controller.report().mode != Mode::Closed {
        panic!("the loop is to be closed");
    }
    let average = instructions(|| {
        black_box(controller.on_sample(black_box(samples.into())));
    });
    // Reading the counter takes a constant number of instructions, some thousands.
    let (mut least, mut most) = (u32::MAX, 0);
    for _ in 0..SAMPLES {
        let start = SYST::get_current();
        black_box(controller.on_sample(black_box(samples.into())));
        let ticks = start.wrapping_sub(SYST::get_current()) & 0x00FF_FFFF;
        let instructions = ticks * 5 / TICKS_PER_FIVE;
        (least, most) = (least.min(instructions), most.max(instructions));
    }
    hprintln!("{} sample {}", name, average);
    hprintln!("{} longest {}", name, average + most - least);
}

/// Prints name and instructions of law and step, which `cargo xtask bench` compares.
fn measure(name: &str, table: &ValidTable) {
    let law = &table.get().law;
    let limits = table.get().actuators.map(|drive| drive.limit);
    // Small enough not to be clamped.
    let w = [[1e-7; LEGS]; 2];
    let mut state = LawState::REST;
    let mut measure = |call: fn(&Law, &Values, &mut LawState, &[Values; 2]) -> (Values, Clamp)| {
        instructions(|| {
            let (law, limits, w) = black_box((law, &limits, &w));
            black_box(call(law, limits, &mut state, w));
        })
    };
    let [empty, whole] = [empty_law, whole_law].map(&mut measure);
    hprintln!("{} law {}", name, whole - empty);

    let mut state = State::settled_on(table, [AdcCode(0); LEGS].into());
    let adc = Samples {
        sensors: [AdcCode(1); LEGS],
        forces: [AdcCode(1); LEGS],
    };
    let mut measure = |call: fn(&ValidTable, &mut State, Samples) -> Output| {
        instructions(|| {
            black_box(call(black_box(table), &mut state, black_box(adc)));
        })
    };
    let [empty, whole] = [empty_step, whole_step].map(&mut measure);
    hprintln!("{} step {}", name, whole - empty);
}
