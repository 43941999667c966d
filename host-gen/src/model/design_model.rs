//! The design model of section 4 of the paper: the machine reduced to its six suspension
//! coordinates, its modes, and the positions of the feedback sensors.

use core::ops::Range;

use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, MatrixXx6};
use serde::Serialize;
use shared::LEGS;

use super::independence::{INDEPENDENT, dependent, reach};
use super::multibody::Multibody;
use crate::machine::{EntryError, FeedbackKind, Machine, MachineError};
use crate::numeric::eigen::generalised_eigen;
use crate::numeric::rows::first_dependent_row;
use crate::numeric::six::{to_dynamic, to_six};

/// The machine reduced to six coordinates, with its modes and sensors, from which the gains are
/// computed.
#[derive(Clone, Debug)]
pub struct DesignModel {
    /// The machine in the elongations of its six legs.
    pub suspension: Suspension,
    /// Natural frequencies of the design model, rad/s, ascending; 0 for a mode that gravity makes
    /// unstable.
    pub omega: [f64; LEGS],
    /// S = M_d^(−1/2)·P of Eq. (17), 6×6, 1/√kg: q_s from modal coordinates, one column for each
    /// mode. SᵀM_dS = 1 and SᵀK_dS = diag(ω²).
    pub modal: Matrix6<f64>,
    /// T_c of Eq. (15), 6×6: positions of the accelerometers along their directions from q_s,
    /// m/m. With force sensors only, sensor values from σ − K_d·q_s, as
    /// [`beside`](Self::beside).
    pub sensing: Matrix6<f64>,
    /// With both kinds of sensors, 6×6: values of the force sensors from σ − K_d·q_s, N/N. A
    /// permutation if a leg is one spring; if it has a flexure in series, the part of the leg
    /// force that reaches the machine. `None` with one kind.
    pub beside: Option<Matrix6<f64>>,
    /// The kind of sensors that are fed back.
    pub feedback: FeedbackKind,
}

impl DesignModel {
    /// The design model of `machine` with the sensors of `feedback`, and the matrix S that
    /// decouples its modes, Eq. (17): the solutions v of K_d·v = ω²·M_d·v as columns, with
    /// vᵀ·M_d·v = 1.
    ///
    /// `model` is the multibody model of the same machine.
    ///
    /// # Errors
    /// If the actuators, or the accelerometers if they are fed back, are not six independent
    /// measurements of the suspension's motion, or if the machine has no sensors of this kind.
    pub fn new(
        machine: &Machine,
        model: &Multibody,
        feedback: FeedbackKind,
    ) -> Result<Self, MachineError> {
        let suspension = Suspension::new(machine, model)?;
        let (squares, mut shapes) = generalised_eigen(
            &to_dynamic(&suspension.stiffness),
            &to_dynamic(&suspension.mass),
        )
        .expect("the mass is positive definite because every body's is");
        canonical(&squares, &mut shapes);
        let sensing = match feedback {
            FeedbackKind::Acceleration | FeedbackKind::Both => {
                acceleration_sensing(machine, model, &suspension)?
            }
            FeedbackKind::Force => force_sensing(machine, model, &suspension)?,
        };
        let beside = match feedback {
            FeedbackKind::Both => Some(force_sensing(machine, model, &suspension)?),
            FeedbackKind::Acceleration | FeedbackKind::Force => None,
        };
        Ok(Self {
            omega: core::array::from_fn(|i| squares[i].max(0.0).sqrt()),
            modal: to_six(&shapes),
            suspension,
            sensing,
            beside,
            feedback,
        })
    }

