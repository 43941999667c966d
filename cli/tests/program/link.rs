//! `host-gen sil` and the two clients: ours, and one that knows only the document.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use crate::edits::model_path;
use host_gen::board::link::{Address, Client, LinkError};
use host_gen::board::measure::{Measurement, MeasurementSettings, measure};
use host_gen::design::{Cache, Search, Study};
use host_gen::machine::Machine;
use nalgebra::Complex;
use serde_json::Value;
use shared::LEGS;
use shared::controller::{ControllerReport, Refusal};
use shared::link::Request;
use shared::recorder::{Record, Recorded, Recording, Trigger};
use shared::supervisor::Mode;

/// A board that is software, ended with the test.
struct Board(Child, Address);

impl Board {
    /// As fast as it can.
    fn start() -> Self {
        Self::with(&["--fast"])
    }

    fn with(arguments: &[&str]) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_host-gen"))
            .arg("sil")
            .arg(model_path())
            .args(["--listen", "127.0.0.1:0"])
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let mut out = BufReader::new(process.stdout.take().unwrap());
        out.read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("listening on ").unwrap();
        let address = address.parse().unwrap();
        Self(process, address)
    }

    /// A command of the link whose reader, `to`, may have enough before its end. The status is
    /// that of the command.
    fn piped(&self, command: &str, to: &str) -> Output {
        let script = format!(
            "\"$0\" link --at {} {command} | {to}; exit ${{PIPESTATUS[0]}}",
            self.1
        );
        Command::new("bash")
            .args(["-c", &script, env!("CARGO_BIN_EXE_host-gen")])
            .output()
            .unwrap()
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A whole session, the plant measured in place with it: off the model by no more
/// than a few times what its own scatter makes one expect.
#[test]
fn a_session_over_tcp() {
    let board = Board::start();
    let mut client = Client::connect(&board.1).unwrap();
    let error = client.command(Request::Start).unwrap_err();
    assert!(
        matches!(error, LinkError::Refused(Refusal::Mode)),
        "{error}"
    );
    client.command(Request::SelfTest).unwrap();
    let report = client.wait_for(|r| r.mode != Mode::Testing).unwrap();
    assert_eq!(report.mode, Mode::Idle, "{report:?}");

    let study = Study::new(Machine::load(&model_path()).unwrap()).unwrap();
    // What the board's process has found just now, if results are kept.
    let cache = Cache::from_environment();
    let search = Search {
        cache: cache.as_ref(),
        ..Search::FULL
    };
    let table = search.design(&study).unwrap().table;
    assert_eq!(client.identity().unwrap().checksum, table.checksum());
    let settings = MeasurementSettings {
        band: [0.5, 500.0],
        averages: 3,
        settling: 1,
        coarse: false,
        // More than by default, which bears a force that jumps by all of it.
        amplitude: Some(120.0),
    };
    let measured = measure(&mut client, &study, &table, &settings, &()).unwrap();
    let lines = &measured.lines;
    assert_eq!(lines.len(), 64);
    for line in lines {
        // Of 36 entries with three averages each: three times is a wide bound.
        assert!(line.error < 3.0 * line.expected_error, "{line:?}");
    }
    // And not only noise: above its modes the plant is known to some per cent.
    let high = lines.iter().filter(|line| line.hz > 100.0);
    assert!(high.clone().count() > 7 && high.clone().all(|line| line.error < 0.1));
    // The machine's modes are found: to a part in a thousand, with their damping to a tenth; and
    // nothing else.
    let modes = study.plant().plant.peaks();
    for resonance in &measured.resonances {
        let near = modes.iter().map(|(hz, width)| {
            let off = (resonance.hz / hz - 1.0).abs() / 1e-3;
            off.max((resonance.damping * hz / width - 1.0).abs() / 0.1)
        });
        assert!(
            near.fold(f64::INFINITY, f64::min) < 1.0,
            "{resonance:?} {modes:?}"
        );
    }
    assert!(measured.resonances.len() > 5, "{:?}", measured.resonances);

    client.command(Request::Start).unwrap();
    let report = client.wait_for(|r| r.mode != Mode::Starting).unwrap();
    assert_eq!(report.mode, Mode::Closed, "{report:?}");
    let recording = Recording {
        trigger: Trigger::Now,
        before: 0,
        after: 500,
    };
    let (records, _) = client.record(recording).unwrap();
    assert_eq!(records.len(), 500);
    assert!(records.iter().any(|record| record.dac[0].0 != 32768));
    client.command(Request::Stop).unwrap();
    let report = client.wait_for(|r| r.mode != Mode::Stopping).unwrap();
    assert_eq!(report.mode, Mode::Idle);

    // Another table, and back.
    let mut tuned = *table.get();
    tuned.self_test.pilot = 0.0;
    let tuned = tuned.validate().unwrap();
    client.send_table(&tuned).unwrap();
    let identity = client.identity().unwrap();
    assert_eq!((identity.checksum, identity.sent), (tuned.checksum(), true));
    assert_eq!(client.report().unwrap().mode, Mode::Untested);
    client.command(Request::Forget).unwrap();
    assert_eq!(client.identity().unwrap().checksum, table.checksum());

    // Another session ends this one.
    let mut other = Client::connect(&board.1).unwrap();
    other.report().unwrap();
}

fn kill(process: &Child, signal: &str) {
    let mut kill = Command::new("kill");
    let kill = kill.args([signal, &process.id().to_string()]);
    assert!(kill.status().unwrap().success());
}

/// Every signal that ends a command ends on the board what the command has begun, and says so;
/// exit codes are those of shells.
#[test]
#[cfg(unix)]
fn signals_end_what_was_begun() {
    let board = Board::start();
    let at = board.1.to_string();
    let link = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-gen"));
        command.args(["link", "--at", &at]).args(arguments);
        command
    };
    let test = link(&["self-test"]).output().unwrap();
    assert!(test.status.success(), "{test:?}");
    let signal = [
        "inject",
        "--signal",
        "sine",
        "--leg",
        "2",
        "--amplitude",
        "1",
    ];
    let long = [&signal[..], &["--samples", "12000000"]].concat();
    for (name, code) in [("-INT", 130), ("-TERM", 143), ("-HUP", 129)] {
        let mut process = link(&long)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(process.stderr.take().unwrap()).lines();
        let waits = said.next().unwrap().unwrap();
        assert_eq!(waits, "waiting for the end of the test signal");
        kill(&process, name);
        assert_eq!(process.wait().unwrap().code(), Some(code), "{name}");
        let end = said.next().unwrap().unwrap();
        assert_eq!(end, "error: interrupted; the test signal is ended");
        let mut client = Client::connect(&board.1).unwrap();
        assert_eq!(client.report().unwrap().injecting, 0, "{name}");
    }

    // One that is left behind is ended by a command of its own, with the loop closed too.
    let start = link(&["start"]).output().unwrap();
    assert!(start.status.success(), "{start:?}");
    let left = [&signal[..], &["--samples", "12000000", "--no-wait"]].concat();
    let json = |arguments: &[&str]| -> Value {
        let output = link(arguments).args(["--format", "json"]).output().unwrap();
        serde_json::from_slice(&output.stdout).unwrap()
    };
    assert!(json(&left)["injecting"].as_u64().unwrap() > 0);
    let after = json(&["end-injection"]);
    assert_eq!(
        (&after["injecting"], &after["mode"]),
        (&0.into(), &"Closed".into())
    );
}

