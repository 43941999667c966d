//! Files that commands write, flags beyond their limits, and warnings.

use std::fs;
use std::path::Path;

use crate::edits::edited;
use crate::run::{host_gen, text};

/// A machine that is quick to search and to simulate.
fn quick(folder: &Path) {
    let text = edited(&[
        ("simulation.duration", "0.2"),
        ("simulation.settling", "0.1"),
    ]);
    fs::write(folder.join("quick.toml"), text).unwrap();
}

#[cfg(unix)]
#[test]
fn a_table_behind_a_link_and_a_read_only_table() {
    use std::os::unix::fs::{PermissionsExt as _, symlink};
    let folder = tempfile::tempdir().unwrap();
    quick(folder.path());
    fs::write(folder.path().join("real.rs"), "old").unwrap();
    let mode = |mode| fs::Permissions::from_mode(mode);
    fs::set_permissions(folder.path().join("real.rs"), mode(0o640)).unwrap();
    symlink("real.rs", folder.path().join("table.rs")).unwrap();
    let generate = || {
        host_gen(
            &["generate", "quick.toml", "--table", "table.rs"],
            folder.path(),
        )
    };
    assert!(generate().status.success());
    let link = fs::symlink_metadata(folder.path().join("table.rs")).unwrap();
    assert!(link.is_symlink());
    let real = fs::metadata(folder.path().join("real.rs")).unwrap();
    assert_eq!(real.permissions().mode() & 0o7777, 0o640);
    let table = fs::read_to_string(folder.path().join("real.rs")).unwrap();
    assert!(table.contains("pub const"), "{table}");

    fs::set_permissions(folder.path().join("real.rs"), mode(0o444)).unwrap();
    let refused = generate();
    assert_eq!(refused.status.code(), Some(1));
    let error = text(&refused.stderr);
    assert!(
        error.contains("table.rs: cannot be written: it is read-only"),
        "{error}"
    );

    // Through standard output, also where that is a file others write to.
    let through = host_gen(
        &["generate", "quick.toml", "--table", "/dev/stdout"],
        folder.path(),
    );
    assert!(through.status.success(), "{}", text(&through.stderr));
    assert!(text(&through.stdout).starts_with(&table));

    // A table that version control gave other line endings is the same table; one that differs
    // in white space is told so.
    let check = |found: &str| {
        fs::write(folder.path().join("other.rs"), found).unwrap();
        host_gen(
            &["check", "quick.toml", "--table", "other.rs"],
            folder.path(),
        )
    };
    assert!(check(&table.replace('\n', "\r\n")).status.success());
    let stale = check(&table.replacen("        ", "\t", 1));
    assert!(
        text(&stale.stderr).contains("white space"),
        "{}",
        text(&stale.stderr)
    );
}

