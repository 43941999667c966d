//! The generalised plant G of Fig. 4, continuous, in modal form.
//!
//! The inputs are the six floor accelerations and the six leg forces. The outputs are the
//! feedback sensors, the performance accelerations, the acceleration of the machine as one rigid
//! body, the legs' elongations, and the frame's acceleration.
//!
//! Eq. (6) of the paper has the inputs in one order in B and in the other in u. Here the floor
//! always comes first, as in Fig. 4.

use core::f64::consts::TAU;
use core::ops::Range;

use nalgebra::{Complex, DMatrix, DVector, Matrix6, MatrixXx6};
use shared::LEGS;

use super::partial_fractions::PlantPole;
use super::response::{Gain, Response, Terms, continuous, contour};
use super::state_space::{INPUTS, Outputs, StateSpace};
use super::tilt::FloorTilt;
use crate::machine::{
    Direction, EntryError, FeedbackKind, Load, Machine, MachineError, Performance,
};
use crate::model::design_model::DesignModel;
use crate::model::multibody::Multibody;
use crate::model::structure::Modes;
use crate::numeric::frequencies::pole_peaks;

/// The generalised plant of a flexible machine, continuous, with its rows of outputs.
#[derive(Clone, Debug)]
pub struct Plant {
    /// The plant as matrices A, B, C and D, in modal coordinates.
    pub state_space: StateSpace,
    /// The plant as partial fractions, in ascending order of |λ|.
    pub poles: Vec<PlantPole>,
    pub(super) terms: Terms,
    /// G(0) and dG/ds at s = 0. Far below the modes, accelerations would be small differences of D
    /// and the partial fractions. Counted from these values they keep their digits.
    pub(super) slow: [DMatrix<f64>; 2],
    pub(super) sensors: usize,
    performance: usize,
    /// Floor accelerations, m/s², that move the base along each mode of the design model, as
    /// columns, 6×6. With these as inputs, the rows [`Plant::whole`] are the identity at low
    /// frequency.
    pub rigid_floor: Matrix6<f64>,
    /// Floor accelerations, m/s², that the independent motions of the base make, as columns, 6×6:
    /// 1 m/s² along x, y and z, and the rotations that go with it, as [`Multibody::rigid_base`]. Of a
    /// loaded plant, its loads: the identity.
    pub base: Matrix6<f64>,
    /// What a tilt of the floor does, with gravity.
    pub(crate) tilt: Option<FloorTilt>,
    /// Whether the rotations in [`base`](Self::base) go with the rates of the translations, 1 m/s³,
    /// as waves in the ground make them.
    pub(crate) waves: bool,
}

impl Plant {
    /// The plant of a flexible machine: performance outputs of Eq. (10), and the sensors that
    /// `design` feeds back, force sensors of Eq. (11) or accelerometers of Eq. (12) or both.
    ///
    /// `model` and `design` are the models of the same machine.
    ///
    /// # Errors
    /// If a mode is exactly critically damped, or if the eigenvalue iteration for modes coupled by
    /// dampers does not converge.
    pub fn new(
        machine: &Machine,
        model: &Multibody,
        design: &DesignModel,
    ) -> Result<Self, MachineError> {
        Self::build(machine, model, design, false)
    }

    /// The plant on a floor at rest, moved by the loads of the machine: its first six inputs are the
    /// loads, N or N m, and zero beyond their number; its performance outputs are displacements, m,
    /// those of [`Plant::new`], then the motion of each load's node along or about it, m or rad.
    ///
    /// # Errors
    /// As [`Plant::new`].
    pub fn loaded(
        machine: &Machine,
        model: &Multibody,
        design: &DesignModel,
    ) -> Result<Self, MachineError> {
        Self::build(machine, model, design, true)
    }

