//! A machine as checked: names resolved, numbers in range.

use std::ops::{Deref, DerefMut};
use std::path::Path;

use nalgebra::{Complex, DMatrix, Matrix3, Matrix6, Rotation3, Unit, Vector3, Vector6};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng};
use shared::LEGS;
use shared::codes::{Adc, Calibration, Dac, DacCode, Drive};
use shared::table::ModelDigest;

use super::error::{EntryError, MachineError};
use super::file::{
    FeedbackKind, LawName, MachineFile, Minimise, Penalty, Provenance, Resonance, RollOff,
    ShapeEntry, Simulation, SupervisionSettings,
};
use super::noise::NoiseDensity;
use super::source::Source;
use crate::floor::{Floor, Spectrum};
use crate::numeric::exposure::Measure;

/// What vibrates: bodies, beams and springs on the base, as checked, with or without control. SI
/// units.
#[derive(Clone, Debug, PartialEq)]
pub struct Structure {
    /// Name of the machine.
    pub name: String,
    /// All nodes, in the order of the file; other fields refer to them by index.
    pub nodes: Vec<Node>,
    /// Rigid bodies, in the order of the file.
    pub bodies: Vec<Body>,
    /// Flexible bodies, in the order of the file.
    pub flexible: Vec<FlexibleBody>,
    /// Beams, in the order of the file.
    pub beams: Vec<Beam>,
    /// Springs of no length, in the order of the file.
    pub springs: Vec<Spring>,
    /// Point masses, in the order of the file.
    pub point_masses: Vec<PointMass>,
    /// Acceleration of gravity, m/s².
    pub gravity: Vector3<f64>,
    /// Damping of the machine as a whole.
    pub damping: Damping,
    pub(super) source: Source,
}

/// A machine as checked: its [`Structure`], whose fields it has, with legs, sensors, outputs and
/// board. SI units.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// What vibrates.
    pub structure: Structure,
    /// Degrees of freedom q_d, Eq. (7): six per body.
    pub coordinates: Vec<Deformation>,
    /// Actuated beams, by index, in channel order.
    pub actuators: [usize; LEGS],
    /// Accelerometers in channel order, none or six.
    pub accelerometers: Option<[Direction; LEGS]>,
    /// Beams with a force sensor by index, in channel order, none or six.
    pub force_sensors: Option<[usize; LEGS]>,
    /// Rheonomic inputs q_r at base nodes, Eq. (8).
    pub floor: [Direction; LEGS],
    /// Rotations of the base about x, y and z as parts of its translation, rad/m; or, of waves, as
    /// parts of the rate of change of its translation, rad s/m.
    pub rotation: Vector3<f64>,
    /// Whether waves in the ground rotate the base.
    pub waves: bool,
    /// The spectrum of the base's acceleration along each of x, y and z, where the file gives it.
    pub spectrum: Option<Floor>,
    /// Performance outputs, Eq. (10), at least one.
    pub performance: Vec<Performance>,
    /// Forces and moments whose compliance is asked for, at most six.
    pub loads: Vec<Load>,
    /// Bands to report peaks in: name, lower and upper limit, Hz.
    pub bands: Vec<(String, f64, f64)>,
    /// Exposure time of moving averages and deviations, s.
    pub exposure: Option<f64>,
    /// Objectives of the controller.
    pub target: Target,
    /// Shapes of the modal law by mode, slowest mode first, where the file gives them;
    /// nothing is searched then.
    pub shapes: Option<[ShapeEntry; LEGS]>,
    /// The board.
    pub board: Board,
    /// Limits and times of the supervisor.
    pub supervision: SupervisionSettings,
    /// Settings of the standard simulation.
    pub simulation: Simulation,
    /// Settings of the Monte Carlo run.
    pub robustness: Robustness,
    /// How far the machine may be from the numbers of its file.
    pub uncertainty: Uncertainty,
    /// Sources of the numbers.
    pub provenance: Vec<Provenance>,
    /// SHA-256 of the description without comments and layout: everything that decides the
    /// controller, the matrices of flexible bodies included. Of `simulation` that is the floor, as
    /// are `floor.rotation`, `floor.wave_speed` and `floor.spectrum`, unless the search minimises the peaks; of
    /// `robustness` what the modal law is verified on; `provenance` is left out.
    pub digest: ModelDigest,
    /// Errors of gains that the controller does not know: zero for the machine of a file.
    pub(crate) gain_errors: GainErrors,
    pub(super) description: MachineFile,
}

