//! The commands as a user types them.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::edits::edited;
use crate::run::{host_gen, text};

fn json(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A short run, so that the tests of the command line are quick.
fn quick_model(folder: &Path) -> String {
    let text = edited(&[
        ("simulation.duration", "0.2"),
        ("simulation.settling", "0.1"),
    ]);
    fs::write(folder.join("quick.toml"), text).unwrap();
    "quick.toml".to_owned()
}

#[test]
fn generate_check_and_generate_again() {
    let folder = tempfile::tempdir().unwrap();
    let model = "modal.toml".to_owned();
    let text_of_model = edited(&[
        ("simulation.duration", "0.2"),
        ("simulation.settling", "0.1"),
        ("control.law", "\"modal\""),
    ]);
    fs::write(folder.path().join(&model), text_of_model).unwrap();
    let table = folder.path().join("table.rs");
    let generate = || {
        let output = host_gen(&["generate", &model, "--table", "table.rs"], folder.path());
        assert!(output.status.success(), "{}", text(&output.stderr));
        (text(&output.stdout), fs::read_to_string(&table).unwrap())
    };
    let (summary, first) = generate();
    for part in [
        "13.910",
        "K_a",
        "Shaping",
        "peak sensitivity",
        "Software in the loop",
        "table.rs",
    ] {
        assert!(summary.contains(part), "{part} in {summary}");
    }
    assert!(generate().1 == first, "the same table to the byte");

    // The model differs from the checked-in one only in what is not part of
    // the digest, so the tables are the same.
    let checked_in =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware/src/tables/metrology_frame.rs");
    assert_eq!(fs::read_to_string(checked_in).unwrap(), first);

    let check = || host_gen(&["check", &model, "--table", "table.rs"], folder.path());
    assert!(check().status.success());
    fs::write(&table, first.replace("leak: ", "leak: 1")).unwrap();
    let stale = check();
    assert_eq!(stale.status.code(), Some(1));
    let error = text(&stale.stderr);
    assert!(
        error.contains("leak: 1") && error.contains("host-gen generate"),
        "{error}"
    );
    assert_eq!(error.lines().count(), 1);
}

/// A table against the one before: the first, the same, one of a heavier machine. A damaged record
/// is an error, and leaves the table as it was.
#[test]
fn generate_tells_what_changed() {
    let folder = tempfile::tempdir().unwrap();
    let mass = |mass: &str| {
        let text = edited(&[("bodies.frame.mass", mass)]);
        fs::write(folder.path().join("quick.toml"), text).unwrap();
    };
    let generate = || {
        let model = ["generate", "quick.toml", "--table", "table.rs"];
        host_gen(
            &[&model[..], &["--changes", "kept.json"]].concat(),
            folder.path(),
        )
    };
    let printed = || {
        let output = generate();
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout)
    };
    mass("742.0");
    let first = printed();
    assert!(first.contains("the first one"), "{first}");
    let again = printed();
    assert!(again.contains(", as before\n"), "{again}");
    mass("900.0");
    let heavier = printed();
    let line = heavier
        .lines()
        .find(|line| line.contains("suspension modes"));
    // A heavier machine on the same legs is slower in its lowest mode.
    let lowest: Vec<f64> = line
        .unwrap()
        .split(['→', ':'])
        .skip(1)
        .map(|modes| modes.split_whitespace().next().unwrap().parse().unwrap())
        .collect();
    assert!(lowest[1] < 0.99 * lowest[0], "{heavier}");
    // Its checksum is that of the table written.
    let table = fs::read_to_string(folder.path().join("table.rs")).unwrap();
    let checksum = heavier.split_whitespace().nth(3).unwrap();
    let checksum = checksum.trim_end_matches(',');
    assert!(table.contains(&format!("0x{checksum};")), "{heavier}");

    fs::write(folder.path().join("kept.json"), "{}").unwrap();
    mass("742.0");
    let refused = generate();
    assert!(!refused.status.success());
    let error = text(&refused.stderr);
    assert!(
        error.contains("kept.json") && error.contains("Remove the file"),
        "{error}"
    );
    assert_eq!(
        fs::read_to_string(folder.path().join("table.rs")).unwrap(),
        table
    );
}

#[test]
fn check_needs_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let model = quick_model(folder.path());
    // An error is told apart from a table that differs.
    let refused = |arguments: &[&str]| {
        let output = host_gen(arguments, folder.path());
        assert_eq!(output.status.code(), Some(2));
        text(&output.stderr)
    };
    let error = refused(&["check", &model, "--table", "none.rs"]);
    assert!(error.contains("none.rs: cannot be read"), "{error}");
    let error = refused(&["check", &model]);
    assert!(error.contains("use --table PATH"), "{error}");
    let error = refused(&["check", "none.toml", "--table", "none.rs"]);
    assert!(error.contains("none.toml"), "{error}");
}

