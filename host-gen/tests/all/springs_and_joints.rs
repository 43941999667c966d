//! Springs of no length, point masses and the joints of beams against closed forms.

use std::f64::consts::{PI, TAU};

use host_gen::machine::{Machine, MachineError};
use host_gen::model::energy::energies;
use host_gen::model::gravity::buckling_load;
use host_gen::model::multibody::Multibody;
use nalgebra::{Matrix3, Matrix6, Vector3};
use toml::{Table, Value};

use crate::beams_with_mass::{
    LENGTH, SECOND, STEEL, TORSION, bending, beside, merge, model, nearest, rod, root,
};
use crate::common::parse;

/// Frequencies, Hz, ascending, of the modes whose kinetic energy is that of the part `name`.
fn of(text: &str, name: &str) -> Vec<f64> {
    let (machine, model) = model(text);
    let modes = model.modes();
    let all = modes
        .hertz()
        .into_iter()
        .zip(energies(&machine, &model, &modes));
    let own = all.filter(|(_, energies)| {
        let share = energies.kinetic.iter().find(|share| share.name == name);
        share.unwrap().share > 0.5
    });
    own.map(|(hz, _)| hz).collect()
}

fn hertz(square: f64) -> f64 {
    square.signum() * square.abs().sqrt() / TAU
}

#[track_caller]
fn same(found: &[f64], mut squares: Vec<f64>, tolerance: f64) {
    squares.sort_by(f64::total_cmp);
    assert_eq!(found.len(), squares.len(), "{found:?} {squares:?}");
    for (hz, square) in found.iter().zip(squares) {
        let exact = hertz(square);
        assert!((hz / exact - 1.0).abs() < tolerance, "{hz} {exact}");
    }
}

const MASS: f64 = 3.0;

/// A point mass at `lump`, and the node `wall` of the base; `more` joins them.
fn lump(wall: [f64; 3], lump: [f64; 3], inertia: &str, more: &str) -> String {
    beside(&format!(
        "[nodes]\nwall = {wall:?}\nlump = {lump:?}\n[base]\nnodes = [\"wall\"]\n[free]\nnodes = [\"lump\"]\n[point_masses.weight]\nnode = \"lump\"\nmass = {MASS:?}\n{inertia}\n{more}"
    ))
}

const INERTIA: [f64; 3] = [0.02, 0.03, 0.04];
const STIFFNESS: [f64; 3] = [2e6, 3e6, 5e6];
const TURNING: [f64; 3] = [4e4, 7e4, 9e4];

/// Beside its node by d: translations across x and rotations are coupled, two by two.
#[test]
fn a_spring_acts_midway_between_its_nodes() {
    let d = 0.05;
    let text = lump(
        [3.0 - 2.0 * d, 0.0, 0.0],
        [3.0, 0.0, 0.0],
        &format!("inertia = {INERTIA:?}"),
        &format!(
            "[springs.joint]\nnodes = [\"wall\", \"lump\"]\nstiffness = {STIFFNESS:?}\nrotational_stiffness = {TURNING:?}"
        ),
    );
    let [kx, ky, kz] = STIFFNESS;
    let [rx, ry, rz] = TURNING;
    let [jx, jy, jz] = INERTIA;
    let pair = |k: f64, r: f64, j: f64| {
        let (a, b) = (k / MASS, (r + k * d * d) / j);
        let apart = (0.5 * (a - b)).hypot(k * d / (MASS * j).sqrt());
        [0.5 * (a + b) - apart, 0.5 * (a + b) + apart]
    };
    let mut squares = vec![kx / MASS, rx / jx];
    squares.extend(pair(ky, rz, jz));
    squares.extend(pair(kz, ry, jy));
    same(&of(&text, "weight"), squares, 1e-9);
}

