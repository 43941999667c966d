//! `host-gen commission` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::WARNING;
use crate::commission::Gate;

impl Display for Gate {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            step,
            criterion,
            found,
            passed,
        } = self;
        if *passed {
            writeln!(f, "passed  {step}: {found}")
        } else {
            writeln!(f, "{WARNING}failed{WARNING:#}  {step}: {found}")?;
            writeln!(f, "        must hold: {criterion}")
        }
    }
}
