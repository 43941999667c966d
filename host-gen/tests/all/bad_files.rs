//! One clear error each, naming the entry and its line.

use crate::common::{model_text, parse};
use host_gen::design::Study;
use host_gen::machine::MachineError;
use proptest::prelude::*;

/// Everything that can be wrong before the roll-off is searched.
fn error_of(text: &str) -> MachineError {
    match parse(text) {
        Err(error) => error,
        Ok(machine) => Study::new(machine).expect_err("the file is bad"),
    }
}

/// Replaces `old`, which must be there once, and asserts that the error names
/// `entry`, stands on the line of `line_of`, and says `says`.
#[track_caller]
fn refused(old: &str, new: &str, line_of: &str, entry: &str, says: &str) {
    let text = model_text();
    assert_eq!(
        text.matches(old).count(),
        1,
        "\"{old}\" is in the file once"
    );
    let text = text.replace(old, new);
    let error = error_of(&text);
    let line = text
        .lines()
        .position(|line| line.contains(line_of))
        .unwrap()
        + 1;
    assert_eq!(error.place().map(|p| p.0), Some(line), "{error}");
    assert_eq!(error.entry(), entry, "{error}");
    let message = error.to_string();
    assert!(message.contains(says), "\"{message}\" says \"{says}\"");
    assert!(!message.trim().contains('\n'), "one line: {message}");
}

#[test]
fn unknown_key() {
    refused(
        "mass = 742.0",
        "mas = 742.0",
        "mas = 742.0",
        "bodies.frame.mas",
        "unknown key `mas`; did you mean `mass`? Otherwise use one of `mass`",
    );
    refused(
        "seed = 1",
        "sead = 1",
        "sead = 1",
        "simulation.sead",
        "unknown key `sead`",
    );
}

#[test]
fn missing_key() {
    refused(
        "cog = [0.0, 0.0, 0.0]\n",
        "",
        "[bodies.frame]",
        "bodies.frame",
        "missing key `cog`; add it: Position `[x, y, z]` of the centre of gravity, m",
    );
}

/// All of them at once, each with what it is, by tables: those nearer to the top first.
#[test]
fn missing_keys() {
    refused(
        "mass = 742.0\n",
        "",
        "[bodies.frame]",
        "bodies.frame",
        "missing key `mass`; add it: Mass of the body, kg",
    );
    let mut table: toml::Table = model_text().parse().unwrap();
    table.remove("coordinates");
    table.remove("board");
    table["bodies"]["lens"]
        .as_table_mut()
        .unwrap()
        .remove("cog");
    table["control"].as_table_mut().unwrap().remove("damping");
    let error = parse(&table.to_string()).unwrap_err();
    assert_eq!(error.entry(), "");
    let keys = [
        "`coordinates`",
        "`board`",
        "`control.damping`",
        "`bodies.lens.cog`",
    ];
    assert_eq!(error.message(), format!("missing keys {}", keys.join(", ")));
    let fix = error.fix().unwrap();
    for says in [
        "add them: `coordinates`, The degrees of freedom q_d, Eq. (7)",
        "`bodies.lens.cog`, Position `[x, y, z]` of the centre of gravity, m",
    ] {
        assert!(fix.contains(says), "{fix}");
    }
}

#[test]
fn wrong_layout() {
    refused(
        "format = 1",
        "format = 2",
        "format = 2",
        "format",
        "reads format 1",
    );
}

#[test]
fn bad_name() {
    refused(
        "name = \"metrology-frame\"",
        "name = \"../x\"",
        "name =",
        "name",
        "lower-case",
    );
}

#[test]
fn missing_node() {
    refused(
        "[\"n9\", \"n3\"]",
        "[\"n9\", \"n33\"]",
        "leg4 = {",
        "beams.leg4.nodes",
        "node \"n33\" does not exist",
    );
    refused(
        "x9 = { node = \"n9\"",
        "x9 = { node = \"m9\"",
        "x9 = {",
        "floor.inputs.x9.node",
        "\"m9\"",
    );
    refused(
        "nodes = [\"lens15\", \"lens16\"",
        "nodes = [\"lens14\", \"lens16\"",
        "\"lens14\"",
        "bodies.lens.nodes",
        "\"lens14\"",
    );
}

