//! The sampled loop: plant, delays and the law as the table has it.

use core::ops::Range;

use nalgebra::{Complex, DMatrix, Matrix6};
use shared::LEGS;

use super::sensitivity::{LoopGrid, PeakSensitivity};
use crate::control::LinearLaw;
use crate::numeric::NumericError;
use crate::numeric::eigen::eigenvalues;
use crate::numeric::frequencies::pole_peaks;
use crate::numeric::six::ComplexMatrix6;
use crate::plant::{Gain, SampledPlant};

/// A sampled plant under a law.
#[derive(Clone, Copy, Debug)]
pub struct SampledLoop<'a> {
    /// The plant.
    pub plant: &'a SampledPlant,
    /// The law.
    pub law: LinearLaw,
}

impl SampledLoop<'_> {
    /// One period of the closed loop as a matrix: the modes, the forces still
    /// to act, and the law's states.
    fn transition(&self) -> DMatrix<f64> {
        let plant = self.plant.state_space();
        let law = self.law.state_space();
        let n = plant.output.ncols();
        let delays = self.plant.seen_delay();
        let inner = n + LEGS * delays;
        let states = inner + law.a.nrows();
        let held = |age: usize| n + LEGS * (age - 1);
        // A signal is its row of coefficients on the states before the step.
        let state = |at: usize| {
            let mut rows = DMatrix::zeros(LEGS, states);
            rows.view_mut((0, at), (LEGS, LEGS)).fill_with_identity();
            rows
        };
        let sensors = 0..self.law.sensors();
        let direct = self.plant.direct();
        let mut y = direct.view((0, LEGS), (sensors.len(), LEGS)) * state(held(delays));
        let mut modes = y.columns_mut(0, n);
        modes += plant.output.rows_range(sensors);

        let mut next = DMatrix::zeros(states, states);
        let mut own = next.rows_range_mut(inner..);
        own += law.b * &y;
        let mut own = own.columns_range_mut(inner..);
        own += law.a;
        let mut force = law.d * y;
        let mut own = force.columns_range_mut(inner..);
        own += law.c;
        let mut set = |at: usize, rows: &DMatrix<f64>| next.rows_mut(at, LEGS).copy_from(rows);
        set(held(1), &force);
        for age in 2..=delays {
            set(held(age), &state(held(age - 1)));
        }
        let age = self.plant.whole_periods;
        let new = if age == 0 { force } else { state(held(age)) };
        let old = state(held(age + 1));
        let mut modes = next.rows_mut(0, n);
        modes += plant.change.after * new + plant.change.before * old;
        for (at, z, pair) in plant.blocks {
            next[(at, at)] += z.re;
            if pair {
                next[(at, at + 1)] -= z.im;
                next[(at + 1, at)] += z.im;
                next[(at + 1, at + 1)] += z.re;
            }
        }
        next
    }

    /// The closed loop's poles as continuous ones, ln(z)/T, rad/s, slowest
    /// first; poles at z = 0 are left out.
    ///
    /// # Errors
    /// Where the eigenvalue iteration does not converge.
    pub fn poles(&self) -> Result<Vec<Complex<f64>>, NumericError> {
        let mut poles: Vec<_> = eigenvalues(&self.transition())?
            .into_iter()
            .filter(|z| z.norm() > 1e-12)
            .map(|z| z.ln() / self.plant.period)
            .collect();
        poles.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
        Ok(poles)
    }

    /// The peak sensitivity from `low` Hz on of the loop with these `poles`, its
    /// modes those of `modal`, S of Eq. (17).
    pub fn peak_sensitivity(
        &self,
        modal: &Matrix6<f64>,
        low: f64,
        poles: &[Complex<f64>],
    ) -> PeakSensitivity {
        LoopGrid::new(self.plant, modal, low, &pole_peaks(poles)).peak(self.plant, &self.law)
    }

    /// The loop gain L by Hz, opened at the forces along the modes of `modal`, S of
    /// Eq. (17); the sensitivity is (1 + L)⁻¹.
    pub fn modal_loop(&self, modal: &Matrix6<f64>) -> impl Fn(f64) -> ComplexMatrix6 {
        let to_modes = modal.transpose().map(Complex::from);
        let from_modes = to_modes.try_inverse().expect("modes are independent");
        move |hz| {
            let law = self.law.response(self.plant.z(hz));
            to_modes * -(law * self.plant.response(hz).g22()) * from_modes
        }
    }

    /// Floor accelerations to `rows` of the plant's outputs at `hz`.
    pub fn close(&self, hz: f64, rows: Range<usize>) -> Gain {
        let controller = self.law.response(self.plant.z(hz));
        self.plant.response(hz).close(rows, &controller)
    }

    /// Rigid floor motion to the rigid whole at `hz`.
    pub fn transmissibility(&self, hz: f64) -> Gain {
        let plant = &self.plant.plant;
        self.close(hz, plant.whole()) * plant.rigid_floor.map(Complex::from)
    }
}
