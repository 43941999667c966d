//! The Monte Carlo run against machines edited by hand.

use crate::common::{Looped, edited, looped, study};
use host_gen::analysis::robustness::{PerturbedSpread, monte_carlo};
use host_gen::closed_loop::SampledLoop;
use host_gen::control::LinearLaw;
use nalgebra::Complex;

fn run(edits: &[(&str, &str)]) -> (Looped, PerturbedSpread) {
    let looped = looped(&edited(edits));
    let (study, table, shaped) = looped;
    let robust = monte_carlo(
        study,
        &study.machine().robustness,
        table,
        &shaped.bands,
        &(),
    )
    .unwrap();
    (looped, robust)
}

/// Where nothing varies, nothing moves, and the nominal machine is the one
/// that the roll-off was found on.
#[test]
fn without_variation_nothing_moves() {
    let ((study, _, shaped), robust) = run(&[
        ("robustness.mass", "0.0"),
        ("robustness.cog", "0.0"),
        ("robustness.leg_stiffness", "0.0"),
        ("robustness.damping", "0.0"),
        ("robustness.sensor_gain", "0.0"),
        ("robustness.misalignment", "0.0"),
        ("robustness.actuator_gain", "0.0"),
        ("robustness.delay", "0.0"),
        ("robustness.samples", "3"),
    ]);
    assert_eq!((robust.stable, robust.samples), (3, 3));
    let spread = robust.peak_sensitivity;
    assert_eq!((spread.min, spread.max), (spread.nominal, spread.nominal));
    assert!((spread.nominal - shaped.peak_sensitivity.value).abs() < 1e-9);
    for (moving, hz) in robust.open.iter().zip(study.model().modes().hertz()) {
        assert_eq!(moving.hz.min, moving.hz.max);
        assert!((moving.hz.nominal / hz - 1.0).abs() < 1e-9);
    }
    // The grid of the run is coarser than the search's.
    for (band, expected) in robust.bands.iter().zip(&shaped.bands) {
        assert!((band.sampled_db.nominal - expected.sampled_db).abs() < 0.05);
    }
}

/// Legs that vary alone, all within 10 %: no frequency moves by more than the
/// root of that, and they do move.
#[test]
fn legs_move_the_suspension() {
    let (_, robust) = run(&[
        ("robustness.mass", "0.0"),
        ("robustness.cog", "0.0"),
        ("robustness.samples", "60"),
    ]);
    for moving in &robust.open[..6] {
        let (low, high) = (
            moving.hz.min / moving.hz.nominal,
            moving.hz.max / moving.hz.nominal,
        );
        assert!(low > 0.9f64.sqrt() && high < 1.1f64.sqrt(), "{low} {high}");
        assert!(low < 0.995 && high > 1.005, "{low} {high}");
    }
}

/// The same on any number of cores, and another seed draws other machines.
#[test]
fn the_seed_decides() {
    let of = |seed: &str| {
        let (_, robust) = run(&[("robustness.samples", "8"), ("robustness.seed", seed)]);
        serde_json::to_value(robust).unwrap()
    };
    assert_eq!(of("1"), of("1"));
    assert_ne!(of("1"), of("2"));
}

/// A light payload against the same machine typed into a file: the poles of the
/// sampled loop under the nominal table.
#[test]
fn a_drawn_machine_is_one_that_could_be_typed() {
    let (_, table, _) = looped(&edited(&[]));
    let light = study(&edited(&[
        ("bodies.lens.mass", "681.28"),
        ("bodies.lens.inertia", "[58.36, 58.36, 39.32]"),
        ("bodies.lens.cog", "[0.02, -0.02, -0.08]"),
    ]));
    let closed = SampledLoop {
        plant: light.plant(),
        law: LinearLaw::new(table),
    };
    let stable = |s: &Complex<f64>| s.re < 0.0;
    assert!(closed.poles().unwrap().iter().all(stable));
    // It lies within what the run finds.
    let (_, robust) = run(&[("robustness.samples", "400")]);
    for (moving, hz) in robust.open.iter().zip(light.model().modes().hertz()) {
        assert!(
            hz > 0.99 * moving.hz.min && hz < 1.01 * moving.hz.max,
            "{hz}"
        );
    }
    assert_eq!(robust.stable, 400);
}

#[test]
fn bad_settings() {
    for (key, value, says) in [
        ("robustness.mass", "1.0", "below 1"),
        ("robustness.cog", "-0.1", "at least 0 m"),
        ("robustness.samples", "0", "at least 1"),
        (
            "robustness.payload",
            "[\"none\"]",
            "\"none\" does not exist",
        ),
    ] {
        let error = crate::common::parse(&edited(&[(key, value)]))
            .unwrap_err()
            .to_string();
        assert!(error.contains(key) && error.contains(says), "{error}");
    }
}
