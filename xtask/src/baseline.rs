//! Counts that are kept in the tree and compared with what is found now.

use std::fs;

use crate::Outcome;

/// A kind of counts.
pub struct Baseline {
    /// Where it is kept: a line each, its name and then a number.
    pub file: &'static str,
    /// Another compiler may take this part more or less before it is a change.
    pub slack: f64,
    /// The task that writes it anew.
    pub update: &'static str,
}

impl Baseline {
    /// Keeps `found` from here on.
    pub fn write(&self, found: &[String]) -> Outcome<()> {
        let text = found.join("\n") + "\n";
        print!("{text}");
        fs::write(self.file, text).map_err(|error| format!("{}: {error}", self.file))
    }

    /// Prints `found` beside what is kept.
    ///
    /// # Errors
    /// Where they are not alike.
    pub fn compare(&self, found: &[String]) -> Outcome<()> {
        let kept =
            fs::read_to_string(self.file).map_err(|error| format!("{}: {error}", self.file))?;
        let split = |line: &str| -> Option<(String, f64)> {
            let (name, count) = line.rsplit_once(' ')?;
            Some((name.to_owned(), count.parse().ok()?))
        };
        let mut moved = Vec::new();
        for (found, kept) in found.iter().zip(kept.lines()) {
            let (Some((name, found)), Some((expected, kept))) = (split(found), split(kept)) else {
                return Err(format!("not a count: {found:?}, {kept:?}"));
            };
            println!("  {name:<36} {found:>6}   baseline {kept:>6}");
            if name != expected || (found / kept - 1.0).abs() > self.slack {
                moved.push(name);
            }
        }
        if found.len() != kept.lines().count() || !moved.is_empty() {
            return Err(format!(
                "not the baseline: {}; if that is meant, cargo xtask {} --update",
                moved.join(", "),
                self.update
            ));
        }
        Ok(())
    }
}
