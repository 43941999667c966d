//! Machine files from a few numbers, and the schema that editors check them by.

use core::f64::consts::TAU;
use std::fs;
use std::path::Path;

use crate::common::{model_path, model_text, rough};
use host_gen::design::Study;
use host_gen::machine::schema::schema;
use host_gen::machine::{FeedbackKind, Machine};
use host_gen::model::template::{
    Mounts, Outline, ReadyBoard, ready_accelerometers, usual_leg_stiffness,
};
use jsonschema::Validator;
use proptest::prelude::*;
use serde_json::Value;

fn study(outline: &Outline) -> Study {
    let path = Path::new("new.toml");
    let text = outline.machine_file(path).unwrap();
    Study::new(Machine::parse(path, &text).unwrap()).unwrap()
}

/// A frame alone: legs of stiffness k at an angle α with the floor hold it up with
/// 6·k·(sin²α + 12·c·cos²α), c = (EI/L)/(k·L²) being the outline's 5.53e-4 for the
/// clamped ends' share, and turn it about z with the same, sin and cos exchanged, on
/// the mounts' circle; the disc's inertia is half of m·R².
#[test]
fn legs_hold_as_their_angle_says() {
    for (mounts, leg_angle) in [(Mounts::Three, 35.0), (Mounts::Six, 50.0)] {
        let outline = Outline {
            mounts,
            leg_angle,
            payload_mass: 0.0,
            ..Outline::default()
        };
        let study = study(&outline);
        let (sin, cos) = leg_angle.to_radians().sin_cos();
        let hz = |stiffness: f64| (stiffness / outline.frame_mass).sqrt() / TAU;
        let (axial, bent) = (
            outline.leg_stiffness,
            12.0 * 5.53e-4 * outline.leg_stiffness,
        );
        let up = hz(6.0 * (axial * sin * sin + bent * cos * cos));
        let modes = study.model().modes();
        let found = modes.hertz();
        // Up and down nothing turns: nothing else acts.
        let nearest = found.iter().map(|hz| (hz / up - 1.0).abs());
        assert!(nearest.fold(1.0, f64::min) < 1e-6, "{up} in {found:?}");
        // Turning bends the mounts' ends a little too.
        let turn = hz(12.0 * (axial * cos * cos + bent * sin * sin));
        let nearest = found.iter().map(|hz| (hz / turn - 1.0).abs());
        assert!(nearest.fold(1.0, f64::min) < 5e-3, "{turn} in {found:?}");
    }
}

/// Whatever the mass and the leg angle, the mean square of the frequencies along x, y and z is that of
/// 1590 kg on the legs of Table 1 of the paper, 2·k/m. From 36° to 54° these are the three lowest of
/// a disc.
#[test]
fn usual_legs_are_as_hard_as_the_papers() {
    let paper = (2.0 * 8.4e6 / 1590.0f64).sqrt() / TAU;
    for (mass, leg_angle) in [(18.0, 45.0), (260.0, 40.0), (5000.0, 50.0)] {
        let found = study(&Outline {
            leg_angle,
            leg_stiffness: usual_leg_stiffness(mass),
            frame_mass: mass,
            payload_mass: 0.0,
            ..Outline::default()
        });
        let found = found.model().modes().hertz();
        let mean = (found[..3].iter().map(|hz| hz * hz).sum::<f64>() / 3.0).sqrt();
        // Half of 5 % for two digits; bending of the legs adds 12·5.53e-4·(2·sin²α + ...) < 1 %.
        assert!((mean / paper - 1.0).abs() < 0.03, "{mean} of {found:?}");
    }
    let usual = Outline::default();
    let mass = usual.frame_mass + usual.payload_mass;
    assert_eq!(usual_leg_stiffness(mass), usual.leg_stiffness);
}

/// The payload moves on the frame where it was asked to, up and down: the mode of
/// two masses on three blocks, a little stiffened by the legs.
#[test]
fn payload_moves_where_it_was_asked() {
    for z in [-0.1, 0.25] {
        let outline = Outline {
            payload_at: [0.0, 0.0, z],
            ..Outline::default()
        };
        let found = study(&outline).model().modes().hertz();
        let nearest = found.iter().map(|hz| hz / outline.internal - 1.0);
        let nearest = nearest.min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap();
        // (13.9/90)² of the legs' share.
        assert!((0.0..0.05).contains(&nearest), "{nearest} of {found:?}");
    }
}

