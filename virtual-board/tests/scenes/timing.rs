//! How long a sample takes: what the budget assumes, what late samples need, and how fast the
//! board can be.

use firmware::budget::{ACCESSES, DUE, GUARD};
use shared::link::Request;
use shared::supervisor::Mode;
use shared::table::Table;
use virtual_board::bus::Block;
use virtual_board::time::{Cost, MICROSECOND, MILLISECOND, Ticks, seconds};
use virtual_board::wires::{Level, Pin, pins};

use crate::lab::{Lab, Outcome, long};
use crate::storage::keep;

/// The latch of the image's table.
fn latch() -> Ticks {
    seconds(f64::from(firmware::tables::NUCLEO_H743.table.get().latch))
}

/// From a rise of CONVST to the next fall of LDAC.
fn latched(lab: &mut Lab) -> Outcome<Ticks> {
    let ends = |bus: &virtual_board::bus::Bus, pin: Pin, level| {
        let history = bus.recorder.history(pin)?;
        let change = history.changes().iter().rfind(|(_, to)| *to == level);
        change.map(|(at, _)| *at)
    };
    for pin in [pins::CONVST, pins::LDAC] {
        lab.board.bus_mut().watch(pin);
    }
    lab.board.run(MILLISECOND)?;
    let bus = lab.board.bus();
    let rose = ends(bus, pins::CONVST, Level::High).ok_or("no CONVST")?;
    let fell = ends(bus, pins::LDAC, Level::Low).ok_or("no LDAC")?;
    // If the sample came after the latch, the latch is that of the sample before.
    let period = seconds(1.0 / f64::from(firmware::tables::NUCLEO_H743.table.get().sample_rate));
    Ok(if fell > rose {
        fell - rose
    } else {
        fell + period - rose
    })
}

/// A board that pushes a leg while the link is busy, with these costs.
fn busy(cost: Cost) -> Outcome<Lab> {
    let mut lab = Lab::off()?;
    lab.board.machine.set_cost(cost);
    lab.board.run(50 * MILLISECOND)?;
    lab.push()?;
    let mut burst = Vec::new();
    for _ in 0..60 {
        burst.extend(lab.frame(Request::Report)?);
    }
    lab.board.send(&burst);
    lab.replies(60)?;
    Ok(lab)
}

/// The accesses to registers that the budget has, poll for poll: the end of the ADC's frame may be
/// asked for more than once.
#[test]
fn accesses() -> Outcome {
    let mut lab = Lab::pushing()?;
    let before = lab.board.bus().counts.clone();
    lab.board.run(20 * MILLISECOND)?;
    let counts = &lab.board.bus().counts;
    let samples = counts.instructions.count - before.instructions.count;
    let mut each = 0.0;
    for (place, [reads, writes]) in &counts.accesses {
        let [earlier_reads, earlier_writes] = before
            .accesses
            .iter()
            .find(|(at, _)| at == place)
            .map_or([0; 2], |(_, count)| *count);
        let count = (reads + writes - earlier_reads - earlier_writes) as f64 / samples as f64;
        // The core's own counter is no peripheral; SR of SPI4 is polled.
        each += match place {
            (Block::Dwt, _) => 0.0,
            (Block::Spi4, 0x14) => count.min(1.0),
            _ => count,
        };
    }
    let budget: u32 = ACCESSES.iter().sum();
    // Reading back makes one sample in two hundred different.
    assert!(
        (each - f64::from(budget)).abs() < 0.1,
        "{each} accesses, {budget} in the budget"
    );
    Ok(())
}

