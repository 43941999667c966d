//! Transmission zeros of the secondary path from leg forces to sensors, G22.
//!
//! At the frequency of a zero the legs can act while all sensors read zero, so the loop cannot
//! control that motion. With high gain the poles of the closed loop move to the zeros (section 5
//! of the paper). For accelerometers the zeros are the modes of the machine with its frame held.
//! For force sensors they are the modes without the axial stiffness of the legs.

use nalgebra::{Complex, DMatrix};
use shared::LEGS;

use super::state_space::StateSpace;
use crate::machine::FeedbackKind;
use crate::numeric::NumericError;
use crate::numeric::eigen::{eigenvalues, generalised_eigenvalues};

/// D is inverted only if its smallest singular value times this exceeds its scale.
const CONDITION: f64 = 1e8;

/// A finite zero of a machine is at most this many times as fast as its fastest pole. Larger
/// eigenvalues of the pencil are infinite ones with rounding errors.
const FINITE: f64 = 30.0;

/// Whether any of the zeros, rad/s, is unstable, that is, in the right half plane.
///
/// Then the machine is unstable while the sensors read zero, for example because the load of a
/// leg under gravity exceeds its lateral stiffness, and high gain makes the closed loop unstable.
pub fn grow(zeros: &[Complex<f64>]) -> bool {
    // Rounding leaves real parts of about 1e-9 of |s|.
    zeros.iter().any(|s| s.re > 1e-6 * s.norm())
}

/// The transmission zeros of G22, rad/s, in ascending order of |s|.
///
/// The first outputs of `plant` must be the sensors of `feedback`. Twelve sensors have no common
/// zeros, so with both kinds the result is the zeros of the accelerometers, then those of the
/// force sensors.
///
/// # Errors
/// [`NumericError::NotConverged`] if an eigenvalue iteration does not converge.
pub fn transmission_zeros(
    plant: &StateSpace,
    feedback: FeedbackKind,
) -> Result<Vec<Complex<f64>>, NumericError> {
    match feedback {
        FeedbackKind::Acceleration => of_six(plant, 0, true),
        FeedbackKind::Force => of_six(plant, 0, false),
        FeedbackKind::Both => {
            let accelerometers = of_six(plant, 0, true)?;
            Ok([accelerometers, of_six(plant, LEGS, false)?].concat())
        }
    }
}

/// The zeros of the six sensors from row `first` on, rad/s, in ascending order of |s|.
///
/// Six accelerometers have twelve zeros at s = 0, because they read zero for constant forces.
/// These are left out.
fn of_six(
    plant: &StateSpace,
    first: usize,
    accelerometers: bool,
) -> Result<Vec<Complex<f64>>, NumericError> {
    let b = plant.b.columns(LEGS, LEGS);
    let c = plant.c.rows(first, LEGS);
    let d = plant.d.view((first, LEGS), (LEGS, LEGS)).into_owned();
    // The size of the terms that cancel in D. If forces reach the sensors only through springs,
    // D is nothing but rounding errors. A mode without stiffness makes A singular; then use the
    // pencil.
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
