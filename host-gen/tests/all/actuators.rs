//! Actuators by the figures of their data sheets.

use host_gen::analysis::controller::DesignAnalysis;
use host_gen::machine::{Machine, MachineError};
use host_gen::simulate::run::run;

use crate::common::{edited, looped, parse};

/// The legs have 8.389e6 N/m.
const STIFFNESS: f64 = 8.389e6;

/// The metrology frame with the actuator `spec` in place of its own.
fn with(spec: &str, more: &[(&str, &str)]) -> Result<Machine, MachineError> {
    let mut edits = vec![("board.actuator", spec)];
    edits.extend(more);
    parse(&edited(&edits))
}

fn piezo(more: &str) -> String {
    format!(
        "{{ piezo = {{ free_stroke = 32e-6, voltage = [-20.0, 120.0], amplifier_gain = 28.0, {more} }} }}"
    )
}

/// Force per volt and limit by hand: k·x/U·A, and half of the range. A blocked force and a stiffness
/// say the same as a free stroke.
#[test]
fn gain_and_limit_follow_from_the_data_sheet() {
    let machine = with(&piezo("stiffness = 50e6"), &[]).unwrap();
    let board = &machine.board;
    let gain = STIFFNESS * 32e-6 / 140.0 * 28.0;
    assert!((board.actuator_gain / gain - 1.0).abs() < 1e-12);
    // 2.5 V at the DAC are 70 V at the stack, which is half of its range.
    let half = 0.5 * STIFFNESS * 32e-6;
    assert!(
        (board.force_limit / half - 1.0).abs() < 1e-4,
        "{}",
        board.force_limit
    );
    assert_eq!(board.gains.actuators, [1.0; 6]);
    let same = "{ piezo = { blocked_force = 1600.0, stiffness = 50e6, voltage = [-20.0, 120.0], amplifier_gain = 28.0 } }";
    let same = with(same, &[]).unwrap();
    assert!((same.board.actuator_gain / gain - 1.0).abs() < 1e-12);
    // A weaker amplifier reaches less, an inverting one as far.
    let weak = piezo("").replace("28.0", "-14.0");
    let weak = with(&weak, &[]).unwrap();
    assert!((weak.board.actuator_gain / gain + 0.5).abs() < 1e-12);
    assert!((weak.board.force_limit / half - 0.5).abs() < 1e-4);
    // A softer leg pushes less with the same stack.
    let legs = "{ nodes = [\"n9\", \"n3\"], stiffness = { axial = 4.1945e6, bending = [371.0, 371.0], torsion = 5.84 } }";
    let apart = with(&piezo(""), &[("beams.leg4", legs)]).unwrap();
    let gains = apart
        .board
        .gains
        .actuators
        .map(|own| own * apart.board.actuator_gain);
    assert!((gains[0] / gains[1] - 0.5).abs() < 1e-12, "{gains:?}");
    assert!((gains[1] / gain - 1.0).abs() < 1e-12);
    assert!(apart.board.force_limit <= 0.5001 * half);
    // What was measured takes precedence.
    let measured = with(
        &piezo("").replace("{ piezo", "{ gain = 50.0, limit = 100.0, piezo"),
        &[("beams.leg4", legs)],
    )
    .unwrap();
    assert_eq!(measured.board.actuator_gain, 50.0);
    assert_eq!(measured.board.force_limit, 100.0);
    assert_eq!(measured.board.gains.actuators, [1.0; 6]);
    // A voice coil.
    let coil = with(
        "{ voice_coil = { force_constant = 20.0, amplifier_gain = 0.8, current = 1.5 } }",
        &[],
    )
    .unwrap();
    assert_eq!(coil.board.actuator_gain, 16.0);
    assert_eq!(coil.board.force_limit, 30.0);
    // The plain form is as before.
    let plain = with("{ gain = 100.0, limit = 200.0 }", &[]).unwrap();
    assert_eq!(plain.board, parse(&edited(&[])).unwrap().board);
    assert_eq!(plain.digest, parse(&edited(&[])).unwrap().digest);
}

/// A data sheet in a file that is based on another takes the place of what that says; what was measured
/// takes precedence over the data sheet below.
#[test]
fn a_data_sheet_replaces_what_is_below() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let below = write("below.toml", edited(&[]));
    let on = |name: &str, below: &std::path::Path, text: &str| {
        let text = format!("based_on = {below:?}\nname = {name:?}\n[board.actuator]\n{text}");
        let path = write(&format!("{name}.toml"), text);
        (Machine::load(&path).unwrap().board, path)
    };
    let sheet = "piezo = { free_stroke = 32e-6, voltage = [-20.0, 120.0], amplifier_gain = 28.0, hysteresis = 0.1 }";
    let (stack, path) = on("stack", &below, sheet);
    let gain = 0.8 * STIFFNESS * 32e-6 / 140.0 * 28.0;
    assert!(
        (stack.actuator_gain / gain - 1.0).abs() < 1e-12,
        "{}",
        stack.actuator_gain
    );
    assert!(stack.force_limit < 150.0);
    let (measured, _) = on("measured", &path, "gain = 45.0\nlimit = 90.0");
    assert_eq!((measured.actuator_gain, measured.force_limit), (45.0, 90.0));
    assert_eq!(measured.piezo.unwrap().hysteresis, 0.1);
    let coil = "voice_coil = { force_constant = 20.0, amplifier_gain = 0.8, current = 1.5 }";
    let (coil, _) = on("coil", &path, coil);
    assert_eq!((coil.actuator_gain, coil.piezo), (16.0, None));
}

