//! What a tilt of the floor does to a machine that has weight.

use core::ops::Range;

use nalgebra::{Complex, Matrix3, Matrix6, MatrixXx6, Vector6};

use super::response::Gain;
use crate::machine::Machine;
use crate::model::multibody::Multibody;

/// The tilt of the floor against gravity.
///
/// A base that is turned by θ stands in gravity g − θ×g, seen from the base. For the machine, and
/// for accelerometers, which read a − g, that is a floor with the acceleration θ×g more. The outputs
/// that are no sensors are accelerations in space and do not have it.
#[derive(Clone, Debug)]
pub(crate) struct FloorTilt {
    /// θ×g as floor accelerations, m/s², from the floor inputs that make θ, m, 6×6, 1/s².
    equivalent: Matrix6<f64>,
    /// The part of the outputs that moves with the floor, from the floor accelerations; zero for
    /// sensors.
    ride: MatrixXx6<f64>,
}

impl FloorTilt {
    /// The tilt of the floor of `machine`, whose first outputs are this many `sensors`. `ride` is
    /// the part of all outputs that moves with the floor. `None` without gravity.
    pub(super) fn new(
        machine: &Machine,
        model: &Multibody,
        ride: &MatrixXx6<f64>,
        sensors: usize,
    ) -> Option<Self> {
        if machine.gravity.norm() == 0.0 {
            return None;
        }
        let mut accelerated = Matrix6::zeros();
        accelerated
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-Matrix3::from(machine.gravity.cross_matrix()));
        let mut ride = ride.clone();
        ride.rows_mut(0, sensors).fill(0.0);
        Some(Self {
            equivalent: model.floor * accelerated * model.floor_inverse(),
            ride,
        })
    }

    /// The gains from the floor accelerations to the output `rows` at `s`, rad/s, where `gain` are
    /// those without tilt.
    pub(super) fn add(&self, gain: Gain, rows: Range<usize>, s: Complex<f64>) -> Gain {
        let ride = self.ride.rows_range(rows).map(Complex::from);
        let tilt = self.equivalent.map(Complex::from) / (s * s);
        let more = (&gain - ride) * tilt;
        gain + more
    }

    /// The floor accelerations, m/s², that are equivalent to the tilt of `floor` inputs, m.
    pub(crate) fn equivalent(&self, floor: Vector6<f64>) -> Vector6<f64> {
        self.equivalent * floor
    }

    /// The part of the output `rows` that moves with the floor, from the floor accelerations.
    pub(crate) fn ride(&self, rows: Range<usize>) -> MatrixXx6<f64> {
        self.ride.rows_range(rows).into_owned()
    }
}