/// A target out of reach: one line, and the old table is left as it was.
#[test]
fn an_unreachable_target_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(
        folder.path().join("slow.toml"),
        edited(&[("control.frequency", "0.1")]),
    )
    .unwrap();
    fs::write(folder.path().join("table.rs"), "old").unwrap();
    let output = host_gen(
        &["generate", "slow.toml", "--table", "table.rs"],
        folder.path(),
    );
    assert_eq!(output.status.code(), Some(1));
    assert!(output.stdout.is_empty());
    let error = text(&output.stderr);
    assert!(
        error.starts_with("error: slow.toml: ") && error.contains("The nearest frequency found"),
        "{error}"
    );
    assert_eq!(
        fs::read_to_string(folder.path().join("table.rs")).unwrap(),
        "old"
    );
    assert_eq!(
        fs::read_dir(folder.path()).unwrap().count(),
        2,
        "nothing half-written"
    );
}

#[test]
fn json_for_programs() {
    let folder = tempfile::tempdir().unwrap();
    let model = quick_model(folder.path());
    let run = |command: &str| {
        json(&host_gen(
            &[command, &model, "--format", "json"],
            folder.path(),
        ))
    };

    let modes = run("modes");
    assert_eq!(modes["modes"].as_array().unwrap().len(), 12);
    assert!((modes["modes"][0]["hz"].as_f64().unwrap() - 13.910).abs() < 5e-4);
    assert_eq!(modes["modes"][0]["shape"][1]["body"], "lens");
    assert_eq!(
        modes["equation_of_motion"]["rheonomic"]
            .as_array()
            .unwrap()
            .len(),
        12
    );

    // K_a·T_c + M_d = K_d/ω_n², Eq. (19), from the printed matrices alone.
    let gains = run("gains");
    let matrix = |name: &str| {
        let rows: Vec<Vec<f64>> = serde_json::from_value(gains[name].clone()).unwrap();
        nalgebra::Matrix6::from_fn(|i, j| rows[i][j])
    };
    let omega = core::f64::consts::TAU;
    let virtual_mass = matrix("proportional") * matrix("sensing") + matrix("mass");
    let expected = matrix("stiffness") / (omega * omega);
    assert!((virtual_mass - expected).amax() < 1e-9 * expected.amax());
    assert_eq!(gains["ideal_poles_rigid"].as_array().unwrap().len(), 12);

    let simulated = run("simulate");
    let rms = |run: &str| {
        simulated["simulation"][run]["rms"]
            .as_array()
            .unwrap()
            .len()
    };
    assert_eq!((rms("open"), rms("closed")), (6, 6));
    assert!(
        simulated["shaped"]["peak_sensitivity"]["value"]
            .as_f64()
            .unwrap()
            <= 2.0
    );

    let generated = json(&host_gen(
        &["generate", &model, "--table", "t.rs", "--format", "json"],
        folder.path(),
    ));
    assert_eq!(generated["table"], "t.rs");
    // In the whole the warnings are those of the whole.
    let mut gains = gains;
    assert_eq!(
        gains.as_object_mut().unwrap().remove("warnings"),
        Some(generated["warnings"].clone())
    );
    assert_eq!(generated["gains"], gains);
    let checked = json(&host_gen(
        &["check", &model, "--table", "t.rs", "--format", "json"],
        folder.path(),
    ));
    assert_eq!(checked["up_to_date"], true);
}

#[test]
fn options_of_simulate() {
    let folder = tempfile::tempdir().unwrap();
    let model = quick_model(folder.path());
    let run = |more: &[&str]| {
        let mut arguments = vec!["simulate", &model, "--format", "json"];
        arguments.extend(more);
        host_gen(&arguments, folder.path())
    };
    let seed = |seed: &str| json(&run(&["--seed", seed]));
    assert_eq!(seed("4"), seed("4"));
    assert_ne!(seed("4"), seed("5"));
    let longer = json(&run(&["--duration", "0.5"]));
    assert_eq!(longer["simulation"]["closed"]["steps"], 10_000);
    let failed = run(&["--floor-rms", "-1"]);
    assert!(!failed.status.success());
}

#[test]
fn a_bad_file_is_one_line_and_exit_1() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(
        folder.path().join("bad.toml"),
        edited(&[("bodies.frame.mass", "-1.0")]),
    )
    .unwrap();
    for command in ["modes", "gains", "generate", "check", "simulate"] {
        let output = host_gen(&[command, "bad.toml"], folder.path());
        let code = if command == "check" { 2 } else { 1 };
        assert_eq!(output.status.code(), Some(code), "{command}");
        assert!(output.stdout.is_empty());
        let error = text(&output.stderr);
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(
            error.starts_with("error: bad.toml:") && error.contains("bodies.frame.mass"),
            "{error}"
        );
    }
}

