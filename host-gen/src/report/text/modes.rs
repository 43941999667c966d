//! `host-gen modes` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::{TITLE, cells, write_table};
use crate::analysis::modes::{BodyMotion, ModeAnalysis, ModeEntry};
use crate::model::energy::Kind;

/// Bodies with less of a mode's kinetic energy than this are not listed.
const LISTED: f64 = 0.01;

/// At most so many bodies are listed for a mode.
const MOST: usize = 4;

impl ModeAnalysis {
    fn write_side_by_side(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{HEAD}")?;
        for shape in self.modes.first().map_or(&[][..], |mode| &mode.shape) {
            write!(f, "   {:<36}", shape.body)?;
        }
        writeln!(f)?;
        for (i, mode) in self.modes.iter().enumerate() {
            write_mode(f, i, mode)?;
            for motion in self.motions(mode) {
                write!(f, "   ")?;
                write_motion(f, &motion)?;
            }
            writeln!(f)?;
        }
        Ok(())
    }

    /// One line for each body or beam with a large share of the kinetic energy.
    fn write_listed(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let shares = self.modes.iter().flat_map(|mode| &mode.energies.kinetic);
        let widest = shares.map(|share| share.name.chars().count()).max();
        let width = widest.unwrap_or(0).clamp(9, 18);
        writeln!(
            f,
            "{HEAD}   {:<width$} energy      x     y     z    rx    ry    rz",
            "body"
        )?;
        for (i, mode) in self.modes.iter().enumerate() {
            let motions = self.motions(mode);
            let shares = &mode.energies.kinetic;
            let mut order: Vec<usize> = (0..shares.len()).collect();
            // Shares that are equal by symmetry differ by rounding.
            order.sort_by_key(|&body| ((-1e6 * shares[body].share).round() as i64, body));
            let large = |&&body: &&usize| shares[body].share >= LISTED;
            let listed = order.iter().take(MOST).take_while(large).count();
            write_mode(f, i, mode)?;
            for (line, &body) in order[..listed].iter().enumerate() {
                if line > 0 {
                    write!(f, "{:indent$}", "", indent = HEAD.len())?;
                }
                let name: String = shares[body].name.chars().take(width).collect();
                let percent = 100.0 * shares[body].share;
                write!(f, "   {name:<width$} {percent:>4.0} %")?;
                // A beam has a share, but no one motion.
                if let Some(motion) = motions.get(body) {
                    write_motion(f, motion)?;
                }
                writeln!(f)?;
            }
            let others = &order[listed..];
            if !others.is_empty() {
                let rest: f64 = others.iter().map(|&body| shares[body].share).sum();
                let name = format!("{} more", others.len());
                let percent = 100.0 * rest;
                writeln!(
                    f,
                    "{:indent$}   {name:<width$} {percent:>4.0} %",
                    "",
                    indent = if listed == 0 { 0 } else { HEAD.len() }
                )?;
            }
        }
        Ok(())
    }

    /// The motion of each body in a mode, rotations times the machine's reach; the largest is 1.
    fn motions(&self, mode: &ModeEntry) -> Vec<Vec<f64>> {
        let scaled = |shape: &BodyMotion| -> Vec<f64> {
            let scale = |(j, x): (usize, &f64)| if j < 3 { *x } else { x * self.reach };
            shape.motion.iter().enumerate().map(scale).collect()
        };
        let mut motions: Vec<Vec<f64>> = mode.shape.iter().map(scaled).collect();
        let all = motions.iter().flatten();
        let largest = all.fold(0.0, |a: f64, x| a.max(x.abs()));
        for x in motions.iter_mut().flatten() {
            *x /= largest;
        }
        motions
    }
}

const HEAD: &str = "   #        Hz  kind            kg";

fn write_mode(f: &mut Formatter<'_>, i: usize, mode: &ModeEntry) -> fmt::Result {
    let kind = match mode.energies.kind {
        Kind::Suspension => "suspension",
        Kind::Internal => "internal",
    };
    let mass = mode.energies.modal_mass;
    let mass = match mass {
        1.0.. => format!("{mass:.1}"),
        1e-3.. => format!("{mass:.4}"),
        _ => format!("{mass:.1e}"),
    };
    write!(f, "  {:>2} {:>9.3}  {kind:<10} {mass:>7}", i + 1, mode.hz)
}

fn write_motion(f: &mut Formatter<'_>, motion: &[f64]) -> fmt::Result {
    for x in motion {
        // Adding zero turns −0.00 into 0.00.
        write!(f, "{:>6.2}", (100.0 * x).round() / 100.0 + 0.0)?;
    }
    Ok(())
}

impl Display for ModeAnalysis {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{TITLE}Modes of {}{TITLE:#}", self.machine)?;
        writeln!(
            f,
            "  Shapes: x, y, z of each centre of gravity, then rotations times {:.2} m; largest 1.",
            self.reach
        )?;
        // Two bodies fit beside each other, if nothing else has mass.
        let moving = |mode: &ModeEntry| mode.energies.kinetic.len();
        if self.modes.first().is_some_and(|mode| moving(mode) > 2) {
            self.write_listed(f)?;
        } else {
            self.write_side_by_side(f)?;
        }
        if let Some(control) = &self.control {
            write!(f, "  Design model ({}), Hz:", control.reduction)?;
            for hz in control.rigid_modes_hz {
                let decimals = if hz < 1e4 { 3 } else { 0 };
                write!(f, " {hz:.decimals$}")?;
            }
            writeln!(f)?;
        }
        if !self.leg_loads.is_empty() {
            let head = cells(["At rest", "axial force, N", "buckling load, N", ""]);
            let rows = self.leg_loads.iter().map(|load| {
                let limit = load.buckling_load;
                let buckles = limit.is_some_and(|limit| -load.axial_force > limit);
                vec![
                    load.beam.clone(),
                    format!("{:.1}", load.axial_force),
                    limit.map_or_else(|| "-".to_owned(), |limit| format!("{limit:.1}")),
                    if buckles { "buckles" } else { "" }.to_owned(),
                ]
            });
            write_table(f, 2, 1, [head].into_iter().chain(rows))?;
        }
        if self.modes.first().is_some_and(|mode| mode.hz < 0.0) {
            writeln!(
                f,
                "  The machine is unstable: a negative Hz is the growth rate of such a mode."
            )?;
        }
        Ok(())
    }
}
