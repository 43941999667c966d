//! The path of a law straight through: from the newest sample to the forces.

use super::{Law, Modal, Paths};
use crate::LEGS;

/// The forces of the legs per unit of the newest sensor values, at full gain and with all else
/// at rest, N per sensor unit: the product of all gains and first coefficients of a [`Law`].
/// Columns are sensors: `sensors[sensor][leg]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectPath {
    /// From the table's sensors.
    pub sensors: [[f32; LEGS]; LEGS],
    /// From the force sensors of a [`Complement`](super::Complement); zero without one.
    pub forces: [[f32; LEGS]; LEGS],
}

impl DirectPath {
    /// The direct path of a law.
    pub const fn new(law: &Law) -> Self {
        let zero = [[0.0; LEGS]; LEGS];
        match &law.paths {
            Paths::Direct(direct) => {
                let mut sensors = zero;
                // `while`, because `for` is not const.
                let mut k = 0;
                while k < LEGS * LEGS {
                    let (i, j) = (k % LEGS, k / LEGS);
                    let gain = direct.integral.data.0[j][i] + direct.proportional.data.0[j][i];
                    sensors[j][i] = -gain * direct.roll_off;
                    k += 1;
                }
                Self {
                    sensors,
                    forces: zero,
                }
            }
            Paths::Modal(modal) => {
                let Some(complement) = &modal.complement else {
                    let sensors = modal.through(&modal.input.data.0, &[1.0; LEGS]);
                    return Self {
                        sensors,
                        forces: zero,
                    };
                };
                let mut rest = [0.0; LEGS];
                let mut i = 0;
                while i < LEGS {
                    rest[i] = 1.0 - complement.split[i];
                    i += 1;
                }
                Self {
                    sensors: modal.through(&modal.input.data.0, &complement.split),
                    forces: modal.through(&complement.input.data.0, &rest),
                }
            }
        }
    }
}

impl Modal {
    /// From sensors through `input`, with a factor on each mode, to the legs.
    const fn through(
        &self,
        input: &[[f32; LEGS]; LEGS],
        factors: &[f32; LEGS],
    ) -> [[f32; LEGS]; LEGS] {
        let mut gains = [0.0; LEGS];
        let mut mode = 0;
        while mode < LEGS {
            let channel = &self.channels[mode];
            let mut gain = -(channel.integral + channel.proportional) * factors[mode];
            let mut j = 0;
            while j < self.sections && j < channel.sections.len() {
                gain *= channel.sections[j].direct;
                j += 1;
            }
            gains[mode] = gain;
            mode += 1;
        }
        let mut path = [[0.0; LEGS]; LEGS];
        let mut k = 0;
        while k < LEGS * LEGS * LEGS {
            let (leg, sensor, mode) = (k % LEGS, k / LEGS % LEGS, k / LEGS / LEGS);
            path[sensor][leg] +=
                self.output.data.0[mode][leg] * (gains[mode] * input[sensor][mode]);
            k += 1;
        }
        path
    }
}
