//! `host-gen compare` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::write_table;
use super::compliance::short;
use crate::analysis::compare::{MachineColumn, MachineComparison, OwnCompliance};
use crate::design::{Band, Design, DesignError, NoDesign};

/// One of a band's levels, dB.
type Level = fn(&Band) -> f64;

/// What stands in the place of a design's figures.
fn without(reason: &NoDesign) -> &'static str {
    match reason {
        NoDesign::Failed(DesignError::Unreachable { .. }) => "unreachable",
        NoDesign::Failed(DesignError::Falls { .. }) => "falls",
        _ => "no design",
    }
}

/// The items, each once, in the order in which they first come.
fn each_once<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    items.fold(Vec::new(), |mut all, item| {
        if !all.contains(&item) {
            all.push(item);
        }
        all
    })
}

impl Display for MachineComparison {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mut rows = Vec::new();
        let line =
            |rows: &mut Vec<Vec<String>>, title: &str, cell: &dyn Fn(&MachineColumn) -> String| {
                let title = [title.to_owned()].into_iter();
                rows.push(title.chain(self.machines.iter().map(cell)).collect());
            };
        line(&mut rows, "", &|c| c.machine.clone());
        line(&mut rows, "feedback", &|c| c.feedback.to_owned());
        let list = |rows: &mut Vec<_>, title: &str, of: &dyn Fn(&MachineColumn) -> &[f64]| {
            let longest = self.machines.iter().map(|c| of(c).len()).max();
            for i in 0..longest.unwrap_or(0) {
                let title = if i == 0 { title } else { "" };
                line(rows, title, &|c| {
                    of(c).get(i).map_or_else(String::new, |x| format!("{x:.3}"))
                });
            }
        };
        list(&mut rows, "suspension modes, Hz", &|c| &c.suspension_hz);
        list(&mut rows, "internal modes, Hz", &|c| &c.internal_hz);
        list(&mut rows, "design model, Hz", &|c| &c.rigid_modes_hz);
        list(&mut rows, "zeros, acceleration feedback, Hz", &|c| {
            &c.acceleration_zeros_hz
        });
        list(&mut rows, "zeros, force feedback, Hz", &|c| {
            &c.force_zeros_hz
        });
        line(&mut rows, "largest proportional gain", &|c| {
            format!("{:.4e}", c.largest_gain)
        });
        let of_loop = |c: &MachineColumn, cell: &dyn Fn(&Design) -> String| {
            c.shaped
                .as_ref()
                .map_or_else(|reason| without(reason).to_owned(), cell)
        };
        line(&mut rows, "peak sensitivity", &|c| {
            of_loop(c, &|r| format!("{:.3}", r.peak_sensitivity.value))
        });
        line(&mut rows, "isolates from, Hz", &|c| {
            of_loop(c, &|r| format!("{:.2}", r.isolation_from_hz))
        });
        line(&mut rows, "the same, ideal loop, Hz", &|c| {
            of_loop(c, &|r| format!("{:.2}", r.isolation_from_ideal_hz))
        });
        let bands = self.machines.iter().filter_map(|c| c.shaped.as_ref().ok());
        let names = bands.flat_map(|r| r.bands.iter().map(|band| &band.name));
        for name in each_once(names) {
            let values: [(&str, Level); 3] = [
                ("open", |band| band.open_db),
                ("ideal", |band| band.ideal_db),
                ("sampled", |band| band.sampled_db),
            ];
            for (what, value) in values {
                line(
                    &mut rows,
                    &format!("σ_max(G11), {name}, {what}, dB"),
                    &|c| {
                        of_loop(c, &|r| {
                            let band = r.bands.iter().find(|band| band.name == *name);
                            band.map_or_else(String::new, |band| format!("{:.1}", value(band)))
                        })
                    },
                );
            }
        }
        let loads = each_once(
            self.machines
                .iter()
                .flat_map(|c| &c.compliance)
                .map(|own| (&own.load[..], own.unit)),
        );
        for (load, unit) in loads {
            let own = |c: &MachineColumn, cell: &dyn Fn(&OwnCompliance) -> String| {
                let own = c
                    .compliance
                    .iter()
                    .find(|own| own.load == load && own.unit == unit);
                own.map_or_else(String::new, cell)
            };
            let title = |what: &str| format!("compliance to {load}, {what}, {unit}");
            line(&mut rows, &title("at rest"), &|c| {
                own(c, &|own| short(own.at_rest))
            });
            line(&mut rows, &title("highest, open"), &|c| {
                own(c, &|own| short(own.open_highest.magnitude))
            });
            line(&mut rows, &title("highest, closed"), &|c| {
                own(c, &|own| {
                    of_loop(c, &|_| {
                        own.closed_highest
                            .map_or_else(String::new, |x| short(x.magnitude))
                    })
                })
            });
        }
        let mut marked = false;
        // The first row has the names.
        for row in rows.iter_mut().skip(1) {
            if row[1..].iter().any(|cell| *cell != row[1]) {
                row.push("≠".to_owned());
                marked = true;
            }
        }
        write_table(f, 0, 1, rows)?;
        if marked {
            writeln!(f, "≠  not equal for all machines")?;
        }
        Ok(())
    }
}
