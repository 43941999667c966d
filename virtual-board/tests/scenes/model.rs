//! The model itself: what is skipped makes no difference.

use virtual_board::time::MILLISECOND;

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
    println!("{}", lab.board.counts());
    let counts = &lab.board.bus().counts;
    let samples = lab.board.bus().adc.samples;
    assert!(samples - counts.instructions.count <= 2, "{samples}");
    // The longest masking is a part of the longest latency; the entry is twelve cycles.
    let entry = 12 * lab.board.bus().ticks.2;
    assert!(counts.masked + entry <= counts.latency.max);
    assert!(counts.latency.min >= entry);
    Ok(())
}