#[test]
fn repeated_name() {
    refused("n5 = [", "n3 = [", "n3 = [-0.4", "", "duplicate key");
    refused(
        "\"block15.e1\", \"block15.e2\", \"block15.e3\", \"block15.e4\", \"block15.e5\", \"block15.e6\",\n]\n\n# Eq. (9)",
        "\"block15.e1\", \"block15.e2\", \"block15.e2\", \"block15.e4\", \"block15.e5\", \"block15.e6\",\n]\n\n# Eq. (9)",
        "deformations = [",
        "coordinates.deformations",
        "\"block15.e2\" is listed twice",
    );
    refused(
        "beams = [\"leg4\", \"leg5\"",
        "beams = [\"leg4\", \"leg4\"",
        "beams = [\"leg4\"",
        "actuators.beams",
        "\"leg4\" is listed twice",
    );
}

#[test]
fn node_carried_twice_or_not_at_all() {
    refused(
        "nodes = [\"n3\", \"n5\", ",
        "nodes = [\"n3\", \"n9\", \"n5\", ",
        "nodes = [\"n3\"",
        "bodies.frame.nodes",
        "node \"n9\" is listed twice",
    );
    refused(
        "nodes = [\"n3\", \"n5\", ",
        "nodes = [\"n5\", ",
        "n3 = [",
        "nodes.n3",
        "not attached to anything",
    );
}

#[test]
fn mass_that_is_not_positive() {
    refused(
        "mass = 742.0",
        "mass = 0.0",
        "mass = 0.0",
        "bodies.frame.mass",
        "mass must be above 0 kg, not 0",
    );
    refused(
        "inertia = [52.25, 52.25, 104.5]",
        "inertia = [52.25, 0.0, 104.5]",
        "inertia = [52.25",
        "bodies.frame.inertia",
        "the largest must not exceed the sum of the others",
    );
    refused(
        "inertia = [52.25, 52.25, 104.5]",
        "inertia = [[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
        "inertia = [[1.0",
        "bodies.frame.inertia",
        "the largest must not exceed the sum of the others",
    );
    refused(
        "inertia = [52.25, 52.25, 104.5]",
        "inertia = [52.25, -52.25, 104.5]",
        "inertia = [52.25",
        "bodies.frame.inertia",
        "principal moments of inertia must not be below 0 kg m²",
    );
    refused(
        "inertia = [52.25, 52.25, 104.5]",
        "inertia = [[1.0, 0.1, 0.0], [0.2, 1.0, 0.0], [0.0, 0.0, 1.0]]",
        "inertia = [[1.0",
        "bodies.frame.inertia",
        "must be symmetric",
    );
}

#[test]
fn inertia_in_no_notation() {
    refused(
        "inertia = [52.25, 52.25, 104.5]",
        "inertia = [52.25, 52.25]",
        "inertia = [52.25, 52.25]",
        "bodies.frame.inertia",
        "three principal moments",
    );
}

#[test]
fn singular_sensors() {
    // Six sensors that do not see the turn about z.
    refused(
        "y5 = { node = \"n5\", direction = [0.0, 1.0, 0.0]",
        "y5 = { node = \"n5\", direction = [0.0, 0.0, 1.0]",
        "z5 = {",
        "sensors.acceleration.z5",
        "singular sensor arrangement",
    );
}

