//! `host-gen fit`.

use std::path::{Path, PathBuf};

use clap::Args;
use host_gen::board::measure::Measurement;
use host_gen::identify::{self, Identification};
use host_gen::machine::Machine;

use crate::arguments::Format;
use crate::failure::Failure;
use crate::files::write_whole;
use crate::print;
use crate::search::Bar;

#[derive(Args)]
pub struct FitArguments {
    /// Machine file that is to be fitted.
    model: PathBuf,
    /// What `host-gen link frf --format json` printed.
    measured: PathBuf,
    /// File to write [default: MODEL-fitted.toml beside the model]. It must be in the same folder
    /// as the model.
    #[arg(long)]
    output: Option<PathBuf>,
    /// Output format: text, or JSON as in docs/json.md.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
}

pub fn fit(arguments: &FitArguments) -> Result<(), Failure> {
    let machine = Machine::load(&arguments.model)?;
    let measurement = read(&arguments.measured)?;
    let own = || fitted_path(&arguments.model, &machine);
    let output = arguments.output.clone().unwrap_or_else(own);
    let beside = |path: &Path| std::path::absolute(path).ok()?.parent().map(Path::to_owned);
    let other = output.file_name() != arguments.model.file_name();
    if beside(&output) != beside(&arguments.model) || !other {
        return Err(Failure::Setting {
            option: "--output",
            must: format!(
                "be another file in the folder of {}",
                arguments.model.display()
            ),
        });
    }
    let bar = Bar::fit();
    let found = identify::fit(&machine, &measurement, &bar);
    drop(bar);
    let found = found.map_err(|error| Failure::Fit {
        path: arguments.measured.display().to_string(),
        error,
    })?;
    print::result(arguments.format, &found)?;
    if !found.unexplained.is_empty() {
        return Err(Failure::Unexplained(output.display().to_string()));
    }
    let text = fitted_text(&arguments.model, &machine, &found, &arguments.measured);
    write_whole(&output, text.as_bytes())
}

/// The name of the fitted machine, and of its file.
fn fitted_name(machine: &Machine) -> String {
    format!("{}-fitted", machine.name)
}

/// The usual path of the fitted file of a machine, beside its own file `model`.
pub fn fitted_path(model: &Path, machine: &Machine) -> PathBuf {
    model.with_file_name(format!("{}.toml", fitted_name(machine)))
}

/// The text of the fitted file of the machine in the file `model`, fitted to the measurement in
/// `measured`.
pub fn fitted_text(
    model: &Path,
    machine: &Machine,
    found: &Identification,
    measured: &Path,
) -> String {
    let based_on = model.file_name().unwrap_or_default().to_string_lossy();
    let from = format!("fitted by host-gen to {}", measured.display());
    identify::fitted_file(machine, found, &based_on, &fitted_name(machine), &from)
}

/// Reads a measurement.
pub fn read(path: &Path) -> Result<Measurement, Failure> {
    let shown = || path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| Failure::Io {
        path: shown(),
        what: "read",
        error,
    })?;
    serde_json::from_slice(&bytes).map_err(|error| Failure::Measurement {
        path: shown(),
        error,
    })
}
