//! The program for those who have no compiler: a wheel for pip and a tarball for Linux, each tried
//! where there is no cargo.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::{Outcome, run, tools};

/// Where the packages are.
const PACKAGES: &str = "target/packages";

/// Where they are made and tried.
const TRIAL: &str = "target/packages-trial";

/// Builds both, and tries both; `install` as for [`tools::venv`].
pub fn dist(install: bool) -> Outcome<()> {
    // What an earlier version made would be given away, too.
    for folder in [PACKAGES, TRIAL] {
        let _ = fs::remove_dir_all(folder);
        made(Path::new(folder))?;
    }
    let mut build = Command::new(tools::maturin(install)?);
    build.args(["build", "--manifest-path", "cli/Cargo.toml", "--locked"]);
    run(build.args(["--out", PACKAGES]))?;
    let wheel = only_wheel()?;
    let programs = tools::venv(&Path::new(TRIAL).join("venv"), install)?;
    let mut pip = Command::new(programs.join("pip"));
    pip.args(["install", "--quiet", "--no-index", "--no-deps"]);
    pip.env("PIP_DISABLE_PIP_VERSION_CHECK", "1");
    run(pip.arg(&wheel))?;
    let program = programs.join("host-gen");
    tried(&program, "wheel", &[])?;

    let tarball = tarball(&program)?;
    let unpacked = Path::new(TRIAL).join("unpacked");
    made(&unpacked)?;
    let mut tar = Command::new("tar");
    tar.arg("-xzf").arg(&tarball).arg("-C").arg(&unpacked);
    run(&mut tar)?;
    let folder = unpacked.join(name());
    let example = fs::canonicalize(folder.join("models/low-parasitic.toml"));
    let example = example.map_err(|error| format!("the tarball has no examples: {error}"))?;
    let example = example.display().to_string();
    tried(&folder.join("host-gen"), "tarball", &["modes", &example])?;
    println!("{}\n{}", wheel.display(), tarball.display());
    Ok(())
}

/// The name of the tarball and of its folder.
fn name() -> String {
    let (version, processor) = (env!("CARGO_PKG_VERSION"), env::consts::ARCH);
    format!("hardmount-{version}-{processor}-linux")
}

fn made(folder: &Path) -> Outcome<()> {
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))
}

/// Packs `program` with the example machines.
fn tarball(program: &Path) -> Outcome<PathBuf> {
    let folder = Path::new(TRIAL).join(name());
    let models = folder.join("models");
    made(&models)?;
    let copy = |from: &Path, to: PathBuf| {
        let copied = fs::copy(from, to).map(|_| ());
        copied.map_err(|error| format!("{}: {error}", from.display()))
    };
    copy(program, folder.join("host-gen"))?;
    for file in ["README.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE"] {
        copy(Path::new(file), folder.join(file))?;
    }
    for entry in fs::read_dir("models").map_err(|error| format!("models: {error}"))? {
        let entry = entry.map_err(|error| format!("models: {error}"))?;
        copy(&entry.path(), models.join(entry.file_name()))?;
    }
    let archive = Path::new(PACKAGES).join(name() + ".tar.gz");
    let mut tar = Command::new("tar");
    tar.arg("-czf").arg(&archive);
    run(tar.args(["-C", TRIAL]).arg(name()))?;
    Ok(archive)
}

/// The wheel.
fn only_wheel() -> Outcome<PathBuf> {
    let files = fs::read_dir(PACKAGES).map_err(|error| format!("{PACKAGES}: {error}"))?;
    let paths = files.flatten().map(|entry| entry.path());
    let mut wheels = paths.filter(|path| path.extension().is_some_and(|own| own == "whl"));
    match (wheels.next(), wheels.next()) {
        (Some(wheel), None) => Ok(wheel),
        _ => Err(format!("{PACKAGES}: not one wheel")),
    }
}

/// Runs `program` of a package in an empty folder with nothing else on the path: a new machine, its
/// page, and `more`, unless that is empty.
fn tried(program: &Path, package: &str, more: &[&str]) -> Outcome<()> {
    let found = fs::canonicalize(program);
    let program = found.map_err(|error| format!("the {package} has no host-gen: {error}"))?;
    let place = Path::new(TRIAL).join(package);
    made(&place.join("models"))?;
    for arguments in [
        &["new", "yours", "--yes"][..],
        &["report", "models/yours.toml", "--output", "page.html"],
        more,
    ] {
        if arguments.is_empty() {
            continue;
        }
        let mut command = Command::new(&program);
        command.args(arguments).current_dir(&place);
        run(command.env_clear().env("PATH", "").env("HOME", "."))?;
    }
    let page = place.join("page.html");
    let text = fs::read_to_string(&page);
    let text = text.map_err(|error| format!("{}: {error}", page.display()))?;
    if !text.trim_end().ends_with("</html>") {
        return Err(format!("the {package}'s program wrote no whole page"));
    }
    println!("{package}: a new machine and its page, without cargo");
    Ok(())
}
