//! `host-gen generate` and `host-gen check`: the table in the firmware's sources.

use std::fmt::Display;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use clap::Args;
use host_gen::analysis::warnings::warnings;
use host_gen::control::emit::{difference, emit};
use host_gen::machine::Machine;
use host_gen::report::changes::{Changes, Figures};
use host_gen::report::summary::GenerateSummary;
use serde::Serialize;

use super::simulate::simulation;
use crate::arguments::{Common, Format};
use crate::failure::{Failure, in_loop};
use crate::files::write_whole;
use crate::print;
use crate::search::{Searcher, study};

#[derive(Args)]
pub struct TableArguments {
    #[command(flatten)]
    common: Common,
    /// File of the table [default: firmware/src/tables/NAME.rs].
    #[arg(long)]
    table: Option<PathBuf>,
}

#[derive(Args)]
pub struct GenerateArguments {
    #[command(flatten)]
    table: TableArguments,
    /// Instead of the summary, print what changed in gains, margins and limits since the table
    /// before, whose figures are kept in this file.
    #[arg(long, value_name = "FILE")]
    changes: Option<PathBuf>,
}

pub fn generate(arguments: &GenerateArguments, searcher: &Searcher) -> Result<(), Failure> {
    let GenerateArguments {
        table: arguments,
        changes,
    } = arguments;
    let model = &arguments.common.model;
    let study = study(model)?;
    let path = table_path(arguments, study.machine())?;
    let before = changes.as_deref().map(kept).transpose()?;
    let design = searcher.design(model, &study)?;
    if let (Some(file), Some(before)) = (changes, before) {
        let now = Figures::new(&study, &design).map_err(in_loop(model))?;
        let json = serde_json::to_string(&now).expect("numbers and strings serialise");
        let changes = Changes::new(path.display().to_string(), before, now);
        write_whole(&path, emit(study.machine(), &design.table).as_bytes())?;
        write_whole(file, json.as_bytes())?;
        return print::warned(arguments.common.format, &changes, &warnings(&study));
    }
    let simulation = simulation(&study, &study.machine().simulation, &design, None);
    write_whole(&path, emit(study.machine(), &design.table).as_bytes())?;
    let report = GenerateSummary::new(&study, design, path.display().to_string(), simulation);
    print::result(arguments.common.format, &report.map_err(in_loop(model))?)
}

/// The figures of the table before; none if there was none.
fn kept(path: &Path) -> Result<Option<Figures>, Failure> {
    let text = match fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => {
            return Err(Failure::Io {
                path: path.display().to_string(),
                what: "read",
                error,
            });
        }
    };
    let figures = serde_json::from_str(&text);
    figures.map(Some).map_err(|error| Failure::Figures {
        path: path.display().to_string(),
        error,
    })
}

/// Result of `host-gen check`.
#[derive(Serialize)]
struct CheckView {
    table: String,
    up_to_date: bool,
    /// The first line that differs; none if the table is up to date.
    difference: Option<String>,
}

impl Display for CheckView {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{} matches the machine file", self.table)
    }
}

pub fn check(arguments: &TableArguments, searcher: &Searcher) -> Result<(), Failure> {
    let Common { model, format } = &arguments.common;
    let study = study(model)?;
    let path = table_path(arguments, study.machine())?;
    let design = searcher.design(model, &study)?;
    let found = fs::read_to_string(&path).map_err(|error| Failure::Io {
        path: path.display().to_string(),
        what: "read",
        error,
    })?;
    let difference = difference(&found, &emit(study.machine(), &design.table));
    let report = CheckView {
        table: path.display().to_string(),
        up_to_date: difference.is_none(),
        difference: difference.clone(),
    };
    if *format == Format::Json || report.up_to_date {
        print::result(*format, &report)?;
    }
    match difference {
        None => Ok(()),
        Some(difference) => Err(Failure::Stale {
            table: report.table,
            model: model.display().to_string(),
            difference,
        }),
    }
}

fn table_path(arguments: &TableArguments, machine: &Machine) -> Result<PathBuf, Failure> {
    if let Some(path) = &arguments.table {
        return Ok(path.clone());
    }
    let folder = Path::new("firmware/src/tables");
    if !folder.is_dir() {
        return Err(Failure::NoTables(folder.display().to_string()));
    }
    Ok(folder
        .join(machine.name.replace('-', "_"))
        .with_extension("rs"))
}
