//! The machine file as written: TOML, SI units, angles in none.
//!
//! Every key is described in `docs/machine-file.md`. This module only says what
//! may stand where; [`super::Machine`] is what has been checked.

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The whole file.
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct File {
    /// Layout of the file; 1.
    #[schemars(range(min = 1, max = 1))]
    pub format: u32,
    /// What the machine is called.
    #[schemars(regex(pattern = "^[a-z][a-z0-9-]*$"))]
    pub name: String,
    /// Acceleration of gravity, m/s²; none if not given.
    #[serde(default)]
    pub gravity: [f64; 3],
    /// Positions, m.
    pub nodes: IndexMap<String, [f64; 3]>,
    /// The moving base.
    pub base: Base,
    /// Rigid bodies.
    pub bodies: IndexMap<String, Body>,
    /// Stiffness sets that beams share by name.
    #[serde(default)]
    pub profiles: IndexMap<String, Profile>,
    /// Massless beams.
    pub beams: IndexMap<String, Beam>,
    /// The degrees of freedom q_d.
    pub coordinates: Coordinates,
    /// Beams with an actuator along them.
    pub actuators: Actuators,
    /// Feedback sensors.
    pub sensors: Sensors,
    /// Rheonomic inputs.
    pub floor: Floor,
    /// What is judged.
    pub performance: Performance,
    /// Damping of the whole; that of single beams stands with them.
    #[serde(default)]
    pub damping: Damping,
    /// The control target.
    pub control: Control,
    /// The board.
    pub board: Board,
    /// When the supervisor acts.
    #[serde(default)]
    pub supervision: Supervision,
    /// The standard run in simulation. Not part of the digest.
    #[serde(default, skip_serializing)]
    pub simulation: Simulation,
    /// The Monte Carlo run. Not part of the digest.
    #[serde(default, skip_serializing)]
    pub robustness: Robustness,
    /// Where the numbers come from. Not part of the digest.
    #[serde(default, skip_serializing)]
    pub provenance: Vec<Provenance>,
}

/// `[base]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Base {
    /// Nodes that move with the base.
    pub nodes: Vec<String>,
}

/// `[bodies.NAME]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// kg.
    #[schemars(range(min = 0))]
    pub mass: f64,
    /// About the body's own centre of gravity, kg m²: `[Ixx, Iyy, Izz]`, or
    /// the full tensor as three rows.
    pub inertia: Inertia,
    /// Centre of gravity, m.
    pub cog: [f64; 3],
    /// Nodes that move with the body.
    pub nodes: Vec<String>,
}

/// Inertia in either notation.
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(
    untagged,
    expecting = "inertia is three principal moments [Ixx, Iyy, Izz] or three rows of the tensor, kg m²"
)]
pub enum Inertia {
    /// Principal moments about the axes of the file.
    Diagonal([f64; 3]),
    /// Symmetric tensor by rows.
    Tensor([[f64; 3]; 3]),
}

/// `[profiles.NAME]`, or given with the beam: either the end stiffnesses or
/// material and section.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// EA/L, N/m.
    pub axial: Option<f64>,
    /// EI/L in the planes of `e3, e4` and of `e5, e6`, N m.
    pub bending: Option<[f64; 2]>,
    /// GJ/L, N m.
    pub torsion: Option<f64>,
    /// Young's modulus E, Pa.
    pub youngs_modulus: Option<f64>,
    /// Shear modulus G, Pa.
    pub shear_modulus: Option<f64>,
    /// Cross-section A, m².
    pub area: Option<f64>,
    /// Second moments of area for bending in the planes of `e3, e4` and of
    /// `e5, e6`, m⁴.
    pub second_moments: Option<[f64; 2]>,
    /// Torsion constant J, m⁴.
    pub torsion_constant: Option<f64>,
    /// Loss factor of the material.
    pub loss_factor: Option<f64>,
    /// A damper along the beam, N s/m.
    pub damper: Option<f64>,
}

/// `[beams.NAME]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Beam {
    /// From the first to the second; e1 grows as they part.
    pub nodes: [String; 2],
    /// A shared stiffness set.
    pub profile: Option<String>,
    /// The beam's own.
    pub stiffness: Option<Profile>,
    /// Roughly the direction of the local y axis; found if not given.
    pub y_axis: Option<[f64; 3]>,
}

/// `[coordinates]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Coordinates {
    /// `"BEAM.e1"` to `"BEAM.e6"`.
    pub deformations: Vec<String>,
}

/// `[actuators]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Actuators {
    /// The six legs, in channel order.
    pub beams: Vec<String>,
}

/// `[sensors]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Sensors {
    /// Accelerometers, in channel order.
    #[serde(default)]
    pub acceleration: IndexMap<String, NodeDirection>,
    /// Leg force sensors, in channel order.
    #[serde(default)]
    pub force: IndexMap<String, ForceSensor>,
}

