//! Machines without control: files with none of its tables.

use std::f64::consts::TAU;
use std::path::Path;

use host_gen::analysis::modes::ModeAnalysis;
use host_gen::machine::{MachineError, Structure};
use host_gen::model::multibody::Multibody;
use host_gen::model::structure::StructureModel;
use host_gen::report::{Report, Review};
use serde_json::Value;
use toml::Table;

use crate::common::{model_text, parse};

fn passive(text: &str) -> Result<Option<Structure>, MachineError> {
    Structure::parse_passive(Path::new("passive.toml"), text)
}

/// Two masses in a row on springs from the base, nothing else: no bodies, no beams.
const ROW: &str = r#"
format = 1
name = "row"

[nodes]
wall = [0.0, 0.0, 0.0]
near = [0.0, 0.0, 0.0]
far = [0.0, 0.0, 0.0]

[base]
nodes = ["wall"]

[free]
nodes = ["near", "far"]

[point_masses]
first = { node = "near", mass = 2.0 }
second = { node = "far", mass = 3.0 }

[springs.foot]
nodes = ["wall", "near"]
stiffness = [4e5, 5e5, 6e5]
rotational_stiffness = [1e3, 1e3, 1e3]

[springs.between]
nodes = ["near", "far"]
stiffness = [1e5, 2e5, 3e5]
rotational_stiffness = [1e3, 1e3, 1e3]
"#;

const CONTROL: [&str; 7] = [
    "coordinates",
    "actuators",
    "sensors",
    "floor",
    "performance",
    "control",
    "board",
];

#[test]
fn two_masses_on_springs() {
    let structure = passive(ROW).unwrap().unwrap();
    let model = StructureModel::new(&structure).unwrap();
    let mut exact = Vec::new();
    for (k, c) in [(4e5, 1e5), (5e5, 2e5), (6e5, 3e5)] {
        // ω⁴ − (a + b)·ω² + k·c/(m·M) = 0.
        let (a, b) = ((k + c) / 2.0, c / 3.0);
        let apart = f64::sqrt((a - b) * (a - b) / 4.0 + c * c / 6.0);
        exact.extend([0.5 * (a + b) - apart, 0.5 * (a + b) + apart]);
    }
    exact.sort_by(f64::total_cmp);
    let found = model.modes().hertz();
    assert_eq!(found.len(), 6);
    for (hz, square) in found.iter().zip(exact) {
        assert!((hz * TAU / square.sqrt() - 1.0).abs() < 1e-9, "{hz}");
    }
    // 0.005 in every mode by default.
    assert_eq!(structure.damping.modal, 0.005);
}

/// The metrology frame without what is of control has its modes.
#[test]
fn control_does_not_change_the_modes() {
    for gravity in ["", "gravity = [0.0, 0.0, -9.81]\n"] {
        let text = format!("{gravity}{}", model_text());
        let mut table: Table = text.parse().unwrap();
        let machine = parse(&text).unwrap();
        for key in CONTROL {
            table.remove(key);
        }
        // Sources of numbers that are no longer there.
        table.remove("provenance");
        let structure = passive(&table.to_string()).unwrap().unwrap();
        assert_eq!(structure, machine.structure);
        let with = Multibody::new(&machine).unwrap();
        let without = StructureModel::new(&structure).unwrap();
        assert_eq!(with.modes().hertz(), without.modes().hertz());
        let analysis = ModeAnalysis::passive(&structure).unwrap();
        let json = serde_json::to_value(&analysis).unwrap();
        assert_eq!(json["modes"].as_array().unwrap().len(), 12);
        for key in ["equation_of_motion", "rigid_modes_hz", "model_sha256"] {
            assert!(json.get(key).is_none(), "{key}");
        }
        assert!(!analysis.to_string().contains("Design model"));
    }
}

