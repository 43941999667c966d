//! Machines other than the paper's: closed forms, published platforms, and
//! random ones.

use core::f64::consts::TAU;
use std::fmt::Write as _;

use crate::common::{model_text, rough, set, study};
use host_gen::closed_loop::ideal_poles;
use host_gen::design::Study;
use host_gen::plant::Plant;
use nalgebra::{Matrix6, Vector3};
use proptest::prelude::*;
use toml::{Table, Value};

/// One body on six legs, with axial stiffness `axial` and no other.
fn platform(
    feet: &[[f64; 3]; 6],
    tops: &[[f64; 3]; 6],
    cog: [f64; 3],
    axial: f64,
    gravity: [f64; 3],
) -> Study {
    let mut text = String::from(
        "format = 1\nname = \"platform\"\n[control]\nfeedback = \"force\"\nfrequency = 1.0\ndamping = 0.5\n\
         [board]\nsample_rate = 20e3\nconversion_delay = 0.0\noutput_delay = 40e-6\n\
         adc = { bits = 16, range = 10.0 }\ndac = { bits = 16, range = [0.0, 5.0] }\n\
         force_sensor = { sensitivity = 0.02 }\nactuator = { gain = 100.0, limit = 200.0 }\n",
    );
    text = format!("gravity = {gravity:?}\n{text}");
    let names = |prefix: &str| {
        let all: Vec<_> = (0..6).map(|i| format!("\"{prefix}{i}\"")).collect();
        all.join(", ")
    };
    writeln!(text, "[base]\nnodes = [{}]", names("foot")).unwrap();
    writeln!(
        text,
        "[bodies.top]\nmass = 1.0\ninertia = [1.0, 1.0, 1.0]\ncog = {cog:?}\nnodes = [{}]",
        names("top")
    )
    .unwrap();
    writeln!(text, "[nodes]").unwrap();
    for i in 0..6 {
        writeln!(text, "foot{i} = {:?}\ntop{i} = {:?}", feet[i], tops[i]).unwrap();
    }
    writeln!(text, "[beams]").unwrap();
    for i in 0..6 {
        writeln!(
            text,
            "leg{i} = {{ nodes = [\"foot{i}\", \"top{i}\"], stiffness = {{ axial = {axial:?}, bending = [0.0, 0.0], torsion = 0.0 }} }}"
        )
        .unwrap();
    }
    writeln!(text, "[actuators]\nbeams = [{}]", names("leg")).unwrap();
    let elongations = names("leg")
        .replace("\",", ".e1\",")
        .replace("5\"", "5.e1\"");
    writeln!(text, "[coordinates]\ndeformations = [{elongations}]").unwrap();
    writeln!(
        text,
        "[performance]\ndeformations = [\"leg0.e1\"]\n[sensors.force]"
    )
    .unwrap();
    for i in 0..6 {
        writeln!(text, "f{i} = {{ beam = \"leg{i}\" }}").unwrap();
    }
    writeln!(text, "[floor.inputs]").unwrap();
    // Three at one foot, two at the next, one at the third.
    for (i, d) in [(0, 0), (0, 1), (0, 2), (2, 1), (2, 2), (4, 2)]
        .into_iter()
        .enumerate()
    {
        let mut direction = [0.0; 3];
        direction[d.1] = 1.0;
        writeln!(
            text,
            "w{i} = {{ node = \"foot{}\", direction = {direction:?} }}",
            d.0
        )
        .unwrap();
    }
    study(&text)
}

/// Six points on a circle about z.
fn ring(radius: f64, z: f64, degrees: [f64; 6]) -> [[f64; 3]; 6] {
    degrees.map(|a| {
        let a = a.to_radians();
        [radius * a.cos(), radius * a.sin(), z]
    })
}

