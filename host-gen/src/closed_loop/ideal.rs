//! The ideal loop of the paper: continuous, without sampling and delay.

use core::ops::Range;

use nalgebra::{Complex, DMatrix, Matrix6, Matrix6xX};
use shared::LEGS;

use super::isolation::{corner, isolation_band};
use crate::control::Gains;
use crate::machine::Target;
use crate::model::design_model::DesignModel;
use crate::numeric::NumericError;
use crate::numeric::eigen::eigenvalues;
use crate::numeric::frequencies::pole_peaks;
use crate::plant::{Control, Gain, Plant, StateSpace};

/// The ideal loop for one target.
pub struct IdealLoop {
    /// The ideal gains.
    pub gains: Gains,
    /// The poles, as [`ideal_poles`] gives them, rad/s.
    pub poles: Vec<Complex<f64>>,
    /// The corner frequency of isolation, Hz.
    pub isolation_from_hz: f64,
}

impl IdealLoop {
    /// The loop of `plant` with the gains that `target` needs on the design model.
    ///
    /// # Errors
    /// As [`ideal_poles`].
    pub fn new(plant: &Plant, model: &DesignModel, target: &Target) -> Result<Self, NumericError> {
        let gains = Gains::new(model, target);
        let poles = ideal_poles(&plant.state_space, &gains)?;
        let [low, high] = isolation_band(model, target.frequency);
        let isolation_from_hz = corner(low, high, &pole_peaks(&poles), |hz| {
            close_ideal(plant, &gains, hz, plant.whole()) * plant.rigid_floor.map(Complex::from)
        });
        Ok(Self {
            gains,
            poles,
            isolation_from_hz,
        })
    }
}

/// The ideal law C(jω) of σ = C(jω)·y at `hz`, Hz, 6×6: H_acc = −(K_a + K_v/s) of Eq. (21) or
/// H_f = −(K_P + K_I/s) of Eq. (22) at s = jω.
///
/// The unit is N per unit of the sensor.
pub fn ideal_response(gains: &Gains, hz: f64) -> Control {
    let s = Complex::new(0.0, core::f64::consts::TAU * hz);
    let c = -(gains.proportional.map(Complex::from) + gains.integral.map(|i| i / s));
    Control::from_column_slice(c.as_slice())
}

/// The gains from the floor accelerations, m/s², to the output `rows` of the plant at `hz`, Hz,
/// with the ideal law.
pub fn close_ideal(plant: &Plant, gains: &Gains, hz: f64, rows: Range<usize>) -> Gain {
    plant.response(hz).close(rows, &ideal_response(gains, hz))
}

/// The poles of a plant with the ideal law, rad/s, in ascending order of |s|. For the design model
/// this is the closed loop of Eq. (16).
///
/// The first six outputs of `plant` must be the sensors. Six poles at s = 0 are left out. They
/// belong to the integrals of the sensors, whose constants of integration have no effect on the
/// motion.
///
/// # Errors
/// [`NumericError::IllPosed`] if 1 + P·D is singular, and [`NumericError::NotConverged`] if the
/// eigenvalue iteration does not converge.
pub fn ideal_poles(plant: &StateSpace, gains: &Gains) -> Result<Vec<Complex<f64>>, NumericError> {
    let states = plant.a.nrows();
    // With Y the integral of the sensors: σ = −(P·(c·x + d·σ) + I·Y).
    let c = plant.c.rows(0, LEGS);
    let d: Matrix6<f64> = plant.d.fixed_view::<LEGS, LEGS>(0, LEGS).into_owned();
    let mut force = Matrix6xX::zeros(states + LEGS);
    force
        .columns_mut(0, states)
        .copy_from(&(-gains.proportional * c));
    force.columns_mut(states, LEGS).copy_from(&-gains.integral);
    let force = (Matrix6::identity() + gains.proportional * d)
        .lu()
        .solve(&force)
        .ok_or(NumericError::IllPosed)?;
    let mut a = DMatrix::zeros(states + LEGS, states + LEGS);
    a.view_mut((0, 0), (states, states)).copy_from(&plant.a);
    a.view_mut((states, 0), (LEGS, states)).copy_from(&c);
    let mut rows = a.rows_mut(0, states);
    rows += plant.b.columns(LEGS, LEGS) * &force;
    let mut rows = a.rows_mut(states, LEGS);
    rows += d * force;
    let mut poles = eigenvalues(&a)?;
    poles.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    Ok(poles.split_off(LEGS))
}
