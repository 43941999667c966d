//! Gravity and tilt: what horizontal accelerometers read of the weight, against a mass on a soft
//! spring and against a rigid body on a turning floor.

use core::f64::consts::TAU;

use host_gen::machine::Direction;
use nalgebra::{Complex, Vector3, Vector6};

use crate::common::{edited, study};

const DOWN: (&str, &str) = ("gravity", "[0.0, 0.0, -9.81]");

/// An accelerometer is a mass on a spring: its reading is minus the spring's deflection times k/m.
/// Here such a mass is part of the machine, so that what it reads of the weight follows from the
/// stiffness under gravity.
#[test]
fn an_accelerometer_reads_as_a_mass_on_a_spring() {
    let own = 200.0;
    let mass = 1e-3;
    let stiffness = format!("[{:e}, 1e6, 1e6]", mass * f64::powi(TAU * own, 2));
    let edits = [
        DOWN,
        ("nodes.probe", "[0.0, 0.5, 0.0]"),
        ("free.nodes", "[\"probe\"]"),
        (
            "point_masses.probe",
            "{ node = \"probe\", mass = 1e-3, inertia = [1e-7, 1e-7, 1e-7] }",
        ),
        (
            "springs.probe",
            &format!(
                "{{ nodes = [\"n3\", \"probe\"], stiffness = {stiffness}, rotational_stiffness = [1e3, 1e3, 1e3] }}"
            ),
        ),
        ("performance.deformations", "[]"),
        (
            "performance.accelerations",
            "{ frame = { node = \"n3\", direction = [1.0, 0.0, 0.0] }, probe = { node = \"probe\", direction = [1.0, 0.0, 0.0] } }",
        ),
        ("performance.bands", "{}"),
        // It would hold the mass back against the base.
        ("damping.modal", "0.0"),
    ];
    for (edits, tilts) in [(&edits[..], true), (&edits[1..], false)] {
        let study = study(&edited(edits));
        let plant = &study.plant().plant;
        let first = plant.performance().start;
        for hz in [0.3, 1.0, 4.0] {
            let response = plant.response(hz);
            // The deflection's second derivative is the difference of the accelerations.
            let scale = (own / hz).powi(2);
            let reads = |rows: host_gen::plant::Gain| rows.map(|z| z * scale);
            for (found, moved) in [
                (
                    response.from_legs(0..1),
                    response.from_legs(first..first + 2),
                ),
                (
                    response.from_floor(0..1),
                    response.from_floor(first..first + 2),
                ),
            ] {
                let moved = reads(moved);
                let expected = moved.row(1) - moved.row(0);
                let error = (&found - expected).norm() / found.norm();
                // The mass is slow by (hz/200)² itself.
                assert!(
                    error < 1.01 * (hz / own).powi(2) + 1e-5,
                    "{error:e} at {hz} Hz"
                );
            }
        }
        // And it is the weight that matters: at 0.3 Hz a leg tilts the machine more than it shakes it.
        let slow = plant.response(0.3);
        let (read, shaken) = (slow.from_legs(0..1), slow.from_legs(first..first + 1));
        let apart = (read - &shaken).norm() / shaken.norm();
        assert_eq!(apart > 1.0, tilts, "{apart}");
    }
}

/// On a floor that turns slowly about a horizontal axis, the machine turns with it. Along x, a point
/// at a height h above the axis has the acceleration h·θ̈, and an accelerometer there reads −g·θ more.
#[test]
fn a_turning_floor_tilts_the_machine() {
    let study = study(&edited(&[
        DOWN,
        ("performance.deformations", "[]"),
        (
            "performance.accelerations",
            "{ x = { node = \"n3\", direction = [1.0, 0.0, 0.0] } }",
        ),
        ("performance.bands", "{}"),
    ]));
    let (machine, model) = (study.machine(), study.model());
    let plant = &study.plant().plant;
    let about = Vector3::y();
    let sensor = machine.accelerometers.as_ref().unwrap()[0].node;
    for below in [-6.0, -1.0, 0.5, 3.0] {
        let pivot = machine.nodes[sensor].at - Vector3::z() * below;
        let along = |d: &Direction| {
            about
                .cross(&(machine.nodes[d.node].at - pivot))
                .dot(&d.direction)
        };
        let inputs = Vector6::from_iterator(machine.floor.iter().map(along));
        // The inputs of a rotation by one radian, so also of one rad/s².
        let inputs = inputs.map(Complex::from);
        for hz in [0.05, 0.2, 0.5] {
            let response = plant.response(hz);
            let of = |row: usize| (response.from_floor(row..row + 1) * inputs)[0];
            let weight = 9.81 / (TAU * hz).powi(2);
            // The machine follows to the square of the frequency over that of its modes, and leans by
            // about its sideways motion over a metre.
            let own = (TAU * model.modes().hertz()[0]).powi(2);
            let follows = 1.5 * ((TAU * hz).powi(2) * (below.abs() + weight) + 9.81 * weight) / own;
            let read = of(0) - (below + weight);
            assert!(read.norm() < follows, "{read} at {hz} Hz");
            let moved = of(plant.performance().start) - below;
            assert!(moved.norm() < follows, "{moved} at {hz} Hz");
        }
    }
}
