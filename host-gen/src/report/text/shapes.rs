//! Shapes as a machine file takes them.

use std::fmt::{self, Formatter};

use super::aligned::TITLE;
use crate::control::Shape;
use crate::control::shape::{Filter, Resonance};

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
        writeln!(f, "[[control.shapes]]\nsections = [")?;
        for Filter { zeros, poles } in &shape.sections {
            writeln!(
                f,
                "  {{ zeros = {}, poles = {} }},",
                pair(zeros),
                pair(poles)
            )?;
        }
        writeln!(f, "]")?;
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