impl Deref for Machine {
    type Target = Structure;

    fn deref(&self) -> &Structure {
        &self.structure
    }
}

impl DerefMut for Machine {
    fn deref_mut(&mut self) -> &mut Structure {
        &mut self.structure
    }
}

/// Relative errors of the gains of sensors and actuators (no unit).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct GainErrors {
    /// Of the accelerometers, and of the force sensors.
    pub(crate) sensors: [[f64; LEGS]; 2],
    /// Of the actuators.
    pub(crate) actuators: [f64; LEGS],
}

/// A design of the modal law is verified on at most so many randomly perturbed machines.
pub const DESIGN_SAMPLES: usize = 40;

/// A named point.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Name of the node.
    pub name: String,
    /// Position, m.
    pub at: Vector3<f64>,
    /// What the node moves with.
    pub carrier: Carrier,
}

/// What a node moves with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carrier {
    /// The moving base.
    Base,
    /// A body, by its index in [`Structure::bodies`].
    Body(usize),
    /// Nothing: it moves by itself, held by beams.
    Free,
    /// Itself, as an interface node of a flexible body, by its index in [`Structure::flexible`].
    Flexible(usize),
}

/// A rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Name of the body.
    pub name: String,
    /// Mass, kg.
    pub mass: f64,
    /// Inertia tensor about the centre of gravity, kg m².
    pub inertia: Matrix3<f64>,
    /// Position of the centre of gravity, m.
    pub cog: Vector3<f64>,
}

impl Body {
    /// The principal moments of inertia, kg m², and their axes as columns. Moments are not
    /// negative: what rounding makes of zero is zero.
    pub fn principal(&self) -> (Vector3<f64>, Matrix3<f64>) {
        let eigen = self.inertia.symmetric_eigen();
        let rounding = 1e-14 * self.inertia.amax();
        let moments = eigen
            .eigenvalues
            .map(|moment| if moment > rounding { moment } else { 0.0 });
        (moments, eigen.eigenvectors)
    }

    /// Its mass matrix, 6×6, kg and kg m², for the translation of the centre of gravity and the
    /// rotation.
    pub(crate) fn mass_matrix(&self) -> Matrix6<f64> {
        let mut mass = Matrix6::from_diagonal_element(self.mass);
        mass.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.inertia);
        mass
    }

    /// Radius of gyration, m: the square root of half the sum of the principal moments over the
    /// mass.
    pub fn gyration(&self) -> f64 {
        (0.5 * self.inertia.trace() / self.mass).sqrt()
    }
}

/// A flexible body of k interface nodes and m modal coordinates.
///
/// Rows of its matrices are the translation, m, and the rotation, rad, of each node, then the
/// modal coordinates in the units of its files.
#[derive(Clone, Debug, PartialEq)]
pub struct FlexibleBody {
    /// Name of the body.
    pub name: String,
    /// Interface nodes, by index in [`Structure::nodes`].
    pub nodes: Vec<usize>,
    /// Mass matrix, 6k+m square, in kg with these units.
    pub mass: DMatrix<f64>,
    /// Stiffness matrix, 6k+m square, in N/m with these units. A rigid motion makes no force.
    pub stiffness: DMatrix<f64>,
    /// Loss factor of the material (no unit).
    pub loss_factor: f64,
    /// Damping ratio of each elastic mode of the free body (no unit).
    pub modal_damping: f64,
    /// Mass, kg.
    pub total: f64,
    /// Position of the centre of gravity, m.
    pub cog: Vector3<f64>,
}

impl FlexibleBody {
    /// Number m of modal coordinates.
    pub fn modes(&self) -> usize {
        self.mass.nrows() - 6 * self.nodes.len()
    }
}

/// An Euler–Bernoulli beam between two nodes, with or without mass.
#[derive(Clone, Debug, PartialEq)]
pub struct Beam {
    /// Name of the beam.
    pub name: String,
    /// End nodes p and q, by index.
    pub ends: [usize; 2],
    /// End stiffnesses.
    pub stiffness: Stiffness,
    /// Mass, kg, evenly spread over the length; 0 for a massless beam.
    pub mass: f64,
    /// Moment of inertia about the beam's own axis, kg m², evenly spread over the length.
    pub polar_inertia: f64,
    /// Number of equal elements that the beam is divided into, at least 1.
    pub segments: usize,
    /// Rotations about the local x, y and z axes that the joints at p and q release. That about x
    /// is released at one end at most.
    pub released: [[bool; 3]; 2],
    /// Loss factor of the material (no unit).
    pub loss_factor: f64,
    /// Viscous damper along the beam, N s/m.
    pub damper: f64,
    /// Axial force with which it is built in, N, tension positive.
    pub preload: f64,
    /// Local axes as rows: x from p to q, then y and z, unit vectors.
    pub axes: Matrix3<f64>,
    /// Length, m.
    pub length: f64,
}