/// Above, below and beside the middle: the payload is where it was asked to be, on upright blocks
/// around its axis.
#[test]
fn payload_is_where_it_was_asked() {
    for at in [[0.15, -0.1, 0.3], [0.0, 0.2, -0.05]] {
        let outline = Outline {
            payload_at: at,
            ..Outline::default()
        };
        let text = outline.machine_file(Path::new("new.toml")).unwrap();
        let machine = Machine::parse(Path::new("new.toml"), &text).unwrap();
        let cog = |name: &str| {
            let body = machine.bodies.iter().find(|body| body.name == name);
            body.unwrap().cog
        };
        let offset = cog("payload") - cog("frame");
        assert_eq!([offset.x, offset.y, offset.z], at);
        let node = |name: String| {
            let node = machine.nodes.iter().find(|node| node.name == name);
            node.unwrap().at
        };
        let ends = [1, 2, 3].map(|i| (node(format!("payload{i}")), node(format!("frame{i}"))));
        for (upper, lower) in ends {
            let block = upper - lower;
            assert!(block.xy().norm() < 1e-9 && (block.z - at[2]).abs() < 1e-9);
        }
        let middle = ends
            .iter()
            .map(|(end, _)| end)
            .sum::<nalgebra::Vector3<f64>>()
            / 3.0;
        assert!((middle - cog("payload")).norm() < 1e-9, "{middle}");
        let word = if at[2] > 0.0 { "above" } else { "below" };
        assert!(text.contains(&format!("a payload {word} it")), "{text}");
    }
}

/// Whether two segments in a plane cross.
fn cross([a, b]: [[f64; 2]; 2], [c, d]: [[f64; 2]; 2]) -> bool {
    let side = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
        (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
    };
    side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
}

/// Crossing legs are those that the file's nodes draw so.
#[test]
fn crossing_legs_are_noticed() {
    let mut seen = [0, 0];
    for mounts in [Mounts::Three, Mounts::Six] {
        for leg_angle in [15.0, 30.0, 45.0] {
            for height in [0.1, 0.2, 0.4] {
                let outline = Outline {
                    mounts,
                    leg_angle,
                    height,
                    payload_mass: 0.0,
                    ..Outline::default()
                };
                let text = outline.machine_file(Path::new("new.toml")).unwrap();
                let machine = Machine::parse(Path::new("new.toml"), &text).unwrap();
                let legs: Vec<_> = machine
                    .actuators
                    .iter()
                    .map(|&leg| {
                        let ends = machine.beams[leg].ends;
                        ends.map(|node| [machine.nodes[node].at.x, machine.nodes[node].at.y])
                    })
                    .collect();
                let drawn = (0..6).any(|i| (0..i).any(|k| cross(legs[i], legs[k])));
                let doubts = outline.doubts();
                assert_eq!(doubts.len(), usize::from(drawn), "{outline:?} {doubts:?}");
                assert!(
                    doubts
                        .iter()
                        .all(|doubt| doubt.contains("legs of neighbouring mounts cross"))
                );
                seen[usize::from(drawn)] += 1;
            }
        }
    }
    assert!(seen[0] > 2 && seen[1] > 2, "{seen:?}");
}

/// A payload that would reach below the feet, which are 0.2 m below the mounts, or that stands
/// outside the mounts on a radius of 0.5 m.
#[test]
fn payloads_out_of_place_are_noticed() {
    for (at, says) in [
        ([0.0, 0.0, -0.1], None),
        ([0.0, 0.0, -0.12], Some("0.240 m below the mounts")),
        ([0.0, 0.0, 0.5], None),
        ([0.4, 0.2, 0.1], None),
        ([0.4, 0.4, 0.1], Some("0.566 m beside the middle")),
    ] {
        let mut outline = Outline {
            payload_at: at,
            ..Outline::default()
        };
        let doubts = outline.doubts();
        assert_eq!(
            doubts.len(),
            usize::from(says.is_some()),
            "{at:?}: {doubts:?}"
        );
        assert!(
            doubts.iter().all(|doubt| doubt.contains(says.unwrap())),
            "{doubts:?}"
        );
        // Without a payload, it is nowhere.
        outline.payload_mass = 0.0;
        assert!(outline.doubts().is_empty());
    }
}

/// The board is that of the file in the models' folder.
#[test]
fn boards_are_those_of_the_models() {
    for board in ReadyBoard::ALL {
        let file = match board {
            ReadyBoard::Example => "metrology-frame",
            ReadyBoard::Nucleo | ReadyBoard::NucleoFast => board.name(),
        };
        let model = model_path().with_file_name(format!("{file}.toml"));
        let model = Machine::load(&model).unwrap();
        let outline = Outline {
            board,
            ..Outline::default()
        };
        assert_eq!(study(&outline).machine().board, model.board, "{file}");
    }
}

/// A named accelerometer has its own figures, and its source stands in the file.
#[test]
fn accelerometers_are_those_of_the_library() {
    let mut seen = 0;
    for (name, part) in ready_accelerometers() {
        let outline = Outline {
            accelerometer: Some(name),
            ..Outline::default()
        };
        let text = outline.machine_file(Path::new("new.toml")).unwrap();
        assert!(errors(&text).is_empty(), "{:?}", errors(&text));
        let machine = Machine::parse(Path::new("new.toml"), &text).unwrap();
        let sensitivity = part.figures["sensitivity"].as_float().unwrap();
        assert_eq!(machine.board.sensor.sensitivity, sensitivity);
        assert!(machine.board.sensor.lower_corner.is_some());
        let sources = &machine.provenance;
        assert!(sources.iter().any(|source| source.from == part.source));
        seen += 1;
    }
    assert!(seen >= 2, "{seen}");
}

