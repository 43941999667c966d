//! The program for those who have no compiler: a wheel for pip and a tarball for Linux, each tried
//! where there is no cargo.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::{Outcome, run, tools};

/// What is made, and where it is tried; cargo has a folder of the profile's name.
const DIST: &str = "target/packages";

/// Builds both, and tries both; `install` as for [`tools::venv`].
pub fn dist(install: bool) -> Outcome<()> {
    let wheels = Path::new(DIST);
    // What an earlier version made would be tried, too.
    let _ = fs::remove_dir_all(wheels);
    fs::create_dir_all(wheels).map_err(|error| format!("{DIST}: {error}"))?;
    let maturin = tools::maturin(install)?;
    let mut build = Command::new(maturin);
    build.args(["build", "--manifest-path", "cli/Cargo.toml", "--locked"]);
    run(build.args(["--out", DIST]))?;
    let wheel = only(wheels, "whl")?;
    let venv = tools::venv(&wheels.join("pip"), install)?;
    let mut pip = Command::new(venv.join("pip"));
    pip.args(["install", "--quiet", "--no-index", "--no-deps"]);
    run(pip.arg(&wheel))?;
    tried(&venv, "the wheel")?;
    let tarball = tarball(&venv.join("host-gen"))?;
    let unpacked = wheels.join("unpacked");
    fs::create_dir_all(&unpacked).map_err(|error| format!("{}: {error}", unpacked.display()))?;
    run(Command::new("tar")
        .args(["-xzf"])
        .arg(&tarball)
        .arg("-C")
        .arg(&unpacked))?;
    tried(&unpacked.join(name()), "the tarball")?;
    println!("{}\n{}", wheel.display(), tarball.display());
    Ok(())
}

/// The name of the tarball and of its folder.
fn name() -> String {
    format!(
        "hardmount-{}-{}-linux",
        env!("CARGO_PKG_VERSION"),
        env::consts::ARCH
    )
}

/// Packs `program` with the example machines.
fn tarball(program: &Path) -> Outcome<PathBuf> {
    let folder = Path::new(DIST).join(name());
    let models = folder.join("models");
    let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
    fs::create_dir_all(&models).map_err(failed)?;
    fs::copy(program, folder.join("host-gen")).map_err(failed)?;
    for file in ["README.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE"] {
        fs::copy(file, folder.join(file)).map_err(failed)?;
    }
    for entry in fs::read_dir("models").map_err(failed)? {
        let entry = entry.map_err(failed)?;
        fs::copy(entry.path(), models.join(entry.file_name())).map_err(failed)?;
    }
    let archive = Path::new(DIST).join(name() + ".tar.gz");
    let mut tar = Command::new("tar");
    tar.arg("-czf").arg(&archive).args(["-C", DIST]).arg(name());
    run(&mut tar)?;
    Ok(archive)
}

/// The only file in `folder` with this extension.
fn only(folder: &Path, extension: &str) -> Outcome<PathBuf> {
    let files = fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut found = files
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|own| own == extension));
    match (found.next(), found.next()) {
        (Some(path), None) => Ok(path),
        _ => Err(format!("{}: not one .{extension}", folder.display())),
    }
}

/// Runs the program in `folder` in an empty folder, with nothing else on the path: a new machine and
/// its page.
fn tried(folder: &Path, what: &str) -> Outcome<()> {
    let program = fs::canonicalize(folder.join("host-gen"));
    let program = program.map_err(|error| format!("{what} has no host-gen: {error}"))?;
    let place = Path::new(DIST).join("trial");
    let failed = |error: std::io::Error| format!("{}: {error}", place.display());
    let _ = fs::remove_dir_all(&place);
    fs::create_dir_all(place.join("models")).map_err(failed)?;
    for arguments in [
        &["new", "yours", "--yes"][..],
        &["report", "models/yours.toml", "--output", "page.html"],
    ] {
        let mut command = Command::new(&program);
        command.args(arguments).current_dir(&place);
        command.env_clear().env("PATH", "").env("HOME", &place);
        run(&mut command)?;
    }
    let page = fs::read_to_string(place.join("page.html")).map_err(failed)?;
    if !page.contains("</html>") {
        return Err(format!("{what} wrote no page"));
    }
    println!("{what}: a new machine and its page, without cargo");
    Ok(())
}
