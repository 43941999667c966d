//! The floor that a command is to use.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use host_gen::files::columns::TextError;
use host_gen::floor::{Criterion, Floor, NamedFloor, Record, STRONGEST, Welch};

use crate::arguments::{between, criterion, positive};
use crate::failure::Failure;

#[derive(Args)]
#[group(multiple = false)]
pub struct FloorChoice {
    /// Floor at the limit of this vibration criterion.
    #[arg(long, value_parser = criterion(), conflicts_with = "record")]
    criterion: Option<Criterion>,
    /// White acceleration along each of x, y and z, m/s²/√Hz.
    #[arg(long, conflicts_with = "record")]
    white: Option<f64>,
    /// Text file with a floor spectrum, that of the acceleration along each of x, y and z. Each
    /// line has a frequency, Hz, ascending, and an acceleration density, m/s²/√Hz; # starts a
    /// comment.
    #[arg(long, conflicts_with = "record")]
    spectrum: Option<PathBuf>,
    #[command(flatten)]
    recorded: Recorded,
}

/// A recorded floor.
#[derive(Args)]
#[group(multiple = true)]
pub struct Recorded {
    /// Recorded motion of the floor, as comma-separated values. The first line names the columns,
    /// with units in brackets: `time [s], x [m/s²], y [m/s²], z [m/s²]`; g, mg, m/s, mm/s, µm/s, nm
    /// and others are known, too. Its spectra are those of Welch's method.
    #[arg(long)]
    record: Option<PathBuf>,
    /// Samples per second of a record without a column of time, Hz.
    #[arg(long, requires = "record")]
    rate: Option<f64>,
}

impl FloorChoice {
    /// The options that make this choice.
    pub fn arguments(&self) -> Vec<OsString> {
        let text = |name: &str, value: String| (name.to_owned(), OsString::from(value));
        let file = |name: &str, path: &PathBuf| (name.to_owned(), path.clone().into_os_string());
        let Recorded { record, rate } = &self.recorded;
        let given = [
            self.criterion
                .map(|own| text("--criterion", own.key().to_owned())),
            self.white
                .map(|density| text("--white", density.to_string())),
            self.spectrum.as_ref().map(|path| file("--spectrum", path)),
            record.as_ref().map(|path| file("--record", path)),
            rate.map(|rate| text("--rate", rate.to_string())),
        ];
        let pairs = given.into_iter().flatten();
        pairs
            .flat_map(|(name, value)| [name.into(), value])
            .collect()
    }

    /// The file that describes the floor, if one does.
    pub fn file(&self) -> Option<&Path> {
        let file = self.spectrum.as_ref().or(self.recorded.record.as_ref());
        file.map(PathBuf::as_path)
    }

    /// The floor that was asked for; none if none was.
    pub fn floor(&self) -> Result<Option<NamedFloor>, Failure> {
        // Beside another floor, clap does not ask for the record.
        if self.recorded.rate.is_some() && self.recorded.record.is_none() {
            return Err(Failure::Setting {
                option: "--rate",
                must: "go with --record".to_owned(),
            });
        }
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
        let of_record = |record: Record| {
            let found = record.welch()?;
            let Welch {
                floor,
                windows,
                window,
            } = found;
            Ok((floor, format!("{windows} windows of {window:.3} s")))
        };
        let found = self.recorded.read(of_record)?;
        Ok(found.map(|((floor, how), name)| NamedFloor {
            floor,
            name: format!("{name} ({how})"),
        }))
    }
}

impl Recorded {
    /// What `make` makes of the record that was given, and its name; none if none was.
    pub fn read<T>(
        &self,
        make: impl FnOnce(Record) -> Result<T, TextError>,
    ) -> Result<Option<(T, String)>, Failure> {
        let Some(path) = &self.record else {
            return Ok(None);
        };
        if let Some(rate) = self.rate {
            positive("rate", rate, "board.sample_rate")?;
        }
        let made = parsed(path, |text| make(Record::read(text, self.rate)?))?;
        Ok(Some((made, path.display().to_string())))
    }
}

/// What `parse` makes of the text in a file.
pub fn parsed<T>(
    path: &Path,
    parse: impl FnOnce(&str) -> Result<T, TextError>,
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