/// Each mode moves the mass along one of the spring's axes; the approximate y axis is (0, 1, 0).
#[test]
fn a_spring_is_turned_by_its_axes() {
    let text = lump(
        [3.0, 0.0, 0.0],
        [3.0, 0.0, 0.0],
        "",
        &format!(
            "[springs.joint]\nnodes = [\"wall\", \"lump\"]\nstiffness = {STIFFNESS:?}\nrotational_stiffness = {TURNING:?}\nx_axis = [2.0, 4.0, 4.0]\ny_axis = [0.0, 1.0, 0.0]"
        ),
    );
    let x = Vector3::new(1.0, 2.0, 2.0) / 3.0;
    let y = (Vector3::y() - x * x.y).normalize();
    let axes = [x, y, x.cross(&y)];
    let (machine, model) = model(&text);
    let modes = model.modes();
    let node = machine.nodes.iter().position(|node| node.name == "lump");
    for (k, axis) in STIFFNESS.iter().zip(axes) {
        let exact = hertz(k / MASS);
        let mut near = modes.hertz().into_iter();
        let near = near.position(|hz| (hz / exact - 1.0).abs() < 1e-9);
        let shape = modes.shapes.column(near.unwrap()).into_owned();
        let moved = model.translation(node.unwrap(), &shape);
        assert!(
            moved.cross(&axis).norm() < 1e-9 * moved.norm(),
            "{moved} {axis}"
        );
    }
}

/// Two masses in the open, tied to the base, and between them a spring with axes and negative parts.
fn pair(more: &str) -> String {
    let tie = |name: &str| {
        format!(
            "[springs.{name}]\nnodes = [\"wall\", \"{name}\"]\nstiffness = [1e6, 2e6, 3e6]\nrotational_stiffness = [1e5, 2e5, 3e5]\n[point_masses.{name}]\nnode = \"{name}\"\nmass = 2.0\ninertia = [0.1, 0.1, 0.1]\n"
        )
    };
    beside(&format!(
        "[damping]\nmodal = 0.0\n[nodes]\nwall = [3.0, 0.0, 0.0]\none = [3.1, 0.2, 0.3]\ntwo = [3.4, -0.1, 0.2]\n[base]\nnodes = [\"wall\"]\n[free]\nnodes = [\"one\", \"two\"]\n{}{}[springs.between]\nnodes = [\"one\", \"two\"]\nx_axis = [1.0, 1.0, 0.5]\ny_axis = [0.0, 1.0, 1.0]\n{more}",
        tie("one"),
        tie("two")
    ))
}

/// In a rigid motion of everything, a spring makes no force, and a damper in it neither; it does in
/// others.
#[test]
fn a_rigid_motion_makes_no_force() {
    let little = "stiffness = [1e-3, 0.0, 0.0]";
    let stiff = "stiffness = [3e5, -2e5, 4e5]\nrotational_stiffness = [2e4, 3e4, -1e4]";
    let damped =
        format!("{little}\ndamper = [10.0, 20.0, 30.0]\nrotational_damper = [4.0, 5.0, 6.0]");
    let [with, without] = [stiff, little].map(|more| model(&pair(more)).1);
    let own = &with.stiffness - &without.stiffness;
    let forces = (&own * &with.ride).amax();
    assert!(own.amax() > 1e5 && forces < 1e-9 * own.amax(), "{forces:e}");
    // D = M·V·Δ·Vᵀ·M: all motions have inertia.
    let (_, model) = model(&pair(&damped));
    let modes = model.modes();
    let momentum = &model.mass * &modes.shapes;
    let own = &momentum * modes.damping * momentum.transpose();
    let forces = (&own * &model.ride).amax();
    assert!(
        own.amax() > 10.0 && forces < 1e-7 * own.amax(),
        "{forces:e}"
    );
}

