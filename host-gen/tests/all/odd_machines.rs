//! Machines with numbers far from the usual: far away, very stiff, without inertia, hung on
//! wires, in other units, absurd.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use host_gen::analysis::modes::ModeAnalysis;
use host_gen::analysis::warnings::warnings;
use host_gen::closed_loop::SampledLoop;
use host_gen::control::table::direct;
use host_gen::design::Study;
use host_gen::machine::{Machine, MachineError};
use host_gen::model::energy::energies;
use toml::{Table, Value};

use crate::common::{assert_digits, edited, model_path, parse, set, study};

fn case(name: &str) -> String {
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/cases");
    std::fs::read_to_string(cases.join(name)).unwrap()
}

fn case_study(name: &str) -> Study {
    study(&case(name))
}

/// A case with values replaced.
fn changed(name: &str, edits: &[(&str, &str)]) -> String {
    let mut table: Table = case(name).parse().unwrap();
    for (key, value) in edits {
        let value: Table = format!("x = {value}").parse().unwrap();
        set(&mut table, key, value["x"].clone());
    }
    table.to_string()
}

/// The error of a machine, from its file or from its model.
fn error_of(text: &str) -> MachineError {
    match parse(text) {
        Err(error) => error,
        Ok(machine) => Study::new(machine).expect_err("the machine is refused"),
    }
}

fn hertz(study: &Study) -> Vec<f64> {
    study.model().modes().hertz()
}

#[track_caller]
fn assert_hertz(found: &[f64], expected: &[&str]) {
    for (found, expected) in found.iter().zip(expected) {
        assert_digits(*found, expected);
    }
}

/// Published: modal analysis of stewart-simscape.
#[test]
fn a_hexapod_of_thirteen_bodies() {
    let study = case_study("machines/hexapod-struts.toml");
    assert_hertz(
        &hertz(&study),
        &["780.6", "780.6", "903.9", "1061.4", "1061.4", "1269.7"],
    );
    // Its text fits on a screen.
    let text = ModeAnalysis::new(&study).to_string();
    for line in text.lines() {
        assert!(line.chars().count() <= 110, "{line}");
    }
}

/// Its closed loop has dozens of poles close together, with which an eigenvalue iteration took
/// minutes for each randomly perturbed machine.
#[test]
fn poles_of_thirteen_bodies_end() {
    let study = case_study("machines/hexapod-struts.toml");
    let target = study.machine().target;
    let table = direct(
        study.machine(),
        study.plant(),
        &target,
        study.gains(),
        100.0,
    )
    .unwrap();
    let poles = SampledLoop::new(study.plant(), &table).poles().unwrap();
    assert!(poles.len() > 156);
}

/// The closed form of a cubic hexapod: 71.18 three times, 194.92 twice, 275.66 Hz.
#[test]
fn a_machine_far_from_the_origin() {
    let far = case("machines/far-from-origin.toml");
    let expected = ["71.18", "71.18", "71.18", "194.92", "194.92", "275.66"];
    assert_hertz(&hertz(&study(&far)), &expected);
    // Sideways and at an angle as well, with the same design model and zeros.
    let shift = [-4.5e5, 350.0, 5.5e6];
    let mut moved: Table = far.parse().unwrap();
    let by_shift = |place: &mut Value| {
        for (x, by) in place.as_array_mut().unwrap().iter_mut().zip(shift) {
            *x = Value::Float(x.as_float().unwrap() + by);
        }
    };
    let nodes = moved["nodes"].as_table_mut().unwrap();
    nodes.iter_mut().for_each(|(_, at)| by_shift(at));
    by_shift(&mut moved["bodies"]["top"]["cog"]);
    let near = study(&far);
    let moved = study(&moved.to_string());
    assert_hertz(&hertz(&moved), &expected);
    for (a, b) in near
        .gains()
        .proportional
        .iter()
        .zip(&moved.gains().proportional)
    {
        assert!(
            (a - b).abs() < 1e-6 * near.gains().proportional.amax(),
            "{a} and {b}"
        );
    }
}

/// Published: the weight holds the plate, 0.7050 twice, 1.0838 Hz.
#[test]
fn a_plate_hung_on_wires() {
    let study = case_study("machines/quadrifilar-refused.toml");
    assert_hertz(&hertz(&study), &["0.7050", "0.7050", "1.0838"]);
    let text = case("machines/quadrifilar-refused.toml");
    // Without weight the springs of 1 mN/m alone hold it, and that is no refusal either.
    let softly = text.replace("gravity = [0.0, 0.0, -9.81]", "");
    let softly = hertz(&crate::common::study(&softly));
    assert!(softly[0] > 0.0 && softly[2] < 2e-3, "{softly:?}");
}