/// A direction at a node.
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct NodeDirection {
    /// Where.
    pub node: String,
    /// Unit vector.
    pub direction: [f64; 3],
}

/// A force sensor in a leg.
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ForceSensor {
    /// Which.
    pub beam: String,
}

/// `[floor]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Floor {
    /// Six directions at base nodes, which fix the motion of the rigid base.
    pub inputs: IndexMap<String, NodeDirection>,
}

/// `[performance]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Performance {
    /// Second time derivatives of deformations, `"BEAM.e1"` to `"BEAM.e6"`.
    #[serde(default)]
    pub deformations: Vec<String>,
    /// Absolute accelerations.
    #[serde(default)]
    pub accelerations: IndexMap<String, NodeDirection>,
    /// Bands whose worst peak is reported, Hz.
    #[serde(default)]
    pub bands: IndexMap<String, [f64; 2]>,
}

/// `[damping]`
#[derive(Debug, Default, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Damping {
    /// Relative damping of every mode.
    pub modal: Option<f64>,
    /// α, 1/s, and β, s, of D = α·M + β·K.
    pub rayleigh: Option<[f64; 2]>,
}

/// `[control]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Control {
    /// `"acceleration"`, `"force"` or `"both"`.
    pub feedback: Feedback,
    /// The corner the suspension is to get, ω_n/2π, Hz.
    pub frequency: f64,
    /// Its relative damping ζ_n.
    pub damping: f64,
    /// The peak sensitivity the sampled loop may have.
    #[serde(default = "two")]
    pub max_sensitivity: f64,
    /// How sensors become forces.
    #[serde(default)]
    pub law: LawName,
    /// What the shaping makes small.
    #[serde(default)]
    pub minimise: Minimise,
}

/// How sensors become forces.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum LawName {
    /// Through the modes, each shaped by itself.
    #[default]
    Modal,
    /// By the matrices of Eq. (14), one roll-off for all.
    Direct,
}

/// What the shaping makes small.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Minimise {
    /// The peaks of σ_max(G11) in the bands of `performance`.
    #[default]
    Peaks,
    /// The rms of the performance outputs on the floor of `simulation`.
    Rms,
}

fn two() -> f64 {
    2.0
}

/// What the loop feeds back.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Feedback {
    /// Frame accelerations (Eq. 12).
    Acceleration,
    /// Leg forces (Eq. 11).
    Force,
    /// Accelerations at low and forces at high frequency.
    Both,
}

impl Feedback {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Acceleration, Self::Force, Self::Both];

    /// `"acceleration"`, `"force"` or `"both"`, as in the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Acceleration => "acceleration",
            Self::Force => "force",
            Self::Both => "both",
        }
    }
}

/// A name that is none of a kind of feedback.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not a kind of feedback: write acceleration, force or both")]
pub struct UnknownFeedback;

impl core::str::FromStr for Feedback {
    type Err = UnknownFeedback;

    fn from_str(name: &str) -> Result<Self, UnknownFeedback> {
        let mut all = Self::ALL.into_iter();
        all.find(|feedback| feedback.name() == name)
            .ok_or(UnknownFeedback)
    }
}

/// `[board]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Hz.
    #[schemars(range(min = 0))]
    pub sample_rate: f64,
    /// From the sampling instant until the code is read, s.
    pub conversion_delay: f64,
    /// From there until the output is latched, s.
    pub output_delay: f64,
    /// The six inputs.
    pub adc: Adc,
    /// The six outputs.
    pub dac: Dac,
    /// Accelerometers with their amplifiers.
    pub accelerometer: Option<Sensor>,
    /// Force sensors with their amplifiers.
    pub force_sensor: Option<Sensor>,
    /// Piezo with amplifier.
    pub actuator: Actuator,
}

/// `[board.adc]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Adc {
    /// 8 to 16.
    #[schemars(range(min = 8, max = 16))]
    pub bits: u32,
    /// ±, V.
    pub range: f64,
    /// rms, V.
    #[serde(default)]
    pub noise: f64,
}

/// `[board.dac]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Dac {
    /// 8 to 16.
    #[schemars(range(min = 8, max = 16))]
    pub bits: u32,
    /// Low and high end, V; the middle is no force.
    pub range: [f64; 2],
    /// rms, V.
    #[serde(default)]
    pub noise: f64,
}

/// `[board.accelerometer]`, `[board.force_sensor]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// V per m/s² or V per N, amplifier included.
    pub sensitivity: f64,
    /// White noise, m/s²/√Hz or N/√Hz.
    #[serde(default)]
    pub noise_density: f64,
    /// V.
    #[serde(default)]
    pub offset: f64,
    /// First-order lag, Hz.
    pub bandwidth: Option<f64>,
}