/// A joint of huge stiffness beside the tip of a rod, and a body that the tip carries.
#[test]
fn a_stiff_joint_is_a_rigid_connection() {
    let tip = [2.0 + LENGTH, 0.0, 0.0];
    let centre = [2.1 + LENGTH, 0.05, -0.1];
    let common = format!(
        "[nodes]\nroot = [2.0, 0.0, 0.0]\ntip = {tip:?}\n[base]\nnodes = [\"root\"]\n[beams.rod]\nnodes = [\"root\", \"tip\"]\nprofile = \"rod\"\n{}",
        rod(3)
    );
    let carried = beside(&format!(
        "{common}[bodies.load]\nmass = 2.0\ninertia = [0.01, 0.02, 0.025]\ncog = {centre:?}\nnodes = [\"tip\"]\n[coordinates]\ndeformations = [\"rod.e1\", \"rod.e2\", \"rod.e3\", \"rod.e4\", \"rod.e5\", \"rod.e6\"]\n"
    ));
    let mut joined: Table = beside(&format!(
        "{common}[free]\nnodes = [\"tip\", \"centre\"]\n[point_masses.load]\nnode = \"centre\"\nmass = 2.0\ninertia = [0.01, 0.02, 0.025]\n[springs.joint]\nnodes = [\"tip\", \"centre\"]\nstiffness = [1e14, 1e14, 1e14]\nrotational_stiffness = [1e12, 1e12, 1e12]\n"
    ))
    .parse()
    .unwrap();
    merge(
        &mut joined,
        "nodes".to_owned(),
        format!("centre = {centre:?}")
            .parse::<Table>()
            .unwrap()
            .into(),
    );
    let [carried, joined] =
        [carried, joined.to_string()].map(|text| model(&text).1.modes().hertz());
    assert_eq!(joined.len(), carried.len() + 6);
    let low = carried.iter().filter(|hz| **hz < 2e3);
    assert!(low.clone().count() > 20);
    for (a, b) in low.zip(&joined) {
        assert!((a / b - 1.0).abs() < 1e-5, "{a} {b}");
    }
}

/// A mass at a node of a body is part of that body, also by its weight.
#[test]
fn a_mass_on_a_body_is_part_of_it() {
    let mass = 40.0;
    let inertia = [1.0, 2.0, 2.5];
    let gravity = "gravity = [0.0, 0.0, -9.81]\n";
    let text = beside(&format!(
        "{gravity}[point_masses.box]\nnode = \"n3\"\nmass = {mass:?}\ninertia = {inertia:?}\n"
    ));
    let with = parse(&text).unwrap();
    let plain = parse(&beside(gravity)).unwrap();
    let body = &plain.bodies[0];
    let at = plain.nodes.iter().find(|node| node.name == "n3").unwrap();
    let total = body.mass + mass;
    let cog = (body.mass * body.cog + mass * at.at) / total;
    let steiner = |mass: f64, at: &Vector3<f64>| {
        let arm = at - cog;
        mass * (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose())
    };
    let tensor = body.inertia
        + Matrix3::from_diagonal(&inertia.into())
        + steiner(body.mass, &body.cog)
        + steiner(mass, &at.at);
    let mut file = plain.description().clone();
    let entry = &mut file.bodies[&body.name];
    entry.mass = total;
    entry.cog = cog.into();
    entry.inertia = host_gen::machine::file::Inertia::Tensor(tensor.into());
    let one = Machine::build(file).unwrap();
    let [with, one, plain] =
        [with, one, plain].map(|machine| Multibody::new(&machine).unwrap().modes().hertz());
    let mut moved = 0.0_f64;
    for ((a, b), without) in with.iter().zip(&one).zip(&plain) {
        assert!((a / b - 1.0).abs() < 1e-8, "{a} {b}");
        moved = moved.max((a / without - 1.0).abs());
    }
    assert!(moved > 0.01, "{moved}");
}

/// Half of the stiffness is taken away, or twice of it: then the mass leaves as e^(t·√(k/m)).
#[test]
fn a_negative_stiffness_softens() {
    let k = 2e6;
    let with = |negative: f64| {
        let held = "rotational_stiffness = [1e5, 1e5, 1e5]";
        lump(
            [3.0, 0.0, 0.0],
            [3.0, 0.0, 0.0],
            "",
            &format!(
                "[springs.plus]\nnodes = [\"wall\", \"lump\"]\nstiffness = [{k:?}, 7e6, 9e6]\n{held}\n[springs.minus]\nnodes = [\"wall\", \"lump\"]\nstiffness = [{negative:?}, 0.0, 0.0]\n"
            ),
        )
    };
    for negative in [-0.5 * k, -2.0 * k] {
        let squares = vec![(k + negative) / MASS, 7e6 / MASS, 9e6 / MASS];
        same(&of(&with(negative), "weight"), squares, 1e-9);
    }
    let (machine, model) = model(&with(-0.5 * k));
    let modes = model.modes();
    let exact = hertz(0.5 * k / MASS);
    let all = modes
        .hertz()
        .into_iter()
        .zip(energies(&machine, &model, &modes));
    let own = all.map(|(hz, energies)| ((hz / exact - 1.0).abs(), energies));
    let (_, own) = own.min_by(|(a, _), (b, _)| a.total_cmp(b)).unwrap();
    for (name, share) in [("plus", 2.0), ("minus", -1.0)] {
        let found = own.strain.iter().find(|part| part.name == name).unwrap();
        assert!((found.share - share).abs() < 1e-9, "{name} {}", found.share);
    }
}

