//! Forces and moments on the machine: compliance against the equation of motion, reciprocity, and
//! the response in time against that over frequency.

use core::f64::consts::TAU;

use host_gen::closed_loop::SampledLoop;
use host_gen::control::LinearLaw;
use host_gen::simulate::profile::Profile;
use host_gen::simulate::push::push;
use nalgebra::{DMatrix, DVector};

use crate::common::{edited, looped, parse, study};

/// A force on the lens, a moment on the frame, beside each other.
const LOADS: &str = "{ push = { node = \"lens15\", direction = [0.0, 0.6, 0.8] }, \
                      twist = { node = \"n3\", direction = [0.0, 0.0, 1.0], moment = true } }";

/// At rest and at any frequency, the displacements are (K − ω²M)⁻¹ times the loads, from the matrices
/// of Eq. (1), which know no modes; and a load displaces the node of another as far as that one
/// displaces its own.
#[test]
fn compliance_is_that_of_the_equation_of_motion() {
    let study = study(&edited(&[("loads", LOADS), ("damping.modal", "0.0")]));
    let (machine, model) = (study.machine(), study.model());
    let plant = study.loaded_plant().unwrap();
    let rows = plant.plant.performance();
    let outputs = machine.performance.len();
    assert_eq!(rows.len(), outputs + 2);
    // The moment: the motion of two points a metre apart, across the axis, over their distance, is
    // the rotation of the body that both belong to; and a couple at them does its work.
    let frame = &machine.loads[0].at;
    let along = |node: &str, axis: usize| {
        let mut direction = frame.clone();
        direction.node = machine
            .nodes
            .iter()
            .position(|own| own.name == node)
            .unwrap();
        direction.direction = nalgebra::Vector3::ith(axis, 1.0);
        model.direction(machine, &direction).0
    };
    // n5 and n7 are both at y = −0.25, at x = ∓0.433.
    let couple = (along("n7", 1) - along("n5", 1)) / 0.866_025_403_784_438;
    let push = model.direction(machine, frame).0;
    let forces = DMatrix::from_columns(&[push, couple]);
    for hz in [0.0, 3.0, 22.0, 60.0, 140.0] {
        let stiffness = &model.stiffness - &model.mass * (TAU * hz).powi(2);
        let moved: DMatrix<f64> = stiffness.lu().solve(&forces).unwrap();
        let expected = forces.transpose() * &moved;
        let found = if hz == 0.0 {
            plant
                .plant
                .at_rest(rows.clone())
                .map(nalgebra::Complex::from)
        } else {
            plant.plant.open(hz, rows.clone())
        };
        let largest = expected.amax();
        for i in 0..2 {
            for j in 0..2 {
                let error = (found[(outputs + i, j)] - expected[(i, j)]).norm();
                assert!(
                    error < 1e-9 * largest,
                    "{i} {j} at {hz} Hz: {error:e} of {largest:e}"
                );
            }
            // Loads that are not there.
            assert!(found.columns(2, 4).iter().all(|z| z.norm() == 0.0));
        }
        let both = [found[(outputs, 1)], found[(outputs + 1, 0)]];
        assert!((both[0] - both[1]).norm() < 1e-9 * largest);
    }
}

/// A sine for a long time, by the step of the firmware and its converters, has the amplitude of the
/// closed loop's response; and a step without control ends where the load at rest ends.
#[test]
fn the_response_in_time_is_that_over_frequency() {
    let (study, table, _) = looped(&edited(&[("loads", LOADS), ("damping.modal", "0.02")]));
    let plant = study.loaded_plant().unwrap();
    let rows = plant.plant.performance();
    let closed = SampledLoop {
        plant: &plant,
        law: LinearLaw::new(table),
    };
    let board = &study.machine().board;
    let own = study.machine().performance.len();
    for hz in [6.0, 25.0] {
        let period = (board.sample_rate / hz).round() as usize;
        let hz = board.sample_rate / period as f64;
        let periods = (20.0 * hz).round() as usize;
        let loads = (0..periods * period).map(|k| {
            let sine = (TAU * k as f64 / period as f64).sin();
            [20.0 * sine, 0.0, 0.0, 0.0, 0.0, 0.0]
        });
        let pushed = push(&plant, board, table, loads.collect(), true);
        assert_eq!(pushed.clamped_steps, 0);
        let gain = closed.close(hz, rows.clone());
        for i in [own, own + 1] {
            // The last two seconds, in whole periods.
            let last = &pushed.displacements[i][(periods - (2.0 * hz) as usize) * period..];
            let (mut sine, mut cosine) = (0.0, 0.0);
            for (k, x) in last.iter().enumerate() {
                let angle = TAU * k as f64 / period as f64;
                sine += x * angle.sin();
                cosine += x * angle.cos();
            }
            let found = sine.hypot(cosine) * 2.0 / last.len() as f64 / 20.0;
            let ratio = found / gain[(i, 0)].norm();
            // What is left of the begin after 18 s, and codes.
            assert!((ratio - 1.0).abs() < 0.02, "{i} at {hz} Hz: {ratio}");
        }
    }
    let step = Profile::step(0, 10.0, 0.1);
    let loads: Vec<_> = (0..400_000)
        .map(|k| step.at(f64::from(k) * plant.period))
        .collect();
    let pushed = push(&plant, board, table, loads, false);
    let end = plant.plant.at_rest(rows)[(own, 0)] * 10.0;
    let all = DVector::from_column_slice(&pushed.displacements[own]);
    let late = all.rows(380_000, 20_000).mean();
    assert!((late / end - 1.0).abs() < 1e-3, "{late:e} {end:e}");
    // Twice that, and less with damping, where one mode moves; several modes do not add up to more.
    let overshoot = all.amax() / end.abs();
    assert!((1.2..2.0).contains(&overshoot), "{overshoot}");
}