/// The six-leg platform whose static compliance Dehaeze printed.
#[test]
fn published_platform() {
    let feet = ring(0.115, 0.015, [-10.0, 10.0, 110.0, 130.0, 230.0, 250.0]);
    let tops = ring(0.090, 0.075, [-50.0, 50.0, 70.0, 170.0, 190.0, -70.0]);
    let study = platform(&feet, &tops, [0.0, 0.0, 0.135], 20e6, [0.0; 3]);
    let compliance = study.model().stiffness.clone().try_inverse().unwrap();
    for (axis, expected, unit) in [
        (0, 4.75e-8, 0.01e-8),
        (1, 4.75e-8, 0.01e-8),
        (2, 2.099e-8, 0.001e-8),
        (3, 5.186e-6, 0.001e-6),
        (4, 5.186e-6, 0.001e-6),
        (5, 1.7073e-6, 0.0001e-6),
    ] {
        let found = compliance[(axis, axis)];
        assert!(
            (found - expected).abs() <= 0.5 * unit,
            "axis {axis}: {found:e}"
        );
    }
}

/// The cubic six-leg configuration: six edges of a cube on its corner, k = 1.
/// At the cube's centre the stiffness is diag(2, 2, 2, L²/2, L²/2, 2L²).
#[test]
fn cubic_platform() {
    let length: f64 = 0.3;
    // Columns are the cube's edges; (1, 1, 1) stands up.
    let up = Vector3::new(1.0, 1.0, 1.0) / 3f64.sqrt();
    let x = Vector3::new(1.0, -1.0, 0.0) / 2f64.sqrt();
    let y = up.cross(&x);
    let corner = |bits: [f64; 3]| {
        let p = (Vector3::from(bits) - Vector3::repeat(0.5)) * length;
        [p.dot(&x), p.dot(&y), p.dot(&up)]
    };
    // The six edges that touch neither the lowest nor the highest corner.
    let (a, b, c) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let (ab, bc, ca) = ([1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]);
    let feet = [a, b, b, c, c, a].map(corner);
    let tops = [ab, ab, bc, bc, ca, ca].map(corner);
    let study = platform(&feet, &tops, [0.0; 3], 1.0, [0.0; 3]);
    let l2 = length * length;
    let expected = Matrix6::from_diagonal(&[2.0, 2.0, 2.0, 0.5 * l2, 0.5 * l2, 2.0 * l2].into());
    let found = study.model().stiffness.fixed_view::<6, 6>(0, 0) - expected;
    assert!(found.amax() < 1e-12, "{found}");
}

/// A body at the end of one beam, given by material and section, against the
/// cantilever's closed forms: δ = FL³/3EI, θ = FL²/2EI, and so on.
#[test]
fn cantilever() {
    let (e, g, area, iy, iz, j, length) = (70e9, 26e9, 4e-4, 2e-8, 5e-8, 6e-8, 0.8f64);
    let mut table: Table = model_text().parse().unwrap();
    table.remove("provenance");
    let mut put = |key: &str, value: &str| {
        let parsed: Table = format!("x = {value}").parse().unwrap();
        set(&mut table, key, parsed["x"].clone());
    };
    // The lens, cut loose from the frame, hangs on one beam from the base.
    put("nodes.wall", "[2.0, 0.0, 0.0]");
    put("nodes.tip", "[2.8, 0.0, 0.0]");
    put(
        "base.nodes",
        r#"["n9", "n11", "n13", "n15", "n17", "n19", "wall"]"#,
    );
    put(
        "bodies.lens.nodes",
        r#"["lens15", "lens16", "lens17", "tip"]"#,
    );
    put("bodies.lens.cog", "[2.8, 0.0, 0.0]");
    put(
        "profiles.block",
        "{ axial = 0.0, bending = [0.0, 0.0], torsion = 0.0 }",
    );
    put(
        "profiles.arm",
        &format!(
            "{{ youngs_modulus = {e:?}, shear_modulus = {g:?}, area = {area:?}, second_moments = [{iy:?}, {iz:?}], torsion_constant = {j:?} }}"
        ),
    );
    put(
        "beams.arm",
        r#"{ nodes = ["wall", "tip"], profile = "arm" }"#,
    );
    put(
        "coordinates.deformations",
        r#"["leg4.e1", "leg5.e1", "leg6.e1", "leg7.e1", "leg8.e1", "leg9.e1",
            "arm.e1", "arm.e2", "arm.e3", "arm.e4", "arm.e5", "arm.e6"]"#,
    );
    let study = study(&table.to_string());
    let model = study.model();
    let compliance = model
        .stiffness
        .view((6, 6), (6, 6))
        .into_owned()
        .try_inverse()
        .unwrap();
    // Local x is the file's x, z is z: e3 and e4 bend in x–z, with iy.
    let checks = [
        (0, 0, length / (e * area)),
        (1, 1, length.powi(3) / (3.0 * e * iz)),
        (2, 2, length.powi(3) / (3.0 * e * iy)),
        (3, 3, length / (g * j)),
        (4, 4, length / (e * iy)),
        (5, 5, length / (e * iz)),
        // An upward push turns the tip nose up: about −y.
        (4, 2, -length.powi(2) / (2.0 * e * iy)),
        // A push along y turns it about +z.
        (5, 1, length.powi(2) / (2.0 * e * iz)),
    ];
    for (row, column, expected) in checks {
        let found = compliance[(row, column)];
        assert!(
            (found / expected - 1.0).abs() < 1e-9,
            "({row}, {column}): {found:e} for {expected:e}"
        );
    }
    assert!(compliance[(2, 1)].abs() < 1e-15);
}