impl Beam {
    /// The elements that the beam is divided into, from p to q, each as a beam of one element. The
    /// first and the last one have its joints.
    ///
    /// Damper and end nodes are those of the whole: they have no part.
    pub(crate) fn elements(&self) -> impl Iterator<Item = Self> {
        let last = self.segments - 1;
        (0..=last).map(move |i| {
            let mut element = self.part(self.segments);
            let [p, q] = self.released;
            if i == 0 {
                element.released[0] = p;
            }
            if i == last {
                element.released[1] = q;
            }
            element
        })
    }

    /// One of `parts` equal parts of the beam without its joints, as a beam of one element.
    ///
    /// Damper and end nodes are those of the whole, as for [`elements`](Self::elements).
    pub(crate) fn part(&self, parts: usize) -> Self {
        let parts = parts as f64;
        Self {
            length: self.length / parts,
            stiffness: Stiffness {
                axial: self.stiffness.axial * parts,
                bending: self.stiffness.bending.map(|plane| plane * parts),
                torsion: self.stiffness.torsion * parts,
            },
            mass: self.mass / parts,
            polar_inertia: self.polar_inertia / parts,
            segments: 1,
            released: [[false; 3]; 2],
            ..self.clone()
        }
    }
}

/// End stiffnesses of a beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffness {
    /// Axial stiffness EA/L, N/m.
    pub axial: f64,
    /// Bending stiffness EI/L in the planes of e3, e4 and of e5, e6, N m.
    pub bending: [f64; 2],
    /// Torsional stiffness GJ/L, N m.
    pub torsion: f64,
}

/// A spring of no length between two nodes, with its dampers.
///
/// It acts at one point, which each of the nodes moves as a rigid arm would. Its six stiffnesses
/// and dampers are along and about the local x, y and z axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Spring {
    /// Name of the spring.
    pub name: String,
    /// Nodes p and q, by index.
    pub ends: [usize; 2],
    /// Where it acts, midway between the nodes, m.
    pub at: Vector3<f64>,
    /// Local axes x, y and z as rows, unit vectors.
    pub axes: Matrix3<f64>,
    /// Stiffnesses, N/m and N m, of either sign.
    pub stiffness: Vector6<f64>,
    /// Viscous dampers, N s/m and N m s.
    pub damper: Vector6<f64>,
    /// Loss factor of the positive stiffnesses (no unit).
    pub loss_factor: f64,
}

/// A mass at a node.
#[derive(Clone, Debug, PartialEq)]
pub struct PointMass {
    /// The node that it moves with, by index.
    pub node: usize,
    /// Its name, mass and inertia; the centre of gravity is the position of the node.
    pub body: Body,
}

/// Damping that does not belong to single beams.
#[derive(Clone, Debug, PartialEq)]
pub struct Damping {
    /// Damping ratio of every mode that is not in `modes` (no unit).
    pub modal: f64,
    /// Damping ratios of the first modes, in ascending order of their frequency (no unit).
    pub modes: Vec<f64>,
    /// Rayleigh damping D = α·M + β·K: α, 1/s, and β, s.
    pub rayleigh: [f64; 2],
}

/// One deformation of one beam.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deformation {
    /// The beam, by its index in [`Structure::beams`].
    pub beam: usize,
    /// Component of the deformation: 0 to 5 for e1 to e6.
    pub component: usize,
}

/// A named direction at a node.
#[derive(Clone, Debug, PartialEq)]
pub struct Direction {
    /// Name of the sensor, input or output.
    pub name: String,
    /// The node, by its index in [`Structure::nodes`].
    pub node: usize,
    /// Unit vector of the positive direction.
    pub direction: Vector3<f64>,
}

/// One performance output.
#[derive(Clone, Debug, PartialEq)]
pub enum Performance {
    /// Second time derivative of a deformation, m/s².
    Deformation(Deformation),
    /// Absolute acceleration, m/s².
    Acceleration(Direction),
}

