//! The design model of section 4 of the paper: all bodies as one rigid body on six legs, its
//! modes, and the positions of the feedback sensors.

use core::ops::Range;

use nalgebra::{DMatrix, DVector, Matrix6};
use shared::LEGS;

use super::independence::{dependent, reach};
use super::multibody::Multibody;
use crate::machine::{EntryError, FeedbackKind, Machine, MachineError};
use crate::numeric::eigen::generalised_eigen;
use crate::numeric::six::{to_dynamic, to_six};

/// The rigid model with its modes and sensors, from which the gains are computed.
#[derive(Clone, Debug)]
pub struct DesignModel {
    /// All bodies as one rigid body on the six legs.
    pub rigid: RigidModel,
    /// Natural frequencies of the rigid model, rad/s, ascending; 0 for a mode that gravity makes
    /// unstable.
    pub omega: [f64; LEGS],
    /// S = M_d^(−1/2)·P of Eq. (17), 6×6, 1/√kg: q_s from modal coordinates, one column for each
    /// mode. SᵀM_dS = 1 and SᵀK_dS = diag(ω²).
    pub modal: Matrix6<f64>,
    /// T_c of Eq. (15), 6×6: positions of the accelerometers along their directions from q_s,
    /// m/m. With force sensors only, a permutation: sensor values from leg forces in the order of
    /// the actuators.
    pub sensing: Matrix6<f64>,
    /// With both kinds of sensors, the permutation for the force sensors, 6×6: sensor values
    /// from leg forces in the order of the actuators. `None` with one kind.
    pub beside: Option<Matrix6<f64>>,
    /// The kind of sensors that are fed back.
    pub feedback: FeedbackKind,
}

