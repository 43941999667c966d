//! `host-gen bound` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::{TITLE, cells, write_table};
use crate::analysis::bound::{BoundAnalysis, BoundsOf, RmsBound, Room, least};
use crate::design::Band;
use crate::design::bound::{ByControllers, Certificate, MeanSquareBound, ModeBound};
use crate::machine::{Minimise, RollOff};

impl Display for BoundAnalysis {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}What no controller of {} can pass, {} feedback{TITLE:#}",
            self.machine, self.feedback
        )?;
        writeln!(
            f,
            "  For the machine exactly as in the file, controllers of any order, a delay of {} sample{} at {} Hz,\n  peak sensitivity {}, isolation from {:.2} Hz on{}",
            self.delay_samples,
            if self.delay_samples == 1 { "" } else { "s" },
            self.sample_rate,
            self.max_sensitivity,
            self.isolated_hz[0],
            match self.roll_off {
                Some(RollOff { hz, order }) => format!(
                    ", σ_max(T) at most ({hz:.0} Hz/f)^{order} from {hz:.0} Hz on{}",
                    if self.asked {
                        " (control.roll_off)"
                    } else {
                        ", as the design has it"
                    }
                ),
                None => String::new(),
            }
        )?;
        if self.both {
            return writeln!(
                f,
                "  There is no bound: with both kinds of sensors, the floor's motion can be told from the machine's,\n  and no such limit keeps a machine that is known exactly from being isolated."
            );
        }
        if let Some(rms) = &self.rms {
            write_rms(f, rms)?;
        }
        match &self.bounds {
            BoundsOf::Design { reached, .. } if reached.is_empty() && self.rms.is_some() => Ok(()),
            BoundsOf::Design { reached, .. } if reached.is_empty() => {
                writeln!(f, "  There is no bound: the file has no performance.bands.")
            }
            BoundsOf::Design {
                reached,
                bands,
                together,
            } => write_design_bounds(f, reached, bands, together),
            BoundsOf::Requirements(modes) => write_requirements(f, modes),
        }
    }
}

fn write_design_bounds(
    f: &mut Formatter<'_>,
    reached: &[Band],
    bands: &[Vec<ModeBound>],
    together: &[ModeBound],
) -> fmt::Result {
    writeln!(
        f,
        "{TITLE}Lower bounds of the highest peak of σ_max(G11), dB{TITLE:#}"
    )?;
    let mut head = cells(["", ""]);
    let mut kinds = cells(["mode", "Hz"]);
    let mut last = cells(["reached", ""]);
    for band in reached {
        head.extend([band.name.clone(), String::new()]);
        kinds.extend(cells(["modal", "any"]));
        last.extend([format!("{:.1}", band.sampled_db), String::new()]);
    }
    head.extend(cells(["all at once*", ""]));
    kinds.extend(cells(["modal", "any"]));
    let rows = together.iter().enumerate().map(|(i, mode)| {
        let mut row = vec![mode.mode.to_string(), format!("{:.2}", mode.hz)];
        for bound in bands.iter().map(|band| &band[i]).chain([mode]) {
            row.extend(levels(bound));
        }
        row
    });
    let rows = [head, kinds].into_iter().chain(rows).chain([last]);
    write_table(f, 2, 1, rows)?;
    writeln!(
        f,
        "  modal: each mode is fed back by itself; any: all controllers; -: no bound was found.\n  *as a part of what is reached."
    )?;
    write_room(f, BANDS, &least(together))?;
    write_grid(f, bands.iter().flatten().chain(together))
}