/// Objectives of the controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Sensors to feed back.
    pub feedback: FeedbackKind,
    /// Suspension frequency ω_n/2π, Hz.
    pub frequency: f64,
    /// Damping ratio ζ_n of the suspension (no unit).
    pub damping: f64,
    /// Upper limit for the peak sensitivity of the sampled loop (no unit).
    pub max_sensitivity: f64,
    /// Upper limit for the complementary sensitivity at high frequency.
    pub roll_off: Option<RollOff>,
    /// Structure of the control law.
    pub law: LawName,
    /// Objective of the search for the controller.
    pub minimise: Minimise,
    /// What forces and strokes of the legs cost in it.
    pub penalty: Option<Penalty>,
}

impl Target {
    /// Suspension frequency ω_n, rad/s.
    pub fn omega(&self) -> f64 {
        core::f64::consts::TAU * self.frequency
    }

    /// Frequency above which a suspension with the target's ω_n and ζ_n isolates, Hz: its
    /// transmissibility 1/(1 + 2ζ_n·s/ω_n + s²/ω_n²) is below 1/√2. At least ω_n/2π, also with
    /// more damping.
    pub fn isolation_hz(&self) -> f64 {
        let b = 1.0 - 2.0 * self.damping * self.damping;
        self.frequency * (b + b.hypot(1.0)).sqrt().max(1.0)
    }
}

/// A force or a moment on the machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Load {
    /// Where, and in what direction or about what axis.
    pub at: Direction,
    /// Whether it is a moment, N m, not a force, N.
    pub moment: bool,
}

impl Load {
    /// `"N m"` or `"N"`.
    pub fn unit(&self) -> &'static str {
        if self.moment { "N m" } else { "N" }
    }
}

/// The board with its converters, sensors and actuators.
#[derive(Clone, Debug, PartialEq)]
pub struct Board {
    /// Sample rate, Hz.
    pub sample_rate: f64,
    /// Delay from the sampling instant until the outputs are latched, s.
    pub latch_delay: f64,
    /// Input converters.
    pub adc: Adc,
    /// Noise of the ADC, rms, V.
    pub adc_noise: f64,
    /// Output converters.
    pub dac: Dac,
    /// Noise of the DAC, rms, V.
    pub dac_noise: f64,
    /// The sensors that are fed back; the accelerometers, if both kinds are.
    pub sensor: Sensor,
    /// The force sensors, if both kinds are fed back.
    pub beside: Option<Sensor>,
    /// Accelerometers, if the machine has them.
    pub accelerometer: Option<Sensor>,
    /// Force sensors, if the machine has them.
    pub force_sensor: Option<Sensor>,
    /// Measured gains of single channels.
    pub gains: ChannelGains,
    /// Force per volt at the DAC, N/V.
    pub actuator_gain: f64,
    /// Bandwidth of amplifier and actuator as a first-order low-pass, Hz.
    pub actuator_bandwidth: Option<f64>,
    /// Force limit of a leg in either direction, N.
    pub force_limit: f64,
    /// What piezo stacks do that is not linear, if the file describes them.
    pub piezo: Option<Piezo>,
}

/// The actuators of the legs with their amplifiers.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Actuator {
    /// Mean force per volt at the DAC, N/V, for small signals.
    pub(super) gain: f64,
    /// Gain of each leg over the mean (no unit).
    pub(super) shares: [f64; LEGS],
    /// Force limit of a leg in either direction, N.
    pub(super) limit: f64,
    /// Bandwidth of amplifier and actuator as a first-order low-pass, Hz.
    pub(super) bandwidth: Option<f64>,
    pub(super) piezo: Option<Piezo>,
}

/// What a piezo stack with its amplifier does that is not linear, in terms of the force that a
/// linear one with the gain of small signals would make.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piezo {
    /// The force at either end of the voltage range, N.
    pub half_range: f64,
    /// Width of the hysteresis loop over the whole voltage range as a fraction of the stroke (no
    /// unit), 0 to below 0.4.
    pub hysteresis: f64,
    /// Relative growth of an expansion in each decade of time (no unit).
    pub creep: f64,
    /// The fastest change of the force that the amplifier's current allows, N/s.
    pub rate: Option<f64>,
}

impl Piezo {
    /// The same stack with `factor` times the force.
    pub(super) fn scaled(self, factor: f64) -> Self {
        Self {
            half_range: factor * self.half_range,
            rate: self.rate.map(|rate| factor * rate),
            ..self
        }
    }

