//! A controller table made from a machine file and compiled into an image: no source changes, all
//! of it is in `target`.

use std::fs;
use std::path::{Path, PathBuf};

use crate::boards::{self, EmulatedBoard};
use crate::tools::Tools;
use crate::{Outcome, built, cached, cargo, run, virtual_board};

/// Where tables and images are kept, a folder for each machine file's name.
const FOLDER: &str = "target/models";

/// A machine's table, made for a board.
pub struct Made {
    folder: PathBuf,
    table: PathBuf,
}

impl Made {
    /// The table of the machine file `model` for the reference board.
    pub fn for_reference(model: &str) -> Outcome<Self> {
        Self::new(model, virtual_board::MACHINE)
    }

    /// The table of the machine file `model` for an emulated board.
    pub fn for_emulated(model: &str, board: &EmulatedBoard) -> Outcome<Self> {
        Self::new(model, board.machine)
    }

    /// Makes the table, if the board called `machine` can run it, and prints what changed since
    /// the one before.
    fn new(model: &str, machine: &str) -> Outcome<Self> {
        let Some(name) = Path::new(model).file_stem() else {
            return Err(format!("--model {model:?} is no machine file"));
        };
        // Together, so that they share what is compiled.
        let mut programs = cargo();
        programs.args(["build", "--quiet", "--release", "--locked"]);
        programs.args(["--package", "cli", "--package", "tests"]);
        run(programs.args(["--bin", "host-gen", "--bin", "pil"]))?;
        println!("{model}: its controller, and whether the board can run it");
        // Before anything is written.
        let mut admits = built("pil");
        admits.args(["--model", model, "--admits", machine]);
        let output = cached(&mut admits)
            .output()
            .map_err(|error| format!("pil cannot be started: {error}"))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            return Err(said.trim().trim_start_matches("error: ").to_owned());
        }
        let folder = Path::new(FOLDER).join(name);
        let failed = |error| format!("{}: {error}", folder.display());
        fs::create_dir_all(&folder).map_err(failed)?;
        let table = folder.join("table.rs");
        let mut generate = built("host-gen");
        generate.args(["generate", model, "--table"]).arg(&table);
        run(generate.arg("--changes").arg(folder.join("figures.json")))?;
        Ok(Self { folder, table })
    }

    /// Builds the reference board's image with it; gives the image's path.
    pub fn reference(&self, tools: &Tools) -> Outcome<PathBuf> {
        let (mut command, image) = boards::building_reference_with(&self.table, tools)?;
        run(&mut command)?;
        self.keep(&image, boards::REFERENCE)
    }

    /// Builds an emulated board's image with it; gives the image's path.
    pub fn emulated(&self, board: &EmulatedBoard, tools: &Tools) -> Outcome<PathBuf> {
        let (mut command, image) = boards::building_with("", &self.table, board, tools)?;
        run(&mut command)?;
        self.keep(&image, board.machine)
    }

    /// Copies the image: where it was built, so are those of other machines and the one with the
    /// table that comes with it, and cargo builds it again when the table is another.
    fn keep(&self, image: &Path, name: &str) -> Outcome<PathBuf> {
        let kept = self.folder.join(name);
        let failed = |error| format!("{}: {error}", kept.display());
        fs::copy(image, &kept).map_err(failed)?;
        Ok(kept)
    }
}
