//! Gains of single channels that are known: the table corrects them, one by one.

use crate::common::{edited, looped, parse};

#[test]
fn known_gains_are_in_the_table() {
    let gains = "[1.0, 1.1, 0.9, 1.0, 1.02, 0.98]";
    let keys = [
        ("board.gains.acceleration", gains),
        ("board.gains.actuators", gains),
    ];
    let [plain, known] = [&[][..], &keys].map(|keys| {
        let (_, table, _) = looped(&edited(keys));
        *table.get()
    });
    for (i, gain) in [1.0, 1.1, 0.9, 1.0, 1.02, 0.98].into_iter().enumerate() {
        let sensor = known.sensors[i].gain / plain.sensors[i].gain * gain;
        let actuator = known.actuators[i].gain / plain.actuators[i].gain * gain;
        assert!(
            (sensor - 1.0).abs() < 1e-6 && (actuator - 1.0).abs() < 1e-6,
            "{i}"
        );
    }
    for (gain, said) in [
        ("20.0", "must be 0.1 to 10"),
        ("-1.0", "must be above 0"),
        ("0.0", "must be above 0"),
    ] {
        let gains = format!("[1.0, 1.0, 1.0, 1.0, 1.0, {gain}]");
        let error = parse(&edited(&[("board.gains.acceleration", &gains)])).unwrap_err();
        let error = error.to_string();
        assert!(error.contains(said), "{error}");
    }
}