    /// The relative growth of the gain per newton of amplitude, 1/N: α of Rayleigh's law, in which a
    /// sine of amplitude a moves the stack by (1 + α·a) times as much as a small one.
    ///
    /// Over the whole range the loop is H of the stroke wide at its middle, and that width is
    /// α·a²: so α·a = 2H/(1 − 2H) at a = [`half_range`](Self::half_range).
    pub fn bend(&self) -> f64 {
        2.0 * self.hysteresis / (1.0 - 2.0 * self.hysteresis) / self.half_range
    }

    /// The describing function for a sine of `amplitude`, N, in terms of small signals: the complex
    /// gain of the fundamental, (1 + α·a) − j·4α·a/3π. Its lag is that of the loop.
    pub fn describing_function(&self, amplitude: f64) -> Complex<f64> {
        let growth = self.bend() * amplitude;
        Complex::new(1.0 + growth, -4.0 / (3.0 * core::f64::consts::PI) * growth)
    }

    /// The highest frequency of a sine of `amplitude`, N, that the amplifier's current allows, Hz;
    /// infinite without a limit.
    pub fn fastest(&self, amplitude: f64) -> f64 {
        self.rate.map_or(f64::INFINITY, |rate| {
            rate / (core::f64::consts::TAU * amplitude)
        })
    }
}

impl Board {
    /// Sample period T, s.
    pub fn period(&self) -> f64 {
        1.0 / self.sample_rate
    }

    /// Total delay of the loop, from the sample to the middle of the hold, s.
    pub fn whole_delay(&self) -> f64 {
        self.latch_delay + 0.5 * self.period()
    }

    /// The calibrations of the sensors that are fed back: of [`sensor`](Self::sensor), and of
    /// [`beside`](Self::beside).
    pub fn calibrations(&self) -> ([Calibration; LEGS], Option<[Calibration; LEGS]>) {
        let of = |sensor: &Sensor, gains: [f64; LEGS]| {
            gains.map(|gain| self.adc.calibration(sensor.sensitivity * gain))
        };
        let [own, beside] = self.gains.sensors;
        let forces = self.beside.as_ref().map(|sensor| of(sensor, beside));
        (of(&self.sensor, own), forces)
    }

    /// The drives of the legs.
    pub fn drives(&self) -> [Drive; LEGS] {
        let drive = |gain| self.dac.drive(self.actuator_gain * gain, self.force_limit);
        self.gains.actuators.map(drive)
    }

    /// The forces that `dac` commands, N, without noise.
    pub(crate) fn forces(&self, dac: [DacCode; LEGS]) -> [f64; LEGS] {
        core::array::from_fn(|leg| {
            let gain = self.actuator_gain * self.gains.actuators[leg];
            self.dac.force(dac[leg], gain)
        })
    }

    /// The sensors that are fed back, by kind: [`sensor`](Self::sensor), then
    /// [`beside`](Self::beside).
    pub fn fed_back(&self) -> impl Iterator<Item = &Sensor> {
        [Some(&self.sensor), self.beside.as_ref()]
            .into_iter()
            .flatten()
    }
}

/// Gains of single channels relative to those of their kind (no unit).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelGains {
    /// Of the sensors that are fed back, by kind, in the order of [`Board::fed_back`].
    pub sensors: [[f64; LEGS]; 2],
    /// Of the actuators.
    pub actuators: [f64; LEGS],
}

/// Standard deviations of the numbers of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uncertainty {
    /// Of the mass of each rigid body and point mass, relative (no unit).
    pub mass: f64,
    /// Of each second moment ∫x² dm of a rigid body along a principal axis, apart from that of its
    /// mass, relative (no unit).
    pub inertia: f64,
    /// Of each coordinate of the centre of gravity of a rigid body, m.
    pub cog: f64,
    /// Of the stiffness of each beam and spring, and of those of bending and torsion of each beam
    /// apart from that, relative (no unit).
    pub stiffness: f64,
    /// Of the modal damping of each mode, and of all other damping together, relative (no unit).
    pub damping: f64,
    /// Of the gain of each sensor, relative (no unit).
    pub sensor_gain: f64,
    /// Of the direction of each accelerometer about both axes across it, rad.
    pub misalignment: f64,
    /// Of the gain of each actuator, relative (no unit).
    pub actuator_gain: f64,
    /// Of the delay of amplifiers and sensors beside what the file gives, s.
    pub delay: f64,
}