#[test]
fn analysis_commands() {
    let folder = tempfile::tempdir().unwrap();
    let model = quick_model(folder.path());
    let run = |arguments: &[&str]| {
        let mut all = arguments.to_vec();
        all.extend(["--format", "json"]);
        json(&host_gen(&all, folder.path()))
    };
    let length = |value: &serde_json::Value| value.as_array().unwrap().len();

    let zeros = run(&["zeros", &model]);
    assert_eq!(length(&zeros["kinds"][0]["zeros"]), 6);
    assert_eq!(length(&zeros["kinds"][1]["zeros"]), 12);
    assert_eq!(zeros["kinds"][1]["unstable"], false);

    let poles = run(&["poles", &model]);
    assert_eq!((length(&poles["open"]), length(&poles["ideal"])), (12, 12));
    assert_eq!(poles["stable"], true);

    let sigma = run(&[
        "sigma", &model, "--from", "1", "--to", "100", "--points", "20",
    ]);
    let names = |sigma: &serde_json::Value| -> Vec<String> {
        let curves = sigma["curves"].as_array().unwrap().iter();
        curves
            .map(|curve| curve["name"].as_str().unwrap().to_owned())
            .collect()
    };
    let curves = [
        "open",
        "acceleration, ideal",
        "acceleration, sampled",
        "force, ideal",
    ];
    assert_eq!(names(&sigma), curves);
    assert_eq!(
        sigma["missing"],
        serde_json::json!(["force, sampled: only designed with --by-feedback"])
    );
    assert_eq!(
        length(&sigma["curves"][3]["sigma_max"]),
        length(&sigma["hz"])
    );
    // Under the direct law force feedback has no loop at 1 Hz, and the reason is there.
    let each = run(&["sigma", &model, "--at", "20", "--by-feedback"]);
    assert_eq!(names(&each), curves);
    let missing = each["missing"][0].as_str().unwrap();
    assert!(missing.contains("no controller was found"), "{missing}");
    let at = run(&["sigma", &model, "--at", "20,13.9,100"]);
    assert_eq!(at["hz"], serde_json::json!([20.0, 13.9, 100.0]));
    for bad in [["--from", "0"], ["--to", "0.01"], ["--at", "1,-1"]] {
        let output = host_gen(&["sigma", &model, bad[0], bad[1]], folder.path());
        assert_eq!(output.status.code(), Some(1), "{bad:?}");
    }
    for bad in [
        ["sigma", "--points", "0"],
        ["sigma", "--points", "1"],
        ["sigma", "--points", "100000000000"],
        ["robust", "--samples", "0"],
        ["robust", "--samples", "18446744073709551615"],
    ] {
        let output = host_gen(&[bad[0], &model, bad[1], bad[2]], folder.path());
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.contains(bad[1]) && error.contains(bad[2]), "{error}");
    }

    let plant = run(&["plant", &model, "--matrix-market", "out/g"]);
    assert_eq!(length(&plant["inputs"]), 12);
    assert_eq!(length(&plant["kinds"][1]["outputs"]), 12);
    let files = fs::read_dir(folder.path().join("out/g")).unwrap().count();
    // Four matrices of two kinds of feedback, each in two formats, and two times the signals.
    assert_eq!(files, 18);
    let signals = fs::read_to_string(folder.path().join("out/g/force-signals.csv")).unwrap();
    let lines: Vec<_> = signals.lines().collect();
    assert_eq!(lines.len(), 1 + 12 + 12);
    assert_eq!(lines[0], "kind,identifier,name,unit");
    assert_eq!(lines[7], "input,force_leg4,\"leg4\",N");
    assert_eq!(
        lines[13],
        "output,performance_block15_e1,\"block15.e1\",m/s^2"
    );
    assert_eq!(lines[19], "output,sensor_leg4,\"leg4\",N");
    assert_eq!(plant["input_identifiers"][6], "force_leg4");
    assert_eq!(plant["kinds"][0]["output_units"][11], "m/s^2");
    assert_eq!(plant["kinds"][0]["states"][23], "rate12");
    // tests/external/mat_file.py looks into it.
    run(&["plant", &model, "--mat", "frame.mat"]);
    let file = fs::read(folder.path().join("frame.mat")).unwrap();
    assert!(file.starts_with(b"MATLAB 5.0 MAT-file"));

    let floor = run(&["floor", &model, "--criterion", "vc-c"]);
    assert_eq!(floor["floor"], "VC-C");
    assert_eq!(length(&floor["closed"]["rms"]), 6 + 6 + 3 + 6 + 6);
    let shown = |i: usize| {
        let row = &floor["closed"]["rms"][i];
        let part = row["rms"].as_f64().unwrap() / row["shown_rms"].as_f64().unwrap();
        (row["shown_unit"].as_str().unwrap().to_owned(), part)
    };
    for (row, unit, part) in [
        (0, "m/s²", 1.0),
        (6, "nm", 1e-9),
        (15, "N", 1.0),
        (26, "µm", 1e-6),
    ] {
        let (found, found_part) = shown(row);
        assert_eq!(found, unit);
        assert!((found_part / part - 1.0).abs() < 1e-12);
    }
    assert_eq!(length(&floor["closed"]["thirds"]), 20);
    fs::write(
        folder.path().join("s.txt"),
        "# mine\n1 1e-5\n100 1e-4 # end\n",
    )
    .unwrap();
    run(&["floor", &model, "--spectrum", "s.txt"]);
    fs::write(folder.path().join("s.txt"), "1 1e-5\n0.5 1e-4\n").unwrap();
    let bad = host_gen(&["floor", &model, "--spectrum", "s.txt"], folder.path());
    assert!(text(&bad.stderr).contains("s.txt:2: frequencies must ascend"));
    floors_are_refused_truly(&model, folder.path());
    floors_are_those_of_the_file(&model, folder.path());
    floors_are_recorded(&model, folder.path());
    let robust = run(&["robust", &model, "--samples", "4", "--seed", "9"]);
    assert_eq!(
        (&robust["samples"], &robust["stable"]),
        (&4.into(), &4.into())
    );

    let compared = run(&["compare", &model, &model]);
    assert_eq!(compared["machines"][0], compared["machines"][1]);
    assert_eq!(length(&compared["machines"][0]["suspension_hz"]), 6);
    // And as text.
    for command in [
        "modes", "gains", "zeros", "poles", "sigma", "plant", "compare", "simulate",
    ] {
        let output = host_gen(&[command, &model], folder.path());
        assert!(
            output.status.success() && !output.stdout.is_empty(),
            "{command}"
        );
    }
}

