//! Shapes as a machine file takes them.

use std::fmt::{self, Formatter};

use super::aligned::TITLE;
use crate::control::Shape;
use crate::control::shape::Resonance;

/// `[[control.shapes]]`, one for each mode. Six digits: the table changes in its last bits,
/// the loop by less than its verification resolves.
pub(super) fn write_shapes(f: &mut Formatter<'_>, shapes: &[Shape]) -> fmt::Result {
    writeln!(
        f,
        "{TITLE}For the machine file: with these shapes nothing is searched{TITLE:#}"
    )?;
    let pair = |Resonance { hz, damping }: &Resonance| {
        format!("{{ hz = {}, damping = {} }}", six(*hz), six(*damping))
    };
    for shape in shapes {
        let [a, b] = shape.lags_hz.map(six);
        writeln!(f, "[[control.shapes]]")?;
        writeln!(f, "lags_hz = [{a}, {b}]")?;
        writeln!(f, "zero_hz = {}", six(shape.zero_hz))?;
        writeln!(f, "notch = {}", pair(&shape.notch))?;
        writeln!(f, "notch_poles = {}", pair(&shape.notch_poles))?;
        if let Some(hz) = shape.split_hz {
            writeln!(f, "split_hz = {}", six(hz))?;
        }
    }
    Ok(())
}

/// With six significant digits, as TOML has a float.
fn six(x: f64) -> String {
    let rounded: f64 = format!("{x:.5e}").parse().unwrap_or(x);
    format!("{rounded:?}")
}