/// On a machine that is not its file, the true machine's modes are found, how far it is from the file,
/// and by a fit its own numbers.
#[test]
fn a_machine_that_is_not_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let [model, truth] = ["model.toml", "truth.toml"].map(|name| folder.path().join(name));
    fs::copy(model_path(), &model).unwrap();
    fs::write(
        &truth,
        "based_on = \"model.toml\"\nname = \"truth\"\n\
         bodies.frame.mass = 860.0\nbodies.frame.cog = [0.01, -0.02, 0.0]\n\
         bodies.lens.mass = 740.0\nprofiles.leg.axial = 7.0e6\nprofiles.block.axial = 3.6e7\n\
         damping.modal = 0.008\nboard.gains.acceleration = [1.0, 1.03, 0.98, 1.0, 1.01, 0.97]\n",
    )
    .unwrap();
    let board = Board::with(&["--fast", "--truth", truth.to_str().unwrap()]);
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-gen"));
        let output = command.args(arguments).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        output.stdout
    };
    let at = board.1.to_string();
    run(&["link", "--at", &at, "self-test"]);
    let shown = model.to_str().unwrap();
    let frf = ["link", "--at", &at, "--format", "json", "frf", shown];
    let json = run(&frf);
    let study = Study::new(Machine::load(&truth).unwrap()).unwrap();
    let modes = study.model().modes().hertz();
    let measured: Measurement = serde_json::from_slice(&json).unwrap();
    for resonance in &measured.resonances {
        // Between modes that overlap there may be one resonance.
        let near = |hz: f64| modes.iter().any(|own| (own / hz - 1.0).abs() < 0.005);
        let between = modes
            .windows(2)
            .any(|pair| pair[1] < 1.015 * pair[0] && (pair[0]..pair[1]).contains(&resonance.hz));
        assert!(near(resonance.hz) || between, "{resonance:?} {modes:?}");
        // Of modes within some widths of each other, a rational function does not tell the damping, nor
        // of the suspension modes, which the floor shakes as much as the legs do.
        let beside = modes
            .iter()
            .filter(|hz| (resonance.hz / *hz - 1.0).abs() < 0.03);
        assert!(
            resonance.hz < 40.0
                || beside.count() > 1
                || (resonance.damping / 0.008 - 1.0).abs() < 0.3,
            "{resonance:?}"
        );
    }
    assert!(measured.resonances.len() > 5, "{:?}", measured.resonances);
    // The plant itself, with the gains of its sensors, which the table does not know.
    let gains = study.machine().board.gains.sensors[0];
    let mut errors = Vec::new();
    for line in measured.lines.iter().filter(|line| line.hz > 40.0) {
        let mut plant = study.plant().response(line.hz).g22();
        for (mut row, gain) in plant.row_iter_mut().zip(gains) {
            row *= Complex::from(gain);
        }
        let error = (line.gain() - &plant).norm() / plant.norm();
        assert!(error < 3.0 * line.noise(), "{} Hz: {error}", line.hz);
        errors.push(error);
    }
    // The floor, which the internal modes amplify, is a few per cent of what is measured there.
    errors.sort_by(f64::total_cmp);
    assert!(errors[errors.len() / 2] < 0.05, "{errors:?}");
    assert!(measured.lines.iter().any(|line| line.error > 1.0));

    let measured = folder.path().join("measured.json");
    fs::write(&measured, &json).unwrap();
    let measured = measured.to_str().unwrap();
    run(&["fit", shown, measured]);
    let fitted = folder.path().join("metrology-frame-fitted.toml");
    is_truth(&fitted, &truth);
    // The fit tells it, where the floor is low beside what was measured: of the internal modes. They
    // overlap, so what one has too much another may lack; all together they have what is there.
    let damping = Machine::load(&fitted).unwrap().damping.clone();
    let internal = &damping.modes[6..];
    for ratio in internal {
        assert!((ratio / 0.008 - 1.0).abs() < 0.2, "{damping:?}");
    }
    let mean = internal.iter().sum::<f64>() / internal.len() as f64;
    assert!((mean / 0.008 - 1.0).abs() < 0.05, "{damping:?}");
    // What is no measurement is refused, and a file elsewhere would not find the model.
    let refused = |arguments: &[&str], why: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-gen"));
        let output = command.arg("fit").args(arguments).output().unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && error.contains(why), "{error}");
    };
    refused(
        &[shown, shown],
        "not a measurement of host-gen link frf --format json",
    );
    let elsewhere = "--output must be another file in the folder of";
    refused(&[shown, measured, "--output", "elsewhere.toml"], elsewhere);
    refused(&[shown, measured, "--output", shown], elsewhere);

    // Another board is refused, with what to change.
    fs::write(
        &truth,
        "based_on = \"model.toml\"\nname = \"truth\"\nboard.sample_rate = 10e3\n",
    )
    .unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_host-gen"));
    let output = command
        .args(["sil", shown, "--truth"])
        .arg(&truth)
        .output()
        .unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    let why = "its board samples at 10000 Hz and the one of the model at 20000 Hz";
    assert!(!output.status.success() && error.contains(why), "{error}");
}

