//! What the commands print as text, compared with `tests/snapshots`.
//!
//! Words are compared exactly, numbers with decimals with a tolerance. With
//! `SNAPSHOTS=overwrite` in the environment, the files are written anew.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use snapbox::assert::DEFAULT_ACTION_ENV;
use snapbox::{Assert, Data};

use crate::edits::edited;
use crate::near::{NEAR, settle};

/// The machine: the metrology frame under the direct law, simulated for a short time, so that no
/// command takes long. The lens is off centre: of two equal frequencies, the modes could be any.
const MODEL: &str = "frame.toml";

fn host_gen(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_host-gen"))
        .args(arguments)
        .current_dir(folder)
        .env_remove("CLICOLOR_FORCE")
        .output()
        .unwrap()
}

/// Compares what a command prints with the snapshot `name`.
#[track_caller]
fn compare(name: &str, printed: &[u8]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/snapshots");
    let path = folder.join(name).with_extension("txt");
    let printed = String::from_utf8(printed.to_vec()).unwrap();
    let written = fs::read_to_string(&path).unwrap_or_default();
    let settled = settle(&printed, &written, NEAR);
    let assert = Assert::new().action_env(DEFAULT_ACTION_ENV);
    assert.eq(settled, Data::read_from(&path, None).raw());
}

/// A folder with the model.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let text = edited(&[
        ("bodies.lens.cog", "[0.03, 0.02, -0.1]"),
        ("simulation.duration", "0.2"),
        ("simulation.settling", "0.1"),
    ]);
    fs::write(folder.path().join(MODEL), text).unwrap();
    folder
}

/// Each command once: its name and what follows the model's.
#[test]
fn results_as_text() {
    let folder = folder();
    let table = ["--table", "table.rs"];
    let commands: [(&str, &[&str]); 16] = [
        ("modes", &[]),
        ("gains", &[]),
        ("zeros", &[]),
        ("poles", &[]),
        ("sigma", &["--from", "1", "--to", "100", "--points", "20"]),
        ("floor", &["--criterion", "vc-d"]),
        ("plant", &[]),
        ("robust", &["--samples", "5"]),
        ("design", &[]),
        ("bound", &[]),
        ("compliance", &[]),
        ("compare", &["--by-feedback"]),
        ("simulate", &[]),
        ("generate", &table),
        ("check", &table),
        ("report", &[]),
    ];
    for (command, options) in commands {
        let output = host_gen(&[&[command, MODEL], options].concat(), folder.path());
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{command}: {errors}");
        compare(command, &output.stdout);
    }
}

/// An error with its line in the file.
#[test]
fn an_error_with_its_line() {
    let folder = folder();
    let text = fs::read_to_string(folder.path().join(MODEL)).unwrap();
    let bad = text.replace("law = \"direct\"", "law = \"drect\"");
    assert_ne!(bad, text);
    fs::write(folder.path().join(MODEL), bad).unwrap();
    let output = host_gen(&["modes", MODEL], folder.path());
    assert_eq!(output.status.code(), Some(1));
    compare("error", &output.stderr);
}