/// The page of the metrology frame without what is of control has the same parts and modes, and
/// nothing of control; that of two masses on springs has their modes.
#[test]
fn a_page_without_control() {
    let json = |review: &Review| serde_json::from_str::<Value>(&review.json()).unwrap();
    let mut table: Table = model_text().parse().unwrap();
    for key in CONTROL.into_iter().chain(["loads", "provenance"]) {
        table.remove(key);
    }
    let without = passive(&table.to_string()).unwrap().unwrap();
    let without = Review::passive(&without).unwrap();
    let with = Report::quick(&parse(&model_text()).unwrap()).unwrap();
    let with = Review::new(vec![with]).unwrap();
    let [one, other] = [&without, &with].map(|review| json(review)["machines"][0].clone());
    for key in ["nodes", "bodies", "springs", "point_masses"] {
        assert_eq!(one["scene"][key], other["scene"][key], "{key}");
    }
    let modes = one["modes"]["modes"].as_array().unwrap();
    assert_eq!(modes.len(), 12);
    for (mode, other) in modes
        .iter()
        .zip(other["modes"]["modes"].as_array().unwrap())
    {
        assert_eq!(mode["hz"], other["hz"]);
        assert_eq!(mode["shape"], other["shape"]);
    }
    for key in ["feedback", "closed", "gains", "compliance", "model_sha256"] {
        assert!(one.get(key).is_none() && other.get(key).is_some(), "{key}");
    }
    // The machine and its modes, as drawings.
    assert_eq!(without.pictures().len(), 13);

    let row = Review::passive(&passive(ROW).unwrap().unwrap()).unwrap();
    assert_eq!(
        json(&row)["machines"][0]["modes"]["modes"][5]["nodes"][1]["node"],
        "far"
    );
    assert!(row.pictures().is_empty());
}

/// With any of control's tables, a file is that of a machine, and the others are missing.
#[test]
fn a_part_of_control_is_not_enough() {
    for key in CONTROL {
        let text = format!("{ROW}[{key}]\n");
        assert_eq!(passive(&text).unwrap(), None);
        let error = parse(&text).unwrap_err();
        for other in CONTROL {
            let says = error.message().contains(&format!("`{other}`"));
            assert_eq!(says, other != key, "{error}");
        }
        assert!(!error.to_string().contains("work without"), "{error}");
    }
    let error = parse(ROW).unwrap_err();
    assert!(error.message().contains("missing keys `coordinates`"));
    let fix = error.fix().unwrap();
    assert!(
        fix.starts_with("host-gen modes and report work without control; for all else add them: "),
        "{fix}"
    );
}

#[test]
fn mistakes_are_named() {
    for (old, new, entry, says) in [
        (
            "mass = 2.0",
            "mass = -2.0",
            "point_masses.first.mass",
            "above 0 kg",
        ),
        (
            "mass = 2.0",
            "weight = 2.0",
            "point_masses.first.weight",
            "unknown key",
        ),
        (
            "[point_masses]\nfirst = { node = \"near\", mass = 2.0 }\nsecond = { node = \"far\", mass = 3.0 }\n",
            "",
            "bodies",
            "at least one body",
        ),
        ("[base]\nnodes = [\"wall\"]\n", "", "", "missing key `base`"),
        ("format = 1", "format = 2", "format", "format 2 is unknown"),
    ] {
        assert!(ROW.contains(old), "{old}");
        let error = passive(&ROW.replace(old, new)).unwrap_err();
        let named = |one: &MachineError| one.entry() == entry && one.message().contains(says);
        assert!(error.all().any(named), "{error}");
    }
    let loose = ROW.replace("[1e5, 2e5, 3e5]", "[1e5, 0.0, 3e5]");
    let structure = passive(&loose).unwrap().unwrap();
    let error = StructureModel::new(&structure).unwrap_err();
    assert_eq!(error.entry(), "nodes.far");
    assert!(error.message().contains("can move"), "{error}");
    assert!(error.place().is_some(), "{error}");
}

