//! The virtual board: the reference board in software, a package of its own because of its
//! emulator's licence.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::tools;
use crate::{Outcome, cargo, run};

/// What processor in the loop calls it.
pub const MACHINE: &str = "virtual-h743";

/// The machine whose table is compiled into its image.
pub const MODEL: &str = "models/nucleo-h743.toml";

/// Where it is built.
const FOLDER: &str = "target/virtual-board";

/// cargo for the package: not in the workspace, and with a folder of its own.
fn package(task: &str) -> Command {
    let mut command = cargo();
    command
        .args([task, "--release", "--locked"])
        .args(["--manifest-path", "virtual-board/Cargo.toml"])
        .args(["--target-dir", FOLDER]);
    command
}

/// The command that builds its program.
pub fn building() -> Command {
    package("build")
}

/// Its program, once it is built.
pub fn program() -> PathBuf {
    Path::new(FOLDER).join("release/virtual-board")
}

/// Builds its program.
pub fn build_program(install: bool) -> Outcome<()> {
    tools::emulator(install)?;
    run(&mut building())
}

/// Its own tests and the scenes on an image; the `long` ones too, which take minutes.
pub fn scenes(image: &Path, long: bool) -> Outcome<Command> {
    let failed = |error| format!("{}: {error}", image.display());
    let image = std::path::absolute(image).map_err(failed)?;
    let mut command = package("test");
    command.arg("--no-fail-fast");
    command.env("VIRTUAL_IMAGE", image);
    command.env("VIRTUAL_LONG", if long { "1" } else { "0" });
    Ok(command)
}