/// Each wrong data sheet has its entry, its cause and its mend.
#[test]
fn wrong_data_sheets_are_refused() {
    let coil = "voice_coil = { force_constant = 20.0, amplifier_gain = 0.8, current = 1.5 }";
    for (spec, entry, words) in [
        (
            piezo("stiffness = 5e6"),
            "board.actuator.piezo.stiffness",
            "softer than the actuated beam \"leg4\"",
        ),
        (
            piezo("amplifier_current = 0.5"),
            "board.actuator.piezo",
            "missing key `capacitance`",
        ),
        (
            piezo("stiffness = 50e6, blocked_force = 300.0"),
            "board.actuator.piezo.blocked_force",
            "not of one stack",
        ),
        (
            piezo("hysteresis = 0.5"),
            "board.actuator.piezo.hysteresis",
            "0 to below 0.4",
        ),
        (
            piezo("creep = 0.2"),
            "board.actuator.piezo.creep",
            "0 to 0.1",
        ),
        (
            piezo("").replace("[-20.0, 120.0]", "[120.0, -20.0]"),
            "board.actuator.piezo.voltage",
            "low < high",
        ),
        (
            piezo("").replace("free_stroke = 32e-6,", ""),
            "board.actuator.piezo",
            "missing key `free_stroke`",
        ),
        (
            piezo("").replace("32e-6", "32.0"),
            "board.actuator.piezo.free_stroke",
            "micrometres",
        ),
        (
            piezo("").replace("{ piezo", &format!("{{ {coil}, piezo")),
            "board.actuator",
            "exclude each other",
        ),
        (
            "{ gain = 100.0 }".to_owned(),
            "board.actuator",
            "missing key `limit`",
        ),
        (
            "{ limit = 100.0 }".to_owned(),
            "board.actuator",
            "missing key `gain`",
        ),
        ("{}".to_owned(), "board.actuator", "missing key `gain`"),
        (
            piezo("").replace("{ piezo", "{ limit = 300.0, piezo"),
            "board.actuator.limit",
            "the DAC's range",
        ),
    ] {
        let error = with(&spec, &[]).unwrap_err();
        assert_eq!(error.entry(), entry, "{spec}: {error}");
        assert!(error.message().contains(words), "{spec}: {error}");
    }
    let soft = "{ nodes = [\"n9\", \"n3\"], stiffness = { axial = 0.0, bending = [371.0, 371.0], torsion = 5.84 } }";
    let error = with(&piezo(""), &[("beams.leg4", soft)]).unwrap_err();
    assert!(error.message().contains("makes no force"), "{error}");
}

/// A stack with hysteresis that moves small signals as far as one without is, on a quiet floor, the
/// same loop; `design` says what it is for large ones, and warns of what the harmonic balance finds.
#[test]
fn hysteresis_changes_large_signals() {
    let without = piezo("");
    // A longer stroke, of which small signals have 1 − 2·0.15.
    let with = piezo("hysteresis = 0.15").replace("32e-6", &format!("{:?}", 32e-6 / 0.7));
    let strong = piezo("hysteresis = 0.39").replace("32e-6", &format!("{:?}", 32e-6 / 0.22));
    let all = [without, with, strong].map(|spec| {
        let (study, table, design) = looped(&edited(&[("board.actuator", &spec)]));
        let board = &study.machine().board;
        let mut settings = study.machine().simulation;
        (settings.duration, settings.settling) = (5.0, 5.0);
        let found = run(study.plant(), board, &settings, table, true);
        let analysis = DesignAnalysis::new(study, design.clone()).unwrap();
        (
            found,
            serde_json::to_value(&analysis).unwrap()["actuators"].clone(),
        )
    });
    let [(linear, none), (curved, some), (_, much)] = all;
    assert_eq!(none["hysteresis"].as_array().unwrap().len(), 0);
    for (a, b) in linear.rms.iter().zip(&curved.rms) {
        assert!((a / b - 1.0).abs() < 0.1, "{a} {b}");
    }
    let amplitudes = some["hysteresis"].as_array().unwrap();
    let at = |i: usize, key: &str| amplitudes[i][key].as_f64().unwrap();
    // The whole range: the gain of small signals over 1 − 2H, and a lag of tan⁻¹(4·0.3/3π).
    let range = 0.5 * STIFFNESS * 32e-6;
    assert!((at(3, "force") / range - 1.0).abs() < 1e-3);
    let lag = (4.0 * 0.3 / (3.0 * core::f64::consts::PI)).atan();
    assert!((at(3, "lag_deg") / lag.to_degrees() - 1.0).abs() < 1e-3);
    assert!((at(3, "gain") * 0.7 * lag.cos() - 1.0).abs() < 1e-3);
    assert!(at(0, "peak_sensitivity") < 2.05, "{some}");
    assert!(at(0, "peak_sensitivity") < at(3, "peak_sensitivity"));
    // 4.5 times the gain is beyond the gain margin of this loop.
    let last = &much["hysteresis"][3]["peak_sensitivity"];
    assert!(last.is_null() || last.as_f64().unwrap() > 2.0, "{much}");
    assert!(much["warning"].is_string(), "{much}");
}
