//! The design model of section 4 of the paper: all bodies as one on six legs, its
//! modes, and what the feedback sensors read of it.

use core::ops::Range;

use nalgebra::{DMatrix, DVector, Matrix6};
use shared::LEGS;

use super::independence::{dependent, reach};
use super::multibody::Multibody;
use crate::machine::{EntryError, Feedback, Machine, MachineError};
use crate::numeric::eigen::generalised_eigen;
use crate::numeric::six::{to_dynamic, to_six};

/// The rigid model with its modes and sensors: what the gains are computed from.
#[derive(Clone, Debug)]
pub struct DesignModel {
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

impl DesignModel {
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

/// The design model of section 4: all bodies as one, on the six legs.
///
/// The six elongations q_s are its coordinates, so B_0 = I.
#[derive(Clone, Debug)]
pub struct RigidModel {
    /// M_d, 6×6, kg.
    pub mass: Matrix6<f64>,
    /// K_d, 6×6, N/m.
    pub stiffness: Matrix6<f64>,
    /// M_r, 6×6, kg.
    pub rheonomic: Matrix6<f64>,
    /// q_s from the motion of the rigid whole (translation of the origin and
    /// rotation), 6×6.
    pub elongations: Matrix6<f64>,
}

impl RigidModel {
    /// Lumps all bodies of `model` into one.
    pub fn new(machine: &Machine, model: &Multibody) -> Result<Self, MachineError> {
        let ride = &model.ride;
        let elongations = &model.elongations * ride;
        if let Some(i) = dependent(&to_dynamic(&elongations), reach(machine)) {
            let beam = &machine.beams[machine.actuators[i]].name;
            return Err(machine.locate(EntryError::new(
                "actuators.beams",
                format!(
                    "singular actuator arrangement: \"{beam}\" moves the machine no way that the legs before it do not; place it otherwise"
                ),
            )));
        }
        let inverse = elongations
            .try_inverse()
            .expect("the elongations were checked to be independent");
        let back = inverse.transpose();
        let mass = ride.transpose() * &model.mass * ride;
        let stiffness = ride.transpose() * &model.stiffness * ride;
        Ok(Self {
            mass: back * mass * inverse,
            stiffness: back * stiffness * inverse,
            rheonomic: back * mass * model.floor_inverse(),
            elongations,
        })
    }
}
