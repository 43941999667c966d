//! Machines built in code against machines read from files.

use std::f64::consts::FRAC_1_SQRT_2;
use std::path::Path;

use proptest::prelude::*;
use toml::Value;

use super::file::*;
use super::{Machine, MachineError};

const FRAME: &str = include_str!("../../../models/metrology-frame.toml");

fn parse(text: &str) -> Result<Machine, MachineError> {
    Machine::parse(Path::new("test.toml"), text)
}

fn all(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

fn direction(node: &str, axis: usize) -> DirectionEntry {
    DirectionEntry {
        node: node.to_owned(),
        direction: core::array::from_fn(|i| if i == axis { 1.0 } else { 0.0 }),
    }
}

/// The metrology frame, written out in Rust from Table 1 and Eq. (7) to Eq. (12).
fn frame() -> MachineFile {
    let ends = |p: &str, q: &str, profile: &str| BeamEntry {
        nodes: [p.to_owned(), q.to_owned()],
        profile: Some(profile.to_owned()),
        ..BeamEntry::default()
    };
    let legs = [
        ("leg4", "n9", "n3"),
        ("leg5", "n11", "n3"),
        ("leg6", "n13", "n5"),
        ("leg7", "n15", "n5"),
        ("leg8", "n17", "n7"),
        ("leg9", "n19", "n7"),
    ];
    let blocks = [15, 16, 17].map(|i| {
        let block = ends(&format!("lens{i}"), &format!("frame{i}"), "block");
        (format!("block{i}"), block)
    });
    let beams = legs.map(|(name, foot, top)| (name.to_owned(), ends(foot, top, "leg")));
    let deformations = (1..=6).map(|k| format!("block15.e{k}"));
    let lengths = legs.map(|(name, ..)| format!("{name}.e1"));
    let profile = |axial: f64, bending: f64, torsion: f64| ProfileEntry {
        axial: Some(axial),
        bending: Some([bending; 2]),
        torsion: Some(torsion),
        ..ProfileEntry::default()
    };
    let body = |mass: f64, moments: [f64; 3], height: f64, nodes: &[&str]| BodyEntry {
        mass,
        inertia: Inertia::Diagonal(moments),
        cog: [0.0, 0.0, height],
        nodes: all(nodes),
    };
    let sensor = |sensitivity: f64, noise_density: f64| SensorEntry {
        sensitivity,
        noise_density: noise_density.into(),
        offset: 2e-3,
        bandwidth: None,
        lower_corner: None,
        lower_order: None,
        transverse: None,
        resonance: None,
    };
    let named = |name: &str, node: &str, axis: usize| (name.to_owned(), direction(node, axis));
    let nodes = [
        ("n3", [0.0, 0.5, 0.0]),
        ("n5", [-0.433012701892219, -0.25, 0.0]),
        ("n7", [0.433012701892219, -0.25, 0.0]),
        ("n9", [-0.2, 0.5, -0.2]),
        ("n11", [0.2, 0.5, -0.2]),
        ("n13", [-0.333012701892219, -0.423205080756888, -0.2]),
        ("n15", [-0.533012701892219, -0.076794919243112, -0.2]),
        ("n17", [0.533012701892219, -0.076794919243113, -0.2]),
        ("n19", [0.333012701892219, -0.423205080756888, -0.2]),
        ("lens15", [-0.285788383248865, 0.165, -0.1]),
        ("lens16", [0.0, -0.33, -0.1]),
        ("lens17", [0.285788383248865, 0.165, -0.1]),
        ("frame15", [-0.285788383248865, 0.165, 0.0]),
        ("frame16", [0.0, -0.33, 0.0]),
        ("frame17", [0.285788383248865, 0.165, 0.0]),
    ];
    MachineFile {
        format: 1,
        name: "metrology-frame".to_owned(),
        gravity: [0.0; 3],
        nodes: nodes.map(|(name, at)| (name.to_owned(), at)).into(),
        base: BaseEntry {
            nodes: all(&["n9", "n11", "n13", "n15", "n17", "n19"]),
        },
        free: FreeEntry::default(),
        bodies: [
            (
                "frame".to_owned(),
                body(
                    742.0,
                    [52.25, 52.25, 104.5],
                    0.0,
                    &["n3", "n5", "n7", "frame15", "frame16", "frame17"],
                ),
            ),
            (
                "lens".to_owned(),
                body(
                    851.6,
                    [72.95, 72.95, 49.15],
                    -0.1,
                    &["lens15", "lens16", "lens17"],
                ),
            ),
        ]
        .into(),
        flexible_bodies: Default::default(),
        springs: Default::default(),
        point_masses: Default::default(),
        loads: [("frame", 0, false), ("twist", 2, true)]
            .map(|(name, axis, moment)| {
                let load = LoadEntry {
                    node: "n3".to_owned(),
                    direction: direction("n3", axis).direction,
                    moment,
                };
                (name.to_owned(), load)
            })
            .into(),
        profiles: [
            ("leg".to_owned(), profile(8.389e6, 371.0, 5.84)),
            ("block".to_owned(), profile(4.5e7, 3.0e4, 1.0e4)),
        ]
        .into(),
        beams: beams.into_iter().chain(blocks).collect(),
        coordinates: CoordinatesEntry {
            deformations: lengths.into_iter().chain(deformations.clone()).collect(),
        },
        actuators: ActuatorsEntry {
            beams: legs.map(|(name, ..)| name.to_owned()).into(),
        },
        sensors: SensorsEntry {
            acceleration: [
                named("x3", "n3", 0),
                named("z3", "n3", 2),
                named("y5", "n5", 1),
                named("z5", "n5", 2),
                named("z7", "n7", 2),
                named("y7", "n7", 1),
            ]
            .into(),
            force: legs
                .map(|(leg, ..)| {
                    let beam = leg.to_owned();
                    (leg.replace("leg", "f"), ForceSensorEntry { beam })
                })
                .into(),
        },
        floor: FloorEntry {
            inputs: [
                named("x9", "n9", 0),
                named("z11", "n11", 2),
                named("y13", "n13", 1),
                named("z15", "n15", 2),
                named("z17", "n17", 2),
                named("y19", "n19", 1),
            ]
            .into(),
            rotation: None,
            wave_speed: None,
            spectrum: None,
        },
        performance: PerformanceEntry {
            deformations: deformations.collect(),
            accelerations: [].into(),
            bands: [
                ("suspension".to_owned(), [5.0, 40.0]),
                ("internal".to_owned(), [40.0, 300.0]),
            ]
            .into(),
            exposure: None,
        },
        damping: DampingEntry {
            modal: Some(0.005),
            ..DampingEntry::default()
        },
        control: ControlEntry {
            feedback: FeedbackKind::Acceleration,
            frequency: 1.0,
            damping: 0.7,
            max_sensitivity: 2.0,
            law: LawName::Modal,
            shapes: None,
            roll_off: None,
            minimise: Minimise::Peaks,
            penalty: None,
        },
        board: BoardEntry {
            sample_rate: 20e3,
            conversion_delay: 10e-6,
            output_delay: 40e-6,
            adc: AdcEntry {
                bits: 16,
                range: 10.0,
                noise: 0.2e-3,
            },
            dac: DacEntry {
                bits: 16,
                range: [0.0, 5.0],
                noise: 50e-6,
            },
            accelerometer: Some(sensor(20.0, 1e-7)),
            force_sensor: Some(sensor(0.02, 1e-4)),
            actuator: ActuatorEntry {
                gain: Some(100.0),
                limit: Some(200.0),
                ..ActuatorEntry::default()
            },
            gains: GainsEntry::default(),
        },
        supervision: SupervisionSettings::default(),
        simulation: Simulation::default(),
        robustness: RobustnessEntry::default(),
        uncertainty: UncertaintyEntry::default(),
        provenance: Vec::new(),
    }
}

/// Field by field, digest included; only the statements of provenance are the file's own.
#[test]
fn the_metrology_frame_in_code_is_the_one_in_the_file() {
    let read = parse(FRAME).unwrap();
    let mut file = frame();
    file.provenance = read.provenance.clone();
    let built = Machine::build(file).unwrap();
    assert_eq!(built, read);
    assert_eq!(built.files().count(), 0);

    let mut heavier = read.description().clone();
    heavier.bodies["frame"].mass = 743.0;
    let heavier = Machine::build(heavier).unwrap();
    assert_ne!(heavier, read);
    assert_ne!(heavier.digest, read.digest);
}

/// What is written out is read back the same, and defaults are among it.
#[test]
fn a_machine_in_code_can_be_written() {
    let text = frame().to_table().unwrap().to_string();
    assert!(text.contains("floor_band"), "{text}");
    assert_eq!(parse(&text).unwrap(), Machine::build(frame()).unwrap());
}

fn set(value: &mut Value, path: &[String], new: f64) {
    match path.split_first() {
        None => *value = Value::Float(new),
        Some((first, rest)) => match value {
            Value::Table(table) => set(&mut table[first], rest, new),
            Value::Array(list) => set(&mut list[first.parse::<usize>().unwrap()], rest, new),
            _ => panic!("{path:?}"),
        },
    }
}

/// The paths of all numbers that may be broken.
fn floats(value: &Value, path: &[String], found: &mut Vec<Vec<String>>) {
    let below = |step: &str| [path, &[step.to_owned()]].concat();
    match value {
        Value::Float(_) => found.push(path.to_vec()),
        Value::Table(table) => {
            for (key, value) in table {
                floats(value, &below(key), found);
            }
        }
        Value::Array(list) => {
            for (i, value) in list.iter().enumerate() {
                floats(value, &below(&i.to_string()), found);
            }
        }
        _ => {}
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 300,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// Whatever number is wrong: code and file are refused for the same entry in the same
    /// words, or both are the same machine. Only the file's error has a line.
    #[test]
    fn code_and_file_are_refused_alike(
        which in any::<prop::sample::Index>(),
        awkward in prop::sample::select(vec![
            f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0, -1.0, 1.0, 0.99, 1e300,
            -1e300, 1e-300, 5e-324, FRAC_1_SQRT_2,
        ]),
    ) {
        let mut value = Value::Table(frame().to_table().unwrap());
        let mut numbers = Vec::new();
        floats(&value, &[], &mut numbers);
        let path: &Vec<String> = which.get(&numbers);
        set(&mut value, path, awkward);
        let file: MachineFile = value.clone().try_into().unwrap();
        let text = value.as_table().unwrap().to_string();
        match (Machine::build(file), parse(&text)) {
            (Ok(built), Ok(read)) => prop_assert!(built == read, "two machines"),
            (Err(built), Err(read)) => {
                prop_assert_eq!(built.entry(), read.entry());
                prop_assert_eq!(built.message(), read.message());
                prop_assert_eq!(built.fix(), read.fix());
                prop_assert_eq!(built.place(), None);
                prop_assert_eq!(built.file(), None);
                prop_assert!(read.place().is_some(), "{}", read);
                let line = read.to_string();
                prop_assert!(line.ends_with(&built.to_string()), "{} / {}", line, built);
            }
            (built, read) => prop_assert!(false, "{:?} / {:?}", built.err(), read.err()),
        }
    }
}

/// What types allow and a file cannot say.
#[test]
fn wrong_in_code() {
    let refused = |change: fn(&mut MachineFile)| {
        let mut file = frame();
        change(&mut file);
        Machine::build(file).unwrap_err().to_string()
    };
    assert_eq!(
        refused(|file| file.bodies["lens"].mass = -120.0),
        "bodies.lens.mass: mass must be above 0 kg, not -120"
    );
    assert_eq!(
        refused(|file| file.beams["leg4"].nodes[1] = "n33".to_owned()),
        "beams.leg4.nodes: node \"n33\" does not exist; did you mean \"n3\"? Otherwise add it under [nodes]"
    );
    assert_eq!(
        refused(|file| file.simulation.seed = 1 << 63),
        "simulation.seed: seed must be at most 9223372036854775807, not 9223372036854775808"
    );
    assert_eq!(
        refused(|file| file.robustness.samples = 0),
        "robustness.samples: samples must be at least 1"
    );
    assert_eq!(
        refused(|file| file.control.max_sensitivity = f64::NAN),
        "control.max_sensitivity: max_sensitivity must be a finite number, not NaN"
    );
}