/// SPACAR's deformations, each by a motion that one sees at once. The first
/// connection block stands upright on the lens; its x is up and its y the
/// file's y.
#[test]
fn signs_of_deformations() {
    let study = crate::common::frame();
    let (machine, model) = (study.machine(), study.model());
    let beam = machine
        .beams
        .iter()
        .position(|b| b.name == "block15")
        .unwrap();
    let axes = machine.beams[beam].axes;
    assert!((axes.row(0).transpose() - Vector3::z()).norm() < 1e-12);
    assert!((axes.row(1).transpose() - Vector3::y()).norm() < 1e-12);
    let deform = |component: usize, body: usize, motion: [f64; 6]| {
        let d = host_gen::machine::Deformation { beam, component };
        let row = model.deformation(machine, d);
        (0..6).map(|i| row[6 * body + i] * motion[i]).sum::<f64>()
    };
    let (frame, lens) = (0, 1);
    // The frame rises: longer.
    assert!(deform(0, frame, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) > 0.0);
    // The lens rises: shorter.
    assert!(deform(0, lens, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) < 0.0);
    // The frame turns about the beam: twist, L times the angle.
    assert!((deform(1, frame, [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]) - 0.1).abs() < 1e-12);
    // The frame moves along local z, which is −x: both ends bend, one each way.
    let shift = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert!((deform(2, frame, shift) + 1.0).abs() < 1e-12);
    assert!((deform(3, frame, shift) - 1.0).abs() < 1e-12);
    // Along local y: likewise in the other plane.
    let shift = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0];
    assert!((deform(4, frame, shift) + (-1.0)).abs() < 1e-12);
    assert!((deform(5, frame, shift) + 1.0).abs() < 1e-12);
}