/// Springs without any stiffness: the weight alone holds the plate sideways; without
/// weight nothing does.
#[test]
fn a_plate_that_only_its_weight_holds() {
    let text = case("machines/quadrifilar-refused.toml").replace("axial = 0.001", "axial = 0.0");
    assert_hertz(&hertz(&study(&text)), &["0.7050", "0.7050", "1.0838"]);
    let error = error_of(&text.replace("gravity = [0.0, 0.0, -9.81]", ""));
    assert_eq!(error.entry(), "bodies.plate");
    assert!(error.message().contains("without deforming"), "{error}");
    // Pulled sideways it would fall.
    let error = error_of(&text.replace("[0.0, 0.0, -9.81]", "[9.0, 0.0, -4.0]"));
    assert_eq!(error.entry(), "bodies.plate");
    assert!(error.message().contains("falls"), "{error}");
}

/// As stiff as rigid, the blocks make one body of frame and lens: the modes are those of the
/// design model, computed independently.
#[test]
fn very_stiff_parts() {
    let profile = |k: &str| {
        edited(&[(
            "profiles.block",
            &format!("{{ axial = {k}, bending = [{k}, {k}], torsion = {k} }}"),
        )])
    };
    let rigid = ["14.174", "14.174", "20.067", "25.138", "25.138", "32.324"];
    for stiff in ["1e12", "1e14"] {
        assert_hertz(&hertz(&study(&profile(stiff))), &rigid);
    }
    let error = error_of(&profile("1e18"));
    assert_eq!(error.entry(), "profiles.block.axial");
    assert!(error.message().contains("make one body"), "{error}");
}

#[test]
fn too_stiff_is_said_to_be_too_stiff() {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/cases/numbers/too-stiff-message.toml");
    let error = Machine::load(&path).unwrap_err();
    assert_eq!(error.entry(), "profiles.block.axial");
    assert!(error.message().contains("1e14 N/m"), "{error}");
}

#[test]
fn moments_of_inertia() {
    let inertia = |value: &str| {
        changed(
            "machines/inertia-last-digit.toml",
            &[("bodies.top.inertia", value)],
        )
    };
    let error = error_of(&case("machines/impossible-inertia.toml"));
    assert_eq!(error.entry(), "bodies.top.inertia");
    assert!(error.message().contains("the sum of the others"), "{error}");
    // Only the principal moments of a tensor count: here 0.001, 0.019 and 0.1.
    for refused in [
        "[[0.01, 9e-3, 0.0], [9e-3, 0.01, 0.0], [0.0, 0.0, 0.1]]",
        "[1.0, 0.2, 0.3]",
        "[0.01, 0.01, -1e-3]",
    ] {
        assert_eq!(error_of(&inertia(refused)).entry(), "bodies.top.inertia");
    }
    // A thin plate, also with three typed digits, a turned one, and one that was symmetric before
    // numpy printed it.
    let turned = "[[0.015, 0.005, 0.0], [0.005, 0.015, 0.0], [0.0, 0.0, 0.01]]";
    for taken in ["[0.01, 0.01, 0.02]", "[0.833, 0.833, 1.67]", turned] {
        study(&inertia(taken));
    }
    let last_digit = hertz(&case_study("machines/inertia-last-digit.toml"));
    let exact = "[[0.01, 1e-3, 0.0], [1e-3, 0.01, 0.0], [0.0, 0.0, 0.02]]";
    for (a, b) in last_digit.iter().zip(hertz(&study(&inertia(exact)))) {
        assert!((a / b - 1.0).abs() < 1e-12);
    }
}