/// Floors of which nothing can be said are refused with the cause; what is not known of others is
/// said, and no criterion is claimed for it.
/// Without an option, the floor is that of the file, which `design` uses too; with an exposure time
/// both show moving averages and deviations.
fn floors_are_those_of_the_file(model: &str, folder: &Path) {
    let without = host_gen(&["floor", model], folder);
    let words = text(&without.stderr);
    assert!(!without.status.success() && words.contains("the file has no floor.spectrum"));
    let shaken = format!(
        "based_on = \"{model}\"\nname = \"shaken\"\n[floor]\nspectrum = \"vc-e\"\n[performance]\nexposure = 0.02\n"
    );
    fs::write(folder.join("shaken.toml"), shaken).unwrap();
    let of = |command: &str| {
        json(&host_gen(
            &[command, "shaken.toml", "--format", "json"],
            folder,
        ))
    };
    for floor in [of("floor"), of("design")["floor"].clone()] {
        assert_eq!(floor["floor"], "VC-E");
        for side in ["open", "closed"] {
            let together = floor[side]["together"].as_array().unwrap();
            let units: Vec<_> = together.iter().map(|row| row["unit"].as_str()).collect();
            assert_eq!(units, [Some("m/s²"), Some("m"), Some("m"), Some("m")]);
            assert_eq!(
                floor[side]["rms"].as_array().unwrap().len(),
                6 + 6 + 3 + 6 + 6 + 12
            );
        }
    }
}

/// A record's spectra are those that another program may give as points.
fn floors_are_recorded(model: &str, folder: &Path) {
    let mut rows = String::from("z [mg],time [s]\n");
    for i in 0..4000 {
        // A chirp and its alias fill the band.
        let t = f64::from(i) * 1e-3;
        rows += &format!("{},{t}\n", 0.01 * (30.0 * t * t * t + 7.0 * t).sin());
    }
    fs::write(folder.join("floor.csv"), &rows).unwrap();
    let on = |more: &[&str]| {
        host_gen(
            &[&["floor", model, "--format", "json"], more].concat(),
            folder,
        )
    };
    let recorded = json(&on(&["--record", "floor.csv"]));
    // 4,000 samples are sixteen windows of 470, each half over the next.
    assert_eq!(recorded["floor"], "floor.csv (16 windows of 0.470 s)");
    assert!(recorded["open"]["rms"][0]["rms"].as_f64().unwrap() > 0.0);
    for (more, words) in [
        (
            &["--record", "floor.csv", "--rate", "1000"][..],
            "leave --rate out",
        ),
        (
            &["--record", "floor.csv", "--criterion", "vc-c"],
            "cannot be used with",
        ),
        (&["--rate", "1000", "--criterion", "vc-c"], "--record"),
        (&["--record", "none.csv"], "none.csv"),
    ] {
        let refused = on(more);
        assert!(!refused.status.success());
        assert!(
            text(&refused.stderr).contains(words),
            "{}",
            text(&refused.stderr)
        );
    }
    let gap = rows.replace(",1.5\n", ",1.6\n");
    fs::write(folder.join("floor.csv"), gap).unwrap();
    let refused = on(&["--record", "floor.csv"]);
    assert!(
        text(&refused.stderr).contains("floor.csv:1502: "),
        "{}",
        text(&refused.stderr)
    );
}