#[test]
fn dependent_coordinates() {
    // e1 of the second block follows from the six of the first.
    refused(
        "\"leg9.e1\",\n",
        "\"block16.e1\",\n",
        "deformations = [",
        "coordinates.deformations",
        "dependent degrees of freedom: \"block15.e",
    );
    refused(
        "\"leg9.e1\",\n",
        "",
        "deformations = [",
        "coordinates.deformations",
        "11 deformations are given; 2 bodies need 12",
    );
    refused(
        "\"leg9.e1\",\n",
        "\"leg9.e7\",\n",
        "deformations = [",
        "coordinates.deformations",
        "\"leg9.e7\" is not a deformation",
    );
}

#[test]
fn dependent_floor() {
    refused(
        "z15 = { node = \"n15\", direction = [0.0, 0.0, 1.0]",
        "z15 = { node = \"n11\", direction = [0.0, 0.0, 1.0]",
        "z15 = {",
        "floor.inputs.z15",
        "rigid base",
    );
    refused(
        "z15 = { node = \"n15\"",
        "z15 = { node = \"n3\"",
        "z15 = {",
        "floor.inputs.z15.node",
        "does not move with the base",
    );
}

/// All six legs in planes through the z axis: none turns the machine about it.
/// The coordinates are those of one leg, so that they are not to blame.
#[test]
fn singular_actuators() {
    let text = crate::common::edited(&[
        ("nodes.n9", "[0.0, 0.7, -0.2]"),
        ("nodes.n11", "[0.0, 0.3, -0.2]"),
        ("nodes.n13", "[-0.606217782649107, -0.35, -0.2]"),
        ("nodes.n15", "[-0.259807621135332, -0.15, -0.2]"),
        ("nodes.n17", "[0.606217782649107, -0.35, -0.2]"),
        ("nodes.n19", "[0.259807621135332, -0.15, -0.2]"),
        (
            "coordinates.deformations",
            r#"["leg4.e1", "leg4.e2", "leg4.e3", "leg4.e4", "leg4.e5", "leg4.e6",
                "block15.e1", "block15.e2", "block15.e3", "block15.e4", "block15.e5", "block15.e6"]"#,
        ),
    ]);
    let error = error_of(&text);
    assert_eq!(error.entry(), "actuators.beams", "{error}");
    assert!(
        error.to_string().contains("singular actuator arrangement"),
        "{error}"
    );
}

#[test]
fn direction_that_is_none() {
    refused(
        "x3 = { node = \"n3\", direction = [1.0, 0.0, 0.0]",
        "x3 = { node = \"n3\", direction = [1.0, 1.0, 0.0]",
        "x3 = {",
        "sensors.acceleration.x3.direction",
        "unit vector",
    );
    refused(
        "x3 = { node = \"n3\", direction = [1.0, 0.0, 0.0]",
        "x3 = { node = \"n3\", direction = [nan, 0.0, 0.0]",
        "x3 = {",
        "sensors.acceleration.x3.direction",
        "finite",
    );
}

#[test]
fn profile_errors() {
    refused(
        "torsion = 5.84 ",
        "torsion_constant = 5.84 ",
        "[profiles.leg]",
        "profiles.leg",
        "must have either axial",
    );
    refused(
        "leg4 = { nodes = [\"n9\", \"n3\"], profile = \"leg\" }",
        "leg4 = { nodes = [\"n9\", \"n3\"] }",
        "leg4 = {",
        "beams.leg4",
        "must have either profile",
    );
    refused(
        "leg4 = { nodes = [\"n9\", \"n3\"], profile = \"leg\" }",
        "leg4 = { nodes = [\"n9\", \"n3\"], profile = \"log\" }",
        "leg4 = {",
        "beams.leg4.profile",
        "profile \"log\" does not exist",
    );
    refused(
        "axial = 8.389e6 ",
        "axial = -8.389e6 ",
        "[profiles.leg]",
        "profiles.leg",
        "axial stiffness EA/L must be finite and at least 0 N/m",
    );
    refused(
        "[\"n9\", \"n3\"]",
        "[\"n9\", \"n9\"]",
        "leg4 = {",
        "beams.leg4.nodes",
        "same position",
    );
}

