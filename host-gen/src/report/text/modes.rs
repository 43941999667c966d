//! `host-gen modes` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::{TITLE, cells, write_table};
use crate::analysis::modes::ModeAnalysis;
use crate::model::energy::Kind;

impl Display for ModeAnalysis {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{TITLE}Modes of {}{TITLE:#}", self.machine)?;
        writeln!(
            f,
            "  Shapes: x, y, z of each centre of gravity, then rotations times {:.2} m; largest 1.",
            self.reach
        )?;
        write!(f, "   #        Hz  {:<10} {:>7}", "kind", "kg")?;
        for shape in self.modes.first().map_or(&[][..], |mode| &mode.shape) {
            write!(f, "   {:<36}", shape.body)?;
        }
        writeln!(f)?;
        for (i, mode) in self.modes.iter().enumerate() {
            let kind = match mode.energies.kind {
                Kind::Suspension => "suspension",
                Kind::Internal => "internal",
            };
            let mass = mode.energies.modal_mass;
            write!(f, "  {:>2} {:>9.3}  {kind:<10} {mass:>7.1}", i + 1, mode.hz)?;
            let scaled = |motion: &[f64]| -> Vec<f64> {
                let scale = |(j, x): (usize, &f64)| if j < 3 { *x } else { x * self.reach };
                motion.iter().enumerate().map(scale).collect()
            };
            let largest = mode
                .shape
                .iter()
                .flat_map(|shape| scaled(&shape.motion))
                .fold(0.0, |a: f64, x| a.max(x.abs()));
            for shape in &mode.shape {
                write!(f, "   ")?;
                for x in scaled(&shape.motion) {
                    // Adding zero turns −0.00 into 0.00.
                    write!(f, "{:>6.2}", (100.0 * x / largest).round() / 100.0 + 0.0)?;
                }
            }
            writeln!(f)?;
        }
        write!(f, "  Design model ({}), Hz:", self.reduction)?;
        for hz in self.rigid_modes_hz {
            write!(f, " {hz:.3}")?;
        }
        writeln!(f)?;
        if !self.leg_loads.is_empty() {
            let head = cells(["Under gravity", "axial force, N", "buckling load, N", ""]);
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
                "  Under gravity the machine is unstable: a negative Hz is the growth rate of such a mode."
            )?;
        }
        Ok(())
    }
}