/// The usual outline is controlled as asked.
#[test]
fn the_usual_machine_has_a_controller() {
    for mounts in [Mounts::Three, Mounts::Six] {
        let study = study(&Outline {
            mounts,
            ..Outline::default()
        });
        let design = rough().design(&study).unwrap();
        assert!(design.isolation_from_hz < 1.5, "{design:?}");
    }
}

/// Beside the chosen feedback stand the other two.
#[test]
fn the_file_names_the_other_choices() {
    for (feedback, line) in [
        (
            FeedbackKind::Acceleration,
            r#"feedback = "acceleration" # or "force", "both""#,
        ),
        (
            FeedbackKind::Force,
            r#"feedback = "force" # or "acceleration", "both""#,
        ),
        (
            FeedbackKind::Both,
            r#"feedback = "both" # or "acceleration", "force""#,
        ),
    ] {
        let outline = Outline {
            feedback,
            ..Outline::default()
        };
        let text = outline.machine_file(Path::new("new.toml")).unwrap();
        assert!(text.lines().any(|found| found == line), "{text}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    /// Whatever is asked for in reason is a machine, and its file is what the schema
    /// allows.
    #[test]
    fn every_outline_is_a_machine(
        six in any::<bool>(),
        radius in 0.05..2.0,
        height in 0.05..1.0,
        leg_angle in 15.0..75.0,
        leg_stiffness in 1e5..1e9,
        frame_mass in 1.0..5000.0,
        payload_mass in prop_oneof![Just(0.0), 1.0..5000.0],
        payload_at in (-0.5..0.5, -0.5..0.5, prop_oneof![-0.5..-0.02, 0.02..0.5]),
        internal in 40.0..300.0,
    ) {
        let outline = Outline {
            mounts: if six { Mounts::Six } else { Mounts::Three },
            radius,
            height,
            leg_angle,
            leg_stiffness,
            frame_mass,
            payload_mass,
            payload_at: payload_at.into(),
            internal,
            feedback: FeedbackKind::Acceleration,
            ..Outline::default()
        };
        let study = study(&outline);
        prop_assert!(study.model().modes().hertz().iter().all(|hz| *hz > 0.0));
        let text = outline.machine_file(Path::new("new.toml")).unwrap();
        let errors = errors(&text);
        prop_assert!(errors.is_empty(), "{errors:?}");
    }
}

fn validator() -> Validator {
    let schema: Value = serde_json::from_str(&schema()).unwrap();
    jsonschema::validator_for(&schema).unwrap()
}

fn errors(text: &str) -> Vec<String> {
    let file: toml::Value = text.parse::<toml::Table>().unwrap().into();
    let file = serde_json::to_value(file).unwrap();
    let errors = validator();
    let errors = errors.iter_errors(&file);
    errors
        .map(|error| format!("{}: {error}", error.instance_path()))
        .collect()
}

/// The schema in the models' folder is the one that the program prints.
#[test]
fn checked_in_schema_is_current() {
    let checked_in =
        fs::read_to_string(model_path().with_file_name("machine.schema.json")).unwrap();
    assert!(
        checked_in == schema(),
        "host-gen schema > models/machine.schema.json"
    );
}

/// Every model in the folder is what the schema allows, those that are based on
/// another too.
#[test]
fn models_are_what_the_schema_allows() {
    let folder = model_path().parent().unwrap().to_owned();
    let mut seen = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            let errors = errors(&fs::read_to_string(&path).unwrap());
            assert!(errors.is_empty(), "{}: {errors:?}", path.display());
            seen += 1;
        }
    }
    assert!(seen >= 6, "{seen}");
}

/// What the program refuses for its form, the schema does not allow either.
#[test]
fn schema_finds_what_is_wrong() {
    for (old, new) in [
        ("mass = 742.0", "mas = 742.0"),
        ("mass = 742.0\n", ""),
        ("mass = 742.0", "mass = \"heavy\""),
        ("n3 = [0.0, 0.5, 0.0]", "n3 = [0.0, 0.5]"),
        ("bits = 16\nrange = 10.0", "bits = 24\nrange = 10.0"),
        ("feedback = \"acceleration\"", "feedback = \"speed\""),
        ("name = \"metrology-frame\"", "name = \"Metrology Frame\""),
        ("[actuators]\n", "[actuator]\n"),
    ] {
        let text = model_text();
        assert_eq!(text.matches(old).count(), 1, "{old}");
        let text = text.replace(old, new);
        assert!(!errors(&text).is_empty(), "{new}");
        assert!(
            Machine::parse(Path::new("test.toml"), &text).is_err(),
            "{new}"
        );
    }
}