/// A mass between two strings: across them it swings on their tension alone, ω² = 2T/(Lm).
#[test]
fn a_mass_on_strings_swings_on_their_tension() {
    let (tension, length, mass) = (120.0, 0.4, 2.0);
    let text = format!(
        r#"
format = 1
name = "strings"
[nodes]
left = [-{length}, 0.0, 0.0]
right = [{length}, 0.0, 0.0]
below = [0.0, 0.0, 0.0]
bob = [0.0, 0.0, 0.0]
[base]
nodes = ["left", "right", "below"]
[free]
nodes = ["bob"]
[point_masses]
weight = {{ node = "bob", mass = {mass:?}, inertia = [0.01, 0.01, 0.01] }}
[springs.turning]
nodes = ["below", "bob"]
rotational_stiffness = [1e5, 1e5, 1e5]
[profiles.string]
axial = 1e6
bending = [0.0, 0.0]
torsion = 0.0
[beams]
one = {{ nodes = ["left", "bob"], profile = "string", preload = {tension:?} }}
two = {{ nodes = ["right", "bob"], profile = "string", preload = {tension:?} }}
"#
    );
    let structure = passive(&text).unwrap().unwrap();
    let model = StructureModel::new(&structure).unwrap();
    assert!(
        model
            .statics
            .axial
            .iter()
            .all(|force| (force / tension - 1.0).abs() < 1e-12)
    );
    let squares = model.modes().squares;
    let expected = 2.0 * tension / (length * mass);
    for i in 0..2 {
        assert!(
            (squares[i] / expected - 1.0).abs() < 1e-9,
            "{} {expected}",
            squares[i]
        );
    }
    assert!((squares[2] / (2.0 * 1e6 / mass) - 1.0).abs() < 1e-9);
    // Without tension nothing holds it across.
    let slack = text.replace(&format!("preload = {tension:?}"), "preload = 0.0");
    let slack = passive(&slack).unwrap().unwrap();
    let error = StructureModel::new(&slack).unwrap_err();
    assert!(
        error.message().contains("can move without deforming"),
        "{error}"
    );
    // Under pressure it falls over.
    let pushed = text.replace(&format!("preload = {tension:?}"), "preload = -120.0");
    let model = StructureModel::new(&passive(&pushed).unwrap().unwrap()).unwrap();
    assert!((model.modes().squares[0] / -expected - 1.0).abs() < 1e-9);
}

/// A string keeps of its preload what the spring at its end leaves, T·k/(k + EA/L); and it swings at
/// n/2L·√(T/μ), raised by its bending stiffness as Fletcher's formula for clamped ends says.
#[test]
fn a_stiff_string_swings_as_its_tension_says() {
    let (preload, length, mass, axial) = (4000.0_f64, 1.0_f64, 0.05_f64, 1e6_f64);
    let spring = 3e6_f64;
    let kept = preload * spring / (spring + axial);
    let slenderness = 0.01_f64;
    let bending = slenderness * slenderness * kept * length;
    let text = format!(
        r#"
format = 1
name = "string"
[nodes]
wall = [0.0, 0.0, 0.0]
end = [{length:?}, 0.0, 0.0]
other = [{length:?}, 0.0, 0.0]
[base]
nodes = ["wall", "other"]
[free]
nodes = ["end"]
[point_masses]
clamp = {{ node = "end", mass = 100.0, inertia = [1.0, 1.0, 1.0] }}
[springs.clamp]
nodes = ["end", "other"]
stiffness = [{spring:?}, 1e12, 1e12]
rotational_stiffness = [1e11, 1e11, 1e11]
[beams.string]
nodes = ["wall", "end"]
preload = {preload:?}
stiffness = {{ axial = {axial:?}, bending = [{bending:?}, {bending:?}], torsion = 50.0, mass = {mass:?}, segments = 60 }}
"#
    );
    let structure = passive(&text).unwrap().unwrap();
    let model = StructureModel::new(&structure).unwrap();
    assert!(
        (model.statics.axial[0] / kept - 1.0).abs() < 1e-9,
        "{}",
        model.statics.axial[0]
    );
    let hertz: Vec<f64> = model
        .modes()
        .squares
        .iter()
        .map(|w| w.sqrt() / TAU)
        .collect();
    for n in 1..=4 {
        let order = f64::from(n);
        let taut = order / (2.0 * length) * (kept * length / mass).sqrt();
        let second = 4.0 + 0.5 * (order * std::f64::consts::PI).powi(2);
        let expected = taut * (1.0 + 2.0 * slenderness + second * slenderness * slenderness);
        // Both planes.
        let near = hertz
            .iter()
            .filter(|hz| (*hz / expected - 1.0).abs() < 2e-4)
            .count();
        assert_eq!(near, 2, "{expected} Hz in {:?}", &hertz[..12]);
    }
}
