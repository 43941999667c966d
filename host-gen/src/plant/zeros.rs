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
use crate::numeric::pencil::finite_eigenvalues;

/// Whether any of the zeros, rad/s, is unstable, that is, in the right half plane.
///
/// Then the machine is unstable while the sensors read zero, for example because the load of a
/// leg under gravity exceeds its lateral stiffness, or because the sensors are away from the legs.
/// High gain makes the closed loop unstable.
pub fn grow(zeros: &[Complex<f64>]) -> bool {
    // Rounding leaves real parts of about 1e-9 of |s|; zeros at s = 0 are exactly there.
    zeros.iter().any(|s| s.re > 1e-6 * s.norm())
}

/// The transmission zeros of G22, rad/s, in ascending order of |s|.
///
/// The first outputs of `plant` must be the sensors of `feedback`. Twelve sensors have no common
/// zeros, so with both kinds the result is the zeros of the accelerometers, then those of the
/// force sensors.
///
/// Zeros at s = 0 are exactly zero: those of a machine that is free while its sensors read zero.
///
/// # Errors
/// [`NumericError::NotConverged`] if an eigenvalue iteration does not converge, and
/// [`NumericError::Singular`] if the legs do not reach the sensors at any frequency.
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

/// Slowest mode that has its own unit of displacement, as a part of the fastest: a mode without
/// stiffness has none.
const SLOW: f64 = 1e-6;

/// The least part of a reading at rest that is none by rounding.
const AT_REST: f64 = 1e-10;

/// Whether the six sensors from row `first` on read constant forces, as accelerometers do that tilt
/// under gravity. No mode may be without stiffness.
fn reads_at_rest(plant: &StateSpace, first: usize) -> bool {
    let modes = plant.a.nrows() / 2;
    let mut sum = plant.d.view((first, LEGS), (LEGS, LEGS)).into_owned();
    let mut size = sum.abs();
    for k in 0..modes {
        let square = plant.a[(modes + k, k)];
        let own = plant.c.view((first, k), (LEGS, 1)) / square
            * plant.b.view((modes + k, LEGS), (1, LEGS));
        sum -= &own;
        size += own.abs();
    }
    sum.iter()
        .zip(&size)
        .any(|(x, size)| x.abs() > AT_REST * size)
}

/// The zeros of the six sensors from row `first` on, rad/s, in ascending order of |s|.
///
/// Six accelerometers have twelve zeros at s = 0, because they read zero for constant forces.
/// These are left out. On one rigid body it is twelve also where they read the weight as they tilt:
/// while the vertical ones read zero it does not tilt.
fn of_six(
    plant: &StateSpace,
    first: usize,
    accelerometers: bool,
) -> Result<Vec<Complex<f64>>, NumericError> {
    let states = plant.a.nrows();
    let modes = states / 2;
    let size = states + LEGS;
    // Units in which all entries are about 1, so that ranks show: time by the fastest mode, each
    // mode's displacement by its own frequency, forces and sensors each by their largest effect.
    let own = |k: usize| plant.a[(modes + k, k)].abs().sqrt();
    let fastest = (0..modes).map(own).fold(0.0, f64::max);
    let mut f = DMatrix::zeros(size, size);
    f.view_mut((0, 0), (states, states)).copy_from(&plant.a);
    f.view_mut((0, states), (states, LEGS))
        .copy_from(&plant.b.columns(LEGS, LEGS));
    let stiff = (0..modes).all(|k| own(k) > SLOW * fastest);
    let positions = accelerometers && stiff && !reads_at_rest(plant, first);
    if positions {
        // Accelerometers read z̈ = −Λ·z − … at rest: their positions have the same zeros but for
        // the twelve at s = 0.
        for k in 0..modes {
            let square = plant.a[(modes + k, k)];
            let column = plant.c.view((first, k), (LEGS, 1)) / square;
            f.view_mut((states, k), (LEGS, 1)).copy_from(&column);
        }
    } else {
        f.view_mut((states, 0), (LEGS, states))
            .copy_from(&plant.c.rows(first, LEGS));
        f.view_mut((states, states), (LEGS, LEGS))
            .copy_from(&plant.d.view((first, LEGS), (LEGS, LEGS)));
    }
    f.rows_mut(0, states).unscale_mut(fastest);
    for k in 0..modes {
        let own = own(k).max(SLOW * fastest);
        f.row_mut(k).scale_mut(own);
        f.column_mut(k).unscale_mut(own);
    }
    for leg in 0..LEGS {
        let largest = f.view((0, states + leg), (states, 1)).amax();
        f.column_mut(states + leg).unscale_mut(largest);
    }
    for sensor in 0..LEGS {
        let largest = f.row(states + sensor).amax();
        f.row_mut(states + sensor).unscale_mut(largest);
    }
    let mut e = DMatrix::zeros(size, size);
    e.view_mut((0, 0), (states, states)).fill_with_identity();
    let finite = finite_eigenvalues(e, f)?;
    let at_zero = if accelerometers && !positions {
        finite.at_zero.saturating_sub(2 * LEGS)
    } else {
        finite.at_zero
    };
    let mut zeros: Vec<_> = finite.others.into_iter().map(|s| s * fastest).collect();
    zeros.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    zeros.splice(0..0, vec![Complex::ZERO; at_zero]);
    Ok(zeros)
}
