//! Beams with mass against closed forms: higher modes, the mass that they add, their weight.

use std::f64::consts::{PI, TAU};

use host_gen::design::Study;
use host_gen::machine::Machine;
use host_gen::model::energy::energies;
use host_gen::model::multibody::Multibody;
use toml::{Table, Value};

use crate::common::{edited, parse};

/// Young's modulus, Pa, shear modulus, Pa, and density, kg/m³, of steel.
pub const STEEL: [f64; 3] = [210e9, 80e9, 7850.0];
/// A rod 20 mm wide and 10 mm high: area, m², and both second moments, m⁴.
pub const AREA: f64 = 2e-4;
pub const SECOND: [f64; 2] = [0.02 * 1e-6 / 12.0, 0.01 * 8e-6 / 12.0];
/// An assumed torsion constant, m⁴.
pub const TORSION: f64 = 4.6e-9;
pub const LENGTH: f64 = 0.8;

/// The metrology frame, and beside it `more`, a text of tables.
pub fn beside(more: &str) -> String {
    let mut table: Table = edited(&[]).parse().unwrap();
    for (key, value) in more.parse::<Table>().unwrap() {
        merge(&mut table, key, value);
    }
    table.to_string()
}

pub fn merge(into: &mut Table, key: String, value: Value) {
    match (into.get_mut(&key), value) {
        (Some(Value::Table(old)), Value::Table(new)) => {
            for (key, value) in new {
                merge(old, key, value);
            }
        }
        (Some(Value::Array(old)), Value::Array(new)) => old.extend(new),
        (_, value) => {
            into.insert(key, value);
        }
    }
}

/// The stiffness set of the rod.
pub fn rod(segments: usize) -> String {
    let [e, g, density] = STEEL;
    format!(
        "[profiles.rod]\nyoungs_modulus = {e:?}\nshear_modulus = {g:?}\narea = {AREA:?}\nsecond_moments = {SECOND:?}\ntorsion_constant = {TORSION:?}\ndensity = {density:?}\nsegments = {segments}\n"
    )
}

/// A rod from the base at `[2, 0, 0]` along x to a free tip.
fn cantilever(segments: usize) -> String {
    beside(&format!(
        "[nodes]\nroot = [2.0, 0.0, 0.0]\ntip = [{:?}, 0.0, 0.0]\n[base]\nnodes = [\"root\"]\n[free]\nnodes = [\"tip\"]\n[beams.rod]\nnodes = [\"root\", \"tip\"]\nprofile = \"rod\"\n{}",
        2.0 + LENGTH,
        rod(segments)
    ))
}

pub fn model(text: &str) -> (Machine, Multibody) {
    let machine = parse(text).unwrap();
    let model = Multibody::new(&machine).unwrap();
    (machine, model)
}

/// Frequencies, Hz, of the modes that are in the beam `rod`: its energy, and only its.
fn of_rod(text: &str) -> Vec<f64> {
    let (machine, model) = model(text);
    let modes = model.modes();
    let all = modes
        .hertz()
        .into_iter()
        .zip(energies(&machine, &model, &modes));
    let own = all.filter(|(_, energies)| {
        let strain = energies.strain.iter().find(|share| share.name == "rod");
        strain.unwrap().share > 0.5
    });
    own.map(|(hz, _)| hz).collect()
}

/// The part by which the nearest of `found` differs from `expected`.
pub fn nearest(found: &[f64], expected: f64) -> f64 {
    let parts = found.iter().map(|hz| hz / expected - 1.0);
    parts.min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap()
}

/// The root of f between `low` and `high`, where it changes its sign.
pub fn root(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if f(low) * f(middle) <= 0.0 {
            high = middle;
        } else {
            low = middle;
        }
    }
    low
}

/// Bending frequency, Hz, of a root β·L, with the second moment of area.
pub fn bending(root: f64, second: f64) -> f64 {
    let [e, _, density] = STEEL;
    (root / LENGTH).powi(2) * (e * second / (density * AREA)).sqrt() / TAU
}

