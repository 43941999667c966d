//! The gains of section 4 of the paper, on the rigid design model.

use core::ops::Range;

use nalgebra::{Complex, DMatrix, DVector, Matrix6, Matrix6xX};
use shared::LEGS;

use crate::linear::{eigenvalues, generalised_eigen};
use crate::machine::{EntryError, Feedback, Machine, MachineError, Target};
use crate::multibody::{Multibody, RigidModel, dependent, reach, to_dynamic, to_six};
use crate::plant::StateSpace;

/// A proportional-integral law, σ = −(P·y + I·∫y), rows actuators, columns
/// sensors: Eqs. (14), (21), (22).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// K_a, N/(m/s²), or K_P.
    pub proportional: Matrix6<f64>,
    /// K_v, N/(m/s), or K_I, 1/s.
    pub integral: Matrix6<f64>,
}

/// The design model with what the gains are made of.
#[derive(Clone, Debug)]
pub struct Design {
    /// All bodies as one.
    pub rigid: RigidModel,
    /// Its modes, rad/s, ascending.
    pub omega: [f64; LEGS],
    /// S = M_d^(−1/2)·P of Eq. (17): SᵀM_dS = 1, SᵀK_dS = diag(ω²).
    pub modal: Matrix6<f64>,
    /// T_c of Eq. (15): sensor positions from q_s. For force sensors alone the
    /// order of the channels only.
    pub sensing: Matrix6<f64>,
    /// The order of the force sensors beside accelerometers, where there are
    /// any.
    pub beside: Option<Matrix6<f64>>,
    /// What is fed back.
    pub feedback: Feedback,
}

impl Design {
    /// The design model of `machine` with the sensors of `feedback`.
    ///
    /// # Errors
    /// Where actuators or sensors do not fix six degrees of freedom, or there
    /// are no such sensors.
    pub fn new(
        machine: &Machine,
        model: &Multibody,
        feedback: Feedback,
    ) -> Result<Self, MachineError> {
        let rigid = RigidModel::new(machine, model)?;
        let (squares, mut shapes) =
            generalised_eigen(&to_dynamic(&rigid.stiffness), &to_dynamic(&rigid.mass))
                .expect("the lumped mass is positive definite because every body's is");
        canonical(&squares, &mut shapes);
        let sensing = match feedback {
            Feedback::Acceleration | Feedback::Both => {
                acceleration_sensing(machine, model, &rigid)?
            }
            Feedback::Force => force_sensing(machine)?,
        };
        let beside = match feedback {
            Feedback::Both => Some(force_sensing(machine)?),
            Feedback::Acceleration | Feedback::Force => None,
        };
        Ok(Self {
            omega: core::array::from_fn(|i| squares[i].max(0.0).sqrt()),
            modal: to_six(&shapes),
            rigid,
            sensing,
            beside,
            feedback,
        })
    }

    /// The modes of the design model, Hz.
    pub fn hertz(&self) -> [f64; LEGS] {
        self.omega.map(|w| w / core::f64::consts::TAU)
    }

    /// The gains that put all six modes of the design model at ω_n with
    /// damping ζ_n.
    ///
    /// Accelerations, Eqs. (19) and (20): K'_a = K_d/ω_n² − M_d,
    /// K'_v = 2ζ_n·ω_n·(K'_a + M_d), both times T_c⁻¹.
    ///
    /// Forces, Eq. (22): K_P = K_d·(ω_n²·M_d)⁻¹ − 1, K_I = 2ζ_n·ω_n·(1 + K_P).
    /// The paper prints the product the other way round. With y = σ − K_d·q
    /// the loop gives M_d·q̈ = −(1 + K_P)⁻¹·K_d·q, which is −ω_n²·M_d·q only in
    /// this order; the two agree where K_d and M_d commute, as they do for six
    /// equal legs without bending stiffness.
    ///
    /// Of both kinds, the accelerations'.
    pub fn gains(&self, target: &Target) -> Gains {
        let omega = target.omega();
        let RigidModel {
            mass, stiffness, ..
        } = &self.rigid;
        let (proportional, integral) = match self.feedback {
            Feedback::Acceleration | Feedback::Both => {
                let virtual_mass = stiffness / (omega * omega) - mass;
                let damping = (virtual_mass + mass) * (2.0 * target.damping * omega);
                (virtual_mass, damping)
            }
            Feedback::Force => {
                let inverse = (mass * (omega * omega))
                    .try_inverse()
                    .expect("the lumped mass is positive definite because every body's is");
                let whole = stiffness * inverse;
                (
                    whole - Matrix6::identity(),
                    whole * (2.0 * target.damping * omega),
                )
            }
        };
        let unsense = self
            .sensing
            .try_inverse()
            .expect("the sensors were checked to be independent");
        Gains {
            proportional: proportional * unsense,
            integral: integral * unsense,
        }
    }
}

/// Sensors to modes and modes to legs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModalTransform {
    /// T_in. Accelerations: S⁻¹·T_c⁻¹, to √kg·m/s². Forces: Sᵀ in the sensors'
    /// order, to N/√kg.
    pub input: Matrix6<f64>,
    /// Sᵀ for the force sensors beside accelerometers.
    pub beside: Option<Matrix6<f64>>,
    /// T_out = S⁻ᵀ, from N/√kg to N.
    pub output: Matrix6<f64>,
}