#[test]
fn a_machine_that_nothing_holds() {
    // Blocks without stiffness: the lens floats.
    refused(
        "axial = 4.5e7\nbending = [3.0e4, 3.0e4]\ntorsion = 1.0e4",
        "axial = 0.0\nbending = [0.0, 0.0]\ntorsion = 0.0",
        "[bodies.lens]",
        "bodies.lens",
        "without deforming",
    );
}

#[test]
fn board_errors() {
    refused(
        "limit = 200.0",
        "limit = 300.0",
        "limit = 300.0",
        "board.actuator.limit",
        "at most 249.992371 N",
    );
    refused(
        "range = 10.0 ",
        "range = -10.0 ",
        "range = -10.0",
        "board.adc.range",
        "range must be above 0 V",
    );
    refused(
        "bits = 16\nrange = 10.0",
        "bits = 24\nrange = 10.0",
        "bits = 24",
        "board.adc.bits",
        "bits must be 8 to 16",
    );
    refused(
        "sample_rate = 20e3",
        "sample_rate = 0.0",
        "sample_rate",
        "board.sample_rate",
        "sample_rate must be above 0 Hz",
    );
    refused(
        "output_delay = 40e-6",
        "output_delay = 40e-3",
        "output_delay",
        "board.output_delay",
        "eight sample periods",
    );
    refused(
        "[board.accelerometer]\nsensitivity = 20.0",
        "[board.accelerometer]\nsensitivity = 0.0",
        "sensitivity = 0.0",
        "board.accelerometer.sensitivity",
        "sensitivity must differ from 0",
    );
}

#[test]
fn control_errors() {
    refused(
        "max_sensitivity = 2.0",
        "max_sensitivity = 1.0",
        "max_sensitivity",
        "control.max_sensitivity",
        "above 1",
    );
    refused(
        "frequency = 1.0 # Hz",
        "frequency = -1.0 # Hz",
        "frequency = -1.0",
        "control.frequency",
        "frequency must be above 0 Hz",
    );
    refused(
        "feedback = \"acceleration\"",
        "feedback = \"velocity\"",
        "feedback = \"velocity\"",
        "control.feedback",
        "unknown value `velocity`; use one of `acceleration`, `force`, `both`",
    );
    refused(
        "feedback = \"acceleration\"",
        "law = \"direct\"\nfeedback = \"both\"",
        "law = \"direct\"",
        "control.law",
        "needs law = \"modal\"",
    );
}

#[test]
fn wrong_type() {
    refused(
        "mass = 742.0",
        "mass = \"heavy\"",
        "mass = \"heavy\"",
        "bodies.frame.mass",
        "expected a number, in kg, found string \"heavy\"",
    );
    // Within an array of many.
    refused(
        "n3 = [0.0, 0.5, 0.0]",
        "n3 = [0.0, \"half\", 0.0]",
        "n3 = [",
        "nodes.n3[1]",
        "expected a number, in m, found string \"half\"",
    );
    refused(
        "bits = 16\nrange = 10.0",
        "bits = -16\nrange = 10.0",
        "bits = -16",
        "board.adc.bits",
        "expected a whole number from 0 to 4294967295, found integer `-16`",
    );
    refused(
        "[base]\nnodes =",
        "[base]\nnodes = 3\n#",
        "nodes = 3",
        "base.nodes",
        "expected an array, found integer `3`",
    );
    refused(
        "kind = \"published\"\nfrom = \"Table 1\"",
        "kind = \"printed\"\nfrom = \"Table 1\"",
        "kind = \"printed\"",
        "provenance[0].kind",
        "unknown value `printed`; use one of `published`",
    );
    refused(
        "feedback = \"acceleration\"",
        "feedback = 3",
        "feedback = 3",
        "control.feedback",
        "expected a string; Sensors to feed back: `\"acceleration\"`",
    );
    refused(
        "floor_band = [1.0, 200.0]",
        "floor_band = [1.0]",
        "floor_band = [1.0]",
        "simulation.floor_band",
        "expected an array of length 2, found length 1",
    );
    refused(
        "name = \"metrology-frame\"",
        "name = 3",
        "name = 3",
        "name",
        "expected a string, found integer `3`",
    );
    refused(
        "leg9 = { nodes = [\"n19\", \"n7\"], profile = \"leg\" }",
        "leg9 = \"leg\"",
        "leg9 = \"leg\"",
        "beams.leg9",
        "expected a table, found string \"leg\"",
    );
}