/// The rms that a design minimises, beside its bounds.
fn write_rms(f: &mut Formatter<'_>, rms: &RmsBound) -> fmt::Result {
    let (name, unit) = match rms.minimise {
        Minimise::Average => ("moving average", "m"),
        Minimise::Deviation => ("moving deviation", "m"),
        Minimise::Rms | Minimise::Peaks => ("rms", "m/s²"),
    };
    writeln!(
        f,
        "{TITLE}Lower bound of the {name} of the performance outputs together, {unit}{TITLE:#}"
    )?;
    let ByControllers { modal, any } = rms.above_db();
    let row = |name: &str, found: &Option<MeanSquareBound>, above: Option<f64>| {
        let bound = found.as_ref().map(|found| format!("{:.3e}", found.rms));
        let above = above.map(|db| format!("{db:.1}"));
        let none = || "-".to_owned();
        vec![
            name.to_owned(),
            bound.unwrap_or_else(none),
            above.unwrap_or_else(none),
        ]
    };
    let head = cells(["", "", "reached is above, dB"]);
    let reached = vec![
        "reached".to_owned(),
        format!("{:.3e}", rms.reached),
        String::new(),
    ];
    let rows = [
        head,
        row("modal", &rms.found.modal, modal),
        row("any", &rms.found.any, any),
        reached,
    ];
    write_table(f, 1, 1, rows)?;
    if let Some(found) = &rms.found.modal {
        let block = |block: &Vec<usize>| {
            let modes: Vec<_> = block.iter().map(usize::to_string).collect();
            modes.join(" ")
        };
        let blocks: Vec<_> = found.blocks.iter().map(block).collect();
        writeln!(
            f,
            "  modal: modes of different blocks do not act on each other; blocks {}.",
            blocks.join(", ")
        )?;
    }
    let found = [&rms.found.modal, &rms.found.any].into_iter().flatten();
    match found.map(|found| found.grid_db).reduce(f64::max) {
        Some(most) => writeln!(
            f,
            "  A grid twice as fine changes none of these by more than {most:.2} dB."
        ),
        None => Ok(()),
    }
}

fn write_requirements(f: &mut Formatter<'_>, modes: &[ModeBound]) -> fmt::Result {
    writeln!(
        f,
        "{TITLE}By how much sensitivity, roll-off and isolation must be widened at least, dB{TITLE:#}"
    )?;
    let head = cells(["mode", "Hz", "modal", "any"]);
    let rows = modes.iter().map(|mode| {
        let mut row = vec![mode.mode.to_string(), format!("{:.2}", mode.hz)];
        row.extend(levels(mode));
        row
    });
    write_table(f, 2, 1, [head].into_iter().chain(rows))?;
    let most = ByControllers::most(modes);
    let beyond = |db: Option<f64>| db.is_some_and(|db| db > 0.0);
    writeln!(
        f,
        "  {}",
        if beyond(most.any) {
            "No controller meets the requirements."
        } else if beyond(most.modal) {
            "No controller that feeds back each mode by itself meets the requirements."
        } else {
            "This does not prove that no controller meets the requirements; none was found."
        }
    )?;
    write_grid(f, modes.iter())
}

fn levels(bound: &ModeBound) -> [String; 2] {
    let level = |found: &Option<Certificate>| match found {
        Some(found) => format!("{:.1}", found.db),
        None => "-".to_owned(),
    };
    [level(&bound.found.modal), level(&bound.found.any)]
}

fn write_grid<'a>(
    f: &mut Formatter<'_>,
    modes: impl Iterator<Item = &'a ModeBound>,
) -> fmt::Result {
    let found = modes.flat_map(|mode| [&mode.found.modal, &mode.found.any]);
    let grids = found.flatten().map(|found| found.grid_db);
    match grids.reduce(f64::max) {
        Some(most) => writeln!(
            f,
            "  A grid twice as fine changes none of these by more than {most:.2} dB."
        ),
        None => Ok(()),
    }
}

/// What all bands of a design can be.
pub(super) const BANDS: &str = "All bands at once";

/// The room that a design leaves for `what` it reaches.
pub(super) fn write_room(f: &mut Formatter<'_>, what: &str, room: &Room) -> fmt::Result {
    let db = |room: Option<f64>| room.map(|db| format!("{db:.1} dB"));
    match (db(room.modal), db(room.any)) {
        (None, None) => writeln!(f, "  {what}: no bound was found for how much lower."),
        (modal, any) => writeln!(
            f,
            "  {what} can be lower by at most {} with modal controllers of any order, {} with any controller.",
            modal.unwrap_or("(no bound found)".to_owned()),
            any.unwrap_or("(no bound found)".to_owned())
        ),
    }
}