/// cos·cosh = −1 in bending, quarter waves along and about the axis; the error of a cubic element
/// falls with its length to the fourth power, that of a linear one with its square.
#[test]
fn a_cantilever_has_its_higher_modes() {
    let [few, more] = [6, 12].map(|segments| of_rod(&cantilever(segments)));
    let [e, g, density] = STEEL;
    for k in 0..4 {
        let middle = (k as f64 + 0.5) * PI;
        let beta = root(|x| x.cos() * x.cosh() + 1.0, middle - 0.5, middle + 0.5);
        for second in SECOND {
            let exact = bending(beta, second);
            let [coarse, fine] = [&few, &more].map(|found| nearest(found, exact));
            // The leading term of the error of cubic elements.
            let leading = (beta / 6.0).powi(4) / 1440.0;
            assert!(
                (0.6..1.2).contains(&(coarse / leading)),
                "{k}: {coarse:e} {leading:e}"
            );
            if k > 1 {
                let rate = (coarse / fine).log2();
                assert!((3.6..4.4).contains(&rate), "{k}: {coarse:e} {fine:e}");
            }
        }
    }
    let polar = SECOND.iter().sum::<f64>();
    for (name, speed) in [
        ("along", (e / density).sqrt()),
        ("about", (g * TORSION / (density * polar)).sqrt()),
    ] {
        let exact = speed / (4.0 * LENGTH);
        let [coarse, fine] = [&few, &more].map(|found| nearest(found, exact));
        let rate = (coarse / fine).log2();
        assert!((1.9..2.1).contains(&rate), "{name}: {coarse:e} {fine:e}");
        assert!(coarse < 5e-3, "{name}: {coarse:e}");
    }
}

/// Clamped at both ends, on the base: cos·cosh = 1. Only inner nodes move.
#[test]
fn a_beam_from_base_to_base_rings() {
    let text = cantilever(10)
        .replace("tip = [", "far = [")
        .replace("\"tip\"", "\"far\"");
    let mut table: Table = text.parse().unwrap();
    table.remove("free");
    let nodes = table["base"]["nodes"].as_array_mut().unwrap();
    nodes.push(Value::String("far".to_owned()));
    let found = of_rod(&table.to_string());
    for k in 1..4 {
        let middle = (f64::from(k) + 0.5) * PI;
        let beta = root(|x| x.cos() * x.cosh() - 1.0, middle - 0.5, middle + 0.5);
        for second in SECOND {
            let part = nearest(&found, bending(beta, second));
            assert!(part.abs() < 1e-3, "{k}: {part:e}");
        }
    }
}

/// A body on a rod, along its axis: β·tan β = mass of the rod over that of the body. The
/// degrees of freedom of the body are the deformations of the rod between its ends.
#[test]
fn a_strut_resonates_under_its_load() {
    let load = 2.0;
    let text = cantilever(16)
        .replace("[free]\nnodes = [\"tip\"]\n", "")
        .replace("tip = [", "top = [")
        .replace("\"tip\"", "\"top\"");
    let mut table: Table = text.parse().unwrap();
    let more = format!(
        "[bodies.load]\nmass = {load:?}\ninertia = [0.001, 0.001, 0.001]\ncog = [{:?}, 0.0, 0.0]\nnodes = [\"top\"]\n[coordinates]\ndeformations = [\"rod.e1\", \"rod.e2\", \"rod.e3\", \"rod.e4\", \"rod.e5\", \"rod.e6\"]\n",
        2.0 + LENGTH
    );
    for (key, value) in more.parse::<Table>().unwrap() {
        merge(&mut table, key, value);
    }
    table.remove("free");
    let text = table.to_string();
    let [e, _, density] = STEEL;
    let mass = density * AREA * LENGTH;
    let found = of_rod(&text);
    for k in 0..3 {
        let low = PI * f64::from(k) + 1e-9;
        let beta = root(|x| x * x.tan() - mass / load, low, low + 0.5 * PI - 1e-6);
        let exact = beta / LENGTH * (e / density).sqrt() / TAU;
        let part = nearest(&found, exact);
        assert!(part.abs() < 0.02 && part > -1e-9, "{k}: {part:e}");
    }
    // The first one is a little below that of a spring with a third of the rod's mass: Rayleigh's
    // quotient of the static shape.
    let (machine, model) = model(&text);
    let hertz = nearest(
        &found,
        (e * AREA / LENGTH / (load + mass / 3.0)).sqrt() / TAU,
    );
    assert!((-4e-3..0.0).contains(&hertz), "{hertz:e}");
    // All of it at rest in q_d: the equation of motion has the same modes.
    let equation = model.equation_of_motion();
    let (squares, _) =
        host_gen::numeric::eigen::generalised_eigen(&equation.stiffness, &equation.mass).unwrap();
    for (a, b) in squares.iter().zip(&model.modes().squares) {
        assert!((a / b - 1.0).abs() < 1e-5, "{a:e} {b:e}");
    }
    assert_eq!(equation.mass.nrows(), 6 * (machine.bodies.len() + 15));
}