/// A byte order mark is no column of the first line.
#[test]
fn a_byte_order_mark() {
    let text = model_text();
    let start = text.find("format = 1").unwrap();
    let text = format!("\u{feff}{}", &text[start..]).replace("format = 1", "format = 2");
    assert_eq!(error_of(&text).place(), Some((1, 1)));
}

/// A name may have dots in it.
#[test]
fn a_dotted_name() {
    let text = model_text().replace("n3 = [0.0, 0.5, 0.0]", "\"n.3\" = [0.0, inf, 0.0]");
    let text = text
        .replace("\"n3\"", "\"n.3\"")
        .replace("\"nodes.n3\", ", "");
    let error = error_of(&text);
    assert_eq!(error.entry(), "nodes.n.3", "{error}");
    let line = text.lines().position(|line| line.starts_with("\"n.3\" ="));
    assert_eq!(
        error.place().map(|(line, _)| line),
        line.map(|line| line + 1)
    );
}

#[test]
fn provenance_of_nothing() {
    refused(
        "\"nodes.n3\", \"nodes.n5\"",
        "\"nodes.n3\", \"nodes.n4\"",
        "\"nodes.n4\"",
        "provenance[4].entries",
        "there is no entry \"nodes.n4\"",
    );
}

#[test]
fn not_toml() {
    refused("format = 1", "format = = 1", "format = = 1", "", "");
}

/// Errors in a file that is based on another name the file they are in.
#[test]
fn based_on_another() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let load = |text: &str| {
        let path = write("variant.toml", text);
        match host_gen::machine::Machine::load(&path) {
            Err(error) => error.to_string(),
            Ok(machine) => Study::new(machine)
                .expect_err("the file is bad")
                .to_string(),
        }
    };
    write("base.toml", &model_text());
    let start = "based_on = \"base.toml\"\n";
    let own = load(&format!("{start}[bodies.frame]\nmass = -1.0\n"));
    assert!(own.contains("variant.toml:3:1: bodies.frame.mass"), "{own}");
    let unknown = load(&format!("{start}[bodies.frame]\nmas = 1.0\n"));
    assert!(
        unknown.contains("variant.toml:3:1: bodies.frame.mas: unknown key"),
        "{unknown}"
    );
    let whole = load(&format!("{start}[nodes]\nlost = [0.0, 0.0, 0.0]\n"));
    assert!(
        whole.contains("variant.toml:3:1: nodes.lost: the node is not attached"),
        "{whole}"
    );
    let base = load(&format!(
        "{start}[control]\ndamping = 0.5\n[base]\nnodes = []\n"
    ));
    assert!(
        base.contains("base.toml:") && base.contains("nodes.n9: the node is not attached"),
        "{base}"
    );
    // The file's own statement is counted after those of its base.
    let stated = load(&format!(
        "{start}[[provenance]]\nkind = \"assumed\"\nfrom = \"\"\nentries = [\"lost\"]\n"
    ));
    assert!(
        stated.contains("variant.toml:5:1: provenance[10].entries: there is no entry \"lost\""),
        "{stated}"
    );
    assert!(load("based_on = \"none.toml\"\n").contains("none.toml cannot be read"));
    let own = "variant.toml:1:1: based_on: the file is based on itself";
    assert!(load("based_on = \"variant.toml\"\n").contains(own));
    assert!(load("based_on = \"./variant.toml\"\n").contains(own));
    // The file that is asked for need not be in the circle.
    write("a.toml", "based_on = \"b.toml\"\n");
    write("b.toml", "based_on = \"a.toml\"\n");
    let circle = load("based_on = \"a.toml\"\n");
    assert!(
        circle.contains("b.toml:1:1: based_on: the files are based on each other in a circle: ")
            && circle.matches("a.toml").count() == 2
            && !circle.contains("variant.toml"),
        "{circle}"
    );
    for k in 0..8 {
        write(
            &format!("{k}.toml"),
            &format!("based_on = \"{}.toml\"\n", k + 1),
        );
    }
    write("8.toml", &model_text());
    let long = load("based_on = \"0.toml\"\n");
    assert!(long.contains("more than 8 files"), "{long}");
    assert!(load("based_on = 3\n").contains("variant.toml:1:1: based_on: must be the path"));
}