    /// Groups of modes with equal natural frequencies, as ranges of indices.
    pub(crate) fn groups(&self) -> Vec<Range<usize>> {
        alike(&self.omega.map(|omega| omega * omega))
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

/// The rows of the accelerometers, 6×N: their positions along their directions, m, from the
/// machine's coordinates, with the base at rest. `None` without accelerometers.
fn accelerometer_rows(machine: &Machine, model: &Multibody) -> Option<Matrix6xX<f64>> {
    let sensors = machine.accelerometers.as_ref()?;
    let rows = sensors.each_ref().map(|sensor| {
        let (relative, _) = model.direction(machine, sensor);
        relative.transpose()
    });
    Some(Matrix6xX::from_rows(&rows))
}

/// T_c of Eq. (15), 6×6: positions of the accelerometers along their directions from q_s.
///
/// The machine moves as the design model, and the base is at rest.
fn acceleration_sensing(
    machine: &Machine,
    model: &Multibody,
    suspension: &Suspension,
) -> Result<Matrix6<f64>, MachineError> {
    let (Some(sensors), Some(rows)) = (&machine.accelerometers, accelerometer_rows(machine, model))
    else {
        return Err(machine.locate(
            EntryError::new("sensors", "there are no accelerometers")
                .fix("add six under sensors.acceleration"),
        ));
    };
    let singular = match suspension.reduction {
        Reduction::Rigid => dependent(&to_dynamic(&(&rows * &model.ride)), reach(machine)),
        Reduction::Condensed | Reduction::Modes => {
            first_dependent_row(&to_dynamic(&(&rows * &suspension.shapes)), INDEPENDENT)
        }
    };
    if let Some(i) = singular {
        return Err(machine.locate(EntryError::new(
            format!("sensors.acceleration.{}", sensors[i].name),
            "singular sensor arrangement: this sensor measures a combination of what the sensors before it measure",
        )
        .fix("move it or change its direction")));
    }
    Ok(rows * &suspension.shapes)
}

/// Values of the force sensors from σ − K_d·q_s, 6×6, N/N.
///
/// A sensor reads y = σ − k·e of its leg, Eq. (11). As in section 4 of the paper, a rigid machine
/// takes up all of a leg's force, so this is the order of the sensors as a permutation. Otherwise
/// the leg also gives way where the design model is held, with the static compliance
/// C = K⁻¹ − Φ·K_d⁻¹·Φᵀ: y = (1 − k·E·C·Eᵀ)·(σ − K_d·q_s).
///
/// Validation of the machine has checked that there is one sensor in each of the six legs.
fn force_sensing(
    machine: &Machine,
    model: &Multibody,
    suspension: &Suspension,
) -> Result<Matrix6<f64>, MachineError> {
    let Some(sensors) = &machine.force_sensors else {
        return Err(machine.locate(
            EntryError::new("sensors", "there are no force sensors")
                .fix("add one for each leg under sensors.force"),
        ));
    };
    let order = Matrix6::from_fn(|i, j| f64::from(u8::from(sensors[i] == machine.actuators[j])));
    if suspension.reduction == Reduction::Rigid {
        return Ok(order);
    }
    let legs = &model.elongations;
    // E·K⁻¹·Eᵀ, and E·Φ = 1.
    let free = model.stiffness.clone().lu().solve(&legs.transpose());
    let (Some(free), Some(own)) = (free, suspension.stiffness.try_inverse()) else {
        return Ok(order);
    };
    let held: Matrix6<f64> = legs * free - own;
    let axial = machine
        .actuators
        .map(|beam| machine.beams[beam].stiffness.axial);
    let axial = Matrix6::from_diagonal(&axial.into());
    Ok(order * (Matrix6::identity() - axial * held))
}

/// How a machine is reduced to six coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reduction {
    /// All bodies move as one rigid body, as in section 4 of the paper.
    Rigid,
    /// All else follows the accelerometers' places statically: a flexure in series with a leg
    /// gives way.
    Condensed,
    /// The machine moves in its six suspension modes: the lowest that strain the legs.
    Modes,
}

impl Reduction {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Rigid => "all bodies as one rigid body",
            Self::Condensed => "all bodies condensed statically to the accelerometers' places",
            Self::Modes => "the six suspension modes of the flexible machine",
        }
    }
}

/// The machine in six coordinates, Eq. (13), without damping.
///
/// Its coordinates q_s are the elongations of the six legs, m, in the order of the actuators, so
/// B_0 = I.
#[derive(Clone, Debug)]
pub struct Suspension {
    /// How the machine was reduced.
    pub reduction: Reduction,
    /// M_d of Eq. (13), 6×6, kg.
    pub mass: Matrix6<f64>,
    /// K_d of Eq. (13), 6×6, N/m: elastic, plus the geometric stiffness under gravity.
    pub stiffness: Matrix6<f64>,
    /// M_r of Eq. (13), 6×6, kg, for the floor inputs q̈_r.
    pub rheonomic: Matrix6<f64>,
    /// Φ, N×6: motion x of the machine from q_s, m/m and rad/m.
    pub shapes: MatrixXx6<f64>,
    /// ω² of the six modes, rad²/s², ascending.
    squares: DVector<f64>,
}

/// A reduced model holds if each of its natural frequencies differs by less than this part from
/// the suspension mode that it stands for. In the paper's machine, the rigid body has 1.9 to 7.4 %.
const HOLDS: f64 = 0.1;

/// A mode strains the legs if at least this part of its potential energy is in the actuated legs,
/// and it is another one if its strains differ by this part from combinations of those before.
const STRAINS: f64 = 0.1;

/// Modes that strain the legs are not those of the suspension if the square of their frequencies is
/// this much above those of the machine as a whole: then the legs are stiff parts of it.
const ABOVE: f64 = 100.0;

/// Reduced models whose natural frequencies differ by less than this part are the same.
const SAME: f64 = 1e-9;