/// Plain text reads back to the bits of the Matrix Market file, which is by columns.
#[test]
fn plant_as_plain_text() {
    let folder = tempfile::tempdir().unwrap();
    quick(folder.path());
    let output = host_gen(
        &["plant", "quick.toml", "--matrix-market", "out"],
        folder.path(),
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    for name in ["A", "B", "C", "D"] {
        let read = |ending: &str| {
            let file = format!("out/acceleration-{name}.{ending}");
            fs::read_to_string(folder.path().join(file)).unwrap()
        };
        let plain: Vec<Vec<f64>> = read("txt")
            .lines()
            .map(|line| line.split(' ').map(|x| x.parse().unwrap()).collect())
            .collect();
        let market = read("mtx");
        let market: Vec<&str> = market.lines().skip(1).collect();
        assert_eq!(market[0], format!("{} {}", plain.len(), plain[0].len()));
        for (k, x) in market[1..].iter().enumerate() {
            let found = plain[k % plain.len()][k / plain.len()];
            assert_eq!(found.to_bits(), x.parse::<f64>().unwrap().to_bits());
        }
    }
}

#[test]
fn flags_beyond_their_limits() {
    let folder = tempfile::tempdir().unwrap();
    quick(folder.path());
    let absurd = ["nan", "-1", "1e-300", "1e300", "inf"];
    for flags in [
        &["simulate", "quick.toml", "--duration"][..],
        &["sigma", "quick.toml", "--from"],
        &["sigma", "quick.toml", "--to"],
        &["sigma", "quick.toml", "--at"],
        &["floor", "quick.toml", "--criterion", "vc-c", "--from"],
        &["floor", "quick.toml", "--criterion", "vc-c", "--to"],
        &["new", "machine", "--yes", "--radius"],
        &["new", "machine", "--yes", "--height"],
        &["new", "machine", "--yes", "--leg-angle"],
        &["new", "machine", "--yes", "--leg-stiffness"],
        &["new", "machine", "--yes", "--frame-mass"],
        &["new", "machine", "--yes", "--internal"],
        &["new", "machine", "--yes", "--frequency"],
    ] {
        let flag = flags[flags.len() - 1];
        for value in absurd {
            let mut arguments = flags[..flags.len() - 1].to_vec();
            let whole = format!("{flag}={value}");
            arguments.push(&whole);
            let output = host_gen(&arguments, folder.path());
            let error = text(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{arguments:?}: {error}");
            assert!(
                error.contains(flag.trim_start_matches('-')),
                "{arguments:?}: {error}"
            );
            assert_eq!(error.lines().count(), 1, "{error}");
        }
    }
    for (flags, says) in [
        (
            &["robust", "quick.toml", "--samples", "100000000"][..],
            "--samples",
        ),
        (
            &["new", "machine", "--yes", "--payload-x=nan"],
            "--payload-x",
        ),
        (
            &["new", "machine", "--yes", "--payload-y=1e300"],
            "--payload-y",
        ),
        (
            &["new", "machine", "--yes", "--payload-z=-inf"],
            "--payload-z",
        ),
        (
            &["new", "machine", "--yes", "--payload-z=1e-300"],
            "--payload-z must be at least 0.001 above or below 0",
        ),
        (
            &["sigma", "quick.toml", "--points", "100000000"],
            "2..=100000",
        ),
        (&["sigma", "quick.toml", "--points", "0"], "--points"),
        (
            &["simulate", "quick.toml", "--floor-rms", "1e300"],
            "--floor-rms",
        ),
        (&["floor", "quick.toml", "--white", "1e300"], "--white"),
    ] {
        let output = host_gen(flags, folder.path());
        assert!(!output.status.success());
        assert!(
            text(&output.stderr).contains(says),
            "{}",
            text(&output.stderr)
        );
    }
    assert!(!folder.path().join("machine.toml").exists());
}

/// Numbers that would take for ever are refused at once, with their entry.
#[test]
fn absurd_files() {
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/cases/numbers");
    for (name, entry) in [
        ("panic-mass", "bodies.frame.mass"),
        ("panic-rayleigh", "damping.rayleigh[1]"),
        ("hang-floor-band", "simulation.floor_band[0]"),
        ("too-stiff-message", "profiles.block.axial"),
    ] {
        let output = host_gen(&["simulate", &format!("{name}.toml")], &cases);
        assert_eq!(output.status.code(), Some(1), "{name}");
        let error = text(&output.stderr);
        assert!(error.contains(&format!("{entry}: ")), "{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

/// A comment of the machine's file is text on the page, whatever it says.
#[test]
fn a_page_with_markup_in_a_comment() {
    let folder = tempfile::tempdir().unwrap();
    let model = format!(
        "# <!--<script> </script>\n{}",
        edited(&[
            ("simulation.duration", "0.2"),
            ("simulation.settling", "0.1"),
        ])
    );
    fs::write(folder.path().join("page.toml"), model).unwrap();
    let output = host_gen(
        &["report", "page.toml", "--output", "page.html"],
        folder.path(),
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    let page = fs::read_to_string(folder.path().join("page.html")).unwrap();
    let start = page.find("# \\u003c!--\\u003cscript> \\u003c/script>");
    assert!(start.is_some(), "the comment is there, escaped");
    assert!(!page.contains("<!--<script>"));
}

#[test]
fn warnings_are_on_standard_error_and_in_json() {
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/cases/machines");
    for command in ["modes", "gains", "zeros", "plant"] {
        let output = host_gen(&[command, "nodes-in-mm.toml"], &cases);
        assert!(output.status.success());
        let error = text(&output.stderr);
        assert!(
            error.starts_with("warning: bodies.top: the radius of gyration"),
            "{error}"
        );
        assert!(!text(&output.stdout).contains("radius of gyration"));
        let output = host_gen(&[command, "nodes-in-mm.toml", "--format", "json"], &cases);
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let warning = json["warnings"][0].as_str().unwrap();
        assert!(warning.starts_with("bodies.top"), "{warning}");
        assert!(output.stderr.is_empty());
    }
}