/// The metrology frame with everything moved: nodes, masses, full inertia
/// tensors, unequal legs, skew sensors.
fn random_machine() -> impl Strategy<Value = Table> {
    (
        prop::collection::vec(-0.05..0.05f64, 45),
        prop::collection::vec(0.5..2.0f64, 14),
        prop::collection::vec(-0.3..0.3f64, 24),
        (0.3..3.0f64, 0.05..0.95f64, any::<bool>()),
    )
        .prop_map(|(shifts, factors, skews, (frequency, damping, force))| {
            let mut table: Table = model_text().parse().unwrap();
            table.remove("provenance");
            let floats = |x: &[f64]| Value::Array(x.iter().map(|x| Value::Float(*x)).collect());
            let nodes = table["nodes"].as_table_mut().unwrap();
            for ((_, node), shift) in nodes.iter_mut().zip(shifts.chunks(3)) {
                for (x, dx) in node.as_array_mut().unwrap().iter_mut().zip(shift) {
                    *x = Value::Float(x.as_float().unwrap() + dx);
                }
            }
            for (i, body) in ["frame", "lens"].into_iter().enumerate() {
                let f = &factors[4 * i..];
                let s = &skews[3 * i..];
                set(
                    &mut table,
                    &format!("bodies.{body}.mass"),
                    Value::Float(800.0 * f[0]),
                );
                // The second moments of a mass distribution, J: off-diagonals within 0.3 of 15,
                // positive definite. Its inertia is tr J − J.
                let [x, y, z] = [30.0 * f[1], 30.0 * f[2], 40.0 * f[3]];
                let tensor = [
                    [y + z, -15.0 * s[0], -15.0 * s[1]],
                    [-15.0 * s[0], z + x, -15.0 * s[2]],
                    [-15.0 * s[1], -15.0 * s[2], x + y],
                ];
                let rows = tensor.iter().map(|row| floats(row)).collect();
                set(
                    &mut table,
                    &format!("bodies.{body}.inertia"),
                    Value::Array(rows),
                );
                let cog: Vec<f64> = s[3..6].iter().map(|x| 0.3 * x).collect();
                set(&mut table, &format!("bodies.{body}.cog"), floats(&cog));
            }
            for i in 0..6 {
                let f = factors[8 + i];
                let profile: Table = format!(
                    "axial = {:?}\nbending = [{:?}, {:?}]\ntorsion = {:?}",
                    8e6 * f,
                    400.0 * f,
                    300.0 / f,
                    6.0 * f
                )
                .parse()
                .unwrap();
                let beam = table["beams"][format!("leg{}", i + 4)]
                    .as_table_mut()
                    .unwrap();
                beam.remove("profile");
                beam.insert("stiffness".to_owned(), Value::Table(profile));
            }
            let sensors = table["sensors"]["acceleration"].as_table_mut().unwrap();
            for ((_, sensor), skew) in sensors.iter_mut().zip(skews[6..].chunks(3)) {
                let old = sensor["direction"].as_array().unwrap();
                let mut d = Vector3::from_fn(|i, _| old[i].as_float().unwrap() + skew[i]);
                d.normalize_mut();
                let inner = sensor.as_table_mut().unwrap();
                inner.insert("direction".to_owned(), floats(d.as_slice()));
            }
            set(&mut table, "control.frequency", Value::Float(frequency));
            set(&mut table, "control.damping", Value::Float(damping));
            if force {
                set(
                    &mut table,
                    "control.feedback",
                    Value::String("force".to_owned()),
                );
            }
            table
        })
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 60,
        rng_seed: prop::test_runner::RngSeed::Fixed(7),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// What the gains are for: on the design model all six modes come to ω_n
    /// with damping ζ_n. The eigenvalues come from a matrix that knows nothing
    /// of Eq. (19), Eq. (20) and Eq. (22).
    #[test]
    fn gains_place_all_poles(table in random_machine()) {
        let study = study(&table.to_string());
        let target = &study.machine().target;
        let plant = Plant::of_design_model(study.design_model());
        let poles = ideal_poles(&plant, study.gains()).unwrap();
        prop_assert_eq!(poles.len(), 12);
        for s in poles {
            // Rounding of a 6×6 with a condition of some 1e4.
            prop_assert!((s.norm() / (TAU * target.frequency) - 1.0).abs() < 1e-6, "{s}");
            prop_assert!((-s.re / s.norm() - target.damping).abs() < 1e-6, "{s}");
        }
    }

    /// A motion of the whole with the base deforms nothing, costs no energy,
    /// and is seen by the sensors as what it is.
    #[test]
    fn rigid_motion_deforms_nothing(table in random_machine(), b in prop::array::uniform6(-1.0..1.0f64)) {
        // Lift every beam off the base: then the whole can move.
        let study = study(&table.to_string());
        let model = study.model();
        let x = &model.ride * nalgebra::Vector6::from(b);
        for beam in study.machine().beams.iter().enumerate().filter(|(_, beam)| beam.name.starts_with("block")) {
            for component in 0..6 {
                let d = host_gen::machine::Deformation { beam: beam.0, component };
                let e = model.deformation(study.machine(), d).dot(&x);
                prop_assert!(e.abs() < 1e-12, "{} e{}: {e}", beam.1.name, component + 1);
            }
        }
        for sensor in study.machine().accelerometers.iter().flatten() {
            let (row, ride) = model.direction(study.machine(), sensor);
            let by_base = (ride * nalgebra::Vector6::from(b))[0];
            prop_assert!((row.dot(&x) - by_base).abs() < 1e-12);
        }
    }

    /// Far below the suspension the machine follows the floor; M_r of Eq. (2)
    /// and the floor inputs must fit each other for that.
    #[test]
    fn the_machine_follows_a_slow_floor(table in random_machine()) {
        let study = study(&table.to_string());
        let plant = &study.plant().plant;
        let floor = plant.rigid_floor.map(nalgebra::Complex::from);
        let whole = plant.response(0.01).from_floor(plant.whole()) * floor;
        let one = nalgebra::MatrixXx6::<nalgebra::Complex<f64>>::identity(6);
        // (0.01 Hz / 10 Hz)²
        prop_assert!((whole - one).camax() < 1e-5);
    }
}