/// c/m and c/J on the diagonal of the modal damping; a loss factor gives half of it.
#[test]
fn a_spring_damps() {
    let damped = |more: &str| {
        let text = lump(
            [3.0, 0.0, 0.0],
            [3.0, 0.0, 0.0],
            &format!("inertia = {INERTIA:?}"),
            &format!(
                "[springs.joint]\nnodes = [\"wall\", \"lump\"]\nstiffness = {STIFFNESS:?}\nrotational_stiffness = {TURNING:?}\n{more}\n[damping]\nmodal = 0.0"
            ),
        );
        let (_, model) = model(&text);
        let modes = model.modes();
        move |square: f64| {
            let exact = hertz(square);
            let mut near = modes.hertz().into_iter();
            let near = near.position(|hz| (hz / exact - 1.0).abs() < 1e-9).unwrap();
            modes.damping[(near, near)]
        }
    };
    let rate = damped("damper = [10.0, 20.0, 30.0]\nrotational_damper = [0.4, 0.5, 0.6]");
    for i in 0..3 {
        let [c, turning] = [10.0 * (i as f64 + 1.0), 0.4 + 0.1 * i as f64];
        for (found, exact) in [
            (rate(STIFFNESS[i] / MASS), c / MASS),
            (rate(TURNING[i] / INERTIA[i]), turning / INERTIA[i]),
        ] {
            assert!((found / exact - 1.0).abs() < 1e-9, "{found} {exact}");
        }
    }
    let rate = damped("loss_factor = 0.02");
    let omega = (STIFFNESS[0] / MASS).sqrt();
    assert!((rate(omega * omega) / (0.02 * omega) - 1.0).abs() < 1e-9);
}

fn with_gravity(text: &str) -> String {
    let mut table: Table = text.parse().unwrap();
    let down = [0.0, 0.0, -9.81].map(Value::Float).to_vec();
    table.insert("gravity".to_owned(), Value::Array(down));
    table.to_string()
}

/// A pendulum on a joint with bending springs, upright and hanging: k ∓ m·g·h over J + m·h².
#[test]
fn a_weight_on_a_joint_swings() {
    let h = 0.4;
    let [jx, jy, _] = INERTIA;
    for (side, hold) in [(1.0, [60.0, 90.0]), (-1.0, [0.0, 1.0])] {
        let [rx, ry] = hold;
        let text = with_gravity(&lump(
            [3.0, 0.0, -side * h],
            [3.0, 0.0, side * h],
            &format!("inertia = {INERTIA:?}"),
            &format!(
                "[springs.joint]\nnodes = [\"wall\", \"lump\"]\nstiffness = [1e10, 1e10, 1e10]\nrotational_stiffness = [{rx:?}, {ry:?}, 1e5]\n"
            ),
        ));
        let found = of(&text, "weight");
        let falls = side * MASS * 9.81 * h;
        for (r, j) in [(rx, jx), (ry, jy)] {
            let part = nearest(&found, hertz((r - falls) / (j + MASS * h * h)));
            assert!(part.abs() < 1e-6, "{side} {r}: {part:e}");
        }
    }
}

/// A rod between two nodes of the base, with joints at its ends.
fn rod_on_joints(joints: &str, segments: usize) -> String {
    beside(&format!(
        "[nodes]\nroot = [2.0, 0.0, 0.0]\nfar = [{:?}, 0.0, 0.0]\n[base]\nnodes = [\"root\", \"far\"]\n[beams.rod]\nnodes = [\"root\", \"far\"]\nprofile = \"rod\"\njoints = {joints}\n{}",
        2.0 + LENGTH,
        rod(segments)
    ))
}

