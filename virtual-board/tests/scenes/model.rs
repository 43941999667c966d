//! The model itself: what is skipped makes no difference.

use firmware::budget::{GUARD, LIMITS};
use virtual_board::time::{MILLISECOND, in_seconds};

use crate::lab::{Lab, Outcome};
use shared::link::Request;

/// With and without skipping: the same outputs at the same ticks, the same answers, the same
/// number of instructions.
#[test]
fn skipping_changes_nothing() -> Outcome {
    let run = |skips| -> Outcome<_> {
        let mut lab = Lab::off()?;
        lab.board.machine.idle_mut().skips = skips;
        lab.board.run(20 * MILLISECOND)?;
        lab.done(Request::SelfTest)?;
        lab.board.run(150 * MILLISECOND)?;
        let report = lab.report()?;
        let outputs = lab.board.output(0).to_vec();
        let counts = &lab.board.bus().counts;
        let passes = lab.board.machine.idle().passes;
        let seen = (
            report,
            outputs,
            lab.board.machine.instructions(),
            (counts.instructions, counts.latency, counts.response),
        );
        Ok((seen, passes))
    };
    let (all, none) = run(false)?;
    let (some, passes) = run(true)?;
    assert_eq!(none, 0);
    assert!(passes > 1_000, "{passes}");
    assert_eq!(all.1.len(), some.1.len());
    assert_eq!(all, some);
    Ok(())
}

/// The counters of the interrupt, printed; they agree with one another.
#[test]
fn counters() -> Outcome {
    let mut lab = Lab::pushing()?;
    lab.health()?;
    println!("{}\n{}", lab.board.measured(), lab.board.counts());
    let counts = &lab.board.bus().counts;
    let samples = lab.board.bus().adc.samples;
    assert!(samples - counts.instructions.count <= 2, "{samples}");
    // The longest masking is a part of the longest latency; the entry is twelve cycles.
    let entry = 12 * lab.board.bus().ticks.2;
    assert!(counts.masked + entry <= counts.latency.max);
    assert!(counts.latency.min >= entry);
    // Both halves of a sample are parts of it.
    assert!(counts.latch.min + counts.follow.max <= counts.instructions.max);
    assert!(counts.latch.max + counts.follow.min <= counts.instructions.max);
    assert_eq!(counts.late, 0);
    // At the highest rate, a sample ends before the time in which the link begins nothing.
    let end = in_seconds(counts.response.max) + f64::from(GUARD);
    assert!(end < 1.0 / f64::from(LIMITS.rate), "{end}");
    Ok(())
}

/// No critical section takes longer than the time before the loop's interrupt in which none
/// begins; requests of all lengths.
#[test]
fn critical_sections_are_short() -> Outcome {
    let mut lab = Lab::pushing()?;
    lab.board.machine.measure_masking();
    for request in [
        Request::Report,
        Request::Health,
        Request::Identity,
        Request::Snapshot(0),
        Request::Recording(0),
        Request::Telemetry(50),
        Request::Piece(0, [0; 256].into_iter().collect()),
        Request::Stop,
    ] {
        lab.ask(request)?;
    }
    lab.board.run(10 * MILLISECOND)?;
    let masking = lab.board.machine.masking().ok_or("nothing is measured")?;
    let microseconds = 1e6 * in_seconds(masking.longest);
    let function = lab.board.image.function(masking.before);
    println!(
        "longest time with the loop's interrupt masked: {microseconds:.2} µs of {}, before {} ({:#010x})",
        masking.count,
        function.map_or("?", |symbol| &symbol.name),
        masking.before
    );
    assert!(masking.count > 100, "{masking:?}");
    assert!(microseconds > 0.1, "{masking:?}");
    assert!(
        in_seconds(masking.longest) < f64::from(GUARD),
        "{masking:?}"
    );
    Ok(())
}
