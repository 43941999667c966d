//! `host-gen parts`: the library of sensors.

use std::fmt::{self, Display, Formatter};

use host_gen::machine::parts::{Library, all};
use serde::Serialize;

use crate::arguments::Format;
use crate::failure::Failure;
use crate::print;

/// By kind.
#[derive(Serialize)]
struct PartsView(&'static Library);

impl Display for PartsView {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (kind, parts) in self.0 {
            for (name, part) in parts {
                write!(f, "[board.{kind}] sensor = \"{name}\": {part}")?;
            }
        }
        Ok(())
    }
}

pub fn parts(format: Format) -> Result<(), Failure> {
    print::result(format, &PartsView(all()))
}
