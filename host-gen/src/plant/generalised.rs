//! The generalised plant G of Fig. 4, in modal form, continuous and sampled.
//!
//! Inputs are the six floor accelerations and the six leg forces; outputs are
//! the feedback sensors, the performance accelerations, and the motion of the
//! machine as a rigid whole, from which the corner is read.
//!
//! The paper stacks the inputs of Eq. (6) in one order in B and in the other in
//! u; here the floor always comes first, as in Fig. 4.

use core::ops::Range;

use nalgebra::{Complex, DMatrix, DVector, Matrix6, MatrixXx6};
use shared::LEGS;

use super::partial_fractions::PlantPole;
use super::response::{Response, Terms, continuous};
use super::state_space::{INPUTS, Outputs, StateSpace};
use crate::machine::{EntryError, Feedback, Machine, MachineError, Performance};
use crate::model::beam::deformation_stiffness;
use crate::model::design_model::DesignModel;
use crate::model::multibody::{Modes, Multibody};
use crate::numeric::frequencies::pole_peaks;

/// The plant.
#[derive(Clone, Debug)]
pub struct Plant {
    /// As matrices.
    pub state_space: StateSpace,
    /// As poles.
    pub poles: Vec<PlantPole>,
    pub(super) terms: Terms,
    /// G(0) and G'(0). Accelerations far below the modes are small differences
    /// of D and the poles' parts; from here they are not.
    pub(super) slow: [DMatrix<f64>; 2],
    pub(super) sensors: usize,
    performance: usize,
    /// Floor accelerations that move the base along each rigid mode, 6×6: with
    /// these for inputs, [`Plant::whole`] is the identity at low frequency.
    pub rigid_floor: Matrix6<f64>,
}

impl Plant {
    /// The flexible machine with the sensors of `design`.
    ///
    /// # Errors
    /// Where a mode is damped exactly critically, or the eigenvalue iteration for
    /// modes coupled by dampers does not converge.
    pub fn new(
        machine: &Machine,
        model: &Multibody,
        design: &DesignModel,
    ) -> Result<Self, MachineError> {
        let modes = model.modes();
        let n = modes.squares.len();
        let shapes = &modes.shapes;
        let floor_inverse = model.floor_inverse();
        let floor = -shapes.transpose() * &model.mass * &model.ride * floor_inverse;
        let actuators = shapes.transpose() * model.elongations.transpose();

        let sensors = match design.feedback {
            Feedback::Acceleration | Feedback::Force => LEGS,
            Feedback::Both => 2 * LEGS,
        };
        let count = machine.performance.len();
        let mut out = Outputs::zeros(sensors + count + 2 * LEGS + 3, n);
        if design.feedback != Feedback::Force {
            let all = machine.accelerometers.iter().flatten();
            for (i, sensor) in all.enumerate() {
                let (relative, ride) = model.direction(machine, sensor);
                let row = relative.transpose() * shapes;
                out.acceleration.row_mut(i).copy_from(&row);
                out.floor.row_mut(i).copy_from(&(ride * floor_inverse));
            }
        }
        if design.feedback != Feedback::Acceleration {
            // σ − (EA/L)·e1, Eq. (11) with the push positive.
            let all = machine.force_sensors.iter().flatten();
            for (i, &beam) in (sensors - LEGS..).zip(all) {
                for (j, &actuator) in machine.actuators.iter().enumerate() {
                    if actuator == beam {
                        let axial = deformation_stiffness(&machine.beams[beam])[(0, 0)];
                        let row = model.elongations.row(j) * shapes * -axial;
                        out.displacement.row_mut(i).copy_from(&row);
                        out.actuators[(i, j)] = 1.0;
                    }
                }
            }
        }
        for (i, output) in machine.performance.iter().enumerate() {
            let at = sensors + i;
            match output {
                Performance::Deformation(d) => {
                    let row = model.deformation(machine, *d).transpose() * shapes;
                    out.acceleration.row_mut(at).copy_from(&row);
                }
                Performance::Acceleration(d) => {
                    let (relative, ride) = model.direction(machine, d);
                    let row = relative.transpose() * shapes;
                    out.acceleration.row_mut(at).copy_from(&row);
                    out.floor.row_mut(at).copy_from(&(ride * floor_inverse));
                }
            }
        }
        // The machine as a rigid whole: its momentum along each rigid mode,
        // whose shape in the motion of the whole is b = E_s⁻¹·S·w.
        let rigid_modes = design
            .rigid
            .elongations
            .try_inverse()
            .expect("the elongations were checked to be independent")
            * design.modal;
        let momentum = rigid_modes.transpose() * model.ride.transpose() * &model.mass;
        out.acceleration
            .rows_mut(sensors + count, LEGS)
            .copy_from(&(&momentum * shapes));
        out.floor
            .rows_mut(sensors + count, LEGS)
            .copy_from(&(&momentum * &model.ride * floor_inverse));

        let legs = sensors + count + LEGS;
        out.acceleration
            .rows_mut(legs, LEGS)
            .copy_from(&(&model.elongations * shapes));
        for axis in 0..3 {
            let (relative, ride) = model.mounts(machine, axis);
            let at = legs + LEGS + axis;
            out.acceleration
                .row_mut(at)
                .copy_from(&(relative.transpose() * shapes));
            out.floor.row_mut(at).copy_from(&(ride * floor_inverse));
        }

        let Modes {
            squares, damping, ..
        } = &modes;
        let state_space = StateSpace::new(squares, damping, &floor, &actuators, &out);
        let poles = state_space
            .poles(squares, damping)
            .map_err(|error| machine.locate(EntryError::new("", error.to_string())))?
            .ok_or_else(|| {
                machine.locate(EntryError::new(
                    "damping",
                    "a mode is damped exactly critically; change the damping a little",
                ))
            })?;
        // 1/(s² + Δ·s + Λ) is Λ⁻¹ − s·Λ⁻¹·Δ·Λ⁻¹ + …; accelerations start at s².
        let soft = DMatrix::from_diagonal(&squares.map(f64::recip));
        let mut value = DMatrix::zeros(state_space.d.nrows(), INPUTS);
        value.columns_mut(0, LEGS).copy_from(&out.floor);
        value.columns_mut(LEGS, LEGS).copy_from(&out.actuators);
        let input = state_space.b.rows(n, n);
        value += &out.displacement * &soft * input;
        let slope = -(&out.displacement * &soft * damping * &soft * input);
        Ok(Self {
            state_space,
            terms: Terms::new(&poles),
            poles,
            slow: [value, slope],
            sensors,
            performance: count,
            rigid_floor: model.floor * rigid_modes,
        })
    }