/// `[board.actuator]`
#[derive(Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Actuator {
    /// N per V at the DAC.
    pub gain: f64,
    /// Largest force either way, N.
    pub limit: f64,
    /// First-order lag, Hz.
    pub bandwidth: Option<f64>,
}

/// `[supervision]`
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Supervision {
    /// Soft start and stop, s.
    pub soft_start: f64,
    /// A soft start's wait for the machine to come to rest, and the time after it
    /// over which the sensors' offsets are taken, s.
    pub settle: f64,
    /// From a fault to the safe codes, s.
    pub safe_ramp: f64,
    /// A sensor this long at a rail is a fault, s.
    pub rail: f64,
    /// A sensor this long at one code is a fault, s; 0 to leave it out. If not
    /// given, 0.1, or 0 where sensor and ADC are too quiet for that.
    pub stuck: Option<f64>,
    /// One code this far from those before and after it is a spike, codes; 0 to leave
    /// it out. If not given, twenty times the noise and at least 48.
    pub spike: Option<u16>,
    /// So many spikes within a second are a fault.
    pub spikes: u32,
    /// So many samples in a row not read are a fault.
    pub lost: u32,
    /// More deadlines missed in a window are a fault.
    pub late: u32,
    /// Clamped for so long is a fault, s. If not given, one period of
    /// `control.frequency`.
    pub saturated: Option<f64>,
    /// Nobody heard on the link for this long while the legs are driven is a
    /// fault, s; 0 to leave it out.
    pub silence: f64,
    /// Length of a window, s.
    pub window: f64,
    /// Forces whose power grows by this factor from window to window diverge,
    pub growth: f64,
    /// if they do so many windows in a row
    pub grown: u32,
    /// and come to this part of their limit.
    pub level: f64,
    /// A sensor is implausible whose rms is this many times the median of its kind,
    pub wild: f64,
    /// or so many times less than that,
    pub dull: f64,
    /// for so many windows in a row.
    pub strange: u32,
    /// The self-test's push, part of a leg's limit.
    pub test_force: f64,
    /// How long the self-test measures a leg, s.
    pub test_time: f64,
    /// The pilot's push with the loop closed, N; 0 to leave it out. If not given, so
    /// much that its answer stands far above the sensors' noise.
    pub pilot: Option<f64>,
    /// How long the pilot measures a leg, s.
    pub pilot_time: f64,
    /// How far an answer may be off, part of what it should be.
    pub test_tolerance: f64,
}

impl Default for Supervision {
    fn default() -> Self {
        Self {
            soft_start: 2.0,
            settle: 2.0,
            safe_ramp: 0.05,
            rail: 0.005,
            stuck: None,
            spike: None,
            spikes: 5,
            lost: 3,
            late: 3,
            saturated: None,
            silence: 0.0,
            window: 0.05,
            growth: 1.5,
            grown: 6,
            level: 0.1,
            wild: 20.0,
            dull: 6.0,
            strange: 20,
            test_force: 0.05,
            test_time: 0.25,
            pilot: None,
            pilot_time: 0.5,
            test_tolerance: 0.4,
        }
    }
}

/// `[simulation]`
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Simulation {
    /// Measured time, s.
    pub duration: f64,
    /// Time before it, s.
    pub settling: f64,
    /// Floor acceleration, rms of each input, m/s².
    pub floor_rms: f64,
    /// Its band, Hz.
    pub floor_band: [f64; 2],
    /// Of the random numbers.
    pub seed: u64,
}

impl Default for Simulation {
    fn default() -> Self {
        Self {
            duration: 20.0,
            settling: 10.0,
            floor_rms: 1e-3,
            floor_band: [1.0, 200.0],
            seed: 1,
        }
    }
}

/// `[robustness]`
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Robustness {
    /// Bodies whose mass and centre of gravity vary; those without a leg if
    /// not given.
    pub payload: Option<Vec<String>>,
    /// Part of the payload's mass and inertia, either way.
    pub mass: f64,
    /// Shift of its centre of gravity along each axis, either way, m.
    pub cog: f64,
    /// Part of each leg's stiffness, either way.
    pub leg_stiffness: f64,
    /// How many machines to draw.
    pub samples: usize,
    /// Of the random numbers.
    pub seed: u64,
}

impl Default for Robustness {
    fn default() -> Self {
        Self {
            payload: None,
            mass: 0.2,
            cog: 0.02,
            leg_stiffness: 0.1,
            samples: 200,
            seed: 1,
        }
    }
}

/// `[[provenance]]`
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Keys of this file, such as `"nodes.n3"` or `"bodies.lens.cog"`; a key
    /// covers all below it.
    pub entries: Vec<String>,
    /// How sure the numbers are.
    pub kind: Certainty,
    /// From what.
    pub from: String,
}

/// How sure a number is.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Certainty {
    /// A source states it.
    Published,
    /// Follows from what a source states.
    Reconstructed,
    /// Chosen.
    Assumed,
}