/// Geometric stiffness, of loaded legs and of a body that turns under forces
/// on its arms: second differences of the exact potential energy, with finite
/// rotations and true leg lengths.
#[test]
fn stiffness_under_gravity_is_the_energys_curvature() {
    let feet = ring(0.5, 0.0, [-10.0, 15.0, 110.0, 130.0, 230.0, 255.0]);
    let tops = ring(0.4, 0.3, [-50.0, 50.0, 75.0, 170.0, 190.0, -70.0]);
    let (cog, axial) = ([0.05, -0.02, 0.7], 1e4);
    // Strong and slanting, so that every term counts.
    let gravity = [300.0, -200.0, -981.0];
    let study = platform(&feet, &tops, cog, axial, gravity);
    let cog = Vector3::from(cog);
    let legs: Vec<_> = (0..6)
        .map(|i| {
            let (foot, top) = (Vector3::from(feet[i]), Vector3::from(tops[i]));
            (
                foot,
                top - cog,
                (top - foot).norm(),
                study.model().statics.axial[i],
            )
        })
        .collect();
    let energy = |x: &nalgebra::Vector6<f64>| {
        let shift = x.fixed_rows::<3>(0);
        let turn = nalgebra::Rotation3::from_scaled_axis(x.fixed_rows::<3>(3).into_owned());
        let elastic: f64 = legs
            .iter()
            .map(|(foot, arm, length, force)| {
                let stretch = (cog + shift + turn * arm - foot).norm() - length;
                force * stretch + 0.5 * axial * stretch * stretch
            })
            .sum();
        // The body has 1 kg.
        elastic - Vector3::from(gravity).dot(&shift)
    };
    let step = 1e-3;
    let moved = |i: usize, a: f64, j: usize, b: f64| {
        let mut x = nalgebra::Vector6::zeros();
        x[i] += a * step;
        x[j] += b * step;
        energy(&x)
    };
    let found = study
        .model()
        .stiffness
        .fixed_view::<6, 6>(0, 0)
        .into_owned();
    for i in 0..6 {
        // Balance: the energy has no slope.
        let slope = (moved(i, 1.0, i, 0.0) - moved(i, -1.0, i, 0.0)) / (2.0 * step);
        assert!(slope.abs() < 0.1, "slope {i}: {slope}");
        for j in 0..6 {
            let curvature =
                (moved(i, 1.0, j, 1.0) - moved(i, 1.0, j, -1.0) - moved(i, -1.0, j, 1.0)
                    + moved(i, -1.0, j, -1.0))
                    / (4.0 * step * step);
            // Differences of fourth order: 1e-6 of the stiffness.
            assert!(
                (found[(i, j)] - curvature).abs() < 1e-5 * found.amax(),
                "({i}, {j}): {} for {curvature}",
                found[(i, j)]
            );
        }
    }
    // It matters here: the geometric part is some per cent of the whole.
    assert!(study.model().statics.geometric.amax() > 0.02 * found.amax());
}