    /// The design model as matrices, its sensors only: undamped, and with force
    /// sensors that measure all of K_d·q, as section 4 of the paper assumes.
    pub fn of_design_model(design: &DesignModel) -> StateSpace {
        let s = &design.modal;
        let mut out = Outputs::zeros(LEGS, LEGS);
        match design.feedback {
            Feedback::Acceleration | Feedback::Both => out
                .acceleration
                .rows_mut(0, LEGS)
                .copy_from(&(design.sensing * s)),
            Feedback::Force => {
                let displacement = -(design.sensing * design.rigid.stiffness * s);
                out.displacement.rows_mut(0, LEGS).copy_from(&displacement);
                out.actuators.rows_mut(0, LEGS).copy_from(&design.sensing);
            }
        }
        let by_six = |m: Matrix6<f64>| MatrixXx6::from_column_slice(m.as_slice());
        StateSpace::new(
            &DVector::from_iterator(LEGS, design.omega.iter().map(|w| w * w)),
            &DMatrix::zeros(LEGS, LEGS),
            &by_six(-(s.transpose() * design.rigid.rheonomic)),
            &by_six(s.transpose()),
            &out,
        )
    }

    /// Rows of the feedback sensors: six, or of both kinds twelve,
    /// accelerometers first.
    pub fn sensors(&self) -> Range<usize> {
        0..self.sensors
    }

    /// Rows of the performance accelerations.
    pub fn performance(&self) -> Range<usize> {
        self.sensors..self.sensors + self.performance
    }

    /// Rows of the acceleration of the machine as a rigid whole, in the modal
    /// coordinates of the design model: its momentum along each rigid mode,
    /// √kg·m/s².
    pub fn whole(&self) -> Range<usize> {
        let start = self.performance().end;
        start..start + LEGS
    }

    /// Rows of the second time derivatives of the actuated legs' elongations,
    /// m/s².
    pub fn legs(&self) -> Range<usize> {
        let start = self.whole().end;
        start..start + LEGS
    }

    /// Rows of the frame's acceleration along x, y and z, m/s²: the mean over
    /// the upper ends of the actuated legs.
    pub fn frame(&self) -> Range<usize> {
        let start = self.legs().end;
        start..start + 3
    }

    /// The pole pairs as resonances: Hz and half width, Hz.
    pub fn peaks(&self) -> Vec<(f64, f64)> {
        pole_peaks(self.poles.iter().map(|pole| &pole.lambda))
    }

    /// All transfer functions at `hz`.
    pub fn response(&self, hz: f64) -> Response<'_> {
        Response {
            terms: &self.terms,
            part: continuous(&self.poles, &self.slow, hz, Complex::ONE),
            sampled: None,
            sensors: self.sensors,
        }
    }
}