/// Wrong loads and profiles are refused with their place and cause.
#[test]
fn wrong_loads_are_refused() {
    for (key, value, entry, words) in [
        (
            "loads.a",
            "{ node = \"n9\", direction = [1.0, 0.0, 0.0] }",
            "loads.a.node",
            "does not yield",
        ),
        (
            "loads.a",
            "{ node = \"n4\", direction = [1.0, 0.0, 0.0] }",
            "loads.a.node",
            "n4",
        ),
        (
            "loads.a",
            "{ node = \"n3\", direction = [1.0, 1.0, 0.0] }",
            "loads.a.direction",
            "unit vector",
        ),
    ] {
        let error = parse(&edited(&[(key, value)])).unwrap_err();
        assert_eq!(error.entry(), entry);
        assert!(error.message().contains(words), "{error}");
    }
    let seven: Vec<_> = (0..7)
        .map(|i| {
            (
                format!("loads.l{i}"),
                "{ node = \"n3\", direction = [1.0, 0.0, 0.0] }",
            )
        })
        .collect();
    let seven: Vec<_> = seven
        .iter()
        .map(|(key, value)| (key.as_str(), *value))
        .collect();
    assert_eq!(parse(&edited(&seven)).unwrap_err().entry(), "loads");
    // What a load is has nothing to do with the controller.
    let with = parse(&edited(&[("loads", LOADS)])).unwrap();
    let without = parse(&edited(&[("loads", "{}")])).unwrap();
    assert_eq!(with.digest, without.digest);
    assert_eq!(with.search_inputs(), without.search_inputs());

    let read = |text: &str| Profile::read(text, &with.loads);
    let profile = read(
        "# stage\ntime [ms]; twist [N m]; push [kN]\n0; 0; 0\n10; 2; 0.1\n10; 2; 0.3\n30; 0; 0\n",
    )
    .unwrap();
    for (time, push, twist) in [
        (0.005, 50.0, 1.0),
        (0.01, 300.0, 2.0),
        (0.02, 150.0, 1.0),
        (1.0, 0.0, 0.0),
    ] {
        let [a, b, ..] = profile.at(time);
        assert!(
            (a - push).abs() < 1e-9 && (b - twist).abs() < 1e-9,
            "{a} {b} at {time} s"
        );
    }
    assert_eq!(profile.last_change(), 0.03);
    for (text, line, words) in [
        ("", None, "empty"),
        ("time, push\n", None, "no points"),
        (
            "time, pull\n0,0\n",
            Some(1),
            "neither time nor one of the loads \"push\", \"twist\"",
        ),
        ("push [N]\n0\n", Some(1), "no column of time"),
        ("time [s], push [lb]\n0,0\n", Some(1), "\"lb\" is no unit"),
        ("time [s], push\n0,0\n1,0\n0.5,1\n", Some(4), "must ascend"),
        (
            "time [s], push\n0,0\n1,x\n",
            Some(3),
            "\"x\" is not a number",
        ),
        ("time [s], push\n0,0\n1,0,0\n", Some(3), "3 values"),
        ("time [s], push, push\n0,0,0\n", Some(1), "twice"),
    ] {
        let error = read(text).unwrap_err();
        assert_eq!(error.line, line, "{text}: {error}");
        assert!(error.message.contains(words), "{text}: {error}");
    }
}