    fn build(
        machine: &Machine,
        model: &Multibody,
        design: &DesignModel,
        loaded: bool,
    ) -> Result<Self, MachineError> {
        let modes = model.modes();
        let n = modes.squares.len();
        let shapes = &modes.shapes;
        let floor_inverse = model.floor_inverse();
        let mut floor = model.momentum(&-shapes.transpose()) * floor_inverse;
        let mut actuators = shapes.transpose() * model.elongations.transpose();

        let sensors = match design.feedback {
            FeedbackKind::Acceleration | FeedbackKind::Force => LEGS,
            FeedbackKind::Both => 2 * LEGS,
        };
        let loads = if loaded { &machine.loads[..] } else { &[] };
        let count = machine.performance.len() + loads.len();
        // Gains that the controller does not know.
        let errors = &machine.gain_errors;
        for (mut column, error) in actuators.column_iter_mut().zip(errors.actuators) {
            column *= 1.0 + error;
        }
        let mut out = Outputs::zeros(sensors + count + 2 * LEGS + 3, n);
        if design.feedback != FeedbackKind::Force {
            // Eq. (12): the absolute acceleration of a node, that is, relative to the base plus that
            // of the base.
            let all = machine.accelerometers.iter().flatten();
            for (i, sensor) in all.enumerate() {
                let (relative, ride) = model.direction(machine, sensor);
                let row = relative.transpose() * shapes;
                let gain = 1.0 + errors.sensors[0][i];
                out.acceleration.row_mut(i).copy_from(&(row * gain));
                out.floor
                    .row_mut(i)
                    .copy_from(&(ride * floor_inverse * gain));
                // Turned by θ relative to the base, it reads along d + θ×d what a − g is there:
                // −(θ×d)·g = θ·(g×d) more.
                let tilt = Direction {
                    direction: machine.gravity.cross(&sensor.direction),
                    ..sensor.clone()
                };
                let row = model.rotation(&tilt).transpose() * shapes;
                out.weight.row_mut(i).copy_from(&(row * gain));
            }
        }
        if design.feedback != FeedbackKind::Acceleration {
            // y = σ − (EA/L)·e1 − c·ė1, Eq. (11) with the damper along the leg: the whole force of
            // the leg, like σ positive if it pushes the frame away from the foot.
            let all = machine.force_sensors.iter().flatten();
            for (i, &beam) in (sensors - LEGS..).zip(all) {
                let gain = 1.0 + errors.sensors[1][i + LEGS - sensors];
                for (j, &actuator) in machine.actuators.iter().enumerate() {
                    if actuator == beam {
                        let leg = &machine.beams[beam];
                        let row = model.elongations.row(j) * shapes;
                        out.displacement
                            .row_mut(i)
                            .copy_from(&(&row * (-leg.stiffness.axial * gain)));
                        out.velocity
                            .row_mut(i)
                            .copy_from(&(row * (-leg.damper * gain)));
                        out.actuators[(i, j)] = gain * (1.0 + errors.actuators[j]);
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
        // The machine's momentum along each mode w of the design model, in which the bodies move by
        // Φ·S·w. A floor that moves as a rigid body excites it by (Φ·S)ᵀ·P.
        let moving = (&design.suspension.shapes * design.modal).transpose();
        let excited = model.momentum(&moving);
        let momentum = moving * &model.mass;
        let rigid_modes = excited.try_inverse().ok_or_else(|| {
            machine.locate(
                EntryError::new(
                    "actuators.beams",
                    "the floor does not move the machine along all six suspension modes",
                )
                .fix("choose legs that carry the machine"),
            )
        })?;
        out.acceleration
            .rows_mut(sensors + count, LEGS)
            .copy_from(&(&momentum * shapes));
        out.floor
            .rows_mut(sensors + count, LEGS)
            .copy_from(&(excited * floor_inverse));

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

        if loaded {
            floor.fill(0.0);
            out.floor.fill(0.0);
            let displaced = out.acceleration.rows(sensors, count).into_owned();
            out.displacement
                .rows_mut(sensors, count)
                .copy_from(&displaced);
            out.acceleration.rows_mut(sensors, count).fill(0.0);
            for (i, Load { at, moment }) in loads.iter().enumerate() {
                let motion = if *moment {
                    model.rotation(at)
                } else {
                    model.direction(machine, at).0
                };
                let row = motion.transpose() * shapes;
                floor.column_mut(i).copy_from(&row.transpose());
                let own = sensors + machine.performance.len() + i;
                out.displacement.row_mut(own).copy_from(&row);
            }
        }

        let Modes {
            squares, damping, ..
        } = &modes;
        let state_space = StateSpace::new(squares, damping, &floor, &actuators, &out);
        let poles = state_space
            .poles(squares, damping)
            .map_err(|error| machine.locate(EntryError::new("", error.to_string())))?
            .ok_or_else(|| {
                machine.locate(
                    EntryError::new(
                        "damping",
                        "a mode is exactly critically damped, so its two poles coincide",
                    )
                    .fix("change the damping slightly"),
                )
            })?;
        // Displacements follow 1/(s² + Δ·s + Λ) = Λ⁻¹ − s·Λ⁻¹·Δ·Λ⁻¹ + …, and velocities s·Λ⁻¹ + ….
        // Accelerations relative to the base are of order s², so they add nothing to value and
        // slope.
        let soft = DMatrix::from_diagonal(&squares.map(f64::recip));
        let mut value = DMatrix::zeros(state_space.d.nrows(), INPUTS);
        value.columns_mut(0, LEGS).copy_from(&out.floor);
        value.columns_mut(LEGS, LEGS).copy_from(&out.actuators);
        let input = state_space.b.rows(n, n);
        let displacement = &out.displacement + &out.weight;
        value += &displacement * &soft * input;
        let slope = (&out.velocity - displacement * &soft * damping) * &soft * input;
        Ok(Self {
            state_space,
            terms: Terms::new(&poles),
            poles,
            slow: [value, slope],
            sensors,
            performance: count,
            rigid_floor: model.floor * rigid_modes,
            base: if loaded {
                Matrix6::identity()
            } else {
                model.rigid_base(machine)
            },
            tilt: if loaded {
                None
            } else {
                FloorTilt::new(machine, model, &out.floor, sensors)
            },
            waves: machine.waves && !loaded,
        })
    }

    /// The design model as matrices, with its six sensors as the only outputs.
    ///
    /// It has no damping, and its force sensors measure all of K_d·q_s, as section 4 of the paper
    /// assumes. With both kinds of sensors, only the accelerometers are outputs.
    pub fn of_design_model(design: &DesignModel) -> StateSpace {
        let s = &design.modal;
        let mut out = Outputs::zeros(LEGS, LEGS);
        match design.feedback {
            FeedbackKind::Acceleration | FeedbackKind::Both => out
                .acceleration
                .rows_mut(0, LEGS)
                .copy_from(&(design.sensing * s)),
            FeedbackKind::Force => {
                let displacement = -(design.sensing * design.suspension.stiffness * s);
                out.displacement.rows_mut(0, LEGS).copy_from(&displacement);
                out.actuators.rows_mut(0, LEGS).copy_from(&design.sensing);
            }
        }
        let by_six = |m: Matrix6<f64>| MatrixXx6::from_column_slice(m.as_slice());
        StateSpace::new(
            &DVector::from_iterator(LEGS, design.omega.iter().map(|w| w * w)),
            &DMatrix::zeros(LEGS, LEGS),
            &by_six(-(s.transpose() * design.suspension.rheonomic)),
            &by_six(s.transpose()),
            &out,
        )
    }

    /// Output rows of the feedback sensors, m/s² or N: six, or with both kinds twelve, the
    /// accelerometers first.
    pub fn sensors(&self) -> Range<usize> {
        0..self.sensors
    }

    /// Output rows of the performance accelerations, m/s²; of a loaded plant, displacements.
    pub fn performance(&self) -> Range<usize> {
        self.sensors..self.sensors + self.performance
    }

    /// Output rows of the acceleration of the machine as one rigid body, √kg·m/s²: the rate of
    /// change of its momentum along each of the six modes of the design model.
    pub fn whole(&self) -> Range<usize> {
        let start = self.performance().end;
        start..start + LEGS
    }

    /// Output rows of the second time derivatives of the six legs' elongations, m/s².
    pub fn legs(&self) -> Range<usize> {
        let start = self.whole().end;
        start..start + LEGS
    }

    /// Output rows of the frame's absolute acceleration along x, y and z, m/s²: the mean over the
    /// legs' ends that are not on the base.
    pub fn frame(&self) -> Range<usize> {
        let start = self.legs().end;
        start..start + 3
    }

    /// The resonances, as centre and half width, Hz, for a frequency grid.
    pub fn peaks(&self) -> Vec<(f64, f64)> {
        pole_peaks(self.poles.iter().map(|pole| &pole.lambda))
    }

    /// The frequency response of the continuous plant at `hz`, Hz. At an undamped pole it is that
    /// a little beside it: for the plant without control there, see [`open`](Self::open).
    pub fn response(&self, hz: f64) -> Response<'_> {
        let (s, at_pole) = contour(&self.poles, hz);
        Response {
            terms: &self.terms,
            part: continuous(&self.poles, &self.slow, s, Complex::ONE),
            sampled: None,
            tilt: self.tilt.as_ref().map(|tilt| (tilt, s)),
            sensors: self.sensors,
            at_pole,
        }
    }

    /// [`base`](Self::base) for motions of 1 m/s² at `hz`, Hz.
    pub(crate) fn base_at(&self, hz: f64) -> Matrix6<f64> {
        let mut base = self.base;
        if self.waves {
            let mut rotations = base.columns_mut(3, 3);
            rotations *= TAU * hz;
        }
        base
    }

    /// The gains from the first six inputs to the output `rows` at rest, at 0 Hz, without control.
    pub fn at_rest(&self, rows: Range<usize>) -> MatrixXx6<f64> {
        let value = self.slow[0].fixed_columns::<LEGS>(0);
        value.rows_range(rows).into_owned()
    }

    /// The gains from the floor accelerations, m/s², to the output `rows` at `hz`, Hz, without
    /// control: infinite where an undamped mode resonates.
    pub fn open(&self, hz: f64, rows: Range<usize>) -> Gain {
        let response = self.response(hz);
        let gain = response.from_floor(rows.clone());
        if !response.at_pole {
            return gain;
        }
        let beside = self.response(hz * (1.0 + ASIDE)).from_floor(rows);
        gain.zip_map(&beside, |at, beside| {
            if at.norm() > RESONATES * beside.norm() {
                Complex::from(f64::INFINITY)
            } else {
                at
            }
        })
    }
}

/// A mode resonates in an output if the gain at its frequency is [`RESONATES`] times that at this
/// part beside it; a resonance without damping makes 1e4.
const ASIDE: f64 = 1e-3;
const RESONATES: f64 = 1e3;