/// sin = 0 between two hinges, tan = tanh with one end fixed; quarter waves of torsion where a ball
/// joint releases it. The error of cubic elements is (β/n)⁴/1440 to leading order.
#[test]
fn a_rod_on_joints_has_its_modes() {
    let n = 12;
    let hinged = |k: usize| PI * k as f64;
    let one_fixed = |k: usize| {
        let middle = (k as f64 + 0.25) * PI;
        root(|x| x.tan() - x.tanh(), middle - 0.3, middle + 0.3)
    };
    let [_, g, density] = STEEL;
    let polar = SECOND.iter().sum::<f64>();
    let quarter = (g * TORSION / (density * polar)).sqrt() / (4.0 * LENGTH);
    for (joints, root) in [
        (
            "[\"ball\", \"universal\"]",
            &hinged as &dyn Fn(usize) -> f64,
        ),
        ("[\"ball\", \"fixed\"]", &one_fixed),
        ("[\"fixed\", [\"rz\", \"ry\", \"rx\"]]", &one_fixed),
    ] {
        let found = of(&rod_on_joints(joints, n), "rod");
        for k in 1..=3 {
            let beta = root(k);
            let leading = (beta / n as f64).powi(4) / 1440.0;
            for second in SECOND {
                let part = nearest(&found, bending(beta, second));
                assert!(
                    part > -1e-9 && part < 1.5 * leading,
                    "{joints} {k}: {part:e} {leading:e}"
                );
            }
        }
        // Linear along the beam: the error falls with the square of an element's length, or faster.
        let finer = nearest(&of(&rod_on_joints(joints, 2 * n), "rod"), quarter);
        let (part, rate) = (nearest(&found, quarter), 1.9..3.1);
        let fallen = (part / finer).log2();
        assert!(rate.contains(&fallen), "{joints}: {part:e} {finer:e}");
    }
    // A hinge about the local y axis alone: bending in the x–z plane.
    let found = of(&rod_on_joints("[[\"ry\"], [\"ry\"]]", n), "rod");
    let clamped = root(|x| x.cos() * x.cosh() - 1.0, 4.5, 5.0);
    for (beta, second) in [(PI, SECOND[0]), (clamped, SECOND[1])] {
        let part = nearest(&found, bending(beta, second));
        assert!(part.abs() < 1e-3, "{part:e}");
    }
}

/// A mass on a column of a frame that does not turn at the top: 12·EI/L³, a quarter of it with a
/// hinge at one end, and nothing but a spring beside it with hinges at both.
#[test]
fn a_hinged_column_is_softer() {
    let axial = 1e9;
    let beside_it = [2e4, 3e4];
    for (joints, [in_xz, in_xy]) in [
        ("[\"fixed\", \"fixed\"]", [12.0, 12.0]),
        ("[\"ball\", \"fixed\"]", [3.0, 3.0]),
        ("[\"fixed\", \"universal\"]", [3.0, 3.0]),
        ("[[\"rz\"], \"fixed\"]", [12.0, 3.0]),
        ("[[\"rz\"], [\"ry\", \"rz\"]]", [3.0, 0.0]),
        ("[\"ball\", \"universal\"]", [0.0, 0.0]),
    ] {
        let text = column(joints, axial, 0.5, beside_it);
        let found = of(&text, "weight");
        // Local z of an upright beam is −x of the file.
        for (factor, plane, spring) in [(in_xz, 0, beside_it[0]), (in_xy, 1, beside_it[1])] {
            let bends = factor * COLUMN[plane] / 0.25;
            let part = nearest(&found, hertz((bends + spring) / MASS));
            assert!(part.abs() < 1e-6, "{joints} {plane}: {part:e}");
        }
    }
}

/// EI/L of the column, N m.
const COLUMN: [f64; 2] = [4e3, 6e3];