/// The base accelerates across the rod: at the tip its inertia bends it as a uniform load does,
/// q·L⁴/(8EI), in one element and in five.
#[test]
fn the_base_takes_the_rod_along() {
    for segments in [1, 5] {
        let (machine, model) = model(&cantilever(segments));
        let equation = model.equation_of_motion();
        // The floor inputs that make one m/s² of the base along z.
        let floor = model.floor.column(2);
        let push = -(&equation.rheonomic * floor);
        let q = equation.stiffness.clone().lu().solve(&push).unwrap();
        let sag = q[6 * machine.bodies.len() + 2];
        // Local z of a rod along x is the file's z.
        let [e, _, density] = STEEL;
        let exact = -density * AREA * LENGTH.powi(4) / (8.0 * e * SECOND[0]);
        assert!(
            (sag / exact - 1.0).abs() < 1e-8,
            "{segments}: {sag:e} {exact:e}"
        );
    }
}

/// A rod between two bodies adds its mass, its moments and its inertia about its middle to those
/// of the machine as one rigid body.
#[test]
fn mass_is_conserved() {
    let total = |text: &str| {
        let (_, model) = model(text);
        model.ride.transpose() * &model.mass * &model.ride
    };
    let between = |more: &str| {
        let text = format!(
            "[beams.rod]\nnodes = [\"n3\", \"lens16\"]\nprofile = \"rod\"\n{}",
            rod(3)
        );
        beside(&text.replace("density = 7850.0\nsegments = 3\n", more))
    };
    let with = total(&between("density = 7850.0\nsegments = 3\n"));
    let without = total(&between(""));
    let added = with - without;
    let (machine, _) = model(&between(""));
    let middle = machine
        .nodes
        .iter()
        .map(|node| node.at)
        .sum::<nalgebra::Vector3<f64>>()
        / machine.nodes.len() as f64;
    let at = |name: &str| {
        machine
            .nodes
            .iter()
            .find(|node| node.name == name)
            .unwrap()
            .at
    };
    let (p, q) = (at("n3"), at("lens16"));
    let along = (q - p).normalize();
    let mass = STEEL[2] * AREA * (q - p).norm();
    let arm = 0.5 * (p + q) - middle;
    let one = nalgebra::Matrix3::<f64>::identity();
    let thin = (one - along * along.transpose()) * (mass * (q - p).norm_squared() / 12.0);
    let polar = mass * SECOND.iter().sum::<f64>() / AREA;
    let inertia = thin
        + along * along.transpose() * polar
        + mass * (one * arm.norm_squared() - arm * arm.transpose());
    let mut expected = nalgebra::Matrix6::zeros();
    expected
        .fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&(mass * one));
    let moment = mass * arm.cross_matrix();
    expected.fixed_view_mut::<3, 3>(0, 3).copy_from(&-moment);
    expected.fixed_view_mut::<3, 3>(3, 0).copy_from(&moment);
    expected.fixed_view_mut::<3, 3>(3, 3).copy_from(&inertia);
    let error = (added - expected).amax();
    assert!(error < 1e-9, "{error:e}");
}

/// An upright rod falls over under its own weight if q·L³ is above 7.837 EI (Greenhill).
#[test]
fn a_column_buckles_under_its_own_weight() {
    // So high that its critical gravity, 6.6 m/s², does nothing to the frame.
    const HEIGHT: f64 = 8.0 * LENGTH;
    let stands = |factor: f64| {
        let [e, _, density] = STEEL;
        let critical = 7.837_347 * e * SECOND[0] / (density * AREA * HEIGHT.powi(3));
        let gravity = factor * critical;
        let text = cantilever(16).replace(
            &format!("tip = [{:?}, 0.0, 0.0]", 2.0 + LENGTH),
            &format!("tip = [2.0, 0.0, {HEIGHT:?}]"),
        );
        let mut table: Table = text.parse().unwrap();
        // Gravity is that of the rod alone: the frame stands on stiff legs.
        let value: Table = format!("x = [0.0, 0.0, {:?}]", -gravity).parse().unwrap();
        table.insert("gravity".to_owned(), value["x"].clone());
        let (_, model) = model(&table.to_string());
        model.modes().squares[0] > 0.0
    };
    assert!(stands(0.99));
    assert!(!stands(1.01));
}