/// One rigid body without a lens goes all the way to a table: its performance is
/// its own acceleration.
#[test]
fn one_body_without_a_lens() {
    let mut table: Table = model_text().parse().unwrap();
    table.remove("provenance");
    for (part, names) in [
        ("bodies", &["lens"][..]),
        ("beams", &["block15", "block16", "block17"]),
        ("nodes", &["lens15", "lens16", "lens17"]),
    ] {
        for name in names {
            table[part].as_table_mut().unwrap().remove(*name);
        }
    }
    let mut put = |key: &str, value: &str| {
        let parsed: Table = format!("x = {value}").parse().unwrap();
        set(&mut table, key, parsed["x"].clone());
    };
    put(
        "coordinates.deformations",
        r#"["leg4.e1", "leg5.e1", "leg6.e1", "leg7.e1", "leg8.e1", "leg9.e1"]"#,
    );
    put(
        "performance",
        r#"{ accelerations = { top = { node = "frame15", direction = [0.6, 0.0, 0.8] } } }"#,
    );
    put("robustness.payload", r#"["frame"]"#);
    let study = study(&table.to_string());
    // The design model is the machine: the modes are the same.
    for (full, rigid) in study
        .model()
        .modes()
        .hertz()
        .iter()
        .zip(study.design_model().hertz())
    {
        assert!((full / rigid - 1.0).abs() < 1e-9);
    }
    let zeros = host_gen::plant::zeros::transmission_zeros(
        &study.plant().plant.state_space,
        study.design_model().feedback,
    );
    assert_eq!(zeros.unwrap().len(), 0, "no internal modes, no zeros");
    assert!(Study::new(study.machine().drawn(0)).is_ok());
    let design = rough().design(&study).unwrap();
    assert!(design.peak_sensitivity.value <= 2.0);
    let run = |closed| {
        let settings = &study.machine().simulation;
        host_gen::simulate::run::run(
            study.plant(),
            &study.machine().board,
            settings,
            &design.table,
            closed,
        )
    };
    assert!(run(true).rms[0] < 0.1 * run(false).rms[0]);
}

/// A third body on the lens, held by one stout beam: eighteen degrees of
/// freedom, and the suspension still six modes by energy.
#[test]
fn a_second_payload() {
    let mut table: Table = model_text().parse().unwrap();
    table.remove("provenance");
    let mut put = |key: &str, value: &str| {
        let parsed: Table = format!("x = {value}").parse().unwrap();
        set(&mut table, key, parsed["x"].clone());
    };
    put("nodes.seat", "[0.1, 0.05, -0.2]");
    put("nodes.stage", "[0.1, 0.05, -0.35]");
    put(
        "bodies.lens.nodes",
        r#"["lens15", "lens16", "lens17", "seat"]"#,
    );
    put(
        "bodies.stage",
        r#"{ mass = 40.0, inertia = [0.8, 0.9, 0.7], cog = [0.12, 0.05, -0.4], nodes = ["stage"] }"#,
    );
    put(
        "beams.post",
        r#"{ nodes = ["seat", "stage"], stiffness = { axial = 6e8, bending = [4e6, 5e6], torsion = 3e6 } }"#,
    );
    put(
        "coordinates.deformations",
        r#"["leg4.e1", "leg5.e1", "leg6.e1", "leg7.e1", "leg8.e1", "leg9.e1",
            "block15.e1", "block15.e2", "block15.e3", "block15.e4", "block15.e5", "block15.e6",
            "post.e1", "post.e2", "post.e3", "post.e4", "post.e5", "post.e6"]"#,
    );
    let study = study(&table.to_string());
    assert_eq!(study.model().modes().squares.len(), 18);
    assert_eq!(study.machine().robustness.payload, [1, 2]);
    let modes = study.model().modes();
    let energies = host_gen::model::energy::energies(study.machine(), study.model(), &modes);
    let kinds = energies
        .iter()
        .filter(|e| e.kind == host_gen::model::energy::Kind::Suspension);
    assert_eq!(kinds.count(), 6);
    let poles = ideal_poles(&Plant::of_design_model(study.design_model()), study.gains()).unwrap();
    for s in poles {
        assert!((s.norm() / TAU - 1.0).abs() < 1e-6);
    }
    assert!(Study::new(study.machine().drawn(0)).is_ok());
    rough().design(&study).unwrap();
}