/// A point mass on an upright beam without mass, held against rotation, with springs along x and y
/// beside it.
fn column(joints: &str, axial: f64, height: f64, beside_it: [f64; 2]) -> String {
    let [x, y] = beside_it;
    let mut table: Table = lump(
        [3.0, 0.0, 0.0],
        [3.0, 0.0, height],
        "",
        &format!(
            "[beams.column]\nnodes = [\"wall\", \"lump\"]\nstiffness = {{ axial = {axial:?}, bending = {COLUMN:?}, torsion = 1e3 }}\njoints = {joints}\n[springs.upright]\nnodes = [\"wall\", \"lump\"]\nrotational_stiffness = [1e11, 1e11, 1e11]\n[springs.beside]\nnodes = [\"anchor\", \"lump\"]\nstiffness = [{x:?}, {y:?}, 0.0]\n"
        ),
    )
    .parse()
    .unwrap();
    let more = format!("[nodes]\nanchor = [3.0, 0.0, {height:?}]\n[base]\nnodes = [\"anchor\"]\n");
    for (key, value) in more.parse::<Table>().unwrap() {
        merge(&mut table, key, value);
    }
    table.to_string()
}

/// Under its load P, a column on hinges has the lateral stiffness −P/L, and one that is fixed at the
/// foot P/(tan(κL)/κ − L) with κ² = P/EI. It buckles at π²·EI/L² and 20.19·EI/L².
#[test]
fn a_loaded_column_on_joints() {
    let beside_it = [2e4, 3e4];
    let load = MASS * 9.81;
    // P·L²/EI of the weaker plane is L·P over EI/L.
    for part in [0.3, 2.0] {
        let height = part * COLUMN[0] / load;
        let between = |joints: &str| with_gravity(&column(joints, 1e12, height, beside_it));
        let hinged = of(&between("[\"ball\", \"universal\"]"), "weight");
        for spring in beside_it {
            let exact = (spring - load / height) / MASS;
            let off = nearest(&hinged, hertz(exact));
            assert!(off.abs() < 1e-8, "{off:e}");
        }
        let fixed = of(&between("[\"fixed\", \"universal\"]"), "weight");
        for (spring, plane) in beside_it.into_iter().zip(COLUMN) {
            let kappa = (load / (plane * height)).sqrt();
            let bends = load / ((kappa * height).tan() / kappa - height);
            let off = nearest(&fixed, hertz((spring + bends) / MASS));
            assert!(off.abs() < 1e-8, "{off:e}");
        }
    }
    let fixed_hinged = root(|x| x.tan() - x, 4.4, 4.6);
    for (joints, limit) in [
        ("[\"ball\", \"universal\"]", PI),
        ("[\"fixed\", \"universal\"]", fixed_hinged),
        ("[\"ball\", \"fixed\"]", fixed_hinged),
        ("[\"fixed\", \"fixed\"]", TAU),
    ] {
        for (factor, buckles) in [(0.99, false), (1.01, true)] {
            let height = factor * limit * limit * COLUMN[0] / load;
            let text = with_gravity(&column(joints, 1e12, height, beside_it));
            let (machine, model) = model(&text);
            let beam = machine.beams.iter().position(|beam| beam.name == "column");
            let beam = beam.unwrap();
            assert_eq!(model.statics.buckled[beam], buckles, "{joints} {factor}");
            let told = buckling_load(&machine.beams[beam]).unwrap();
            assert!((told * factor / load - 1.0).abs() < 1e-9, "{joints}");
        }
    }
}

/// Energies add up with all of it, and a free body of two masses and a spring keeps its momentum.
#[test]
fn shares_of_energy_add_up() {
    let text = pair("stiffness = [3e5, -2e5, 4e5]\nrotational_stiffness = [2e4, 3e4, -1e4]");
    let (machine, model) = model(&text);
    let modes = model.modes();
    for energies in energies(&machine, &model, &modes) {
        for shares in [&energies.kinetic, &energies.strain] {
            let sum: f64 = shares.iter().map(|share| share.share).sum();
            assert!((sum - 1.0).abs() < 1e-6, "{sum}");
        }
    }
    // The mass of the whole, in all directions.
    let whole: Matrix6<f64> = model.ride.transpose() * &model.mass * &model.ride;
    let bodies: f64 = machine.bodies.iter().map(|body| body.mass).sum();
    for i in 0..3 {
        assert!((whole[(i, i)] / (bodies + 4.0) - 1.0).abs() < 1e-12);
    }
}