/// How machines are perturbed for the Monte Carlo run; all distributions are uniform.
#[derive(Clone, Debug, PartialEq)]
pub struct Robustness {
    /// The bodies that vary, by index.
    pub payload: Vec<usize>,
    /// Largest relative change of their mass and inertia (no unit).
    pub mass: f64,
    /// Largest shift of their centre of gravity along each axis, m.
    pub cog: f64,
    /// Largest relative change of each leg's stiffness (no unit).
    pub leg_stiffness: f64,
    /// Largest relative change of all damping (no unit).
    pub damping: f64,
    /// Largest relative error of each sensor's gain (no unit).
    pub sensor_gain: f64,
    /// Largest error of each accelerometer's direction, rad.
    pub misalignment: f64,
    /// Largest relative error of each actuator's gain (no unit).
    pub actuator_gain: f64,
    /// Largest change of the delay from the sample to the latched outputs, s.
    pub delay: f64,
    /// Number of machines to draw.
    pub samples: usize,
    /// Seed of the random numbers.
    pub seed: u64,
}

/// A sensor with its amplifier.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Sensitivity with the amplifier, V/(m/s²) or V/N.
    pub sensitivity: f64,
    /// Noise density, m/s²/√Hz or N/√Hz.
    pub noise_density: NoiseDensity,
    /// Offset voltage at the converter, V.
    pub offset: f64,
    /// Bandwidth of sensor and amplifier as a first-order low-pass, Hz.
    pub bandwidth: Option<f64>,
    /// High-pass at low frequency.
    pub lower_corner: Option<LowerCorner>,
    /// Resonance of the sensor, a low-pass of second order.
    pub resonance: Option<Resonance>,
    /// Largest part of an acceleration across its axis that the sensor reads (no unit).
    pub transverse: f64,
}

/// The high-pass of a sensor that does not measure constant values, with its corner (−3 dB), Hz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LowerCorner {
    /// s/(s + ω).
    First(f64),
    /// Butterworth, s²/(s² + √2ωs + ω²).
    Second(f64),
}

impl LowerCorner {
    /// The corner, Hz.
    pub fn hz(self) -> f64 {
        match self {
            Self::First(hz) | Self::Second(hz) => hz,
        }
    }
}

impl Sensor {
    /// The delay of bandwidth and resonance far below both, s.
    pub fn delay(&self) -> f64 {
        let lag = self.bandwidth.map_or(0.0, |hz| 1.0 / hz);
        let resonance = self
            .resonance
            .map_or(0.0, |peak| 2.0 * peak.damping / peak.hz);
        (lag + resonance) / core::f64::consts::TAU
    }
}

/// Whether any of these has damping of its own.
pub(super) fn has_damped_parts(
    beams: &[Beam],
    springs: &[Spring],
    flexible: &[FlexibleBody],
) -> bool {
    let of_beam = |beam: &Beam| beam.loss_factor != 0.0 || beam.damper != 0.0;
    let of_spring = |spring: &Spring| spring.loss_factor != 0.0 || spring.damper.amax() != 0.0;
    let of_body = |body: &FlexibleBody| body.loss_factor != 0.0 || body.modal_damping != 0.0;
    beams.iter().any(of_beam) || springs.iter().any(of_spring) || flexible.iter().any(of_body)
}

impl Structure {
    /// The files that the machine was read from, with their texts: the one asked for, then
    /// those it is based on. None for a machine that was built in code.
    pub fn files(&self) -> impl Iterator<Item = (&Path, &str)> {
        self.source.files()
    }

    /// Whether anything damps but modal damping.
    pub(crate) fn has_other_damping(&self) -> bool {
        self.damping.rayleigh != [0.0; 2]
            || has_damped_parts(&self.beams, &self.springs, &self.flexible)
    }

    /// Multiplies all damping by `factor`: modal and Rayleigh damping, loss factors, dampers.
    pub(crate) fn scale_damping(&mut self, factor: f64) {
        let Damping {
            modal,
            modes,
            rayleigh,
        } = &mut self.damping;
        *modal *= factor;
        for x in modes.iter_mut().chain(rayleigh) {
            *x *= factor;
        }
        for body in &mut self.flexible {
            body.loss_factor *= factor;
            body.modal_damping *= factor;
        }
        for beam in &mut self.beams {
            beam.loss_factor *= factor;
            beam.damper *= factor;
        }
        for spring in &mut self.springs {
            spring.loss_factor *= factor;
            spring.damper *= factor;
        }
    }

