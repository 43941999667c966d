//! The reference board's time, from the counted instructions.

use firmware::budget::{ADC_CLOCK, BEGIN, Budget, DAC_CLOCK, GUARD, LIMITS};
use firmware::converters::{ad5676r, ad7606};
use firmware::tables;

/// Of the Cortex-M7 with a modal law and the loop closed, from the kept baseline.
fn instructions(of: &str) -> f64 {
    let baseline = include_str!("../instructions.txt");
    let name = format!("mps2-an500 modal {of} ");
    let mut lines = baseline.lines();
    let line = lines.find_map(|line| line.strip_prefix(&name));
    line.unwrap().parse().unwrap()
}

/// Every sample is ready before the earliest latch that the board admits; at its highest rate
/// the longest leaves a microsecond to the link, before the time in which it begins nothing; and
/// none begins to write before the board says so.
#[test]
fn the_limits_hold_the_longest_sample() {
    let latch = instructions("closed latch");
    // One whose forces the clamp reduces.
    let longest = Budget::new(
        instructions("clamped longest"),
        instructions("clamped latch"),
    );
    assert!(instructions("closed longest") < instructions("clamped longest"));
    let (begun, ended) = LIMITS.written;
    assert!(longest.ready() < ended.into(), "{longest:?}");
    let left = 1.0 / f64::from(LIMITS.rate) - longest.busy() - f64::from(GUARD);
    assert!(left > 1e-6, "{longest:?}");
    let usual = Budget::new(instructions("closed"), latch);
    assert!(f64::from(begun) < BEGIN + usual.read, "{usual:?}");
    println!(
        "usual {:.1} µs, longest {:.1} µs, ready after {:.1} µs",
        1e6 * usual.busy(),
        1e6 * longest.busy(),
        1e6 * longest.ready()
    );
}

/// The converters' limits hold on the internal oscillator too, which is exact to 1 %, and the
/// longest conversion has ended when its frame begins.
#[test]
fn the_converters_limits_hold() {
    assert!(1.01 * ADC_CLOCK < f64::from(ad7606::CLOCK));
    assert!(1.01 * DAC_CLOCK < f64::from(ad5676r::CLOCK));
    const { assert!(0.99 * BEGIN > ad7606::CONVERSION) };
}

/// The board runs its own table, and neither the one with sensors it has no inputs for
/// nor one that is too fast.
#[test]
fn the_board_admits_its_own_table() {
    let own = tables::NUCLEO_H743.table;
    assert_eq!(LIMITS.admit(own), Ok(()));
    assert!(LIMITS.admit(tables::BOTH_SENSORS.table).is_err());
    let mut fast = *own.get();
    fast.sample_rate = 60e3;
    assert!(LIMITS.admit(&fast.validate().unwrap()).is_err());
}