fn error_of(text: &str) -> MachineError {
    match parse(text) {
        Err(error) => error,
        Ok(machine) => Multibody::new(&machine).expect_err("the file is bad"),
    }
}

#[test]
fn each_mistake_is_named() {
    let at_one = |more: &str| lump([3.0, 0.0, 0.0], [3.0, 0.0, 0.0], "", more);
    let spring = |keys: &str| {
        at_one(&format!(
            "[springs.joint]\nnodes = [\"wall\", \"lump\"]\n{keys}"
        ))
    };
    let good = "stiffness = [1e6, 1e6, 1e6]\nrotational_stiffness = [1e4, 1e4, 1e4]\n";
    assert!(parse(&spring(good)).is_ok());
    for (text, entry, says) in [
        (
            at_one(&format!(
                "[springs.joint]\nnodes = [\"lump\", \"lump\"]\n{good}"
            )),
            "springs.joint.nodes",
            "these are the same",
        ),
        (
            at_one(&format!(
                "[springs.joint]\nnodes = [\"wall\", \"lumb\"]\n{good}"
            )),
            "springs.joint.nodes",
            "node \"lumb\" does not exist",
        ),
        (spring(""), "springs.joint", "does nothing"),
        (
            spring("stiffness = [0.0, 0.0, 0.0]"),
            "springs.joint",
            "does nothing",
        ),
        (
            spring("damper = [1.0, -1.0, 1.0]"),
            "springs.joint.damper",
            "at least 0 N s/m",
        ),
        (
            spring("rotational_damper = [1.0, -1.0, 1.0]"),
            "springs.joint.rotational_damper",
            "at least 0 N m s",
        ),
        (
            spring("stiffness = [nan, 1.0, 1.0]"),
            "springs.joint.stiffness",
            "three finite numbers, in N/m",
        ),
        (
            spring("stiffness = [1e20, 1.0, 1.0]"),
            "springs.joint.stiffness[0]",
            "1e-6 to 1e14 N/m",
        ),
        (
            spring(&format!("{good}x_axis = [0.0, 0.0, 0.0]")),
            "springs.joint.x_axis",
            "must differ from [0, 0, 0]",
        ),
        (
            spring(&format!("{good}y_axis = [-2.0, 0.0, 0.0]")),
            "springs.joint.y_axis",
            "parallel to the local x axis",
        ),
        (
            spring("stiffness = [1e6, 1e6, 1e6]"),
            "nodes.lump",
            "no beam or spring holds it",
        ),
        (
            at_one(""),
            "nodes.lump",
            "neither a beam nor a spring ends on it",
        ),
        (
            spring(&format!(
                "{good}[point_masses.foot]\nnode = \"wall\"\nmass = 1.0"
            )),
            "point_masses.foot.node",
            "a mass there changes nothing",
        ),
        (
            spring(&format!(
                "{good}[point_masses.foot]\nnode = \"lump\"\nmass = -1.0"
            )),
            "point_masses.foot.mass",
            "above 0 kg",
        ),
        (
            spring(&format!(
                "{good}[point_masses.foot]\nnode = \"lump\"\nmass = 1.0\ninertia = [1.0, 1.0, 3.0]"
            )),
            "point_masses.foot.inertia",
            "must not exceed the sum",
        ),
        (
            rod_on_joints("[\"ball\", \"ball\"]", 3),
            "beams.rod.joints",
            "both joints release rx",
        ),
        (
            rod_on_joints("[\"pinned\", \"fixed\"]", 3),
            "beams.rod.joints[0]",
            "expected \"fixed\", \"ball\", \"universal\"",
        ),
        (rod_on_joints("[\"ball\"]", 3), "beams.rod.joints", "length"),
    ] {
        let error = error_of(&text);
        assert_eq!(error.entry(), entry, "{error}");
        assert!(error.message().contains(says), "{error}");
    }
}