fn floors_are_refused_truly(model: &str, folder: &Path) {
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/cases/floor");
    let given = |name: &str| cases.join(name).display().to_string();
    let with = |name: &str, content: &str| {
        fs::write(folder.join(name), content).unwrap();
        name.to_owned()
    };
    let on = |spectrum: &str, more: &[&str]| {
        host_gen(
            &[&["floor", model, "--spectrum", spectrum], more].concat(),
            folder,
        )
    };
    for (spectrum, more, words) in [
        (
            given("floor-empty.txt"),
            &[][..],
            "floor-empty.txt: there is no point",
        ),
        (
            given("floor-one-point.txt"),
            &[],
            "floor-one-point.txt: one point is no spectrum",
        ),
        (
            given("floor-from-0hz.txt"),
            &[],
            "floor-from-0hz.txt:1: a spectrum cannot begin at 0 Hz",
        ),
        (
            with("high.txt", "400 1e-6\n500 1e-6"),
            &[],
            "gives 400 to 500 Hz only",
        ),
        (
            with("low.txt", "0.01 1e-6\n0.5 1e-6"),
            &[],
            "gives 0.01 to 0.5 Hz only",
        ),
        (
            with("all.txt", "0.1 1e-6\n900 1e-6"),
            &["--to", "20000"],
            "--to must be from 0.5 to 10000",
        ),
        (
            "all.txt".to_owned(),
            &["--from", "1e-9"],
            "--from must be 1e-4 to 1e6 Hz",
        ),
    ] {
        let failed = on(&spectrum, more);
        assert_eq!(failed.status.code(), Some(1), "{spectrum}");
        assert!(failed.stdout.is_empty());
        let error = text(&failed.stderr);
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(error.contains(words), "{error}");
    }
    let read = on(&given("floor-bom.txt"), &[]);
    assert!(text(&read.stdout).contains("VC-C to VC-G are not judged: the one-third octaves need 0.89 to 89.2 Hz, known are 1 to 100 Hz"));
    let narrow = on("all.txt", &["--from", "100", "--to", "200"]);
    let narrow = text(&narrow.stdout);
    assert!(!narrow.contains("meets"), "{narrow}");
    assert!(narrow.contains("VC-A and VC-B are not judged"), "{narrow}");
    let white = host_gen(&["floor", model, "--white", "1e200"], folder);
    assert!(text(&white.stderr).contains("--white must be from 0 to 1000000 m/s²/√Hz"));
}

/// Acceleration feedback holds the low-parasitic machine, though its legs
/// buckle: it is told.
#[test]
fn generate_warns_of_gravity() {
    let folder = tempfile::tempdir().unwrap();
    let model = edited(&[
        ("gravity", "[0.0, 0.0, -9.81]"),
        // With accelerometers that read the weight, 1 Hz is not reached.
        ("control.frequency", "2.5"),
        ("profiles.leg.bending", "[24.7, 24.7]"),
        ("profiles.leg.torsion", "0.39"),
        ("simulation.duration", "0.2"),
        ("simulation.settling", "0.1"),
    ]);
    fs::write(folder.path().join("heavy.toml"), model).unwrap();
    let arguments = ["generate", "heavy.toml", "--table", "t.rs"];
    let output = host_gen(&arguments, folder.path());
    assert!(output.status.success(), "{}", text(&output.stderr));
    let summary = text(&output.stdout);
    assert!(
        summary.contains("Warning: leg4 buckles: its load is 36"),
        "{summary}"
    );
    let quiet = quick_model(folder.path());
    let output = host_gen(&["generate", &quiet, "--table", "t.rs"], folder.path());
    assert!(!text(&output.stdout).contains("Warning"));
}