#[test]
fn no_file() {
    let path = std::path::Path::new("no-such-machine.toml");
    let error = host_gen::machine::Machine::load(path)
        .unwrap_err()
        .to_string();
    assert!(
        error.starts_with("no-such-machine.toml: cannot be read"),
        "{error}"
    );
}

/// Mistakes in the form of the file: each in a line of its own, alone, and in any company.
const FORMS: [(&str, &str, &str); 8] = [
    ("mass = 742.0", "mas = 742.0", "bodies.frame.mas"),
    ("n3 = [0.0, 0.5, 0.0]", "n3 = [0.0, 0.5]", "nodes.n3"),
    ("mass = 851.6", "mass = \"heavy\"", "bodies.lens.mass"),
    (
        "\"block15.e6\",\n]\n\n# Eq. (9)",
        "6,\n]\n\n# Eq. (9)",
        "coordinates.deformations[11]",
    ),
    (
        "feedback = \"acceleration\"",
        "feedback = \"speed\"",
        "control.feedback",
    ),
    (
        "[performance]\n",
        "[performance]\ncolour = 1\n",
        "performance.colour",
    ),
    (
        "bits = 16\nrange = 10.0",
        "bits = 16\nrange = \"wide\"",
        "board.adc.range",
    ),
    ("gain = 100.0 ", "gian = 100.0 ", "board.actuator.gian"),
];

/// Mistakes in what the file says.
const VALUES: [(&str, &str, &str); 10] = [
    ("mass = 742.0", "mass = -742.0", "bodies.frame.mass"),
    (
        "inertia = [72.95, 72.95, 49.15]",
        "inertia = [72.95, 72.95, 490.15]",
        "bodies.lens.inertia",
    ),
    ("[\"n13\", \"n5\"]", "[\"n31\", \"n5\"]", "beams.leg6.nodes"),
    (
        "x3 = { node = \"n3\"",
        "x3 = { node = \"n33\"",
        "sensors.acceleration.x3.node",
    ),
    (
        "z7 = { node = \"n7\", direction = [0.0, 0.0, 1.0]",
        "z7 = { node = \"n7\", direction = [0.0, 0.0, 2.0]",
        "sensors.acceleration.z7.direction",
    ),
    (
        "f4 = { beam = \"leg4\" }",
        "f4 = { beam = \"lag4\" }",
        "sensors.force.f4.beam",
    ),
    ("frequency = 1.0 ", "frequency = 0.0 ", "control.frequency"),
    (
        "sample_rate = 20e3 ",
        "sample_rate = -20e3 ",
        "board.sample_rate",
    ),
    (
        "noise_density = 1e-7 ",
        "noise_density = -1e-7 ",
        "board.accelerometer.noise_density",
    ),
    ("modal = 0.005", "modal = -0.5", "damping.modal"),
];