/// The cubic hexapod with a second body on a beam of its own on the base: 0.1 m upright, EI/L of
/// 50 N m, GJ/L of 20 N m.
fn with_bob(inertia: &str, more: &[(&str, &str)]) -> String {
    let deformations: Vec<String> = (0..6)
        .map(|leg| format!("\"leg{leg}.e1\""))
        .chain((1..=6).map(|e| format!("\"blade.e{e}\"")))
        .collect();
    let body =
        format!("{{ mass = 0.5, inertia = {inertia}, cog = [0.0, 0.0, 0.1], nodes = [\"bob\"] }}");
    let all = format!("[{}]", deformations.join(", "));
    let mut edits = vec![
        ("nodes.foot", "[0.0, 0.0, 0.0]"),
        ("nodes.bob", "[0.0, 0.0, 0.1]"),
        (
            "base.nodes",
            r#"["f0", "f1", "f2", "f3", "f4", "f5", "foot"]"#,
        ),
        ("bodies.bob", &body),
        (
            "beams.blade",
            r#"{ nodes = ["foot", "bob"], stiffness = { axial = 1e6, bending = [50.0, 50.0], torsion = 20.0 } }"#,
        ),
        ("coordinates.deformations", &all),
    ];
    edits.extend(more);
    changed("machines/inertia-last-digit.toml", &edits)
}

/// A point mass on a cantilever: ω² = 3·EI/(L³·m) twice, and EA/(L·m). The hexapod's modes stay.
#[test]
fn a_point_mass_on_a_blade() {
    let found = hertz(&study(&with_bob("[0.0, 0.0, 0.0]", &[])));
    assert_eq!(found.len(), 9);
    let bending = (3.0 * 50.0 / (0.1_f64.powi(2) * 0.5)).sqrt() / core::f64::consts::TAU;
    let axial = (1e6 / 0.5_f64).sqrt() / core::f64::consts::TAU;
    let mut expected = vec![bending, bending, axial];
    expected.extend(hertz(&case_study("machines/inertia-last-digit.toml")));
    expected.sort_by(f64::total_cmp);
    for (found, expected) in found.iter().zip(&expected) {
        assert!(
            (found / expected - 1.0).abs() < 1e-9,
            "{found} and {expected}"
        );
    }
    // The limit of ever smaller moments, in the plant as well.
    let small = study(&with_bob("[1e-11, 1e-11, 1e-11]", &[]));
    let point = study(&with_bob("[0.0, 0.0, 0.0]", &[]));
    for hz in [1.0, 30.0, 100.0, 300.0] {
        let (a, b) = (
            small.plant().response(hz).g22(),
            point.plant().response(hz).g22(),
        );
        assert!((&a - &b).norm() < 1e-6 * a.norm(), "{hz} Hz");
    }
}

/// A thin rod along its beam: the rotation about the axis has no inertia.
#[test]
fn a_thin_rod() {
    let found = hertz(&study(&with_bob("[2e-3, 2e-3, 0.0]", &[])));
    let nearly = hertz(&study(&with_bob("[2e-3, 2e-3, 1e-9]", &[])));
    assert_eq!((found.len(), nearly.len()), (11, 12));
    for (a, b) in found.iter().zip(&nearly) {
        assert!((a / b - 1.0).abs() < 1e-6, "{a} and {b}");
    }
    // The rod along y instead, as a tensor with its rounding.
    let along_y = "[[2e-3, 0.0, 0.0], [0.0, 1e-19, 0.0], [0.0, 0.0, 2e-3]]";
    assert_eq!(hertz(&study(&with_bob(along_y, &[]))).len(), 11);
}

/// What holds no rotation, or drives one that has no inertia, is named.
#[test]
fn rotations_without_inertia_that_cannot_be() {
    let free = with_bob(
        "[2e-3, 2e-3, 0.0]",
        &[("beams.blade.stiffness.torsion", "0.0")],
    );
    let error = error_of(&free);
    assert_eq!(error.entry(), "bodies.bob.inertia");
    assert!(
        error.message().contains("about [0.00, 0.00, 1.00]") && error.message().contains("no beam"),
        "{error}"
    );
    let driven = changed(
        "machines/inertia-last-digit.toml",
        &[("bodies.top.inertia", "[0.01, 0.01, 0.0]")],
    );
    let error = error_of(&driven);
    assert_eq!(error.entry(), "bodies.top.inertia");
    assert!(
        error.message().contains("the actuator in \"leg0\""),
        "{error}"
    );
}