impl Suspension {
    /// Reduces `model` to the elongations of the six legs: M_d, K_d and M_r of Eq. (13).
    ///
    /// A static reduction to the accelerometers is taken if it holds for the machine's suspension
    /// modes, then one rigid body if that holds, else the modes themselves. Where the first two
    /// agree, or the machine has no six suspension modes, it is one rigid body.
    ///
    /// # Errors
    /// If the elongations of the six legs do not determine the motion.
    pub fn new(machine: &Machine, model: &Multibody) -> Result<Self, MachineError> {
        let rigid = model.as_one_body(machine);
        let rigid = rigid.and_then(|shapes| Self::along(model, Reduction::Rigid, shapes));
        let independent = dependent(
            &to_dynamic(&(&model.elongations * &model.ride)),
            reach(machine),
        );
        let rigid = match independent {
            None => rigid,
            Some(_) => None,
        };
        let condensed = accelerometer_rows(machine, model).and_then(|rows| {
            let follow = model.stiffness.clone().lu().solve(&rows.transpose())?;
            let follow = MatrixXx6::from_column_slice(follow.as_slice());
            Self::along(model, Reduction::Condensed, follow)
        });
        let near = |reduced: &Option<Self>, other: &[f64], limit: f64| {
            reduced.as_ref().is_some_and(|reduced| {
                let mut pairs = reduced.squares.iter().zip(other);
                pairs.all(|(own, other)| ((own / other).sqrt() - 1.0).abs() < limit)
            })
        };
        let same = condensed
            .as_ref()
            .is_some_and(|condensed| near(&rigid, condensed.squares.as_slice(), SAME));
        let far_above = |modes: &Self, other: &Option<Self>| {
            other
                .as_ref()
                .is_some_and(|other| modes.squares.min() > ABOVE * other.squares.max().abs())
        };
        let found = match suspension_modes(machine, model) {
            Some((squares, _)) if near(&condensed, &squares, HOLDS) && !same => condensed,
            Some((squares, _)) if near(&rigid, &squares, HOLDS) => rigid,
            modes => modes
                .and_then(|(_, shapes)| Self::along(model, Reduction::Modes, shapes))
                .filter(|modes| !far_above(modes, &rigid) && !far_above(modes, &condensed))
                .or(rigid)
                .or(condensed),
        };
        found.ok_or_else(|| singular_legs(machine, independent.unwrap_or(0)))
    }

    /// The machine that moves as a combination of six `shapes`, N×6. `None`
    /// if the legs' elongations do not determine the combination.
    fn along(model: &Multibody, reduction: Reduction, shapes: MatrixXx6<f64>) -> Option<Self> {
        let elongations: Matrix6<f64> = &model.elongations * &shapes;
        let independent = first_dependent_row(&to_dynamic(&elongations), INDEPENDENT).is_none();
        if reduction != Reduction::Rigid && !independent {
            return None;
        }
        let inverse = elongations.try_inverse()?;
        let back = inverse.transpose();
        let mass = shapes.transpose() * &model.mass * &shapes;
        let stiffness = shapes.transpose() * &model.stiffness * &shapes;
        let rheonomic = model.momentum(&shapes.transpose()) * model.floor_inverse();
        let mass = back * mass * inverse;
        let stiffness = back * stiffness * inverse;
        let (squares, _) = generalised_eigen(&to_dynamic(&stiffness), &to_dynamic(&mass))?;
        Some(Self {
            reduction,
            mass,
            stiffness,
            rheonomic: back * rheonomic,
            shapes: shapes * inverse,
            squares,
        })
    }
}

fn singular_legs(machine: &Machine, leg: usize) -> MachineError {
    let beam = &machine.beams[machine.actuators[leg]].name;
    machine.locate(
        EntryError::new(
            "actuators.beams",
            format!(
                "singular actuator arrangement: the elongation of \"{beam}\" follows from those of the legs before it"
            ),
        )
        .fix("change its position or direction"),
    )
}

/// ω², rad²/s², and the shapes of the six lowest modes that strain the legs, each in a way that
/// those before do not. `None` if there are fewer, or if gravity makes a mode unstable.
fn suspension_modes(machine: &Machine, model: &Multibody) -> Option<(Vec<f64>, MatrixXx6<f64>)> {
    let modes = model.modes();
    if modes.squares[0] <= 0.0 {
        return None;
    }
    let axial = machine
        .actuators
        .map(|beam| machine.beams[beam].stiffness.axial);
    let mut found: Vec<usize> = Vec::new();
    let mut strains: Vec<DVector<f64>> = Vec::new();
    for (i, shape) in modes.shapes.column_iter().enumerate() {
        let mut strain = DVector::from_column_slice((&model.elongations * shape).as_slice());
        for (x, k) in strain.iter_mut().zip(axial) {
            *x *= (k / modes.squares[i]).sqrt();
        }
        if strain.norm_squared() < STRAINS {
            continue;
        }
        strains.push(strain);
        let rows = DMatrix::from_columns(&strains).transpose();
        if first_dependent_row(&rows, STRAINS).is_some() {
            strains.pop();
            continue;
        }
        found.push(i);
        if found.len() == LEGS {
            let shapes = modes.shapes.select_columns(&found);
            let squares = found.iter().map(|&i| modes.squares[i]).collect();
            return Some((squares, MatrixXx6::from_column_slice(shapes.as_slice())));
        }
    }
    None
}
