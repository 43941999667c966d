//! The generalised plant G of Fig. 4, in modal form, continuous and sampled.
//!
//! Inputs are the six floor accelerations and the six leg forces; outputs are
//! the feedback sensors, the performance accelerations, and the motion of the
//! machine as a rigid whole, from which the corner is read.
//!
//! The paper stacks the inputs of Eq. (6) in one order in B and in the other in
//! u; here the floor always comes first, as in Fig. 4.

use nalgebra::{Complex, DMatrix, DVector, Matrix2, Matrix6, MatrixXx6, Vector2};
use shared::LEGS;
use shared::table::Feedback;

use crate::design::Design;
use crate::machine::{Board, Machine, Performance};
use crate::multibody::{Multibody, deformation_stiffness, to_dynamic};

/// Outputs y = A·z̈ + D·z + F·q̈_r + B·σ, with z the modal coordinates.
#[derive(Clone, Debug)]
pub struct Outputs {
    /// A, from modal accelerations.
    pub acceleration: DMatrix<f64>,
    /// D, from modal displacements.
    pub displacement: DMatrix<f64>,
    /// F, straight from the floor.
    pub floor: MatrixXx6<f64>,
    /// B, straight from the actuators.
    pub actuators: MatrixXx6<f64>,
}

impl Outputs {
    fn zeros(count: usize, modes: usize) -> Self {
        Self {
            acceleration: DMatrix::zeros(count, modes),
            displacement: DMatrix::zeros(count, modes),
            floor: MatrixXx6::zeros(count),
            actuators: MatrixXx6::zeros(count),
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.acceleration.nrows()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The plant: modes z̈ + 2ζω·ż + ω²·z = b_r·q̈_r + b_a·σ, and outputs.
#[derive(Clone, Debug)]
pub struct Plant {
    /// ω, rad/s.
    pub omega: DVector<f64>,
    /// ζ of every mode.
    pub damping: f64,
    /// b_r, modes×6.
    pub floor: MatrixXx6<f64>,
    /// b_a, modes×6.
    pub actuators: MatrixXx6<f64>,
    /// The six feedback sensors.
    pub sensors: Outputs,
    /// The performance accelerations.
    pub performance: Outputs,
    /// Acceleration of the machine as a rigid whole, in the modal coordinates
    /// of the design model: its momentum along each rigid mode, √kg·m/s².
    pub whole: Outputs,
    /// Floor accelerations that move the base along each rigid mode, 6×6: with
    /// these for inputs, [`Plant::whole`] is the identity at low frequency.
    pub rigid_floor: Matrix6<f64>,
}

impl Plant {
    /// The flexible machine.
    pub fn new(machine: &Machine, model: &Multibody, design: &Design) -> Self {
        let modes = model.modes();
        let n = modes.omega.len();
        let shapes = &modes.shapes;
        let floor_inverse = model.floor_inverse();
        let floor = -shapes.transpose() * &model.mass * &model.ride * floor_inverse;
        let actuators = shapes.transpose() * model.elongations.transpose();

        let mut sensors = Outputs::zeros(LEGS, n);
        match design.feedback {
            Feedback::Acceleration => {
                let all = machine.accelerometers.iter().flatten();
                for (i, sensor) in all.enumerate() {
                    let (relative, ride) = model.direction(machine, sensor);
                    let row = relative.transpose() * shapes;
                    sensors.acceleration.row_mut(i).copy_from(&row);
                    sensors.floor.row_mut(i).copy_from(&(ride * floor_inverse));
                }
            }
            Feedback::Force => {
                // σ − (EA/L)·e1, Eq. (11) with the push positive.
                for (i, &beam) in machine.force_sensors.iter().flatten().enumerate() {
                    for (j, &actuator) in machine.actuators.iter().enumerate() {
                        if actuator == beam {
                            let axial = deformation_stiffness(&machine.beams[beam])[(0, 0)];
                            let row = model.elongations.row(j) * shapes * -axial;
                            sensors.displacement.row_mut(i).copy_from(&row);
                            sensors.actuators[(i, j)] = 1.0;
                        }
                    }
                }
            }
        }

        let mut performance = Outputs::zeros(machine.performance.len(), n);
        for (i, output) in machine.performance.iter().enumerate() {
            match output {
                Performance::Deformation(d) => {
                    let row = model.deformation(machine, *d).transpose() * shapes;
                    performance.acceleration.row_mut(i).copy_from(&row);
                }
                Performance::Acceleration(d) => {
                    let (relative, ride) = model.direction(machine, d);
                    let row = relative.transpose() * shapes;
                    performance.acceleration.row_mut(i).copy_from(&row);
                    performance
                        .floor
                        .row_mut(i)
                        .copy_from(&(ride * floor_inverse));
                }
            }
        }

        // Rigid modes in the motion of the whole: b = E_s⁻¹·S·w.
        let rigid_modes = design
            .rigid
            .elongations
            .try_inverse()
            .expect("the elongations were checked to be independent")
            * design.modal;
        let momentum = rigid_modes.transpose() * model.ride.transpose() * &model.mass;
        let mut whole = Outputs::zeros(LEGS, n);
        whole.acceleration.copy_from(&(&momentum * shapes));
        whole
            .floor
            .copy_from(&(&momentum * &model.ride * floor_inverse));

        Self {
            omega: modes.omega,
            damping: machine.modal_damping,
            floor,
            actuators,
            sensors,
            performance,
            whole,
            rigid_floor: model.floor * rigid_modes,
        }
    }

    /// The design model itself as a plant: undamped, and with force sensors
    /// that measure all of K_d·q, as section 4 of the paper assumes.
    pub fn of_design(design: &Design) -> Self {
        let s = &design.modal;
        let mut sensors = Outputs::zeros(LEGS, LEGS);
        match design.feedback {
            Feedback::Acceleration => sensors.acceleration = to_dynamic(&(design.sensing * s)),
            Feedback::Force => {
                let displacement = -(design.sensing * design.rigid.stiffness * s);
                sensors.displacement = to_dynamic(&displacement);
                sensors.actuators.copy_from(&design.sensing);
            }
        }
        Self {
            omega: DVector::from_column_slice(&design.omega),
            damping: 0.0,
            floor: by_six(&-(s.transpose() * design.rigid.rheonomic)),
            actuators: by_six(&s.transpose()),
            sensors,
            performance: Outputs::zeros(0, LEGS),
            whole: Outputs::zeros(0, LEGS),
            rigid_floor: Matrix6::identity(),
        }
    }

    /// All transfer functions at `hz`.
    pub fn response(&self, hz: f64) -> Response {
        let s = Complex::new(0.0, core::f64::consts::TAU * hz);
        let displacement = self
            .omega
            .map(|w| (s * s + s * (2.0 * self.damping * w) + w * w).inv());
        let floor = Modal {
            acceleration: displacement.map(|h| s * s * h),
            displacement,
        };
        Response::new(self, &floor, &floor, Complex::ONE)
    }
}

fn by_six(matrix: &Matrix6<f64>) -> MatrixXx6<f64> {
    MatrixXx6::from_column_slice(matrix.as_slice())
}

/// Any number of outputs from six inputs, as complex gains.
pub type Gain = MatrixXx6<Complex<f64>>;

/// What a unit modal force gives in each mode.
struct Modal {
    acceleration: DVector<Complex<f64>>,
    displacement: DVector<Complex<f64>>,
}

/// Frequency response of the plant at one frequency.
#[derive(Clone, Debug)]
pub struct Response {
    /// Floor → sensors (G21), 6×6.
    pub floor_to_sensors: Matrix6<Complex<f64>>,
    /// Actuators → sensors (G22), 6×6.
    pub actuators_to_sensors: Matrix6<Complex<f64>>,
    /// Floor → performance (G11).
    pub floor_to_performance: Gain,
    /// Actuators → performance (G12).
    pub actuators_to_performance: Gain,
    /// Rigid floor motion → the rigid whole, 6×6.
    pub floor_to_whole: Gain,
    /// Actuators → the rigid whole, 6×6.
    pub actuators_to_whole: Gain,
}

impl Response {
    /// `seen` is the part of an actuator's force that a direct path shows.
    fn new(plant: &Plant, floor: &Modal, actuators: &Modal, seen: Complex<f64>) -> Self {
        let complex = |m: &MatrixXx6<f64>| m.map(Complex::from);
        let through = |out: &Outputs, by: &Modal, input: &MatrixXx6<f64>| {
            let mut rows = out.acceleration.map(Complex::from);
            for (j, mut column) in rows.column_iter_mut().enumerate() {
                column *= by.acceleration[j];
                for (i, entry) in column.iter_mut().enumerate() {
                    *entry += by.displacement[j] * out.displacement[(i, j)];
                }
            }
            rows * complex(input)
        };
        let from_floor = |out: &Outputs| through(out, floor, &plant.floor) + complex(&out.floor);
        let from_actuators = |out: &Outputs| {
            through(out, actuators, &plant.actuators) + complex(&out.actuators) * seen
        };
        let six = |m: Gain| m.fixed_rows::<LEGS>(0).into_owned();
        let rigid = plant.rigid_floor.map(Complex::from);
        Self {
            floor_to_sensors: six(from_floor(&plant.sensors)),
            actuators_to_sensors: six(from_actuators(&plant.sensors)),
            floor_to_performance: from_floor(&plant.performance),
            actuators_to_performance: from_actuators(&plant.performance),
            floor_to_whole: from_floor(&plant.whole) * rigid,
            actuators_to_whole: from_actuators(&plant.whole),
        }
    }

    /// Closes the loop with σ = C·y; `None` opens it. Gives floor → performance
    /// and rigid floor motion → rigid whole.
    pub fn close(&self, plant: &Plant, controller: Option<&Matrix6<Complex<f64>>>) -> (Gain, Gain) {
        let Some(c) = controller else {
            return (
                self.floor_to_performance.clone(),
                self.floor_to_whole.clone(),
            );
        };
        // σ = C·(1 − G22·C)⁻¹·G21·q̈_r
        let difference = Matrix6::identity() - self.actuators_to_sensors * c;
        let Some(inverse) = difference.try_inverse() else {
            // Exactly on a closed-loop pole.
            let infinite = |m: &Gain| m.map(|_| Complex::from(f64::INFINITY));
            return (
                infinite(&self.floor_to_performance),
                infinite(&self.floor_to_whole),
            );
        };
        let force = c * inverse * self.floor_to_sensors;
        let rigid = force * plant.rigid_floor.map(Complex::from);
        (
            &self.floor_to_performance + &self.actuators_to_performance * force,
            &self.floor_to_whole + &self.actuators_to_whole * rigid,
        )
    }
}

/// The largest singular value; infinite if an entry is not finite.
pub fn largest_singular_value(matrix: &Gain) -> f64 {
    if matrix
        .iter()
        .any(|z| !z.re.is_finite() || !z.im.is_finite())
    {
        return f64::INFINITY;
    }
    matrix.singular_values().max()
}

/// One mode over a sample period, exactly, for inputs held in between.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SampledMode {
    /// Transition of (z, ż) over a period.
    pub(crate) transition: Matrix2<f64>,
    /// From a modal force held over the whole period.
    pub(crate) whole: Vector2<f64>,
    /// From one held from its start until the latch.
    pub(crate) before: Vector2<f64>,
    /// From one held from the latch until its end.
    pub(crate) after: Vector2<f64>,
}

/// Transition of (z, ż) over `t` and the effect of a unit force held for it.
fn propagate(omega: f64, damping: f64, t: f64) -> (Matrix2<f64>, Vector2<f64>) {
    let rate = damping * omega;
    let damped = omega * (1.0 - damping * damping).sqrt();
    let (sin, cos) = (damped * t).sin_cos();
    let decay = (-rate * t).exp();
    let s = sin / damped;
    let transition = decay * Matrix2::new(cos + rate * s, s, -omega * omega * s, cos - rate * s);
    // 1 − decay·(cos + rate·s), written without taking nearly equal numbers
    // from each other.
    let half = (0.5 * damped * t).sin();
    let rest = 2.0 * half * half - cos * (-rate * t).exp_m1() - decay * rate * s;
    (transition, Vector2::new(rest / (omega * omega), decay * s))
}

/// The plant as the board sees it: sampled at kT, forces latched a while later
/// and held for T.
///
/// With a latch delay of m·T + θ, 0 ≤ θ < T, the force of sample k acts from
/// (k + m)T + θ on. A sample sees what was latched before its instant; where a
/// latch and a sample coincide the sample comes first, as it does on a board
/// whose converter samples on the edge that also latches.
#[derive(Clone, Debug)]
pub struct SampledPlant {
    pub(crate) modes: Vec<SampledMode>,
    /// m.
    pub(crate) whole_periods: usize,
    /// T, s.
    pub period: f64,
    /// The continuous plant.
    pub plant: Plant,
}

impl SampledPlant {
    /// Samples `plant` with the timing of `board`.
    pub fn new(plant: Plant, board: &Board) -> Self {
        let period = board.period();
        let periods = board.latch_delay / period;
        // A delay typed as a whole number of periods is one.
        let nearest = periods.round();
        let (whole_periods, part) = if (periods - nearest).abs() < 1e-9 {
            (nearest, 0.0)
        } else {
            (periods.floor(), (periods - periods.floor()) * period)
        };
        let modes = plant
            .omega
            .iter()
            .map(|&omega| {
                let (transition, whole) = propagate(omega, plant.damping, period);
                let (rest, after) = propagate(omega, plant.damping, period - part);
                let (_, early) = propagate(omega, plant.damping, part);
                SampledMode {
                    transition,
                    whole,
                    before: rest * early,
                    after,
                }
            })
            .collect();
        Self {
            modes,
            // At most eight: checked with the file.
            whole_periods: whole_periods as usize,
            period,
            plant,
        }
    }

    /// How many samples old the force is that a sample sees.
    pub fn seen_delay(&self) -> usize {
        self.whole_periods + 1
    }

    /// e^(jωT) at `hz`.
    pub fn z(&self, hz: f64) -> Complex<f64> {
        Complex::cis(core::f64::consts::TAU * hz * self.period)
    }

    /// All transfer functions of the sampled plant at `hz`, forces counted from
    /// the sample they were computed from.
    pub fn response(&self, hz: f64) -> Response {
        let z = self.z(hz);
        let delay = z.powi(-(self.whole_periods as i32));
        let seen = delay / z;
        let modal = |input: &dyn Fn(&SampledMode) -> Vector2<Complex<f64>>, direct| {
            let damping = self.plant.damping;
            let pairs = self.modes.iter().zip(&self.plant.omega).map(|(mode, &w)| {
                let resolvent =
                    Matrix2::from_diagonal_element(z) - mode.transition.map(Complex::from);
                let state = resolvent
                    .try_inverse()
                    .map_or_else(Vector2::zeros, |inverse| inverse * input(mode));
                let acceleration = direct - state[0] * (w * w) - state[1] * (2.0 * damping * w);
                (acceleration, state[0])
            });
            let (acceleration, displacement): (Vec<_>, Vec<_>) = pairs.unzip();
            Modal {
                acceleration: DVector::from_vec(acceleration),
                displacement: DVector::from_vec(displacement),
            }
        };
        let floor = modal(&|mode| mode.whole.map(Complex::from), Complex::ONE);
        let actuators = modal(
            &|mode| mode.after.map(Complex::from) * delay + mode.before.map(Complex::from) * seen,
            seen,
        );
        Response::new(&self.plant, &floor, &actuators, seen)
    }
}