impl Design {
    /// The coordinates in which the gains of [`Design::gains`] are diagonal:
    /// with K'_a = S⁻ᵀ·(Ω²/ω_n² − 1)·S⁻¹ and K_P = S⁻ᵀ·(Ω²/ω_n² − 1)·Sᵀ, both
    /// kinds have ω_k²/ω_n² − 1 and 2ζ_n·ω_k²/ω_n there.
    pub fn transform(&self) -> ModalTransform {
        let inverse = self.modal.try_inverse().expect("modes are independent");
        let unsense = self
            .sensing
            .try_inverse()
            .expect("the sensors were checked to be independent");
        let to_modes = match self.feedback {
            Feedback::Acceleration | Feedback::Both => inverse,
            Feedback::Force => self.modal.transpose(),
        };
        // What symmetry makes zero is zero, and the same on every processor.
        let clean = |m: Matrix6<f64>| {
            let smallest = 1e-12 * m.amax();
            m.map(|x| if x.abs() < smallest { 0.0 } else { x })
        };
        ModalTransform {
            input: clean(to_modes * unsense),
            // An order of channels has its transpose for its inverse.
            beside: self
                .beside
                .map(|order| clean(self.modal.transpose() * order.transpose())),
            output: clean(inverse.transpose()),
        }
    }
}

/// Modes nearer than this part of each other count as one.
const ALIKE: f64 = 1e-6;

/// Modes of one frequency, by their ω², ascending.
pub(crate) fn alike(squares: &[f64]) -> Vec<Range<usize>> {
    let mut groups: Vec<Range<usize>> = Vec::new();
    for (i, square) in squares.iter().enumerate() {
        match groups.last_mut() {
            Some(group) if (square / squares[group.start]).sqrt() - 1.0 < ALIKE => group.end += 1,
            _ => groups.push(i..i + 1),
        }
    }
    groups
}

/// Turns the shapes of equal modes, which are only known up to a rotation, and
/// all signs to the same ones on every processor: the first row that is as long
/// as any gets one entry, a positive one, and so on with the columns left.
fn canonical(squares: &DVector<f64>, shapes: &mut DMatrix<f64>) {
    let n = squares.len();
    for Range { start, end } in alike(squares.as_slice()) {
        for column in start..end {
            let length = |row: usize| shapes.view((row, column), (1, end - column)).norm();
            let longest = (0..n).map(length).fold(0.0, f64::max);
            // Rows that symmetry makes equal are so to rounding.
            let row = (0..n).find(|&row| length(row) > (1.0 - ALIKE) * longest);
            let row = row.unwrap_or(0);
            for other in column + 1..end {
                let (a, b) = (shapes[(row, column)], shapes[(row, other)]);
                let size = a.hypot(b);
                if size > 0.0 {
                    let (cos, sin) = (a / size, b / size);
                    let (first, second) = (
                        shapes.column(column).into_owned(),
                        shapes.column(other).into_owned(),
                    );
                    shapes.set_column(column, &(&first * cos + &second * sin));
                    shapes.set_column(other, &(second * cos - first * sin));
                }
            }
            if shapes[(row, column)] < 0.0 {
                shapes.column_mut(column).neg_mut();
            }
        }
    }
    // What symmetry makes zero.
    let smallest = 1e-12 * shapes.amax();
    shapes.apply(|x| {
        if x.abs() < smallest {
            *x = 0.0;
        }
    });
}

fn acceleration_sensing(
    machine: &Machine,
    model: &Multibody,
    rigid: &RigidModel,
) -> Result<Matrix6<f64>, MachineError> {
    let Some(sensors) = &machine.accelerometers else {
        return Err(machine.locate(EntryError::new(
            "sensors",
            "there are no accelerometers; add six under sensors.acceleration",
        )));
    };
    let rows = sensors.each_ref().map(|sensor| {
        let (relative, _) = model.direction(machine, sensor);
        relative.transpose() * &model.ride
    });
    let rows = DMatrix::from_rows(&rows.map(|row| row.columns(0, 6).into_owned()));
    if let Some(i) = dependent(&rows, reach(machine)) {
        return Err(machine.locate(EntryError::new(
            format!("sensors.acceleration.{}", sensors[i].name),
            "singular sensor arrangement: it reads nothing of the rigid machine that the sensors before it do not; move or turn it",
        )));
    }
    let inverse = rigid
        .elongations
        .try_inverse()
        .expect("the elongations were checked to be independent");
    Ok(to_six(&rows) * inverse)
}

/// The channel order of the force sensors; that they are the six legs was
/// checked when the file was read.
fn force_sensing(machine: &Machine) -> Result<Matrix6<f64>, MachineError> {
    let Some(sensors) = &machine.force_sensors else {
        return Err(machine.locate(EntryError::new(
            "sensors",
            "there are no force sensors; add one per leg under sensors.force",
        )));
    };
    Ok(Matrix6::from_fn(|i, j| {
        f64::from(u8::from(sensors[i] == machine.actuators[j]))
    }))
}

/// The poles of a plant with the unsampled, undelayed law, rad/s, slowest
/// first. The first six outputs of `plant` are the sensors.
///
/// Six more at s = 0 are left out: the integrals of the sensors, whose
/// constants of integration nothing holds.
///
/// None if the eigenvalue iteration does not end.
pub fn ideal_poles(plant: &StateSpace, gains: &Gains) -> Option<Vec<Complex<f64>>> {
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
        .solve(&force)?;
    let mut a = DMatrix::zeros(states + LEGS, states + LEGS);
    a.view_mut((0, 0), (states, states)).copy_from(&plant.a);
    a.view_mut((states, 0), (LEGS, states)).copy_from(&c);
    let mut rows = a.rows_mut(0, states);
    rows += plant.b.columns(LEGS, LEGS) * &force;
    let mut rows = a.rows_mut(states, LEGS);
    rows += d * force;
    let mut poles = eigenvalues(&a)?;
    poles.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    Some(poles.split_off(LEGS))
}
