//! The sampled loop: the sampled plant, the delay, and the law of a table.

use core::ops::Range;

use nalgebra::{Complex, DMatrix, Matrix6};
use rayon::prelude::*;
use shared::LEGS;
use shared::table::ValidTable;

use super::poles::stable;
use super::sensitivity::{LoopGrid, PeakSensitivity};
use crate::control::LinearLaw;
use crate::numeric::NumericError;
use crate::numeric::eigen::eigenvalues;
use crate::numeric::frequencies::pole_peaks;
use crate::numeric::six::ComplexMatrix6;
use crate::plant::{Gain, SampledPlant};

/// The closed loop of a sampled plant and the linear law of a table.
#[derive(Clone, Copy, Debug)]
pub struct SampledLoop<'a> {
    /// The sampled plant.
    pub plant: &'a SampledPlant,
    /// The law, with the table's coefficients.
    pub law: LinearLaw,
}

impl<'a> SampledLoop<'a> {
    /// The plant with the law of `table`.
    pub fn new(plant: &'a SampledPlant, table: &ValidTable) -> Self {
        Self {
            plant,
            law: LinearLaw::new(table),
        }
    }
}

impl SampledLoop<'_> {
    /// The transition matrix of the closed loop over one period.
    ///
    /// Its states are those of [`SampledPlant::discrete`] and those of the law.
    fn transition(&self) -> DMatrix<f64> {
        let plant = self.plant.discrete();
        let law = self.law.state_space();
        let inner = plant.a.nrows();
        let states = inner + law.a.nrows();
        let sensed = plant.c.rows_range(0..self.law.sensors());
        let by_force = plant.b.columns(LEGS, LEGS);
        let mut next = DMatrix::zeros(states, states);
        let mut set = |at: (usize, usize), block: DMatrix<f64>| {
            next.view_mut(at, block.shape()).copy_from(&block);
        };
        set((0, 0), &plant.a + by_force * (&law.d * sensed));
        set((0, inner), by_force * &law.c);
        set((inner, 0), &law.b * sensed);
        set((inner, inner), law.a);
        next
    }

    /// The poles of the closed loop as continuous poles ln(z)/T, rad/s, in ascending order of
    /// magnitude. Poles at z = 0 are left out.
    ///
    /// # Errors
    /// [`NumericError::NotConverged`] if the eigenvalue iteration does not converge.
    pub fn poles(&self) -> Result<Vec<Complex<f64>>, NumericError> {
        let mut poles: Vec<_> = eigenvalues(&self.transition())?
            .into_iter()
            .filter(|z| z.norm() > 1e-12)
            .map(|z| z.ln() / self.plant.period)
            .collect();
        poles.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
        Ok(poles)
    }

    /// Whether the loop is stable with each of these `gains` on the law's forces.
    pub fn is_stable_with(&self, gains: &[f64]) -> bool {
        gains.par_iter().all(|&gain| {
            let scaled = SampledLoop {
                plant: self.plant,
                law: self.law.with_gain(gain),
            };
            scaled.poles().is_ok_and(|poles| stable(&poles))
        })
    }

    /// The peak sensitivity of the loop from `low`, Hz, to half the sample rate.
    ///
    /// `modal` is S of Eq. (17), the modes at which the loop is opened. `poles` are those of this
    /// loop, rad/s; the frequency grid is refined at them.
    pub fn peak_sensitivity(
        &self,
        modal: &Matrix6<f64>,
        low: f64,
        poles: &[Complex<f64>],
    ) -> PeakSensitivity {
        LoopGrid::new(self.plant, modal, low, &pole_peaks(poles)).peak(self.plant, &self.law)
    }

    /// The loop gain L as a function of frequency, Hz, 6×6, with the loop opened at the modal
    /// forces. The sensitivity is (1 + L)⁻¹.
    ///
    /// `modal` is S of Eq. (17).
    pub fn modal_loop(&self, modal: &Matrix6<f64>) -> impl Fn(f64) -> ComplexMatrix6 {
        let to_modes = modal.transpose().map(Complex::from);
        let from_modes = to_modes.try_inverse().expect("modes are independent");
        move |hz| {
            let law = self.law.response(self.plant.z(hz));
            to_modes * -(law * self.plant.response(hz).g22()) * from_modes
        }
    }

    /// The closed loop's gains from the floor accelerations, m/s², to the output `rows` of the
    /// plant at `hz`, Hz.
    pub fn close(&self, hz: f64, rows: Range<usize>) -> Gain {
        let controller = self.law.response(self.plant.z(hz));
        self.plant.response(hz).close(rows, &controller)
    }

    /// The closed loop's gains from rigid floor motion to the machine as one rigid body at `hz`,
    /// Hz, 6×6, both in the modes of the design model; the identity at low frequency.
    pub fn transmissibility(&self, hz: f64) -> Gain {
        let plant = &self.plant.plant;
        self.close(hz, plant.whole()) * plant.rigid_floor.map(Complex::from)
    }
}
