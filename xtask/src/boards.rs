//! The boards: how to build for them, and how to start the emulated ones.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::tools::{TARGET, Tools};
use crate::{Outcome, cargo, run};

/// An emulated board.
pub struct EmulatedBoard {
    /// The emulator's name for it.
    pub machine: &'static str,
    /// Its core, for the compiler.
    cpu: &'static str,
}

/// Both boards.
pub const BOARDS: [EmulatedBoard; 2] = [
    EmulatedBoard {
        machine: "mps2-an386",
        cpu: "cortex-m4",
    },
    EmulatedBoard {
        machine: "mps2-an500",
        cpu: "cortex-m7",
    },
];

/// The command that builds the emulated board's binaries, and the folder they are then in.
pub fn building(board: &EmulatedBoard, tools: &Tools) -> (Command, PathBuf) {
    building_for(board.machine, board.cpu, &EMULATED, None, tools)
}

/// The command that builds the emulated board's image with the table in the file `table`, in the
/// folder of the board with `suffix`, and the image's path then.
pub fn building_with(
    suffix: &str,
    table: &Path,
    board: &EmulatedBoard,
    tools: &Tools,
) -> Outcome<(Command, PathBuf)> {
    let table = absolute(table)?;
    let name = format!("{}{suffix}", board.machine);
    let arguments = [&EMULATED[..], &["--bin", IMAGE]].concat();
    let (command, folder) = building_for(&name, board.cpu, &arguments, Some(&table), tools);
    Ok((command, folder.join(IMAGE)))
}

/// What chooses the emulated boards.
const EMULATED: [&str; 3] = ["--no-default-features", "--features", "mps2"];

/// The emulated boards' image that runs a controller.
pub const IMAGE: &str = "mps2";

/// Builds the emulated board's binaries; gives the folder they are in.
pub fn build(board: &EmulatedBoard, tools: &Tools) -> Outcome<PathBuf> {
    let (mut command, folder) = building(board, tools);
    run(&mut command)?;
    Ok(folder)
}

/// Builds the reference board's image; gives its path.
pub fn build_reference(tools: &Tools) -> Outcome<PathBuf> {
    let (mut command, image) = building_reference(tools);
    run(&mut command)?;
    Ok(image)
}

/// The command that builds the reference board's image, and its path then.
pub fn building_reference(tools: &Tools) -> (Command, PathBuf) {
    building_reference_from(None, tools)
}

/// The same with the table in the file `table`.
pub fn building_reference_with(table: &Path, tools: &Tools) -> Outcome<(Command, PathBuf)> {
    Ok(building_reference_from(Some(&absolute(table)?), tools))
}

fn building_reference_from(table: Option<&Path>, tools: &Tools) -> (Command, PathBuf) {
    let arguments = ["--bin", REFERENCE];
    let (command, folder) = building_for(REFERENCE, "cortex-m7", &arguments, table, tools);
    (command, folder.join(REFERENCE))
}

fn absolute(path: &Path) -> Outcome<PathBuf> {
    std::path::absolute(path).map_err(|error| format!("{}: {error}", path.display()))
}

/// The reference board's image.
pub const REFERENCE: &str = "nucleo-h743";

/// What probe-rs calls its processor.
pub const CHIP: &str = "STM32H743ZITx";

/// The environment variable of the firmware's build with a table's absolute path.
const TABLE: &str = "HARDMOUNT_TABLE";

fn building_for(
    name: &str,
    cpu: &str,
    arguments: &[&str],
    table: Option<&Path>,
    tools: &Tools,
) -> (Command, PathBuf) {
    // A folder per board, so that one does not rebuild the other.
    let folder = Path::new("target").join("boards").join(name);
    let mut command = cargo();
    command
        .args(["build", "--quiet", "--profile", "board"])
        .args(["--package", "firmware"])
        .args(arguments)
        .args(["--target", TARGET])
        .arg("--target-dir")
        .arg(&folder)
        // They would take the place of the target's own flags.
        .env_remove("RUSTFLAGS")
        .env_remove("CARGO_ENCODED_RUSTFLAGS")
        .env(
            "CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS",
            format!("-C target-cpu={cpu}"),
        )
        .env("DEFMT_LOG", "info");
    match table {
        Some(table) => command.env(TABLE, table),
        None => command.env_remove(TABLE),
    };
    tools.apply(&mut command);
    (command, folder.join(TARGET).join("board"))
}

/// The emulator with an image loaded, its console on ours.
pub fn emulator(board: &EmulatedBoard, image: &Path) -> Command {
    let mut command = Command::new("qemu-system-arm");
    command
        .args(["-M", board.machine, "-display", "none", "-monitor", "none"])
        .args(["-semihosting-config", "enable=on,target=native"])
        .arg("-kernel")
        .arg(image);
    command
}
