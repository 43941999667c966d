//! Power, reset pin, brown-out: the processor starts anew.

use shared::controller::Restart;
use virtual_board::board::LEGS;
use virtual_board::chips::ad5676r::MIDDLE;
use virtual_board::peripherals::rcc::Reset;
use virtual_board::time::{MICROSECOND, MILLISECOND};
use virtual_board::wires::{Level, pins};

use crate::lab::{Lab, Outcome};

/// No output moves from power-on until the loop runs, and RESET rises once.
#[test]
fn power_on_moves_no_output() -> Outcome {
    let mut lab = Lab::off()?;
    lab.board.record(&[pins::DAC_RESET]);
    lab.board.run(50 * MILLISECOND)?;
    for leg in 0..LEGS {
        assert_eq!(lab.board.output(leg), [(0, MIDDLE)], "leg {leg}");
    }
    let history = lab
        .board
        .bus()
        .recorder
        .history(pins::DAC_RESET)
        .ok_or("recorded")?;
    let levels: Vec<Level> = history.changes().iter().map(|(_, level)| *level).collect();
    assert_eq!(levels, [Level::Low, Level::High]);
    assert_eq!(lab.restart()?, Restart::Power);
    assert!(lab.board.resets.is_empty());
    Ok(())
}

/// The resistor at the DAC's RESET acts at once.
#[test]
fn the_reset_pin_takes_the_forces_away() -> Outcome {
    let mut lab = Lab::pushing()?;
    let pressed = lab.board.now();
    lab.board.reset(Reset::Pin);
    assert_eq!(lab.restart()?, Restart::Pin);
    lab.safe_within(pressed, MICROSECOND)
}

/// As the reset pin, but with a cause of its own.
#[test]
fn a_brown_out_takes_the_forces_away_and_is_told() -> Outcome {
    let mut lab = Lab::pushing()?;
    let fell = lab.board.now();
    lab.board.reset(Reset::BrownOut);
    let restart = lab.restart()?;
    lab.safe_within(fell, MICROSECOND)?;
    assert!(
        restart != Restart::Pin && restart != Restart::Power,
        "told as {restart:?}"
    );
    Ok(())
}

/// Without the clock from the ST-LINK the board must not hang without a watchdog: it runs
/// from another clock, or is reset again and again, its outputs safe.
#[test]
fn without_hse_the_watchdog_runs() -> Outcome {
    let mut lab = Lab::off()?;
    lab.board.bus_mut().set_hse(false);
    lab.board.run(1_000 * MILLISECOND)?;
    lab.safe_within(0, 0)?;
    let samples = lab.board.bus().adc.samples;
    assert!(
        samples > 0 || !lab.board.resets.is_empty(),
        "neither samples nor a reset in a second"
    );
    Ok(())
}

/// USB is pulled while the legs are pushed: the clock from the ST-LINK stops.
#[test]
fn hse_lost_while_pushing_takes_the_forces_away() -> Outcome {
    let mut lab = Lab::pushing()?;
    let lost = lab.board.now();
    lab.board.bus_mut().set_hse(false);
    lab.board.run(500 * MILLISECOND)?;
    lab.safe_within(lost, 60 * MILLISECOND)
}