fn with(mistakes: &[(&str, &str, &str)], made: u32) -> (String, Vec<String>) {
    let mut text = model_text();
    let mut entries = Vec::new();
    for (i, (old, new, entry)) in mistakes.iter().enumerate() {
        if made >> i & 1 == 1 {
            assert_eq!(text.matches(old).count(), 1, "{old}");
            text = text.replace(old, new);
            entries.push((*entry).to_owned());
        }
    }
    entries.sort();
    (text, entries)
}

fn entries(error: &MachineError) -> Vec<String> {
    let mut all: Vec<_> = error.all().map(|one| one.entry().to_owned()).collect();
    all.sort();
    all
}

/// Every mistake of a form is told, each on its line, and nothing else is: not what follows from them.
#[test]
fn all_mistakes_of_form_are_told_at_once() {
    for made in 1..1 << FORMS.len() {
        let (text, expected) = with(&FORMS, made);
        let error = error_of(&text);
        assert_eq!(entries(&error), expected, "{error}");
        assert!(error.all().all(|one| one.place().is_some()), "{error}");
        assert_eq!(error.to_string().lines().count(), expected.len(), "{error}");
    }
}

/// Of mistakes in what the file says, all are told that do not depend on others, and no others.
#[test]
fn all_independent_mistakes_of_content_are_told_at_once() {
    for made in 1..1 << VALUES.len() {
        let (text, expected) = with(&VALUES, made);
        let error = error_of(&text);
        let found = entries(&error);
        assert!(
            found.iter().all(|entry| expected.contains(entry)),
            "{expected:?}: {error}"
        );
        // Damping follows from the parts, and the board's noise is looked at once these are right.
        let first = ["bodies", "beams", "sensors", "control", "board.sample_rate"];
        let of = |entries: &[String]| {
            let is = |entry: &&String| first.iter().any(|part| entry.starts_with(part));
            entries.iter().filter(is).cloned().collect::<Vec<_>>()
        };
        assert_eq!(of(&found), of(&expected), "{error}");
    }
}

/// Every line that is no TOML, once.
#[test]
fn all_lines_that_are_no_toml_are_told_at_once() {
    let text = model_text()
        .replace("mass = 742.0", "mass = = 742.0")
        .replace("limit = 200.0", "limit 200.0");
    let error = error_of(&text);
    let lines: Vec<_> = error
        .all()
        .filter_map(|one| one.place())
        .map(|(line, _)| line)
        .collect();
    let line = |part: &str| text.lines().position(|line| line.contains(part)).unwrap() + 1;
    assert_eq!(lines, [line("mass = = "), line("limit 200.0")], "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 400,
        rng_seed: prop::test_runner::RngSeed::Fixed(11),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// Whatever the text, an answer and no panic: lines swapped, doubled, cut,
    /// numbers replaced by awkward ones.
    #[test]
    fn garbled_files_never_panic(
        edits in prop::collection::vec((0usize..200, 0usize..200, 0usize..8), 1..4),
    ) {
        let text = model_text();
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        for (a, b, how) in edits {
            let (a, b) = (a % lines.len(), b % lines.len());
            let awkward = |s: &str, with: &str| {
                let mut out = String::new();
                let mut digits = false;
                for c in s.chars() {
                    if c.is_ascii_digit() {
                        if !digits { out.push_str(with); }
                        digits = true;
                    } else {
                        digits = false;
                        out.push(c);
                    }
                }
                out
            };
            match how {
                0 => lines.swap(a, b),
                1 => { let line = lines[a].clone(); lines.insert(b, line); }
                2 => { lines.remove(a); }
                3 => lines[a] = awkward(&lines[a], "0"),
                4 => lines[a] = awkward(&lines[a], "1e300"),
                5 => lines[a] = awkward(&lines[a], "-1"),
                6 => lines[a] = awkward(&lines[a], "1e-300"),
                _ => { let half = lines[a].chars().count() / 2; lines[a] = lines[a].chars().take(half).collect(); }
            }
        }
        if let Ok(machine) = parse(&lines.join("\n")) {
            let _ = Study::new(machine);
        }
    }
}