impl DesignModel {
    /// The design model of `machine` with the sensors of `feedback`, and the matrix S that
    /// decouples its modes, Eq. (17).
    ///
    /// `model` is the multibody model of the same machine.
    ///
    /// # Errors
    /// If the actuators, or the accelerometers if they are fed back, are not six independent
    /// measurements of a rigid body's motion, or if the machine has no sensors of this kind.
    pub fn new(
        machine: &Machine,
        model: &Multibody,
        feedback: FeedbackKind,
    ) -> Result<Self, MachineError> {
        let rigid = RigidModel::new(machine, model)?;
        let (squares, mut shapes) =
            generalised_eigen(&to_dynamic(&rigid.stiffness), &to_dynamic(&rigid.mass))
                .expect("the lumped mass is positive definite because every body's is");
        canonical(&squares, &mut shapes);
        let sensing = match feedback {
            FeedbackKind::Acceleration | FeedbackKind::Both => {
                acceleration_sensing(machine, model, &rigid)?
            }
            FeedbackKind::Force => force_sensing(machine)?,
        };
        let beside = match feedback {
            FeedbackKind::Both => Some(force_sensing(machine)?),
            FeedbackKind::Acceleration | FeedbackKind::Force => None,
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

    /// Natural frequencies of the design model, Hz, ascending.
    pub fn hertz(&self) -> [f64; LEGS] {
        self.omega.map(|w| w / core::f64::consts::TAU)
    }
}

/// Natural frequencies with a smaller relative difference count as equal.
const ALIKE: f64 = 1e-6;

/// Groups of modes with equal natural frequencies, as ranges of indices. `squares` are ω²,
/// ascending.
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

/// Makes the mode shapes unique, so that every processor computes the same ones.
///
/// The signs of shapes are arbitrary, and shapes of equal frequency are defined only up to a
/// rotation. In each group of equal frequencies the first row of largest norm is rotated so that
/// it has one non-zero entry, which is positive. The remaining columns are then treated likewise.
fn canonical(squares: &DVector<f64>, shapes: &mut DMatrix<f64>) {
    let n = squares.len();
    for Range { start, end } in alike(squares.as_slice()) {
        for column in start..end {
            let length = |row: usize| shapes.view((row, column), (1, end - column)).norm();
            let longest = (0..n).map(length).fold(0.0, f64::max);
            // Rows that are equal by symmetry differ by rounding.
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
    // Entries that are zero by symmetry differ from zero by rounding.
    let smallest = 1e-12 * shapes.amax();
    shapes.apply(|x| {
        if x.abs() < smallest {
            *x = 0.0;
        }
    });
}

/// T_c of Eq. (15), 6×6: positions of the accelerometers along their directions from q_s.
///
/// The machine moves as the rigid model, and the base is at rest.
fn acceleration_sensing(
    machine: &Machine,
    model: &Multibody,
    rigid: &RigidModel,
) -> Result<Matrix6<f64>, MachineError> {
    let Some(sensors) = &machine.accelerometers else {
        return Err(machine.locate(
            EntryError::new("sensors", "there are no accelerometers")
                .fix("add six under sensors.acceleration"),
        ));
    };
    let rows = sensors.each_ref().map(|sensor| {
        let (relative, _) = model.direction(machine, sensor);
        relative.transpose() * &model.ride
    });
    let rows = DMatrix::from_rows(&rows.map(|row| row.columns(0, 6).into_owned()));
    if let Some(i) = dependent(&rows, reach(machine)) {
        return Err(machine.locate(EntryError::new(
            format!("sensors.acceleration.{}", sensors[i].name),
            "singular sensor arrangement: this sensor measures a combination of what the sensors before it measure",
        )
        .fix("move it or change its direction")));
    }
    let inverse = rigid
        .elongations
        .try_inverse()
        .expect("the elongations were checked to be independent");
    Ok(to_six(&rows) * inverse)
}

/// The order of the force sensors as a permutation, 6×6: sensor values from leg forces in the
/// order of the actuators.
///
/// Validation of the machine has checked that there is one sensor in each of the six legs.
fn force_sensing(machine: &Machine) -> Result<Matrix6<f64>, MachineError> {
    let Some(sensors) = &machine.force_sensors else {
        return Err(machine.locate(
            EntryError::new("sensors", "there are no force sensors")
                .fix("add one for each leg under sensors.force"),
        ));
    };
    Ok(Matrix6::from_fn(|i, j| {
        f64::from(u8::from(sensors[i] == machine.actuators[j]))
    }))
}

/// All bodies as one rigid body on the six legs, Eq. (13), without damping.
///
/// Its coordinates q_s are the elongations of the six legs, m, in the order of the actuators, so
/// B_0 = I.
#[derive(Clone, Debug)]
pub struct RigidModel {
    /// M_d of Eq. (13), 6×6, kg.
    pub mass: Matrix6<f64>,
    /// K_d of Eq. (13), 6×6, N/m: elastic, plus the geometric stiffness under gravity.
    pub stiffness: Matrix6<f64>,
    /// M_r of Eq. (13), 6×6, kg, for the floor inputs q̈_r.
    pub rheonomic: Matrix6<f64>,
    /// E_s, 6×6: q_s from the motion of the rigid body, that is, the translation at the mean
    /// position of the nodes, m, and the rotation, rad. m/m and m/rad.
    pub elongations: Matrix6<f64>,
}

impl RigidModel {
    /// Takes all bodies of `model` as one rigid body: M_d, K_d and M_r of Eq. (13).
    ///
    /// # Errors
    /// If the elongations of the six legs do not determine the motion of a rigid body.
    pub fn new(machine: &Machine, model: &Multibody) -> Result<Self, MachineError> {
        let ride = &model.ride;
        let elongations = &model.elongations * ride;
        if let Some(i) = dependent(&to_dynamic(&elongations), reach(machine)) {
            let beam = &machine.beams[machine.actuators[i]].name;
            return Err(machine.locate(EntryError::new(
                "actuators.beams",
                format!(
                    "singular actuator arrangement: the elongation of \"{beam}\" follows from those of the legs before it"
                ),
            )
            .fix("change its position or direction")));
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