/// Where the legs are singular, no other coordinates help.
#[test]
fn singular_legs_are_named() {
    // leg3 beside leg0.
    let text = changed(
        "machines/inertia-last-digit.toml",
        &[("beams.leg3.nodes", r#"["f0", "m0"]"#)],
    );
    let error = error_of(&text);
    assert_eq!(error.entry(), "actuators.beams", "{error}");
    assert!(
        error
            .message()
            .contains("\"leg3\" follows from those of \"leg0\""),
        "{error}"
    );
}

#[track_caller]
fn warned(text: &str, says: &str) {
    let study = study(text);
    let warnings = warnings(&study);
    assert!(
        warnings.iter().any(|warning| warning.contains(says)),
        "{says} in {warnings:?}"
    );
}

#[test]
fn slips_of_units_are_warned_of() {
    warned(
        &case("machines/nodes-in-mm.toml"),
        "bodies.top: the radius of gyration is 4.472e-2 m",
    );
    let cubic = |edits: &[(&str, &str)]| changed("machines/inertia-last-digit.toml", edits);
    warned(
        &cubic(&[("bodies.top.cog", "[0.0, 0.0, 30.0]")]),
        "bodies.top.cog is",
    );
    // Only the feet in mm.
    let mut feet: Table = case("machines/nodes-in-mm.toml").parse().unwrap();
    let right: Table = cubic(&[]).parse().unwrap();
    for top in ["m0", "m1", "m2", "m3", "m4", "m5"] {
        set(
            &mut feet,
            &format!("nodes.{top}"),
            right["nodes"][top].clone(),
        );
    }
    warned(&feet.to_string(), "m long, and no body is larger than");
    // In g, in t, in kg mm².
    warned(&cubic(&[("bodies.top.mass", "10000.0")]), "bodies.top");
    warned(&cubic(&[("bodies.top.mass", "0.01")]), "bodies.top");
    warned(
        &cubic(&[("bodies.top.inertia", "[1e4, 1e4, 2e4]")]),
        "bodies.top",
    );
    warned(
        &cubic(&[("beams.leg0.stiffness.axial", "1.0")]),
        "leg0 has an axial stiffness of 1e0 N/m",
    );
    warned(&cubic(&[("damping.modal", "0.5")]), "in percent");
    warned(&cubic(&[("gravity", "[0.0, 0.0, -981.0]")]), "gravity is");
    warned(
        &cubic(&[("board.accelerometer.noise_density", "1e2")]),
        "noise_density",
    );
    let section = |e: &str, area: &str, second: &str| {
        let profile = format!(
            "{{ youngs_modulus = {e}, shear_modulus = 8e10, area = {area}, second_moments = [{second}, {second}], torsion_constant = 1e-12 }}"
        );
        cubic(&[("beams.leg0.stiffness", &profile)])
    };
    warned(
        &section("210.0", "1e-4", "1e-9"),
        "youngs_modulus is 210 Pa",
    );
    warned(&section("2.1e5", "1e-4", "1e-9"), "in N/mm²");
    warned(&section("2.1e11", "1e-4", "0.833"), "no section");
    warned(&section("2.1e5", "100.0", "0.833"), "the area in mm²");
}

/// What is right is not warned of.
#[test]
fn no_warning_without_cause() {
    for model in [
        "metrology-frame",
        "low-parasitic",
        "both-sensors",
        "nucleo-h743",
    ] {
        let path = model_path().with_file_name(format!("{model}.toml"));
        let study = Study::new(Machine::load(&path).unwrap()).unwrap();
        assert_eq!(warnings(&study), Vec::<String>::new(), "{model}");
    }
    // The hexapod's sensors are far from its legs, which makes unstable zeros.
    for name in ["hexapod-struts", "inertia-last-digit", "far-from-origin"] {
        let study = case_study(&format!("machines/{name}.toml"));
        let mut all = warnings(&study);
        all.retain(|warning| !warning.contains("host-gen zeros"));
        assert_eq!(all, Vec::<String>::new(), "{name}");
    }
}

/// Modal masses are masses of the machine: none is above the whole one, also that of a rotation
/// about an axis that goes through all nodes, and pairs have the same.
#[test]
fn modal_masses() {
    for name in [
        "machines/hexapod-struts.toml",
        "machines/inertia-last-digit.toml",
    ] {
        let study = case_study(name);
        let machine = study.machine();
        let whole: f64 = machine.bodies.iter().map(|body| body.mass).sum();
        let modes = study.model().modes();
        for mode in energies(machine, study.model(), &modes) {
            assert!(mode.modal_mass > 0.0 && mode.modal_mass <= 1.001 * whole);
        }
    }
    // A mass that turns about its only node: I/r² with r² = ½·tr I/m.
    let text = with_bob("[2e-3, 2e-3, 2e-3]", &[]);
    let study = study(&text);
    let modes = study.model().modes();
    let twist = (20.0 / 2e-3_f64).sqrt() / core::f64::consts::TAU;
    let hertz = modes.hertz();
    let at = hertz
        .iter()
        .position(|hz| (hz / twist - 1.0).abs() < 1e-9)
        .unwrap();
    let mass = energies(study.machine(), study.model(), &modes)[at].modal_mass;
    assert!((mass - 0.5 * 2.0 / 3.0).abs() < 1e-9, "{mass}");
    // The paper's machine is symmetric: modes 1 and 2, 4 and 5 are pairs.
    let frame = crate::common::frame();
    let all = energies(frame.machine(), frame.model(), &frame.model().modes());
    for (a, b) in [(0, 1), (3, 4), (6, 7)] {
        let (a, b) = (all[a].modal_mass, all[b].modal_mass);
        assert!((a / b - 1.0).abs() < 1e-9, "{a} and {b}");
    }
}

/// Every number of the models, replaced by absurd ones: an error that names an entry, or modes;
/// never a panic.
#[test]
fn absurd_numbers_are_refused_or_computed() {
    let section = edited(&[
        (
            "profiles.leg",
            "{ youngs_modulus = 2.1e11, shear_modulus = 8e10, area = 1e-4, second_moments = [1e-9, 1e-9], torsion_constant = 1e-9, loss_factor = 0.01, damper = 10.0 }",
        ),
        ("gravity", "[0.0, 0.0, -9.81]"),
        ("damping.rayleigh", "[0.1, 1e-6]"),
        ("control.law", "\"modal\""),
        ("control.feedback", "\"both\""),
        (
            "supervision",
            "{ soft_start = 2.0, stuck = 0.1, pilot = 0.1, saturated = 1.0 }",
        ),
        ("robustness", "{ mass = 0.2, cog = 0.01, samples = 10 }"),
    ]);
    let hung = case("machines/quadrifilar-refused.toml");
    let bob = with_bob("[0.0, 0.0, 0.0]", &[]);
    let mut tried = 0;
    for text in [edited(&[]), section, hung, bob] {
        let table: Table = text.parse().unwrap();
        let mut places = Vec::new();
        numbers(&Value::Table(table.clone()), &mut Vec::new(), &mut places);
        for place in &places {
            for value in [0.0_f64, -1.0, 1e-300, 1e-30, 1e-9, 1e9, 1e30, 1e150, 1e300] {
                let mut table = Value::Table(table.clone());
                let at = place.iter().fold(&mut table, |value, step| match step {
                    Step::Key(key) => value.get_mut(key.as_str()).unwrap(),
                    Step::Index(i) => value.get_mut(*i).unwrap(),
                });
                if at.is_integer() && value.fract() != 0.0 {
                    continue;
                }
                *at = if at.is_integer() {
                    Value::Integer(value as i64)
                } else {
                    Value::Float(value)
                };
                let text = table.as_table().unwrap().to_string();
                let outcome = catch_unwind(AssertUnwindSafe(|| {
                    let made = parse(&text).and_then(|machine| {
                        Machine::drawn(&machine, 1);
                        Study::new(machine)
                    });
                    match made {
                        Ok(study) => {
                            let _ = warnings(&study);
                            let modes = ModeAnalysis::new(&study);
                            assert!(!modes.to_string().contains("NaN"), "{modes}");
                        }
                        Err(error) => assert!(!error.entry().is_empty(), "{error}"),
                    }
                }));
                assert!(outcome.is_ok(), "{place:?} = {value:e}");
                tried += 1;
            }
        }
    }
    assert!(tried > 2000, "{tried}");
}

#[derive(Clone, Debug)]
enum Step {
    Key(String),
    Index(usize),
}

/// The places of all numbers below `value`.
fn numbers(value: &Value, at: &mut Vec<Step>, places: &mut Vec<Vec<Step>>) {
    match value {
        Value::Float(_) | Value::Integer(_) => places.push(at.clone()),
        Value::Array(array) => {
            for (i, value) in array.iter().enumerate() {
                at.push(Step::Index(i));
                numbers(value, at, places);
                at.pop();
            }
        }
        Value::Table(table) => {
            for (key, value) in table {
                at.push(Step::Key(key.clone()));
                numbers(value, at, places);
                at.pop();
            }
        }
        _ => {}
    }
}
