//! `host-gen generate --changes` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::TITLE;
use crate::report::changes::Changes;

impl Display for Changes {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            table,
            now,
            before,
            changed,
        } = self;
        write!(
            f,
            "{TITLE}Table of {}{TITLE:#} {:08x}",
            now.machine, now.checksum
        )?;
        match before {
            None => writeln!(f, ", the first one: nothing to compare it with")?,
            Some(before) if before.checksum == now.checksum => writeln!(f, ", as before")?,
            Some(before) => {
                write!(f, ", before {:08x}", before.checksum)?;
                if before.machine != now.machine {
                    write!(f, " of {}", before.machine)?;
                }
                writeln!(f)?;
                if changed.is_empty() {
                    writeln!(
                        f,
                        "  gains, margins and limits as before, in the digits shown"
                    )?;
                }
            }
        }
        for change in changed {
            let or_none = |text: &Option<String>| text.clone().unwrap_or("none".to_owned());
            let (before, now) = (or_none(&change.before), or_none(&change.now));
            writeln!(f, "  {}: {before} → {now}", change.name)?;
        }
        writeln!(f, "Table written to {table}")
    }
}
