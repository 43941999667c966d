//! Transmission zeros of the secondary path, leg forces to sensors (G22).
//!
//! Where the sensors read nothing whatever the forces do, the loop has no hold
//! on the machine: with high gain the closed loop's poles move onto the zeros
//! (section 5). For accelerations these are the modes of what is left when the
//! sensors stand still; for forces those without the legs' axial stiffness.

use nalgebra::{Complex, DMatrix};
use shared::LEGS;

use super::state_space::StateSpace;
use crate::machine::Feedback;
use crate::numeric::NumericError;
use crate::numeric::eigen::{eigenvalues, generalised_eigenvalues};

/// D is inverted if no direction of it is smaller than its scale by this.
const CONDITION: f64 = 1e8;

/// A finite zero of a machine lies within this many times its fastest pole;
/// what the pencil gives beyond is infinite but for rounding.
const FINITE: f64 = 30.0;

/// Whether a zero grows: what is left with the sensors held is unstable, as
/// where a leg's load under gravity outweighs its stiffness, and high gain
/// makes the closed loop so.
pub fn grow(zeros: &[Complex<f64>]) -> bool {
    // Rounding leaves real parts of 1e-9 or so of a zero's size.
    zeros.iter().any(|s| s.re > 1e-6 * s.norm())
}

/// The zeros, rad/s, slowest first. The first outputs of `plant` are the
/// sensors. Twelve sensors have none together: of both kinds, each kind's own.
///
/// # Errors
/// Where the eigenvalue iteration does not converge.
pub fn transmission_zeros(
    plant: &StateSpace,
    feedback: Feedback,
) -> Result<Vec<Complex<f64>>, NumericError> {
    match feedback {
        Feedback::Acceleration => of_six(plant, 0, true),
        Feedback::Force => of_six(plant, 0, false),
        Feedback::Both => {
            let accelerometers = of_six(plant, 0, true)?;
            Ok([accelerometers, of_six(plant, LEGS, false)?].concat())
        }
    }
}

/// The same of the six sensors from row `first` on. The twelve zeros at s = 0
/// that six accelerometers have, because nothing accelerates at rest, are left
/// out.
fn of_six(
    plant: &StateSpace,
    first: usize,
    accelerometers: bool,
) -> Result<Vec<Complex<f64>>, NumericError> {
    let b = plant.b.columns(LEGS, LEGS);
    let c = plant.c.rows(first, LEGS);
    let d = plant.d.view((first, LEGS), (LEGS, LEGS)).into_owned();
    // What D would be but for cancellation: sensors that a force reaches only
    // through springs leave nothing of it but rounding. A mode without stiffness
    // makes A singular; the pencil serves then.
    let slow = plant.a.clone().lu().solve(&b.into_owned());
    let scale = slow.map_or(f64::INFINITY, |slow| (c.abs() * slow.abs()).amax());
    let inverse = (d.singular_values().min() * CONDITION > scale)
        .then(|| d.clone().try_inverse())
        .flatten();
    let mut zeros = if let Some(inverse) = inverse {
        eigenvalues(&(&plant.a - b * inverse * c))?
    } else {
        let n = plant.a.nrows();
        let mut left = DMatrix::zeros(n + LEGS, n + LEGS);
        left.view_mut((0, 0), (n, n)).copy_from(&plant.a);
        left.view_mut((0, n), (n, LEGS)).copy_from(&b);
        left.view_mut((n, 0), (LEGS, n)).copy_from(&c);
        left.view_mut((n, n), (LEGS, LEGS)).copy_from(&d);
        let mut right = DMatrix::zeros(n + LEGS, n + LEGS);
        right.view_mut((0, 0), (n, n)).fill_with_identity();
        let fastest = eigenvalues(&plant.a)?
            .iter()
            .map(|s| s.norm())
            .fold(0.0, f64::max);
        let mut all = generalised_eigenvalues(&left, &right)?;
        all.retain(|s| s.norm() < FINITE * fastest);
        all
    };
    zeros.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    if accelerometers {
        zeros.drain(..zeros.len().min(2 * LEGS));
    }
    Ok(zeros)
}
