//! `host-gen zeros` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::{TITLE, WARNING};
use crate::analysis::zeros::ZeroAnalysis;

impl Display for ZeroAnalysis {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Transmission zeros of {}, leg forces to sensors (G22){TITLE:#}",
            self.machine
        )?;
        writeln!(
            f,
            "  High gain moves the poles of the closed loop to them: there the loop cannot act."
        )?;
        for kind in &self.kinds {
            writeln!(f, "  {} feedback", kind.feedback)?;
            writeln!(
                f,
                "            Hz     damping   nearest pole of the ideal loop, Hz"
            )?;
            for zero in &kind.zeros {
                let nearest = zero.nearest_closed_loop_hz.unwrap_or(f64::NAN);
                writeln!(
                    f,
                    "    {:>10.3}  {:>10.4}   {nearest:>10.3}",
                    zero.at.hz, zero.at.damping
                )?;
            }
            if kind.unstable {
                let cause = if kind.by_weight {
                    "With the sensor outputs held at zero, the machine is unstable:\n    its stiffness under gravity is negative."
                } else if kind.by_springs {
                    "With the sensor outputs held at zero, the machine is unstable:\n    the negative stiffness of its springs is too large."
                } else {
                    "It is so without gravity, too:\n    the sensors are not where the legs act."
                };
                writeln!(
                    f,
                    "    {WARNING}Warning:{WARNING:#} a zero is unstable. {cause} High gain of this kind makes the loop unstable."
                )?;
            }
        }
        Ok(())
    }
}