    /// `error` with its place in this machine's file.
    pub(crate) fn locate(&self, error: EntryError) -> MachineError {
        self.source.locate(error)
    }

    /// Name of a deformation, such as `"leg4.e1"`.
    pub fn deformation_name(&self, deformation: Deformation) -> String {
        format!(
            "{}.e{}",
            self.beams[deformation.beam].name,
            deformation.component + 1
        )
    }
}

impl Machine {
    /// The same machine with other sensors fed back; None if it or its board does not have
    /// them.
    pub fn with_feedback(&self, feedback: FeedbackKind) -> Option<Self> {
        let of_board = &self.board;
        let accelerometer = self.accelerometers.as_ref();
        let accelerometer = accelerometer.and(of_board.accelerometer.clone());
        let force_sensor = self.force_sensors.and(of_board.force_sensor.clone());
        let (sensor, beside) = match feedback {
            FeedbackKind::Acceleration => (accelerometer?, None),
            FeedbackKind::Force => (force_sensor?, None),
            FeedbackKind::Both => (accelerometer?, Some(force_sensor?)),
        };
        let mut machine = self.clone();
        machine.target.feedback = feedback;
        machine.description.control.feedback = feedback;
        machine.board.sensor = sensor;
        machine.board.beside = beside;
        Some(machine)
    }

    /// The same machine with each kind of feedback that it has sensors for: acceleration,
    /// force, both.
    pub fn by_feedback(&self) -> Vec<Self> {
        let mut machines = Vec::new();
        for feedback in [
            FeedbackKind::Acceleration,
            FeedbackKind::Force,
            FeedbackKind::Both,
        ] {
            // Only the modal law takes both kinds.
            if feedback == FeedbackKind::Both && self.target.law == LawName::Direct {
                continue;
            }
            machines.extend(self.with_feedback(feedback));
        }
        machines
    }

    /// Everything that a search for a controller reads, as text: two machines with equal
    /// texts have equal controllers. Unlike the digest, it is that of the machine as it is
    /// now, not as its file described it.
    pub fn search_inputs(&self) -> String {
        // Without `..`: whoever adds a field decides here whether the search reads it.
        let Self {
            structure:
                Structure {
                    nodes,
                    bodies,
                    flexible,
                    beams,
                    springs,
                    point_masses,
                    gravity,
                    damping,
                    name: _,
                    source: _,
                },
            coordinates,
            actuators,
            accelerometers,
            force_sensors,
            floor,
            rotation,
            waves,
            spectrum,
            performance,
            loads: _,
            bands,
            exposure,
            target,
            board,
            simulation,
            robustness,
            gain_errors,
            supervision: _,
            shapes: _,
            uncertainty: _,
            provenance: _,
            digest: _,
            description: _,
        } = self;
        let shaken = match target.minimise {
            Minimise::Peaks => None,
            Minimise::Rms | Minimise::Average | Minimise::Deviation => Some((
                simulation.floor_band,
                simulation.floor_rms,
                spectrum,
                rotation,
                waves,
                exposure,
            )),
        };
        // Debug prints numbers in the shortest form that reads back to the same bits.
        format!(
            "{nodes:?} {bodies:?} {flexible:?} {beams:?} {springs:?} {point_masses:?} {coordinates:?} {actuators:?} {accelerometers:?} {force_sensors:?} {floor:?} {performance:?} {bands:?} {gravity:?} {damping:?} {target:?} {board:?} {robustness:?} {gain_errors:?} {shaken:?}"
        )
    }

    /// Randomly perturbed machine number `index`, as [`Robustness`] says: mass, inertia and centre
    /// of gravity of the payload, stiffness of every leg, damping, gains and directions of
    /// sensors, gains of actuators, and delay. Each index has its own random stream, so the order
    /// does not matter.
    pub fn drawn(&self, index: usize) -> Self {
        self.drawn_with(&self.robustness, index)
    }

