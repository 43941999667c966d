//! The processor goes astray: panic, hard fault, stack overflow, a hang.

use shared::controller::Restart;
use virtual_board::peripherals::rcc::Reset;
use virtual_board::time::{MICROSECOND, MILLISECOND, Ticks};

use crate::lab::{Lab, Outcome};

/// Longest time until the DAC's RESET is low after a panic or fault: some hundred
/// instructions.
const SOON: Ticks = 5 * MICROSECOND;

/// The watchdog's time-out at its slowest oscillator.
const BITE: Ticks = 60 * MILLISECOND;

/// Where the processor goes astray.
#[derive(Clone, Copy)]
enum At {
    Main,
    Interrupt,
}

fn pushing(at: At) -> Outcome<Lab> {
    let mut lab = Lab::pushing()?;
    match at {
        At::Main => lab.run_into_main()?,
        At::Interrupt => lab.run_into_interrupt()?,
    }
    Ok(lab)
}

/// What follows a panic or a hard fault.
fn ends(mut lab: Lab, cause: Restart) -> Outcome {
    let since = lab.board.now();
    lab.board.run(MILLISECOND)?;
    lab.reset_within(Reset::Software, since, MILLISECOND)?;
    assert_eq!(lab.restart()?, cause);
    lab.safe_within(since, SOON)
}

fn panic_at(at: At) -> Outcome {
    let mut lab = pushing(at)?;
    // panic_bounds_check(1, 1, &Location of an empty file name).
    let panic = lab.function("panic_bounds_check")?;
    let empty = 0x2400_0000 + 0x7_FF00;
    lab.board.machine.poke(empty, &[0; 32]);
    for (register, value) in [(0, 1), (1, 1), (2, empty), (15, panic)] {
        lab.board.machine.set_register(register, value);
    }
    ends(lab, Restart::Panic)
}

#[test]
fn a_panic_in_main() -> Outcome {
    panic_at(At::Main)
}

#[test]
fn a_panic_in_the_interrupt() -> Outcome {
    panic_at(At::Interrupt)
}

fn undefined_at(at: At) -> Outcome {
    let mut lab = pushing(at)?;
    // udf #254, what the compiler puts where nothing may come.
    let undefined = lab.instruction(0xDEFE)?;
    lab.board.machine.set_register(15, undefined);
    ends(lab, Restart::HardFault)
}

#[test]
fn an_undefined_instruction_in_main() -> Outcome {
    undefined_at(At::Main)
}

#[test]
fn an_undefined_instruction_in_the_interrupt() -> Outcome {
    undefined_at(At::Interrupt)
}

/// A read where nothing is: ldr through a wild pointer.
#[test]
fn a_wild_pointer() -> Outcome {
    let mut lab = pushing(At::Main)?;
    // ldr r0, [r0]
    let load = lab.instruction(0x6800)?;
    lab.board.machine.set_register(0, 0x3FFF_0000);
    lab.board.machine.set_register(15, load);
    ends(lab, Restart::HardFault)
}

fn overflow_at(at: At) -> Outcome {
    let mut lab = pushing(at)?;
    lab.board.machine.set_register(13, 0x2000_0000);
    // push {r4, r5, r6, r7, lr}
    let push = lab.instruction(0xB5F0)?;
    lab.board.machine.set_register(15, push);
    ends(lab, Restart::HardFault)
}

#[test]
fn a_stack_overflow_in_main() -> Outcome {
    overflow_at(At::Main)
}

#[test]
fn a_stack_overflow_in_the_interrupt() -> Outcome {
    overflow_at(At::Interrupt)
}

/// An interrupt finds no room for its frame.
#[test]
fn a_stack_without_room_for_a_frame() -> Outcome {
    let mut lab = pushing(At::Main)?;
    lab.board.machine.set_register(13, 0x2000_0008);
    // b .
    let hang = lab.instruction(0xE7FE)?;
    lab.board.machine.set_register(15, hang);
    let since = lab.board.now();
    lab.board.run(MILLISECOND)?;
    // The next sample comes within a period.
    lab.reset_within(Reset::Software, since, MILLISECOND)?;
    assert_eq!(lab.restart()?, Restart::HardFault);
    lab.safe_within(since, 60 * MICROSECOND)
}

/// The link hangs: the loop goes on until the watchdog bites.
#[test]
fn a_hang_in_main() -> Outcome {
    let mut lab = pushing(At::Main)?;
    let hang = lab.instruction(0xE7FE)?;
    lab.board.machine.set_register(15, hang);
    let since = lab.board.now();
    lab.board.run(BITE)?;
    lab.reset_within(Reset::Watchdog, since, BITE)?;
    assert_eq!(lab.restart()?, Restart::Watchdog);
    lab.safe_within(since, BITE)
}

#[test]
fn a_hang_in_the_interrupt() -> Outcome {
    let mut lab = pushing(At::Interrupt)?;
    let hang = lab.instruction(0xE7FE)?;
    lab.board.machine.set_register(15, hang);
    let since = lab.board.now();
    lab.board.run(BITE)?;
    lab.reset_within(Reset::Watchdog, since, BITE)?;
    assert_eq!(lab.restart()?, Restart::Watchdog);
    lab.safe_within(since, BITE)
}
