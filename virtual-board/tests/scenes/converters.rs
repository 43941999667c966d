//! Converters, their buses and the timer that drives them.

use shared::controller::Refusal;
use shared::controller::Restart;
use shared::link::{Reply, Request};
use shared::supervisor::{Cause, Mode};
use virtual_board::chips::{ad5676r, ad7606};
use virtual_board::peripherals::rcc::Reset;
use virtual_board::time::{MILLISECOND, Ticks};
use virtual_board::wires::{Level, pins};

use crate::lab::{Lab, Outcome};

/// A fault's ramp to the safe codes, 1,000 samples, and the samples until it is found.
const RAMP: Ticks = 52 * MILLISECOND;

/// The fault that a defect gives, and that the board still runs and answers.
fn found(lab: &mut Lab, since: Ticks, bound: Ticks) -> Outcome<Cause> {
    lab.board.run(500 * MILLISECOND)?;
    if !lab.board.resets.is_empty() {
        return Err(format!("reset: {:?}", lab.board.resets).into());
    }
    lab.safe_within(since, bound)?;
    let fault = lab.report()?.fault.ok_or("no fault")?;
    Ok(fault.cause)
}

#[test]
fn busy_stuck_high() -> Outcome {
    let mut lab = Lab::pushing()?;
    let since = lab.board.now();
    lab.board.bus_mut().adc.defect = Some(ad7606::Defect::BusyHigh);
    assert_eq!(found(&mut lab, since, RAMP)?, Cause::Lost);
    Ok(())
}

/// The interrupt comes after the longest conversion, so the codes are right all the same.
#[test]
fn busy_stuck_low_changes_no_code() -> Outcome {
    let run = |defect| -> Outcome<_> {
        let mut lab = Lab::new()?;
        lab.board.bus_mut().adc.defect = defect;
        lab.push()?;
        let codes: Vec<u16> = lab.board.output(0).iter().map(|(_, code)| *code).collect();
        Ok((codes, lab.report()?.fault))
    };
    let (sound, stuck) = (run(None)?, run(Some(ad7606::Defect::BusyLow))?);
    assert_eq!(sound, stuck);
    assert_eq!(sound.1, None);
    Ok(())
}

fn dead(line: ad7606::Line, level: bool) -> Outcome<Cause> {
    let mut lab = Lab::pushing()?;
    let since = lab.board.now();
    lab.board.bus_mut().adc.defect = Some(ad7606::Defect::Dead(line, level));
    // A code that stays is found after 2,000 samples.
    found(&mut lab, since, RAMP + 110 * MILLISECOND)
}

#[test]
fn a_cut_data_line_is_a_stuck_sensor() -> Outcome {
    use ad7606::Line::{DoutA, DoutB};
    for (line, level) in [(DoutA, false), (DoutA, true), (DoutB, false), (DoutB, true)] {
        let cause = dead(line, level)?;
        // Those whose last code was that already are found first.
        assert!(matches!(cause, Cause::Stuck(_)), "{cause:?}");
    }
    Ok(())
}

/// SPI4 or SPI5 never ends a transfer: the samples are lost, and the link still answers.
#[test]
fn a_dead_bus_of_the_adc() -> Outcome {
    for dead in [[false, true, false], [false, false, true]] {
        let mut lab = Lab::pushing()?;
        let since = lab.board.now();
        lab.board.bus_mut().kill_spi(dead);
        assert_eq!(found(&mut lab, since, RAMP)?, Cause::Lost, "{dead:?}");
    }
    Ok(())
}

/// SPI3 never ends a transfer: RESET takes the forces away.
#[test]
fn a_dead_bus_of_the_dac() -> Outcome {
    let mut lab = Lab::pushing()?;
    let since = lab.board.now();
    lab.board.bus_mut().kill_spi([true, false, false]);
    assert_eq!(found(&mut lab, since, MILLISECOND)?, Cause::Lost);
    assert_eq!(lab.board.bus().level(pins::DAC_RESET), Level::Low);
    Ok(())
}

/// A wire of the DAC breaks while it runs: writes seem to succeed, but it must be noticed.
#[test]
fn a_cut_wire_of_the_dac_is_noticed() -> Outcome {
    for defect in [ad5676r::Defect::SclkCut, ad5676r::Defect::SdiCut] {
        let mut lab = Lab::pushing()?;
        let since = lab.board.now();
        lab.board.bus_mut().dac.defect = Some(defect);
        lab.board.run(500 * MILLISECOND)?;
        lab.safe_within(since, 200 * MILLISECOND)
            .map_err(|why| format!("{defect:?}: {why}"))?;
        assert!(lab.report()?.fault.is_some(), "{defect:?}");
    }
    Ok(())
}

/// At start: RESET stays low, and the loop cannot be closed.
#[test]
fn a_dac_that_does_not_read_back() -> Outcome {
    for defect in [
        ad5676r::Defect::SdoCut(false),
        ad5676r::Defect::SdoCut(true),
        ad5676r::Defect::SclkCut,
        ad5676r::Defect::SdiCut,
    ] {
        let mut lab = Lab::off()?;
        lab.board.bus_mut().dac.defect = Some(defect);
        lab.board.run(50 * MILLISECOND)?;
        lab.safe_within(0, 0)?;
        assert_eq!(
            lab.board.bus().level(pins::DAC_RESET),
            Level::Low,
            "{defect:?}"
        );
        let report = lab.report()?;
        assert_eq!(
            report.fault.map(|fault| fault.cause),
            Some(Cause::Lost),
            "{defect:?}"
        );
        let refused = Reply::Refused(Refusal::Mode);
        assert_eq!(lab.ask(Request::Start)?, refused, "{defect:?}");
        assert!(lab.board.resets.is_empty());
    }
    Ok(())
}

/// The timer stops: no samples, so the watchdog is not fed.
#[test]
fn tim1_stopped() -> Outcome {
    let mut lab = Lab::pushing()?;
    let since = lab.board.now();
    let bus = lab.board.bus_mut();
    let sampling = bus.gate.sampling(since);
    bus.tim1.write(0x00, 0, sampling)?;
    let bite = 60 * MILLISECOND;
    lab.board.run(bite)?;
    lab.reset_within(Reset::Watchdog, since, bite)?;
    assert_eq!(lab.restart()?, Restart::Watchdog);
    lab.safe_within(since, bite)
}

/// Samples that come too late stop the loop.
#[test]
fn late_samples_are_a_fault() -> Outcome {
    let mut lab = Lab::pushing()?;
    let since = lab.board.now();
    lab.board.machine.set_cost(virtual_board::time::Cost {
        instruction: 1.0,
        // Some twenty accesses come before the latch, 25 µs after the sample.
        access: 400.0,
    });
    lab.board.run(200 * MILLISECOND)?;
    let report = lab.report()?;
    assert_eq!(report.fault.map(|fault| fault.cause), Some(Cause::Late));
    assert_ne!(report.mode, Mode::Testing);
    lab.safe_within(since, 2 * RAMP)
}