/// At the table's rate no sample is late, whatever instructions and accesses cost within
/// reason; the interrupt comes within 0.3 µs; and LDAC is where the table wants it.
#[test]
fn no_sample_is_late() -> Outcome {
    for instruction in [0.6, 1.0, 1.5] {
        for access in [10.0, 20.0, 40.0] {
            let cost = Cost {
                instruction,
                access,
            };
            let lab = &mut busy(cost)?;
            let late = lab.report()?.late;
            let health = lab.health()?;
            let counts = &lab.board.bus().counts;
            let us = |ticks: Ticks| ticks as f64 / MICROSECOND as f64;
            println!(
                "{instruction} cycles an instruction, {access} an access: codes in the DAC after \
                 {:.2} µs at most, longest sample {:.2} µs, jitter {} ns",
                us(counts.written.max),
                f64::from(health.longest) / 1000.0,
                health.jitter
            );
            assert_eq!(late, 0, "{cost:?}");
            assert!(counts.written.max < latch(), "{cost:?}");
            assert!(health.jitter < 300, "{cost:?}: {} ns", health.jitter);
            assert_eq!(latched(lab)?, latch(), "{cost:?}");
        }
    }
    Ok(())
}

/// The image's table at another rate.
fn at_rate(lab: &mut Lab, rate: f32) -> Outcome {
    let mut table: Table = *firmware::tables::NUCLEO_H743.table.get();
    table.sample_rate = rate;
    let table = table.validate().map_err(|why| format!("{why:?}"))?;
    keep(lab, &table)
}

/// At its highest rate the board takes every sample in time and answers.
#[test]
fn the_highest_rate() -> Outcome {
    let mut lab = Lab::new()?;
    let rate = firmware::budget::LIMITS.rate;
    at_rate(&mut lab, rate)?;
    lab.push()?;
    let before = lab.board.bus().adc.samples;
    lab.board.run(100 * MILLISECOND)?;
    let samples = lab.board.bus().adc.samples - before;
    assert!(samples.abs_diff((0.1 * rate) as u64) <= 1, "{samples}");
    let report = lab.report()?;
    let health = lab.health()?;
    let load = 100.0 * f64::from(health.longest) / f64::from(health.period);
    println!(
        "{rate} Hz: load {load:.0} % at the longest sample, codes handed over {} ns after the \
         interrupt, jitter {} ns",
        health.written, health.jitter
    );
    assert_eq!((report.late, report.mode), (0, Mode::Testing));
    assert!(load < 60.0 && health.jitter < 300);
    Ok(())
}

/// Sets the timer as the image would for a rate that it refuses.
fn force_rate(lab: &mut Lab, rate: f64) -> Outcome {
    let counts = |seconds: f64| (seconds * 240e6).round() as u32;
    let period = counts(1.0 / rate);
    let begin = counts(latch() as f64 / 480e9) % period;
    let end = (begin + counts(1e-6)).min(period - 1);
    let guard = (counts(DUE) + period - counts(f64::from(GUARD)).min(period)) % period;
    let now = lab.board.now();
    let bus = lab.board.bus_mut();
    let sampling = bus.gate.sampling(now);
    for (offset, value) in [
        (0x00, 0),
        (0x24, 0),
        (0x2C, period - 1),
        (0x3C, begin),
        (0x40, end),
        (0x58, guard),
        (0x00, 1),
    ] {
        bus.tim1.write(offset, value, sampling)?;
    }
    Ok(())
}

/// The rates at which the first sample comes too late, and at which the link has no time left:
/// beyond what the board admits.
#[test]
fn the_first_late_sample() -> Outcome {
    let most = f64::from(firmware::budget::LIMITS.rate);
    let (mut silent, mut late) = (None, None);
    let mut rate = most;
    while late.is_none() && rate < 250e3 {
        rate += if long() { 1e3 } else { 10e3 };
        let mut lab = Lab::pushing()?;
        force_rate(&mut lab, rate)?;
        lab.board.bus_mut().counts = Default::default();
        let frame = lab.frame(Request::Report)?;
        lab.board.send(&frame);
        lab.board.run(20 * MILLISECOND)?;
        if lab.board.received().is_empty() {
            silent.get_or_insert(rate);
        }
        let counts = &lab.board.bus().counts;
        if counts.overlapped > 0 || counts.written.max > latch() {
            late = Some(rate);
        }
    }
    println!("link silent from {silent:?} Hz, first late sample at {late:?} Hz");
    assert!(silent.is_none_or(|rate| rate > most) && late.is_some_and(|rate| rate > most));
    Ok(())
}
