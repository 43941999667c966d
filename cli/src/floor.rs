//! The floor that a command is to use.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use host_gen::floor::{Criterion, Floor, NamedFloor, Record, STRONGEST, SpectrumError};

use crate::arguments::{between, criterion, positive};
use crate::failure::Failure;

#[derive(Args)]
#[group(multiple = false)]
pub struct FloorChoice {
    /// Floor at the limit of this vibration criterion.
    #[arg(long, value_parser = criterion())]
    criterion: Option<Criterion>,
    /// White acceleration along each of x, y and z, m/s²/√Hz.
    #[arg(long)]
    white: Option<f64>,
    /// Text file with a floor spectrum, that of the acceleration along each of x, y and z. Each
    /// line has a frequency, Hz, ascending, and an acceleration density, m/s²/√Hz; # starts a
    /// comment.
    #[arg(long)]
    spectrum: Option<PathBuf>,
    #[command(flatten)]
    recorded: Recorded,
}

#[derive(Args)]
#[group(multiple = true)]
struct Recorded {
    /// Recorded motion of the floor, as comma-separated values. The first line names the columns,
    /// with units in brackets: `time [s], x [m/s²], y [m/s²], z [m/s²]`; g, mg, m/s, mm/s, µm/s, nm
    /// and others are known, too. Its spectra are those of Welch's method.
    #[arg(long, conflicts_with_all = ["criterion", "white", "spectrum"])]
    record: Option<PathBuf>,
    /// Samples per second of a record without a column of time, Hz.
    #[arg(long, requires = "record")]
    rate: Option<f64>,
}

impl FloorChoice {
    /// The floor that was asked for; none if none was.
    pub fn floor(&self) -> Result<Option<NamedFloor>, Failure> {
        if let Some(criterion) = self.criterion {
            return Ok(Some(Floor::Criterion(criterion).into()));
        }
        if let Some(density) = self.white {
            between("white", density, [0.0, STRONGEST], " m/s²/√Hz")?;
            return Ok(Some(Floor::White(density).into()));
        }
        if let Some(path) = &self.spectrum {
            return Ok(Some(NamedFloor {
                floor: Floor::Table(parsed(path, str::parse)?),
                name: path.display().to_string(),
            }));
        }
        let Some(path) = &self.recorded.record else {
            return Ok(None);
        };
        let rate = self.recorded.rate;
        if let Some(rate) = rate {
            positive("rate", rate, "board.sample_rate")?;
        }
        let found = parsed(path, |text| Record::read(text, rate)?.welch())?;
        let name = format!(
            "{} ({} windows of {:.3} s)",
            path.display(),
            found.windows,
            found.window
        );
        let floor = found.floor;
        Ok(Some(NamedFloor { floor, name }))
    }
}

/// What `parse` makes of the text in a file.
fn parsed<T>(
    path: &Path,
    parse: impl FnOnce(&str) -> Result<T, SpectrumError>,
) -> Result<T, Failure> {
    let name = || path.display().to_string();
    let text = fs::read_to_string(path).map_err(|error| Failure::Io {
        path: name(),
        what: "read",
        error,
    })?;
    parse(&text).map_err(|error| Failure::Spectrum {
        path: name(),
        error,
    })
}