    /// The same with other `settings` than those of the file.
    pub fn drawn_with(&self, settings: &Robustness, index: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(settings.seed);
        random.set_stream(index as u64);
        // Uniform between −1 and 1.
        let mut uniform = || (random.next_u64() >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
        let mut machine = self.clone();
        for &i in &settings.payload {
            let body = &mut machine.bodies[i];
            let factor = 1.0 + settings.mass * uniform();
            body.mass *= factor;
            body.inertia *= factor;
            for x in body.cog.iter_mut() {
                *x += settings.cog * uniform();
            }
        }
        for &leg in &machine.actuators {
            let stiffness = &mut machine.structure.beams[leg].stiffness;
            let factor = 1.0 + settings.leg_stiffness * uniform();
            stiffness.axial *= factor;
            stiffness.torsion *= factor;
            stiffness.bending = stiffness.bending.map(|x| x * factor);
        }
        machine.scale_damping(1.0 + settings.damping * uniform());
        for sensor in machine.accelerometers.iter_mut().flatten() {
            // About an axis across it, evenly drawn around.
            let turn = Vector3::from_fn(|_, _| uniform()).cross(&sensor.direction);
            let length = turn.norm();
            let angle = settings.misalignment * uniform();
            if length > 0.0 {
                let axis = Unit::new_unchecked(turn / length);
                sensor.direction = Rotation3::from_axis_angle(&axis, angle) * sensor.direction;
            }
        }
        let gains = &mut machine.gain_errors;
        for gain in gains.sensors.iter_mut().flatten() {
            *gain = settings.sensor_gain * uniform();
        }
        for gain in &mut gains.actuators {
            *gain = settings.actuator_gain * uniform();
        }
        let latch = &mut machine.board.latch_delay;
        *latch = (*latch + settings.delay * uniform()).max(0.0);
        machine
    }

    /// The machine file as data, with all defaults filled in. Change it and
    /// [`build`](Self::build) it to get a variant of the machine.
    pub fn description(&self) -> &MachineFile {
        &self.description
    }

    /// Names of the sensors that `feedback` uses, in channel order; a force sensor has the
    /// name of its leg.
    pub fn sensor_names(&self, feedback: FeedbackKind) -> Vec<String> {
        let accelerometers = || self.accelerometers.iter().flatten();
        let legs = || self.force_sensors.iter().flatten();
        let mut names = Vec::new();
        if feedback != FeedbackKind::Force {
            names.extend(accelerometers().map(|sensor| sensor.name.clone()));
        }
        if feedback != FeedbackKind::Acceleration {
            names.extend(legs().map(|&leg| self.beams[leg].name.clone()));
        }
        names
    }

    /// The units of the sensors of [`sensor_names`](Self::sensor_names), in ASCII: `m/s^2` or `N`.
    pub fn sensor_units(&self, feedback: FeedbackKind) -> Vec<&'static str> {
        let kinds: &[_] = match feedback {
            FeedbackKind::Acceleration => &["m/s^2"],
            FeedbackKind::Force => &["N"],
            FeedbackKind::Both => &["m/s^2", "N"],
        };
        kinds.iter().flat_map(|unit| [*unit; LEGS]).collect()
    }

    /// The motion of the floor: its spectrum, or else white with the rms of `simulation` over the
    /// band of `simulation`.
    pub fn floor_motion(&self) -> Floor {
        let Simulation {
            floor_rms,
            floor_band: [low, high],
            ..
        } = self.simulation;
        let white = || Floor::White(floor_rms / (high - low).sqrt());
        self.spectrum.clone().unwrap_or_else(white)
    }

    /// The same, without motion outside the band of `simulation` where the file has no spectrum.
    pub(crate) fn floor_in_band(&self) -> Floor {
        let floor = self.floor_motion();
        match &floor {
            Floor::White(density) => {
                let edges = self.simulation.floor_band.map(|hz| [hz, *density]);
                Spectrum::new(&edges).map_or(floor, Floor::Table)
            }
            _ => floor,
        }
    }

    /// What the search for a controller minimises the rms of; none if it minimises peaks.
    pub(crate) fn measure(&self) -> Option<Measure> {
        match self.target.minimise {
            Minimise::Peaks => None,
            Minimise::Rms => Some(Measure::Acceleration),
            Minimise::Average => self.exposure.map(Measure::Average),
            Minimise::Deviation => self.exposure.map(Measure::Deviation),
        }
    }

    /// Names of the performance outputs.
    pub fn performance_names(&self) -> Vec<String> {
        self.performance
            .iter()
            .map(|output| match output {
                Performance::Deformation(d) => self.deformation_name(*d),
                Performance::Acceleration(d) => d.name.clone(),
            })
            .collect()
    }
}
