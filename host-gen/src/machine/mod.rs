//! A machine, read from its file or described in code, and checked.
//!
//! A file without control describes a [`Structure`]: its modes are those of a [`Machine`], which has
//! one.
//!
//! Each file here imports only from those before it:
//!
//! | file | |
//! |---|---|
//! | `error` | errors with the place, the entry, the cause and the fix |
//! | [`mod@file`] | the machine file as data |
//! | [`limits`] | the limits of all numbers |
//! | `source` | texts of files, what they are based on, where an entry is |
//! | [`schema`] | the JSON Schema of machine files |
//! | `read` | from TOML values to the file's types |
//! | `names` | names that do not exist, and what was meant |
//! | `noise` | the noise of a sensor over frequency |
//! | [`parts`] | sensors with the figures of their makers |
//! | `sensor` | a sensor with its noise and its dynamics |
//! | `checked` | [`Machine`] and its parts |
//! | `actuator` | actuators with their amplifiers, from data sheets |
//! | `beam_mass` | mass and segments of a beam, and the nodes that beams hold |
//! | `flexible` | flexible bodies and their matrices |
//! | `validate` | from the file's types to a [`Machine`] |
//!
//! What only the arrangement as a whole can show (dependent degrees of freedom, a singular
//! sensor arrangement) is checked by [`crate::model`], not here.

mod actuator;
mod beam_mass;
mod checked;
mod error;
pub mod file;
mod flexible;
pub mod limits;
mod names;
mod noise;
pub mod parts;
mod read;
pub mod schema;
mod sensor;
mod source;
#[cfg(test)]
mod tests;
mod validate;

use std::path::Path;

pub use checked::{
    Beam, Board, Body, Carrier, ChannelGains, DESIGN_SAMPLES, Damping, Deformation, Direction,
    FlexibleBody, Load, LowerCorner, Machine, Node, Performance, Piezo, PointMass, Robustness,
    Sensor, Spring, Stiffness, Structure, Target, Uncertainty,
};
pub(crate) use error::EntryError;
pub use error::MachineError;
pub use file::{
    Certainty, FeedbackKind, FilterEntry, LawName, MachineFile, Minimise, NoiseEntry, Penalty,
    Provenance, Resonance, ResonanceEntry, RollOff, ShapeEntry, Simulation, SpectrumEntry,
    SupervisionSettings, UnknownFeedback,
};
pub use noise::NoiseDensity;
use source::Source;

impl Machine {
    /// Reads and checks a machine file.
    ///
    /// # Errors
    /// If the file cannot be read, is not TOML, or is not a machine.
    pub fn load(path: &Path) -> Result<Self, MachineError> {
        let (source, table) = Source::read(path)?;
        Self::from_table(source, table)
    }

    /// Checks the text of a machine file. `path` is the file that errors name; files that it
    /// is based on are looked for from there.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn parse(path: &Path, text: &str) -> Result<Self, MachineError> {
        let (source, table) = Source::parse(path, text)?;
        Self::from_table(source, table)
    }

    /// Checks a machine that is described in code ([example](mod@file)).
    ///
    /// # Errors
    /// As for a file with the same values; without a line.
    pub fn build(file: MachineFile) -> Result<Self, MachineError> {
        validate::machine(file, Source::default())
    }

    fn from_table(source: Source, table: toml::Table) -> Result<Self, MachineError> {
        match read::file(table) {
            Ok(file) => validate::machine(file, source),
            Err(error) => Err(source.locate(error)),
        }
    }
}

impl Structure {
    /// Reads and checks a machine file that says nothing of control: it has none of the tables
    /// `coordinates`, `actuators`, `sensors`, `floor`, `performance`, `control` and `board`. `None`
    /// if it has one of them, and so is that of a [`Machine`].
    ///
    /// # Errors
    /// If the file cannot be read, is not TOML, or what vibrates in it is wrong.
    pub fn load_passive(path: &Path) -> Result<Option<Self>, MachineError> {
        let (source, table) = Source::read(path)?;
        Self::passive(source, table)
    }

    /// The same of the text of a machine file, as [`Machine::parse`].
    ///
    /// # Errors
    /// As [`load_passive`](Self::load_passive).
    pub fn parse_passive(path: &Path, text: &str) -> Result<Option<Self>, MachineError> {
        let (source, table) = Source::parse(path, text)?;
        Self::passive(source, table)
    }

    fn passive(source: Source, table: toml::Table) -> Result<Option<Self>, MachineError> {
        match read::passive(table) {
            None => Ok(None),
            Some(Ok(file)) => validate::structure(&file, source).map(Some),
            Some(Err(error)) => Err(source.locate(error)),
        }
    }
}
