//! `host-gen compliance` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::{TITLE, WARNING, cells, write_table};
use crate::analysis::compliance::Compliance;
use crate::simulate::compliance::{ComplianceAnalysis, Course, Response, Tolerance};

/// Frequencies at which magnitudes are shown, Hz.
const AT: [f64; 3] = [1.0, 10.0, 100.0];

/// A magnitude in three digits.
pub(super) fn short(x: f64) -> String {
    if x == 0.0 {
        "0".to_owned()
    } else {
        format!("{:.2e}", x.abs())
    }
}

impl Display for ComplianceAnalysis {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{TITLE}Compliance of {}{TITLE:#}", self.machine)?;
        let Compliance { hz: grid, loads } = &self.compliance;
        for load in loads {
            writeln!(f, "  to {}, per {}", load.name, load.unit)?;
            let mut head = cells(["", "", "", "at rest", "highest", "at Hz"]);
            head.extend(AT.map(|hz| format!("{hz:.0} Hz")));
            let mut rows = vec![head];
            for output in &load.outputs {
                let open = Some((&output.open, output.open_highest));
                let closed = output.closed.as_ref().zip(output.closed_highest);
                for (side, found) in [("open", open), ("closed", closed)] {
                    let Some((values, highest)) = found else {
                        continue;
                    };
                    let name = if side == "open" { &output.name[..] } else { "" };
                    let mut row = cells([name, output.unit, side]);
                    row.push(short(output.fixed));
                    row.push(short(highest.magnitude));
                    row.push(match highest.magnitude {
                        0.0 => String::new(),
                        _ => format!("{:.2}", highest.hz),
                    });
                    row.extend(AT.map(|hz| {
                        let at = grid.partition_point(|own| *own < hz);
                        values.get(at).map_or("-".to_owned(), |x| short(*x))
                    }));
                    rows.push(row);
                }
            }
            write_table(f, 4, 3, rows)?;
        }
        if let Some(response) = &self.profile {
            write_response(f, response)?;
        }
        Ok(())
    }
}

fn write_response(f: &mut Formatter<'_>, response: &Response) -> fmt::Result {
    let within = match response.tolerance {
        Tolerance::Part(part) => format!("{} % of the largest without control", 100.0 * part),
        Tolerance::Absolute(size) => format!("{size:e} m or rad"),
    };
    writeln!(
        f,
        "{TITLE}Under {}, {} s simulated{TITLE:#}; settled within {within}, counted from {:.4} s",
        response.name, response.duration, response.last_change
    )?;
    let head = cells([
        "",
        "",
        "largest open",
        "closed",
        "settled after, s, open",
        "closed",
    ]);
    let settled = |course: &Course| match course.settled_after {
        Some(after) => format!("{after:.4}"),
        None => "not".to_owned(),
    };
    let rows = response.outputs.iter().map(|output| {
        let mut row = cells([&output.name, output.unit]);
        row.extend([&output.open, &output.closed].map(|course| format!("{:.3e}", course.peak)));
        row.extend([&output.open, &output.closed].map(settled));
        row
    });
    write_table(f, 4, 2, [head].into_iter().chain(rows))?;
    writeln!(f, "  largest force of a leg {:.1} N", response.force_peak)?;
    if response.clamped_steps > 0 {
        writeln!(
            f,
            "  {WARNING}Warning:{WARNING:#} the forces were clamped in {} samples.",
            response.clamped_steps
        )?;
    }
    Ok(())
}