/// A new file is a machine; an old one stays, and nothing wrong is written.
#[test]
fn new_writes_a_machine_once() {
    let folder = tempfile::tempdir().unwrap();
    let new = |arguments: &[&str]| host_gen(&[&["new"], arguments].concat(), folder.path());
    let made = new(&["scanner", "--mounts", "6", "--frame-mass", "300", "--yes"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let shown = text(&made.stdout);
    let (_, rest) = shown.split_once("Suspension modes from ").expect("modes");
    let said = rest.contains("the target of 1 Hz is reached: the loop isolates from ");
    let unknown = "whether the target of 1 Hz is reached is not known";
    assert!(said || text(&made.stderr).contains(unknown), "{shown}");
    let path = folder.path().join("scanner.toml");
    let first = fs::read_to_string(&path).unwrap();
    assert!(first.contains("mass = 300.0"));
    let modes = json(&host_gen(
        &["modes", "scanner.toml", "--format", "json"],
        folder.path(),
    ));
    assert_eq!(modes["modes"].as_array().unwrap().len(), 12);

    let again = new(&["scanner", "--yes"]);
    assert!(!again.status.success());
    assert!(text(&again.stderr).contains("scanner.toml already exists"));
    assert_eq!(fs::read_to_string(&path).unwrap(), first);
    for (arguments, says) in [
        (
            ["four", "--mounts", "4"],
            "3 mounts with two legs each, or 6",
        ),
        (["light", "--frame-mass", "-1"], "--frame-mass must be"),
        (
            ["upright", "--leg-angle", "90"],
            "vertical legs do not hold",
        ),
        (["Caps", "--radius", "1"], "lower-case letters"),
        (["flat", "--payload-z", "0"], "--payload-z must be at least"),
    ] {
        let refused = new(&arguments);
        assert!(!refused.status.success());
        let error = text(&refused.stderr);
        assert!(error.contains(says), "{error}");
    }
    // The machine and the schema that it names; nothing half-written.
    assert!(first.starts_with("#:schema machine.schema.json\n"));
    assert!(folder.path().join("machine.schema.json").is_file());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

/// `new` with these answers in a pipe.
#[cfg(unix)]
fn answered(options: &[&str], answers: &str) -> Output {
    use std::io::Write as _;
    use std::process::Stdio;

    let mut child = Command::new(env!("CARGO_BIN_EXE_host-gen"))
        .args([&["new", "--output", "/dev/stdout"], options].concat())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The program may have ended before it reads everything.
    let _ = child.stdin.take().unwrap().write_all(answers.as_bytes());
    child.wait_with_output().unwrap()
}

/// Answers come from a pipe, line by line; where they end, the rest is usual.
#[cfg(unix)]
#[test]
fn new_reads_answers_from_a_pipe() {
    let all =
        "scope\n3\n0.35\n\n40\n120\n60\n0.05\n\n0.3\n\n9.5e5\nboth\n2\nnucleo-h743\nendevco-86\n";
    let output = answered(&[], all);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let options = [
        "scope",
        "--mounts",
        "3",
        "--radius",
        "0.35",
        "--leg-angle",
        "40",
        "--frame-mass",
        "120",
        "--payload-mass",
        "60",
        "--payload-x",
        "0.05",
        "--payload-z",
        "0.3",
        "--leg-stiffness",
        "9.5e5",
        "--feedback",
        "both",
        "--frequency",
        "2",
        "--board",
        "nucleo-h743",
        "--sensor",
        "endevco-86",
        "--yes",
    ];
    let by_options = answered(&options, "");
    assert!(by_options.status.success(), "{}", text(&by_options.stderr));
    assert_eq!(text(&output.stdout), text(&by_options.stdout));
    let shown = text(&output.stderr);
    assert!(shown.contains("Mass of the frame, kg: 120\n"), "{shown}");

    let usual = text(&answered(&["--yes"], "").stdout);
    assert!(usual.contains("mass = 740.0"), "{usual}");
    assert_eq!(text(&answered(&[], "").stdout), usual);
    assert_eq!(text(&answered(&["--yes"], "scope\n4\n").stdout), usual);
    // Only the name is answered, and only mounts are no question.
    let named = text(&answered(&["--mounts", "6"], "scope\n").stdout);
    let mounts = text(&answered(&["scope", "--yes", "--mounts", "6"], "").stdout);
    assert_eq!(named, mounts);
}

#[cfg(unix)]
#[test]
fn new_refuses_wrong_answers_in_a_pipe() {
    let many = "\n".repeat(16) + "left\n";
    for (answers, says) in [
        (
            "scope\n4\n",
            "answer 2, to \"Mounts\": expected one of 3, 6, not \"4\"",
        ),
        (
            "\n\nwide\n",
            "answer 3, to \"Radius of the circle of mounts, m\": expected a number from 0.001 to 1000, not \"wide\"",
        ),
        ("\n\n-1\n", "not \"-1\""),
        (
            &many,
            "line 17 of the answers, \"left\", answers no question",
        ),
    ] {
        let output = answered(&[], answers);
        assert_eq!(output.status.code(), Some(1));
        let error = text(&output.stderr);
        assert!(error.contains(says), "{error}");
        assert!(output.stdout.is_empty());
    }
    let refused = answered(&["--sensor", "adxl355"], "");
    let error = text(&refused.stderr);
    assert!(error.contains("endevco-86, endevco-87-10"), "{error}");
}

/// What stands in the way is said when the file is written: here a target above the suspension, which
/// no search reaches, and a payload that reaches below the feet.
#[test]
fn new_says_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let options = [
        "new",
        "low",
        "--frame-mass",
        "50",
        "--payload-mass",
        "20",
        "--payload-z=-0.2",
        "--frequency",
        "100",
        "--yes",
    ];
    let output = host_gen(&options, folder.path());
    assert!(output.status.success(), "{}", text(&output.stderr));
    let (out, error) = (text(&output.stdout), text(&output.stderr));
    assert!(
        out.starts_with("Wrote low.toml.\nSuspension modes from "),
        "{out}"
    );
    assert!(!out.contains("is reached"), "{out}");
    assert!(
        error.contains("warning: the payload reaches 0.400 m below the mounts"),
        "{error}"
    );
    // Known or, on a slow machine, not known.
    let reason = "the target lies above the suspension modes";
    assert!(
        error.contains(reason) || error.contains("is reached is not known"),
        "{error}"
    );
}

/// The page is written whole, and beside it every chart three times.
#[test]
fn report_writes_page_and_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let model = quick_model(folder.path());
    let report = |arguments: &[&str]| host_gen(&[&["report"], arguments].concat(), folder.path());
    let made = report(&[&model, "--plots", "pictures"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    assert!(text(&made.stdout).starts_with("metrology-frame-report.html"));
    let page = fs::read_to_string(folder.path().join("metrology-frame-report.html")).unwrap();
    assert!(page.starts_with("<!doctype html>") && page.trim_end().ends_with("</html>"));
    let count = fs::read_dir(folder.path().join("pictures"))
        .unwrap()
        .count();
    assert_eq!(count, 3 * 26);
    let json = json(&report(&[&model, "--format", "json"]));
    assert_eq!(json["machines"][0]["machine"], "metrology-frame");
    let each = report(&[&model, "--by-feedback", "--format", "json"]);
    let each = self::json(&each);
    let kinds = [0, 1].map(|i| each["machines"][i]["feedback"].as_str().unwrap());
    assert_eq!(kinds, ["acceleration", "force"]);

    fs::write(folder.path().join("bad.toml"), "format = 1\nmass = 2\n").unwrap();
    let refused = report(&["bad.toml", "--output", "bad.html"]);
    assert!(!refused.status.success());
    assert!(text(&refused.stderr).contains("bad.toml:2:1"));
    assert!(!folder.path().join("bad.html").exists());
}

/// Colours are for terminals: none in a pipe, but where they are forced.
#[test]
fn colours_on_a_terminal_only() {
    let folder = tempfile::tempdir().unwrap();
    let model = quick_model(folder.path());
    let modes = |forced: bool| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-gen"));
        command.args(["modes", &model]).current_dir(folder.path());
        command.env_remove("NO_COLOR").env_remove("CLICOLOR_FORCE");
        if forced {
            command.env("CLICOLOR_FORCE", "1");
        }
        text(&command.output().unwrap().stdout)
    };
    let (plain, coloured) = (modes(false), modes(true));
    assert!(!plain.contains('\u{1b}') && coloured.starts_with("\u{1b}[1mModes of"));
    let stripped = coloured.replace("\u{1b}[1m", "").replace("\u{1b}[0m", "");
    assert_eq!(stripped, plain);
}

/// Names as long as people give them do not push the columns out of line.
#[test]
fn tables_align_with_long_names() {
    let folder = tempfile::tempdir().unwrap();
    let edited = edited(&[
        ("simulation.duration", "0.2"),
        ("simulation.settling", "0.1"),
    ]);
    let long = edited.replace("block15", "the-block-under-the-second-lens-mount");
    fs::write(folder.path().join("long.toml"), long).unwrap();
    let output = host_gen(&["simulate", "long.toml"], folder.path());
    let output = text(&output.stdout);
    let rows: Vec<&str> = output
        .lines()
        .skip_while(|line| !line.contains("rms open"))
        .take(7)
        .collect();
    let ends: Vec<usize> = rows.iter().map(|row| row.chars().count()).collect();
    assert!(ends.iter().all(|end| *end == ends[0]), "{rows:#?}");
}

/// Every command has an example in its help, and a shell completes every command.
#[test]
fn help_and_completions_know_every_command() {
    let folder = Path::new(".");
    let help = text(&host_gen(&["--help"], folder).stdout);
    let commands: Vec<&str> = help
        .lines()
        .skip_while(|line| !line.starts_with("Commands:"))
        .skip(1)
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next())
        .filter(|name| name.chars().all(|c| c.is_ascii_lowercase()) && *name != "help")
        .collect();
    assert!(commands.len() >= 20, "{commands:?}");
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = text(&host_gen(&["completions", shell], folder).stdout);
        for command in &commands {
            assert!(script.contains(command), "{command} in {shell}");
        }
    }
    let link = text(&host_gen(&["link", "--at", "x:1", "--help"], folder).stdout);
    let inner: Vec<&str> = link
        .lines()
        .skip_while(|line| !line.starts_with("Commands:"))
        .skip(1)
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next())
        .filter(|name| *name != "help")
        .collect();
    assert!(
        inner.contains(&"self-test") && inner.contains(&"frf"),
        "{inner:?}"
    );
    for command in inner {
        let help = text(&host_gen(&["link", command, "--help"], folder).stdout);
        assert!(
            help.contains(&format!(" {command}")) && help.contains("Example: host-gen link --at"),
            "{command}"
        );
    }
    for command in commands {
        let help = text(&host_gen(&[command, "--help"], folder).stdout);
        let example = format!("Example: host-gen {command}");
        let example = if command == "link" {
            "Example: host-gen link"
        } else {
            &example
        };
        assert!(help.contains(example), "{command}: {help}");
    }
}