/// The paper's machine: legs of a mass that does not matter change nothing, in one element or in
/// four.
#[test]
fn a_tiny_mass_changes_nothing() {
    let modes = |mass: &str| {
        let text = edited(&[("profiles.leg.axial", "8.389e6")]);
        let mut table: Table = text.parse().unwrap();
        for (key, value) in format!("[profiles.leg]\n{mass}").parse::<Table>().unwrap() {
            merge(&mut table, key, value);
        }
        let study = Study::new(parse(&table.to_string()).unwrap()).unwrap();
        (study.model().modes().hertz(), study.design_model().hertz())
    };
    let (today, rigid) = modes("");
    for mass in ["mass = 1e-6", "mass = 1e-6\nsegments = 4"] {
        let (found, of_design) = modes(mass);
        for (a, b) in found.iter().zip(&today).chain(of_design.iter().zip(&rigid)) {
            assert!((a / b - 1.0).abs() < 1e-8, "{mass}: {a} {b}");
        }
    }
}

/// Legs with mass in segments: energies add up, and the loop's machine is a machine.
#[test]
fn shares_of_energy_add_up() {
    let mut table: Table = edited(&[]).parse().unwrap();
    for (key, value) in "[profiles.leg]\nmass = 5.0\nsegments = 5"
        .parse::<Table>()
        .unwrap()
    {
        merge(&mut table, key, value);
    }
    let (machine, model) = model(&table.to_string());
    let modes = model.modes();
    assert_eq!(modes.squares.len(), 12 + 6 * 4 * 6);
    for energies in energies(&machine, &model, &modes) {
        for shares in [&energies.kinetic, &energies.strain] {
            let sum: f64 = shares.iter().map(|share| share.share).sum();
            assert!((sum - 1.0).abs() < 1e-6, "{sum}");
        }
    }
}

#[test]
fn a_wrong_mass_is_refused() {
    for (edit, entry, says) in [
        (
            "mass = 1.0\ndensity = 7850.0",
            "profiles.leg.mass",
            "not both",
        ),
        (
            "density = 7850.0",
            "profiles.leg.density",
            "needs the section",
        ),
        ("mass = -1.0", "profiles.leg.mass", "above 0 kg"),
        ("segments = 3", "profiles.leg.segments", "without mass"),
        (
            "mass = 1.0\nsegments = 0",
            "profiles.leg.segments",
            "at least 1",
        ),
        ("mass = 1.0\nsegments = 60", "beams.leg9", "useful time"),
        (
            "mass = 1.0\nsegments = 2\ntorsion = 0.0",
            "profiles.leg.segments",
            "would not be held",
        ),
    ] {
        let mut table: Table = edited(&[]).parse().unwrap();
        for (key, value) in format!("[profiles.leg]\n{edit}").parse::<Table>().unwrap() {
            merge(&mut table, key, value);
        }
        let error = parse(&table.to_string()).unwrap_err();
        assert_eq!(error.entry(), entry, "{error}");
        assert!(error.message().contains(says), "{error}");
    }
}

/// Two springs in series through a free node without mass are one spring of half the stiffness.
#[test]
fn a_free_node_joins_two_springs() {
    let machine = |middle: bool| {
        let beam = |name: &str, p: &str, q: &str, factor: f64| {
            format!(
                "[beams.{name}]\nnodes = [\"{p}\", \"{q}\"]\nstiffness = {{ axial = {:?}, bending = [{:?}, {:?}], torsion = {:?} }}\n",
                1e6 * factor,
                3e3 * factor,
                2e3 * factor,
                1e3 * factor
            )
        };
        // From the base under the frame's cog to the frame's node at [0.0, 0.5, 0.0].
        let base = "[nodes]\nstand = [0.0, 0.5, -0.6]\n[base]\nnodes = [\"stand\"]\n";
        beside(&if middle {
            format!(
                "[nodes]\nstand = [0.0, 0.5, -0.6]\nhalf = [0.0, 0.5, -0.3]\n[base]\nnodes = [\"stand\"]\n[free]\nnodes = [\"half\"]\n{}{}",
                beam("low", "stand", "half", 2.0),
                beam("up", "half", "n3", 2.0)
            )
        } else {
            format!("{base}{}", beam("whole", "stand", "n3", 1.0))
        })
    };
    let [one, two] = [false, true].map(|middle| model(&machine(middle)).1.modes().hertz());
    assert_eq!(one.len(), two.len());
    for (a, b) in one.iter().zip(&two) {
        assert!((a / b - 1.0).abs() < 1e-10, "{a} {b}");
    }
}
