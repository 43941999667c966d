//! The library of sensors against the figures of its sources, and in machine files.

use host_gen::closed_loop::SampledLoop;
use host_gen::design::Study;
use host_gen::machine::{Machine, MachineError, parts};
use toml::{Table, Value};

use crate::common::{parse, search};
use crate::edits::{edited, set};

/// The metrology frame with this table of accelerometers.
fn with(accelerometer: &str) -> Result<Machine, MachineError> {
    let mut table: Table = edited(&[]).parse().unwrap();
    let sensor: Table = accelerometer.parse().unwrap();
    set(&mut table, "board.accelerometer", Value::Table(sensor));
    parse(&table.to_string())
}

const G: f64 = 9.80665;

/// Noise in ng/√Hz and corners (±3 dB) as the sources state them.
#[test]
fn sensors_have_the_figures_of_their_sources() {
    for (name, noise, band) in [
        (
            "endevco-86",
            [(1.0, 37.0), (10.0, 7.0), (100.0, 3.0)],
            [0.003, 200.0],
        ),
        (
            "endevco-87-10",
            [(1.0, 90.0), (10.0, 25.0), (100.0, 10.0)],
            [0.02, 500.0],
        ),
    ] {
        let machine = with(&format!("sensor = \"{name}\"")).unwrap();
        let sensor = &machine.board.sensor;
        assert!((sensor.sensitivity * G / 10.0 - 1.0).abs() < 1e-5);
        for (hz, nano_g) in noise {
            let found = sensor.noise_density.at(hz) / (1e-9 * G);
            assert!(
                (found / nano_g - 1.0).abs() < 1e-3,
                "{name} {hz} Hz: {found}"
            );
        }
        let peak = sensor.resonance.unwrap();
        // −3 dB below, and +3 dB of a resonance above.
        assert_eq!(sensor.lower_corner.unwrap().hz(), band[0]);
        let ratio = band[1] / peak.hz;
        let gain = (1.0 - ratio * ratio)
            .hypot(2.0 * peak.damping * ratio)
            .recip();
        assert!((20.0 * gain.log10() - 3.0).abs() < 0.05, "{name}: {gain}");
    }
    let machine = with("sensor = \"adxl355\"\nsensitivity = 1.0").unwrap();
    let found = machine.board.sensor.noise_density.at(10.0) / (1e-6 * G);
    assert!((found / 22.5 - 1.0).abs() < 1e-3, "{found}");
}

/// Every entry is a sensor once its sensitivity is given, and says where it is from.
#[test]
fn the_whole_library_can_be_used() {
    for (kind, parts) in parts::all() {
        assert_eq!(kind, "accelerometer");
        for (name, part) in parts {
            with(&format!("sensor = \"{name}\"\nsensitivity = 2.0")).unwrap();
            assert!(part.source.len() > 20 && !part.assumed.is_empty(), "{name}");
        }
    }
}

/// Keys of the file come first, and the machine is the one with the figures written out.
#[test]
fn keys_of_the_file_override_the_library() {
    let named = with("sensor = \"endevco-86\"\nsensitivity = 20.0\nlower_corner = 0.01").unwrap();
    let written = with(
        "sensitivity = 20.0
         noise_density = [[1.0, 3.628e-7], [10.0, 6.865e-8], [100.0, 2.942e-8]]
         lower_corner = 0.01
         resonance = { hz = 370.0, damping = 0.02 }",
    )
    .unwrap();
    assert_eq!(named.board, written.board);
    assert_eq!(named.digest, written.digest);
}

#[test]
fn unknown_sensors_are_refused() {
    for (text, entry, says) in [
        (
            "sensor = \"endevco86\"",
            "sensor",
            "did you mean \"endevco-86\"?",
        ),
        (
            "sensor = \"endevco-87\"",
            "sensor",
            "did you mean \"endevco-8",
        ),
        (
            "sensor = \"geophone\"",
            "sensor",
            "accelerometer \"geophone\" does not exist; give its figures",
        ),
        ("sensor = 86", "sensor", "expected a string"),
        ("sensor = \"adxl355\"", "", "missing key `sensitivity`"),
    ] {
        let error = with(text).unwrap_err();
        let dot = if entry.is_empty() { "" } else { "." };
        assert_eq!(
            error.entry(),
            format!("board.accelerometer{dot}{entry}"),
            "{error}"
        );
        assert!(error.to_string().contains(says), "{error}");
        assert!(error.place().is_some(), "{error}");
    }
    let force = edited(&[("board.force_sensor.sensor", "\"x\"")]);
    let error = parse(&force).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("force sensor \"x\" does not exist; give"),
        "{error}"
    );
}

/// A variant of a file that names a sensor has its figures and none of those of the file below; what
/// belongs to the board stays.
#[test]
fn a_variant_may_name_another_sensor() {
    let folder = tempfile::tempdir().unwrap();
    let mut table: Table = edited(&[]).parse().unwrap();
    let below = "sensitivity = 20.0\nnoise_density = 1e-7\noffset = 2e-3\nbandwidth = 3e3";
    let below: Table = below.parse().unwrap();
    set(&mut table, "board.accelerometer", Value::Table(below));
    std::fs::write(folder.path().join("below.toml"), table.to_string()).unwrap();
    let variant = |keys: &str| {
        let file = folder.path().join("variant.toml");
        let text = format!("based_on = \"below.toml\"\n[board.accelerometer]\n{keys}");
        std::fs::write(&file, text).unwrap();
        Machine::load(&file)
    };
    let named = variant("sensor = \"endevco-86\"\nsensitivity = 5.0").unwrap();
    let alone = with("sensor = \"endevco-86\"\nsensitivity = 5.0\noffset = 2e-3").unwrap();
    assert_eq!(named.board, alone.board);
    // This library entry has no sensitivity, and that of another sensor does not stand in.
    let error = variant("sensor = \"adxl355\"").unwrap_err().to_string();
    assert!(error.contains("missing key `sensitivity`"), "{error}");
    let error = variant("sensor = \"endevco-68\"").unwrap_err().to_string();
    assert!(error.contains("variant.toml:3:"), "{error}");
}

/// A sensor that resonates within the band of the loop is fed back, and the loop stands it if the
/// resonance lies a little elsewhere.
#[test]
fn a_sensor_may_resonate_in_the_band_of_the_loop() {
    let machine = |more: &str| {
        let sensor = format!("{{ sensor = \"endevco-86\", sensitivity = 20.0{more} }}");
        let law = ("control.law", "\"modal\"");
        parse(&edited(&[law, ("board.accelerometer", &sensor)])).unwrap()
    };
    let study = Study::new(machine("")).unwrap();
    let design = search().design(&study).unwrap();
    assert!(design.bands[0].sampled_db < -50.0, "{:?}", design.bands);
    for resonance in [
        "{ hz = 370.0, damping = 0.02 }",
        "{ hz = 360.0, damping = 0.02 }",
        "{ hz = 380.0, damping = 0.02 }",
        "{ hz = 370.0, damping = 0.01 }",
    ] {
        let other = Study::new(machine(&format!(", resonance = {resonance}"))).unwrap();
        let closed = SampledLoop::new(other.plant(), &design.table);
        assert!(closed.is_stable_with(&[1.0]), "{resonance}");
    }
}