/// Asserts that the modes of a fitted machine are those of the true one.
fn is_truth(fitted: &Path, truth: &Path) {
    let [fitted, truth] = [fitted, truth].map(|path| {
        let study = Study::new(Machine::load(path).unwrap()).unwrap();
        study.model().modes().hertz()
    });
    for (hz, truth) in fitted.iter().zip(&truth) {
        assert!((hz / truth - 1.0).abs() < 0.005, "{fitted:?} {truth:?}");
    }
}

/// A machine that is not its file is measured, fitted, closed at rising gains and accepted; then the
/// legs are at rest. A run that is ended leaves them at rest, too, and the next one takes up its
/// measurement.
#[test]
#[cfg(unix)]
fn a_machine_is_commissioned() {
    let folder = tempfile::tempdir().unwrap();
    let [model, truth, kept] =
        ["model.toml", "truth.toml", "run"].map(|name| folder.path().join(name));
    fs::copy(model_path(), &model).unwrap();
    fs::write(
        &truth,
        "based_on = \"model.toml\"\nname = \"truth\"\n\
         bodies.frame.mass = 650.0\nbodies.lens.cog = [0.015, 0.0, -0.11]\n\
         bodies.lens.mass = 960.0\nprofiles.leg.axial = 9.5e6\ndamping.modal = 0.009\n\
         board.gains.actuators = [1.05, 0.96, 1.0, 1.0, 1.07, 0.93]\n",
    )
    .unwrap();
    let board = Board::with(&["--fast", "--truth", truth.to_str().unwrap()]);
    let at = board.1.to_string();
    let commission = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-gen"));
        command.args(["commission", model.to_str().unwrap(), "--at", &at]);
        command.args(["--folder", kept.to_str().unwrap()]);
        command.args(more);
        command
    };
    // Nobody is asked here, and nothing moves.
    let output = commission(&[]).output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(error.contains("--yes must be given"), "{error}");
    let mut client = Client::connect(&board.1).unwrap();
    assert_eq!(client.report().unwrap().mode, Mode::Untested);
    drop(client);

    // Ended in the middle of a test signal.
    let mut process = commission(&["--yes"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(process.stdout.take().unwrap()).lines();
    let ready = said.next().unwrap().unwrap();
    assert!(ready.starts_with("passed  board ready"), "{ready}");
    kill(&process, "-INT");
    let output = process.wait_with_output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(130), "{error}");
    assert!(
        error.contains("interrupted; the legs are at rest"),
        "{error}"
    );
    let mut client = Client::connect(&board.1).unwrap();
    let report = client.report().unwrap();
    assert_eq!((report.mode, report.injecting), (Mode::Idle, 0));
    drop(client);

    let output = commission(&["--yes"]).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let fitted = folder.path().join("metrology-frame-fitted.toml");
    is_truth(&fitted, &truth);
    let json = fs::read(kept.join("record.json")).unwrap();
    let record: Value = serde_json::from_slice(&json).unwrap();
    let gates = record["gates"].as_array().unwrap();
    assert!(gates.iter().all(|gate| gate["passed"] == true), "{gates:?}");
    assert_eq!(gates.last().unwrap()["step"], "accepted");
    assert_eq!(record["closed"].as_array().unwrap().len(), 3);
    // The loop is that of the design, at its highest sensitivity too.
    for line in record["closed"][2]["lines"].as_array().unwrap() {
        let number = |key: &str| line[key].as_f64().unwrap();
        if number("hz") > 600.0 {
            let off = (number("measured") / number("designed") - 1.0).abs();
            assert!(off < 0.1 + 3.0 * number("deviation"), "{line}");
        }
    }
    // On the floor of the file the forces are those of the design: most of them is from a few Hz, which
    // scatter within ten seconds, and the simulated floor has no sharp edges.
    let legs = record["acceptance"]["legs"].as_array().unwrap();
    let square = |key: &str| -> f64 {
        legs.iter()
            .map(|leg| leg[key].as_f64().unwrap().powi(2))
            .sum()
    };
    let ratio = (square("measured") / square("designed")).sqrt();
    assert!((0.75..1.3).contains(&ratio), "{ratio}");
    let page = fs::read_to_string(kept.join("record.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 2);
    let mut client = Client::connect(&board.1).unwrap();
    assert_eq!(client.report().unwrap().mode, Mode::Idle);
}

/// What is out of range is refused by its own name, before anything is asked of a board.
#[test]
fn numbers_out_of_range() {
    let inject = [
        "inject",
        "--signal",
        "noise",
        "--leg",
        "1",
        "--samples",
        "9",
    ];
    let model = model_path();
    let frf = ["frf", model.to_str().unwrap()];
    let cases: [(&[&str], &[&str], &str); 21] = [
        (&frf, &["--averages", "1"], "--averages must be at least 2"),
        (&frf, &["--averages", "0"], "--averages must be at least 2"),
        (
            &frf,
            &["--averages", "4000000000"],
            "--settling must with --averages be at most 183",
        ),
        (
            &frf,
            &["--settling", "4000000000"],
            "--settling must with --averages be at most 183",
        ),
        (&frf, &["--from", "0"], "--from must be above 0 Hz"),
        (
            &frf,
            &["--from", "50", "--to", "40"],
            "--to must be above --from, 50 Hz",
        ),
        (&frf, &["--amplitude", "0"], "--amplitude must be above 0 N"),
        (
            &frf,
            &["--amplitude", "-1"],
            "--amplitude must be above 0 N",
        ),
        (
            &frf,
            &["--amplitude", "nan"],
            "--amplitude must be above 0 N",
        ),
        (
            &frf,
            &["--amplitude", "inf"],
            "--amplitude must be above 0 N",
        ),
        (&inject, &["--amplitude", "0"], "must be a number above 0"),
        (
            &inject,
            &["--amplitude", "1e39"],
            "must be a number above 0",
        ),
        (
            &frf,
            &["--from", "0.001"],
            "--from must be at least 0.04 Hz",
        ),
        (
            &frf,
            &["--from", "0.1", "--to", "0.5"],
            "--to must be at least 0.61 Hz",
        ),
        (&frf, &["--to", "5000"], "--to must be at most 1249.7 Hz"),
        (&["gain"], &["nan"], "must be above 0 and at most 1"),
        (&["gain"], &["-1"], "must be above 0 and at most 1"),
        (&["gain"], &["2"], "must be above 0 and at most 1"),
        (&["telemetry"], &["--every", "0"], "--every"),
        (&["telemetry"], &["--count", "0"], "--count"),
        (&["record"], &["--after", "0"], "--after"),
    ];
    for (command, numbers, said) in cases {
        let output = Command::new(env!("CARGO_BIN_EXE_host-gen"))
            // Nothing listens on the port.
            .args(["link", "--at", "127.0.0.1:1"])
            .args(command)
            .args(numbers)
            .output()
            .unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(
            !output.status.success() && error.contains(said),
            "{numbers:?}: {error}"
        );
    }
}

/// A reader that has enough, as `head`: nothing is said, and the command has succeeded.
#[test]
#[cfg(unix)]
fn a_closed_pipe_is_no_error() {
    let board = Board::start();
    for command in ["telemetry --raw --every 10", "record --raw --after 5000"] {
        let output = board.piped(command, "head -n 1");
        let error = String::from_utf8(output.stderr).unwrap();
        // On a busy machine the command says what it waits for.
        let waits = |line: &str| line.is_empty() || line.starts_with("waiting for ");
        assert!(
            output.status.success() && error.lines().all(waits),
            "{command}: {error}"
        );
        let head = String::from_utf8(output.stdout).unwrap();
        assert!(head.contains("sensor1"), "{head}");
    }
}

/// Records in units have a time from the trigger, and their force is what the loop asks for; a machine
/// file that is not the board's gives no units.
#[test]
fn records_have_units_and_time() {
    let board = Board::start();
    let address = board.1.to_string();
    let run = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_host-gen"))
            .args(["link", "--at", &address])
            .args(arguments)
            .output()
            .unwrap()
    };
    let model = model_path().display().to_string();
    let table = |arguments: &[&str]| -> (Vec<String>, Vec<Vec<String>>) {
        let output = run(arguments);
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{error}");
        let text = String::from_utf8(output.stdout).unwrap();
        let cells = |line: &str| line.split(',').map(str::to_owned).collect();
        let mut lines = text.lines().map(cells);
        (lines.next().unwrap(), lines.collect())
    };
    let number = |cell: &String| -> f64 { cell.parse().unwrap() };

    let rise = ["--trigger", "rise", "--before", "3", "--after", "5"];
    let (head, rows) = table(&[&["record", &model], &rise[..]].concat());
    assert_eq!(head.len(), 1 + 6 + 6);
    assert_eq!(head[0], "time [s]");
    assert!(head[1].starts_with("sensor ") && head[1].ends_with(" [m/s^2]"));
    assert_eq!(head[7], "force leg4 [N]");
    let times: Vec<_> = rows.iter().map(|row| number(&row[0])).collect();
    // Fewer before, if the trigger came earlier.
    let before = times.len() - 5;
    assert!(before <= 3, "{times:?}");
    for (time, sample) in times.iter().zip(-(before as i32)..) {
        assert!((time - f64::from(sample) / 20e3).abs() < 1e-9, "{times:?}");
    }
    // At time 0 the sensor has risen above code 0.
    assert!(number(&rows[before][1]) > 0.0, "{rows:?}");
    assert!(
        before == 0 || number(&rows[before - 1][1]) <= 0.0,
        "{rows:?}"
    );
    for row in &rows {
        // At rest the legs are told no force, and the noise of the sensors is below 0.1 m/s².
        assert!(row[7..].iter().all(|force| number(force) == 0.0), "{row:?}");
        assert!(row[1..7].iter().any(|y| number(y) != 0.0), "{row:?}");
        assert!(row[1..7].iter().all(|y| number(y).abs() < 0.1), "{row:?}");
    }
    let (head, rows) = table(&["telemetry", &model, "--every", "100", "--count", "3"]);
    assert_eq!(head[..4], ["time [s]", "mode", "gain", "clamped"]);
    assert_eq!(head.len(), 4 + 6 + 6);
    let step = number(&rows[1][0]) - number(&rows[0][0]);
    assert!((step - 100.0 / 20e3).abs() < 1e-9, "{rows:?}");
    let (head, rows) = table(&["record", "--raw", "--after", "5"]);
    assert_eq!(
        (head[0].as_str(), head[1].as_str(), head.len()),
        ("at", "sensor1", 19)
    );
    assert_eq!((rows[0][0].as_str(), rows[0][13].as_str()), ("0", "32768"));

    let other = Path::new(&model).with_file_name("both-sensors.toml");
    let refused = run(&["record", &other.display().to_string(), "--after", "5"]);
    let error = String::from_utf8(refused.stderr).unwrap();
    assert!(
        !refused.status.success() && error.contains("the table of another machine"),
        "{error}"
    );
    let missing = run(&["record", "--after", "5"]);
    assert_eq!(missing.status.code(), Some(2));
}

/// The levels against a recording of the same noise, and windows that follow each other.
#[test]
fn levels_of_what_the_board_reads() {
    // In real time, so that requests follow each other within a window.
    let board = Board::with(&[]);
    let mut client = Client::connect(&board.1).unwrap();
    let recording = Recording {
        trigger: Trigger::Now,
        before: 0,
        after: 16_000,
    };
    client.levels_after(0).unwrap();
    client.command(Request::Record(recording)).unwrap();
    let first = client.levels().unwrap();
    // The window that runs now began before the recording, the next one does not.
    let running = client.levels_after(first.window).unwrap();
    let levels = client.levels_after(running.window).unwrap();
    let done = |report: &ControllerReport| matches!(report.recorded, Recorded::Done { .. });
    client.wait_for(done).unwrap();
    let (records, _) = client.recording().unwrap();
    // The window is a quarter of a second somewhere in the recording: where all sensors agree.
    let difference = |records: &[Record]| {
        let differences = (0..LEGS).map(|i| {
            let codes = records.iter().map(|r| f64::from(r.adc.sensors[i].0));
            let count = records.len() as f64;
            let mean = codes.clone().sum::<f64>() / count;
            let power = codes.map(|x| (x - mean).powi(2)).sum::<f64>() / count;
            let rms = 10.0 * (power / 32_768f64.powi(2)).log10();
            (f64::from(levels.sensors[i].rms.decibels().unwrap()) - rms).abs()
        });
        differences.fold(0.0, f64::max)
    };
    let windows = records.windows(5_000).step_by(20);
    let least = windows.map(difference).fold(f64::INFINITY, f64::min);
    // Steps of half a decibel, and every seventh sample of a window that is some samples longer.
    assert!(least < 0.6, "{least} dB");

    // The command goes on until its reader has enough.
    let output = board.piped("--format json levels --watch", "head -c 20000");
    assert!(output.status.success());
    let printed = serde_json::Deserializer::from_slice(&output.stdout).into_iter();
    // The last one is cut.
    let windows: Vec<u64> = printed
        .map_while(|window: Result<Value, _>| window.ok())
        .map(|window| window["window"].as_u64().unwrap())
        .collect();
    assert!(windows.len() > 3, "{windows:?}");
    assert!(windows.is_sorted_by(|a, b| a < b), "{windows:?}");
}

/// The program in Python that was written from `docs/link.md`.
#[test]
fn a_foreign_program() {
    let board = Board::start();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/external/link_client.py");
    let output = Command::new("python3")
        .arg(script)
        .arg(board.1.to_string())
        .output()
        .expect("the foreign client needs python3");
    let said = String::from_utf8_lossy(&output.stdout);
    let wrong = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}{wrong}");
    assert!(said.contains("stopped at"), "{said}");
}