/// A mass on springs, 100 Hz along x, and its page; for a design, control is missing.
#[test]
fn modes_and_report_need_no_control() {
    let folder = tempfile::tempdir().unwrap();
    let stiffness = 2.0 * (core::f64::consts::TAU * 100.0).powi(2);
    let file = format!(
        "format = 1\nname = \"mass\"\n[nodes]\nwall = [0.0, 0.0, 0.0]\nlump = [0.0, 0.0, 0.0]\n[base]\nnodes = [\"wall\"]\n[free]\nnodes = [\"lump\"]\n[point_masses.weight]\nnode = \"lump\"\nmass = 2.0\n[springs.mount]\nnodes = [\"wall\", \"lump\"]\nstiffness = [{stiffness:?}, 1e7, 1e7]\nrotational_stiffness = [1e4, 1e4, 1e4]\n"
    );
    fs::write(folder.path().join("mass.toml"), file).unwrap();
    let output = host_gen(&["modes", "mass.toml"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let shown = text(&output.stdout);
    assert!(shown.starts_with("Modes of mass"), "{shown}");
    assert!(
        shown.contains("  1   100.000  suspension     2.0"),
        "{shown}"
    );
    let output = host_gen(&["report", "mass.toml"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let page = fs::read_to_string(folder.path().join("mass-report.html")).unwrap();
    assert!(page.contains("\"machine\":\"mass\""));
    let output = host_gen(&["design", "mass.toml"], folder.path());
    assert_eq!(output.status.code(), Some(1));
    let error = text(&output.stderr);
    assert!(error.contains("missing keys `coordinates`"), "{error}");
}

/// The histories are those whose rms and peak the summary has, at the sample rate.
#[test]
fn histories_have_units_and_time() {
    let folder = tempfile::tempdir().unwrap();
    let model = quick_model(folder.path());
    let arguments = ["simulate", &model, "--format", "json", "--csv", "time.csv"];
    let summary = json(&host_gen(&arguments, folder.path()));
    let csv = fs::read_to_string(folder.path().join("time.csv")).unwrap();
    let mut lines = csv.lines();
    let head: Vec<_> = lines.next().unwrap().split(',').collect();
    assert_eq!(head.len(), 1 + 6 + 6 + 6);
    assert_eq!(head[0], "time [s]");
    assert_eq!(head[1], "block15.e1 open [m/s^2]");
    assert_eq!(head[7], "block15.e1 closed [m/s^2]");
    assert_eq!(head[13], "force leg4 [N]");
    let numbers =
        |line: &str| -> Vec<f64> { line.split(',').map(|x| x.parse().unwrap()).collect() };
    let rows: Vec<_> = lines.map(numbers).collect();
    // 0.2 s at 20 kHz.
    assert_eq!(rows.len(), 4000);
    for (i, row) in rows.iter().enumerate() {
        assert!((row[0] - i as f64 / 20e3).abs() < 1e-9);
    }
    for (side, first) in [("open", 1), ("closed", 7)] {
        for output in 0..6 {
            let column = rows.iter().map(|row| row[first + output]);
            let square: f64 = column.clone().map(|x| x * x).sum();
            let peak = column.fold(0.0, |most: f64, x| most.max(x.abs()));
            let of = |what: &str| summary["simulation"][side][what][output].as_f64().unwrap();
            assert!(((square / 4000.0).sqrt() / of("rms") - 1.0).abs() < 1e-5);
            assert!((peak / of("peak") - 1.0).abs() < 1e-5);
        }
    }
    let forces = rows.iter().flat_map(|row| &row[13..]);
    let peak = forces.fold(0.0, |most: f64, x| most.max(x.abs()));
    let most = summary["simulation"]["closed"]["force_peak"]
        .as_f64()
        .unwrap();
    assert!((peak / most - 1.0).abs() < 1e-5);

    let long = [
        "simulate",
        &model,
        "--duration",
        "1000",
        "--csv",
        "time.csv",
    ];
    let refused = host_gen(&long, folder.path());
    let error = text(&refused.stderr);
    assert!(
        !refused.status.success() && error.contains("--duration must be lower"),
        "{error}"
    );
}
