//! The machine file as data: one Rust type per table of the file.
//!
//! TOML files are read into these types, and code can fill them in directly;
//! [`Machine::build`](super::Machine::build) checks both in the same way. The types say
//! which keys a table has; [`Machine`](super::Machine) is what has been checked. SI
//! units, frequencies in Hz. A type named `…Entry` is only the file's form of something;
//! the others are kept by `Machine` as they are.
//!
//! The docs of each field are the hover text of that key in an editor (JSON Schema).
//! `docs/machine-file.md` describes all keys with their background.
//!
//! A machine in code: a disc on six legs, controlled to 2 Hz.
//!
//! ```
//! use std::f64::consts::TAU;
//!
//! use host_gen::machine::file::*;
//! use host_gen::machine::{FeedbackKind, LawName, Machine, Minimise, Simulation, SupervisionSettings};
//!
//! let on_circle = |radius: f64, degrees: f64, z: f64| {
//!     let (sin, cos) = degrees.to_radians().sin_cos();
//!     [radius * cos, radius * sin, z]
//! };
//! let at = |node: String, direction| DirectionEntry { node, direction };
//! let mut file = MachineFile {
//!     format: 1,
//!     name: "disc".to_owned(),
//!     gravity: [0.0; 3],
//!     nodes: Default::default(),
//!     base: BaseEntry::default(),
//!     free: FreeEntry::default(),
//!     bodies: Default::default(),
//!     flexible_bodies: Default::default(),
//!     profiles: Default::default(),
//!     beams: Default::default(),
//!     springs: Default::default(),
//!     point_masses: Default::default(),
//!     loads: Default::default(),
//!     coordinates: CoordinatesEntry::default(),
//!     actuators: ActuatorsEntry::default(),
//!     sensors: SensorsEntry::default(),
//!     floor: FloorEntry::default(),
//!     performance: PerformanceEntry::default(),
//!     damping: DampingEntry::default(),
//!     control: ControlEntry {
//!         feedback: FeedbackKind::Acceleration,
//!         frequency: 2.0,
//!         damping: 0.7,
//!         max_sensitivity: 2.0,
//!         law: LawName::Modal,
//!         roll_off: None,
//!         minimise: Minimise::Peaks,
//!         penalty: None,
//!         shapes: None,
//!     },
//!     board: BoardEntry {
//!         sample_rate: 20e3,
//!         conversion_delay: 10e-6,
//!         output_delay: 40e-6,
//!         adc: AdcEntry { bits: 16, range: 10.0, noise: 0.2e-3 },
//!         dac: DacEntry { bits: 16, range: [0.0, 5.0], noise: 50e-6 },
//!         accelerometer: Some(SensorEntry {
//!             sensitivity: 20.0,
//!             noise_density: 1e-7.into(),
//!             offset: 0.0,
//!             bandwidth: None,
//!             lower_corner: None,
//!             lower_order: None,
//!             transverse: None,
//!             resonance: None,
//!         }),
//!         force_sensor: None,
//!         actuator: ActuatorEntry { gain: Some(100.0), limit: Some(200.0), ..ActuatorEntry::default() },
//!         gains: GainsEntry::default(),
//!     },
//!     supervision: SupervisionSettings::default(),
//!     simulation: Simulation::default(),
//!     robustness: RobustnessEntry::default(),
//!     uncertainty: UncertaintyEntry::default(),
//!     provenance: Vec::new(),
//! };
//! let mut on_disc = Vec::new();
//! for leg in 0..6 {
//!     let degrees = 60.0 * f64::from(leg);
//!     let lean = if leg % 2 == 0 { 15.0 } else { -15.0 };
//!     let (top, foot) = (format!("top{leg}"), format!("foot{leg}"));
//!     file.nodes.insert(top.clone(), on_circle(0.5, degrees, 0.0));
//!     file.nodes.insert(foot.clone(), on_circle(0.5, degrees + lean, -0.2));
//!     file.base.nodes.push(foot.clone());
//!     on_disc.push(top.clone());
//!     let name = format!("leg{leg}");
//!     file.beams.insert(
//!         name.clone(),
//!         BeamEntry {
//!             nodes: [foot.clone(), top.clone()],
//!             stiffness: Some(ProfileEntry {
//!                 axial: Some(8e6),
//!                 bending: Some([400.0, 400.0]),
//!                 torsion: Some(6.0),
//!                 ..ProfileEntry::default()
//!             }),
//!             ..BeamEntry::default()
//!         },
//!     );
//!     file.coordinates.deformations.push(format!("{name}.e1"));
//!     file.actuators.beams.push(name);
//!     // Along the circle and upwards, by turns.
//!     let (sin, cos) = degrees.to_radians().sin_cos();
//!     let direction = if leg % 2 == 0 { [-sin, cos, 0.0] } else { [0.0, 0.0, 1.0] };
//!     let sensors = &mut file.sensors.acceleration;
//!     sensors.insert(format!("a{leg}"), at(top.clone(), direction));
//!     file.floor.inputs.insert(format!("floor{leg}"), at(foot, direction));
//!     let outputs = &mut file.performance.accelerations;
//!     outputs.insert(format!("w{leg}"), at(top, direction));
//! }
//! file.bodies.insert(
//!     "disc".to_owned(),
//!     BodyEntry {
//!         mass: 700.0,
//!         inertia: Inertia::Diagonal([44.0, 44.0, 88.0]),
//!         cog: [0.0; 3],
//!         nodes: on_disc,
//!     },
//! );
//!
//! let machine = Machine::build(file.clone())?;
//! assert_eq!(machine.target.omega(), TAU * 2.0);
//!
//! // A refusal names the entry, as it does for a file.
//! file.bodies["disc"].mass = -700.0;
//! let error = Machine::build(file).unwrap_err();
//! assert_eq!(error.entry(), "bodies.disc.mass");
//! assert_eq!(error.message(), "mass must be above 0 kg, not -700");
//! # Ok::<(), host_gen::machine::MachineError>(())
//! ```

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The whole machine file.
///
/// Serialised, it leaves out [`simulation`](Self::simulation),
/// [`robustness`](Self::robustness), [`loads`](Self::loads) and [`provenance`](Self::provenance),
/// which the digest of a machine does not cover.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct MachineFile {
    /// Version of the file format: 1.
    #[schemars(range(min = 1, max = 1))]
    pub format: u32,
    /// Name of the machine: lower-case letters, digits and hyphens, a letter first. The
    /// generated table's file is named after it.
    #[schemars(regex(pattern = "^[a-z][a-z0-9-]*$"))]
    pub name: String,
    /// Acceleration of gravity `[x, y, z]`, m/s². Default: no gravity. With gravity, the
    /// geometry is that of the loaded machine, and static loads change the stiffness.
    #[serde(default)]
    pub gravity: [f64; 3],
    /// Position `[x, y, z]` of each node by name, m. Every node moves with one body or with
    /// the base, or is free.
    pub nodes: IndexMap<String, [f64; 3]>,
    /// The rigid base, which moves with the floor.
    pub base: BaseEntry,
    /// Nodes that neither a body nor the base carries.
    #[serde(default, skip_serializing_if = "FreeEntry::is_empty")]
    pub free: FreeEntry,
    /// Rigid bodies by name. At least one unless something else has mass.
    #[serde(default)]
    pub bodies: IndexMap<String, BodyEntry>,
    /// Flexible bodies by name, from finite elements.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub flexible_bodies: IndexMap<String, FlexibleBodyEntry>,
    /// Stiffness sets by name, for beams that share one.
    #[serde(default)]
    pub profiles: IndexMap<String, ProfileEntry>,
    /// Beams by name, between two nodes each.
    #[serde(default)]
    pub beams: IndexMap<String, BeamEntry>,
    /// Springs of no length and joints by name, between two nodes each.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub springs: IndexMap<String, SpringEntry>,
    /// Point masses by name, at one node each.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub point_masses: IndexMap<String, PointMassEntry>,
    /// Forces and moments on the machine by name, at most six, whose compliance `compliance` shows.
    /// Not part of the digest.
    #[serde(default, skip_serializing)]
    pub loads: IndexMap<String, LoadEntry>,
    /// The degrees of freedom q_d, Eq. (7).
    pub coordinates: CoordinatesEntry,
    /// The beams with an actuator, Eq. (9).
    pub actuators: ActuatorsEntry,
    /// Sensors for feedback, Eq. (11), Eq. (12).
    pub sensors: SensorsEntry,
    /// Floor motion, the prescribed (rheonomic) inputs q_r, Eq. (8).
    pub floor: FloorEntry,
    /// Performance outputs, Eq. (10), and the bands in which they are judged.
    pub performance: PerformanceEntry,
    /// Damping of the machine as a whole. Damping of single beams is given with the beams;
    /// all add up.
    #[serde(default)]
    pub damping: DampingEntry,
    /// Objectives of the controller.
    pub control: ControlEntry,
    /// The board: converters, sensors, actuators, delays.
    pub board: BoardEntry,
    /// Limits and times of the supervisor.
    #[serde(default)]
    pub supervision: SupervisionSettings,
    /// Settings of the standard simulation. Part of the digest only as far as the search for
    /// the controller reads them: `floor_band` and `floor_rms`, unless it minimises the peaks.
    #[serde(default, skip_serializing)]
    pub simulation: Simulation,
    /// Settings of the randomly perturbed machines, on which `robust` runs and a design of the
    /// modal law is verified.
    #[serde(default, skip_serializing)]
    pub robustness: RobustnessEntry,
    /// Standard deviations of the numbers of this file. Not part of the digest.
    #[serde(default, skip_serializing)]
    pub uncertainty: UncertaintyEntry,
    /// Sources of the numbers in this file. Not part of the digest.
    #[serde(default, skip_serializing)]
    pub provenance: Vec<Provenance>,
}

impl MachineFile {
    /// All keys with their values as TOML, defaults included.
    ///
    /// # Errors
    /// If an integer is above that of TOML, 2⁶³ − 1.
    pub fn to_table(&self) -> Result<toml::Table, toml::ser::Error> {
        let mut table = toml::Table::try_from(self)?;
        let simulation = toml::Value::try_from(self.simulation)?;
        let robustness = toml::Value::try_from(&self.robustness)?;
        let provenance = toml::Value::try_from(&self.provenance)?;
        let loads = toml::Value::try_from(&self.loads)?;
        table.insert("simulation".to_owned(), simulation);
        table.insert("robustness".to_owned(), robustness);
        table.insert("provenance".to_owned(), provenance);
        table.insert("loads".to_owned(), loads);
        Ok(table)
    }
}

/// `[base]`: the rigid base.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct BaseEntry {
    /// Names of the nodes that move with the base.
    pub nodes: Vec<String>,
}

/// `[free]`: nodes that move by themselves, held by beams and springs.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FreeEntry {
    /// Names of the nodes that neither a body nor the base carries. Each has six coordinates of
    /// its own; beams and springs join it to the rest.
    pub nodes: Vec<String>,
}

impl FreeEntry {
    fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }
}

/// `[bodies.NAME]`: a rigid body.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct BodyEntry {
    /// Mass of the body, kg. Above 0.
    #[schemars(range(min = 0))]
    pub mass: f64,
    /// Inertia about the body's own centre of gravity, kg m². `[Ixx, Iyy, Izz]`, or the
    /// symmetric tensor as three rows, its off-diagonals with the tensor's sign
    /// (Ixy = −∫xy dm).
    pub inertia: Inertia,
    /// Position `[x, y, z]` of the centre of gravity, m.
    pub cog: [f64; 3],
    /// Names of the nodes that move with the body.
    pub nodes: Vec<String>,
}

/// `[flexible_bodies.NAME]`: an elastic body, reduced by a finite element program to some nodes
/// and modes (Guyan, or Craig–Bampton).
///
/// The rows of both matrices are x, y, z, rx, ry, rz of each node, in the order of `nodes` and the
/// axes of the file, then any modal coordinates. The body is free: a rigid motion makes no force.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FlexibleBodyEntry {
    /// Names of the interface nodes, in the order of the matrices. They belong to this body alone.
    pub nodes: Vec<String>,
    /// Path of the mass matrix, relative to this file: Matrix Market (`.mtx`) or NumPy (`.npy`).
    pub mass_matrix: String,
    /// Path of the stiffness matrix, relative to this file: `.mtx` or `.npy`.
    pub stiffness_matrix: String,
    /// Unit of length in the matrices: `"m"` (the default) or `"mm"`.
    #[serde(default)]
    pub length_unit: LengthUnit,
    /// Unit of mass in the matrices: `"kg"` (the default) or `"t"`. The unit of force is that of
    /// mass times length over s²: N for kg and m, and for t and mm.
    #[serde(default)]
    pub mass_unit: MassUnit,
    /// Mass of the body, kg. Above 0. The mass of the matrix must be this to 1 %. Default: not
    /// compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// Loss factor of the material (no unit), not negative. Default: 0. Adds half its mean
    /// over a mode's strain energy to the damping ratio of the mode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loss_factor: Option<f64>,
    /// Damping ratio of each elastic mode that the body has by itself, free, with its nodes
    /// unsupported (no unit). At least 0 and below 1. Default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub modal_damping: Option<f64>,
}

/// A unit of length.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LengthUnit {
    /// Metre.
    #[default]
    M,
    /// Millimetre.
    Mm,
}

/// A unit of mass.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum MassUnit {
    /// Kilogram.
    #[default]
    Kg,
    /// Tonne, 1000 kg.
    T,
}

/// Inertia of a body about its centre of gravity, in one of two notations.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(
    untagged,
    expecting = "expected three principal moments [Ixx, Iyy, Izz] or three rows of the tensor, in kg m²"
)]
pub enum Inertia {
    /// Principal moments `[Ixx, Iyy, Izz]` about the axes of the file, kg m². Not negative, and
    /// none above the sum of the others. All 0 for a point mass, one 0 for a thin rod.
    Diagonal([f64; 3]),
    /// Symmetric tensor by rows, kg m², with such principal moments.
    Tensor([[f64; 3]; 3]),
}

/// A stiffness set: `[profiles.NAME]`, or `stiffness` of a beam.
///
/// Give either `axial`, `bending` and `torsion`, or material and section
/// (`youngs_modulus`, `shear_modulus`, `area`, `second_moments`, `torsion_constant`).
/// `loss_factor`, `damper`, `mass` and `segments` go with both, `density` with the latter.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ProfileEntry {
    /// Axial stiffness EA/L, N/m. Not negative.
    pub axial: Option<f64>,
    /// Bending stiffness EI/L in the planes of e3, e4 and of e5, e6, N m. Not negative.
    pub bending: Option<[f64; 2]>,
    /// Torsional stiffness GJ/L, N m. Not negative.
    pub torsion: Option<f64>,
    /// Young's modulus E, Pa. Above 0.
    pub youngs_modulus: Option<f64>,
    /// Shear modulus G, Pa. Above 0.
    pub shear_modulus: Option<f64>,
    /// Cross-section area A, m².
    pub area: Option<f64>,
    /// Second moments of area I for bending in the planes of e3, e4 and of e5, e6, m⁴.
    pub second_moments: Option<[f64; 2]>,
    /// Torsion constant J of the section, m⁴.
    pub torsion_constant: Option<f64>,
    /// Loss factor of the material (no unit), not negative. Default: 0. Adds half its mean
    /// over a mode's strain energy to the damping ratio of the mode.
    pub loss_factor: Option<f64>,
    /// Viscous damper along the beam, between its two ends, N s/m. Not negative. Default: 0.
    pub damper: Option<f64>,
    /// Density of the material, kg/m³. Above 0. Only with material and section; not with `mass`.
    /// Default: the beam has no mass.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    /// Mass of the whole beam, kg. Evenly spread over its length. Above 0. Default: the beam has
    /// no mass.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// Number of equal elements that a beam with mass is divided into, 1 to 100. Its own
    /// resonances need several. Default: 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 100))]
    pub segments: Option<usize>,
}

/// `[beams.NAME]`: an Euler–Bernoulli beam, massless unless its stiffness set says more.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct BeamEntry {
    /// The two end nodes `["P", "Q"]`. The elongation e1 is positive when Q moves away
    /// from P.
    pub nodes: [String; 2],
    /// Name of a shared stiffness set under `[profiles]`. Give either this or `stiffness`.
    pub profile: Option<String>,
    /// The beam's own stiffness set. Give either this or `profile`.
    pub stiffness: Option<ProfileEntry>,
    /// Approximate direction `[x, y, z]` of the local y axis (no unit). Only its part across
    /// the beam counts. Default: local z is as near to the file's z as possible; for an upright beam,
    /// local y is the file's y.
    pub y_axis: Option<[f64; 3]>,
    /// The joints `[P, Q]` at its two ends, in the order of `nodes`. Each is `"fixed"`, `"ball"` for
    /// all rotations, `"universal"` for those of bending, or a list of the released rotations by the
    /// beam's own axes, such as `["ry"]` for a hinge about the local y axis. Default: both fixed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<[JointEntry; 2]>,
    /// Axial force with which it is built in, N. Tension positive: the force that it has as long as
    /// its ends stay where they are; the machine yields to it as to the weight, and static loads
    /// change the stiffness. Default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preload: Option<f64>,
}

/// The joint at an end of a beam, in one of two notations.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(
    untagged,
    expecting = "expected \"fixed\", \"ball\", \"universal\", or a list of released rotations, of \"rx\", \"ry\" and \"rz\""
)]
pub enum JointEntry {
    /// By its name.
    Named(Joint),
    /// The rotations that it releases, about the beam's local axes.
    Released(Vec<Rotation>),
}

/// A joint at an end of a beam.
#[derive(Clone, Copy, Debug, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Joint {
    /// Releases nothing.
    Fixed,
    /// Releases all rotations.
    Ball,
    /// Releases the rotations about the local y and z axes, and holds that about the beam's own
    /// axis.
    Universal,
}

/// A rotation about an axis of a beam.
#[derive(Clone, Copy, Debug, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Rotation {
    /// About the beam's own axis.
    Rx,
    /// About the local y axis: bending in the local x–z plane, that of e3 and e4.
    Ry,
    /// About the local z axis: bending in the local x–y plane, that of e5 and e6.
    Rz,
}

/// `[springs.NAME]`: a spring of no length, or a joint, between two nodes.
///
/// It acts at the point midway between its nodes, which is theirs if they are at one place: each
/// node moves that point as a rigid arm would. A motion of both nodes as one rigid body makes no
/// force.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SpringEntry {
    /// The two nodes `["P", "Q"]` that it joins. One of them may be a node of the base.
    pub nodes: [String; 2],
    /// Stiffness against translation along the local x, y and z, N/m. Negative for a spring that
    /// pushes away from the middle. Default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<[f64; 3]>,
    /// Stiffness against rotation about the local x, y and z, N m. Per rad, and negative for a
    /// spring that pushes away from the middle. Default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotational_stiffness: Option<[f64; 3]>,
    /// Viscous damper along the local x, y and z, N s/m. Not negative. Default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damper: Option<[f64; 3]>,
    /// Viscous damper about the local x, y and z, N m s. Per rad, and not negative. Default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotational_damper: Option<[f64; 3]>,
    /// Loss factor of its positive stiffnesses (no unit), not negative. Default: 0. Adds half its
    /// mean over a mode's strain energy to the damping ratio of the mode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loss_factor: Option<f64>,
    /// Direction `[x, y, z]` of the local x axis (no unit). Default: the file's x axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x_axis: Option<[f64; 3]>,
    /// Approximate direction `[x, y, z]` of the local y axis (no unit). Only its part across the
    /// local x axis counts. Default: as for beams.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub y_axis: Option<[f64; 3]>,
}

/// `[point_masses.NAME]`: a mass at a node.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PointMassEntry {
    /// Name of the node that the mass moves with. It may be free, or one of a body, rigid or
    /// flexible.
    pub node: String,
    /// Mass, kg. Above 0. A body's own mass does not contain it.
    #[schemars(range(min = 0))]
    pub mass: f64,
    /// Inertia about the node, kg m². Written like that of a body. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inertia: Option<Inertia>,
}

/// `[loads.NAME]`: a force or a moment on the machine, such as the reaction of a stage.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct LoadEntry {
    /// Name of the node that it acts on, not one of the base.
    pub node: String,
    /// Unit vector `[x, y, z]` of its positive direction, or axis (no unit).
    pub direction: [f64; 3],
    /// Whether it is a moment about the axis, not a force. Default: false.
    #[serde(default)]
    pub moment: bool,
}

/// `[coordinates]`: the degrees of freedom.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct CoordinatesEntry {
    /// Degrees of freedom q_d, Eq. (7), as `"BEAM.e1"` to `"BEAM.e6"`: six independent ones
    /// per body.
    pub deformations: Vec<String>,
}

/// `[actuators]`: the actuated beams.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorsEntry {
    /// Names of the six actuated beams (legs), in channel order. The force acts along the
    /// beam, positive when it pushes the ends apart.
    pub beams: Vec<String>,
}

/// `[sensors]`: six sensors of the kind that is fed back, or six of each kind.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SensorsEntry {
    /// Accelerometers by name, none or six, in channel order.
    #[serde(default)]
    pub acceleration: IndexMap<String, DirectionEntry>,
    /// Force sensors in the legs by name, none or six, in channel order. Positive in
    /// compression, as the leg's push.
    #[serde(default)]
    pub force: IndexMap<String, ForceSensorEntry>,
}

/// A direction at a node.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DirectionEntry {
    /// Name of the node.
    pub node: String,
    /// Unit vector `[x, y, z]` of the positive direction (no unit).
    pub direction: [f64; 3],
}

/// A force sensor in a leg.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ForceSensorEntry {
    /// Name of the actuated beam that the sensor is in.
    pub beam: String,
}

/// `[floor]`: floor motion.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FloorEntry {
    /// Six directions at nodes of the base, by name, that together fix the motion of the
    /// rigid base: the rheonomic inputs q_r, Eq. (8).
    pub inputs: IndexMap<String, DirectionEntry>,
    /// Rotations of the base about x, y and z through the mean position of the base's nodes,
    /// relative to its translations, rad/m. The spectrum of the floor times this is that of the
    /// rotation, independent of all others. Not negative. Default: the base does not rotate. Part
    /// of the digest only where the search for the controller reads it: unless it minimises the
    /// peaks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[f64; 3]>,
    /// Speed of the waves in the ground that rotate the base as they pass under it, m/s. Above 0. At
    /// the frequency f, the acceleration along z, travelling in all directions alike, makes rotations
    /// of 2πf/√2 over the speed about x and y, and those along x and y one of πf over the speed
    /// about z. Either this or `rotation`. Default: the base does not rotate. Part of the digest as
    /// `rotation`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wave_speed: Option<f64>,
    /// One-sided spectrum of the base's acceleration along each of x, y and z: that of a vibration
    /// criterion, `"vc-a"` to `"vc-g"` or `"nist-a"`, or points `[[frequency, density], …]`, Hz
    /// and m/s²/√Hz, straight on logarithmic axes. Default: white, as `simulation` says. Part of
    /// the digest only where the search for the controller reads it, as `rotation`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spectrum: Option<SpectrumEntry>,
}

/// The spectrum of the floor, in one of two notations.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(
    untagged,
    expecting = "expected the name of a criterion, such as \"vc-e\", or points [[Hz, m/s²/√Hz], …]"
)]
pub enum SpectrumEntry {
    /// The name of a vibration criterion: at its limit in every one-third-octave band.
    Criterion(String),
    /// Frequencies, Hz, ascending, and acceleration densities, m/s²/√Hz.
    Points(Vec<[f64; 2]>),
}

/// `[performance]`: performance outputs, at least one, and frequency bands.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PerformanceEntry {
    /// Deformations whose second time derivatives (m/s²) are performance outputs, Eq. (10),
    /// as `"BEAM.e1"` to `"BEAM.e6"`.
    #[serde(default)]
    pub deformations: Vec<String>,
    /// Absolute accelerations (m/s²) that are performance outputs, by name.
    #[serde(default)]
    pub accelerations: IndexMap<String, DirectionEntry>,
    /// Frequency bands `[low, high]` by name, Hz. The highest peak of σ_max(G11) in each is
    /// reported.
    #[serde(default)]
    pub bands: IndexMap<String, [f64; 2]>,
    /// Exposure time, s. Above 0. The moving averages and the moving standard deviations of the
    /// outputs' displacements are taken over it. Default: these are not computed. Part of the
    /// digest only where the search for the controller reads it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<f64>,
}

/// `[damping]`: damping of the machine as a whole.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DampingEntry {
    /// Damping ratio of every mode (no unit), at least 0 and below 1. Default: 0.005, or 0
    /// if the file gives any other damping.
    pub modal: Option<f64>,
    /// Rayleigh damping `[α, β]` of D = α·M + β·K, 1/s and s. Not negative.
    pub rayleigh: Option<[f64; 2]>,
    /// Damping ratios of the first modes (no unit), in ascending order of their frequency, in place of
    /// `modal`. Each at least 0 and below 1. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub modes: Vec<f64>,
}

/// `[control]`: objectives of the controller.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ControlEntry {
    /// Sensors to feed back: `"acceleration"`, `"force"` or `"both"`.
    pub feedback: FeedbackKind,
    /// Target suspension frequency ω_n/2π, Hz. Above 0.
    pub frequency: f64,
    /// Target damping ratio ζ_n of the suspension (no unit), not negative.
    pub damping: f64,
    /// Upper limit for the peak sensitivity of the sampled loop (no unit), above 1.
    /// Default: 2.
    #[serde(default = "two")]
    pub max_sensitivity: f64,
    /// Limit for the loop at high frequency, where the machine has modes that the model does
    /// not have. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roll_off: Option<RollOff>,
    /// Structure of the control law: `"modal"` (the default) or `"direct"`.
    #[serde(default)]
    pub law: LawName,
    /// Objective of the search for the controller: `"peaks"` (the default), `"rms"`,
    /// `"average"` or `"deviation"`.
    #[serde(default)]
    pub minimise: Minimise,
    /// What forces and strokes of the legs cost. Only with `minimise = "rms"`. Default: nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub penalty: Option<Penalty>,
    /// Shapes of the modal law, one for each of the six modes, slowest mode first, as
    /// `host-gen design` prints them. With them nothing is searched, and the controller
    /// that they make is verified. Default: the best ones are searched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shapes: Option<Vec<ShapeEntry>>,
}

/// One of `[[control.shapes]]`: the shaping filter of one mode, with gain 1 at low frequency.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ShapeEntry {
    /// Filters of second order in series, one to three.
    pub sections: Vec<FilterEntry>,
    /// Crossover frequency between the two kinds of sensors, Hz. Accelerometers act below it,
    /// force sensors above it. Above 0; required if `feedback` is `"both"`, and not allowed otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub split_hz: Option<f64>,
}

/// A filter of second order with gain 1 at low frequency.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FilterEntry {
    /// The two zeros.
    pub zeros: ResonanceEntry,
    /// The two poles.
    pub poles: ResonanceEntry,
}

/// A pair of poles or zeros of a shaping filter.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ResonanceEntry {
    /// Natural frequency ω/2π, Hz. Above 0.
    pub hz: f64,
    /// Damping ratio (no unit). Above 0; above 1 the pair is real.
    pub damping: f64,
}

/// `control.roll_off`: an upper limit for the complementary sensitivity T of the sampled loop.
///
/// Above `hz`, σ_max(T) with the loop opened at the forces along the modes is at most
/// (`hz`/f)^`order` at each frequency f. So the loop also stays stable with unmodelled dynamics
/// whose relative size is at most (f/`hz`)^`order` there.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RollOff {
    /// Frequency from which on the limit holds, Hz. Above 0.
    pub hz: f64,
    /// Slope: the limit falls as 1/f to this power (no unit). Not negative.
    pub order: f64,
}

/// `control.penalty`: what the search adds to the mean square of the performance outputs.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Penalty {
    /// Of the force of each leg, m/s²/N. Its mean square counts with the square of this. Not negative.
    pub force: f64,
    /// Of the elongation of each leg, 1/s². As of the force: m/s² per m. Not negative.
    pub stroke: f64,
}

impl RollOff {
    /// The largest allowed σ_max(T) at the frequency `hz`, Hz (no unit): infinite below the
    /// frequency from which on the limit holds.
    pub fn limit(&self, hz: f64) -> f64 {
        if hz < self.hz {
            f64::INFINITY
        } else {
            (self.hz / hz).powf(self.order)
        }
    }
}

/// Structure of the control law.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum LawName {
    /// Modal control: each mode has its own filter.
    #[default]
    Modal,
    /// The matrices of Eq. (14), with one low-pass filter for all channels.
    Direct,
}

/// Objective of the search for the controller.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Minimise {
    /// The highest peaks of σ_max(G11) in the bands of `performance`.
    #[default]
    Peaks,
    /// The rms of the performance outputs, accelerations, in `simulation.floor_band`: on the floor
    /// of the file, with the noise of sensors, ADC and DAC.
    Rms,
    /// As [`Rms`](Self::Rms), the rms of the moving averages of the outputs' displacements over
    /// `performance.exposure`.
    Average,
    /// As [`Rms`](Self::Rms), the moving standard deviations of the outputs' displacements over
    /// `performance.exposure`.
    Deviation,
}

fn two() -> f64 {
    2.0
}

/// Sensors that the loop feeds back.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum FeedbackKind {
    /// Accelerometers on the frame, Eq. (12).
    Acceleration,
    /// Force sensors in the legs, Eq. (11).
    Force,
    /// Accelerometers at low and force sensors at high frequency; with the modal law only.
    Both,
}

impl FeedbackKind {
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

/// Error: a name is not that of a kind of feedback.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not a kind of feedback: write acceleration, force or both")]
pub struct UnknownFeedback;

impl core::str::FromStr for FeedbackKind {
    type Err = UnknownFeedback;

    fn from_str(name: &str) -> Result<Self, UnknownFeedback> {
        let mut all = Self::ALL.into_iter();
        all.find(|feedback| feedback.name() == name)
            .ok_or(UnknownFeedback)
    }
}

/// `[board]`: converters, sensors, actuators and delays.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct BoardEntry {
    /// Sample rate of the control loop, Hz. Above 0.
    #[schemars(range(min = 0))]
    pub sample_rate: f64,
    /// Delay from the sampling instant until the ADC code is read, s. Not negative.
    pub conversion_delay: f64,
    /// Delay from reading the ADC codes until the outputs are latched, s. Not negative.
    pub output_delay: f64,
    /// The input converters (ADC), all alike.
    pub adc: AdcEntry,
    /// The output converters (DAC), all alike.
    pub dac: DacEntry,
    /// Accelerometers with their amplifiers. Required if accelerations are fed back.
    pub accelerometer: Option<SensorEntry>,
    /// Force sensors with their amplifiers. Required if forces are fed back.
    pub force_sensor: Option<SensorEntry>,
    /// Piezo actuators with their amplifiers.
    pub actuator: ActuatorEntry,
    /// Measured gains of single channels.
    #[serde(default, skip_serializing_if = "GainsEntry::is_empty")]
    pub gains: GainsEntry,
}

/// `[board.gains]`: measured gains of single channels (no unit), six in channel order, relative to
/// `sensitivity` or `gain`, from 0.1 to 10. The table corrects them.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct GainsEntry {
    /// Of the accelerometers (no unit). Default: 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceleration: Option<[f64; 6]>,
    /// Of the force sensors (no unit). Default: 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force: Option<[f64; 6]>,
    /// Of the actuators (no unit). Default: 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub actuators: Option<[f64; 6]>,
}

impl GainsEntry {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// `[board.adc]`: the input converters.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct AdcEntry {
    /// Resolution of the ADC, bits: 8 to 16.
    #[schemars(range(min = 8, max = 16))]
    pub bits: u32,
    /// Input range of the ADC in either direction, V. The inputs reach from −range to +range.
    pub range: f64,
    /// Noise of the ADC, rms, V. Not negative. Default: 0.
    #[serde(default)]
    pub noise: f64,
}

/// `[board.dac]`: the output converters.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DacEntry {
    /// Resolution of the DAC, bits: 8 to 16.
    #[schemars(range(min = 8, max = 16))]
    pub bits: u32,
    /// Output range `[low, high]` of the DAC, V. Mid-range is zero force.
    pub range: [f64; 2],
    /// Noise of the DAC, rms, V. Not negative. Default: 0.
    #[serde(default)]
    pub noise: f64,
}

/// `[board.accelerometer]` or `[board.force_sensor]`: sensors of one kind.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SensorEntry {
    /// Sensitivity including the amplifier, V/(m/s²) or V/N. Negative if it inverts; not 0.
    pub sensitivity: f64,
    /// Noise density of the sensor, one-sided, m/s²/√Hz or N/√Hz. Not negative. A number is white
    /// noise, a table `[[hz, density], …]` is a straight line on logarithmic axes from point to
    /// point and constant beyond its ends. Default: 0.
    #[serde(default)]
    pub noise_density: NoiseEntry,
    /// Offset voltage at the converter, V. Default: 0.
    #[serde(default)]
    pub offset: f64,
    /// Bandwidth of the sensor as a first-order low-pass, Hz. Above 0. Default: no low-pass.
    pub bandwidth: Option<f64>,
    /// Lower corner (−3 dB) of the sensor as a high-pass, Hz. Above 0, and at most half of
    /// `bandwidth` and of `resonance.hz`. Default: the sensor measures constant values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lower_corner: Option<f64>,
    /// Order of the high-pass at `lower_corner` (no unit). 1 or 2, the second order with
    /// Butterworth's damping, 1/√2. Default: 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 2))]
    pub lower_order: Option<u32>,
    /// Transverse sensitivity: the largest part of an acceleration across its axis that it reads (no
    /// unit). From 0 to 0.3. Adds to the errors of direction on which a design is verified. Default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transverse: Option<f64>,
    /// The sensor's own resonance, a low-pass of second order. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resonance: Option<Resonance>,
}

/// The resonance of a sensor: a low-pass of second order.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Resonance {
    /// Natural frequency ω/2π, Hz. Above 0.
    pub hz: f64,
    /// Damping ratio (no unit). From 0.0001 to 0.99.
    pub damping: f64,
}

/// Noise density of a sensor, one-sided, m/s²/√Hz or N/√Hz.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(
    untagged,
    expecting = "expected a number, in m/s²/√Hz or N/√Hz, or a table [[hz, density], …] of frequencies, in Hz, with their densities"
)]
pub enum NoiseEntry {
    /// The same density at all frequencies. Not negative.
    White(f64),
    /// At least two frequencies, Hz, ascending and above 0, each with its density, above 0.
    Table(Vec<(f64, f64)>),
}

impl Default for NoiseEntry {
    fn default() -> Self {
        Self::White(0.0)
    }
}

impl From<f64> for NoiseEntry {
    fn from(density: f64) -> Self {
        Self::White(density)
    }
}

/// `[board.actuator]`: actuators with their amplifiers, all of one kind.
///
/// Either `gain` and `limit`, or the figures of a data sheet in `piezo` or `voice_coil`, from which
/// both follow. `gain` and `limit` take precedence where they are given too.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorEntry {
    /// Force per volt at the DAC with the amplifier, N/V. Negative if it inverts; not 0. Default:
    /// from `piezo` or `voice_coil`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// Force limit of a leg in either direction, N. Above 0, and within the DAC's range. Default:
    /// from `piezo` or `voice_coil`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
    /// Bandwidth of amplifier and actuator as a first-order low-pass, Hz. Above 0. Default: no
    /// low-pass.
    pub bandwidth: Option<f64>,
    /// Piezo stacks, by the figures of their data sheet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub piezo: Option<PiezoEntry>,
    /// Voice coils, by the figures of their data sheet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voice_coil: Option<VoiceCoilEntry>,
}

/// `[board.actuator.piezo]`: a piezo stack in series with the flexures of a leg.
///
/// Mid-range of the DAC is the middle of the voltage range. The stack's free expansion strains the
/// whole leg, so the force σ_a of Eq. (9) is the leg's axial stiffness times that expansion. That is
/// exact for a stack and flexures without mass, whatever the share of each in the stiffness.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PiezoEntry {
    /// Free stroke over the whole of `voltage`, m. Above 0. Default: `blocked_force` over
    /// `stiffness`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_stroke: Option<f64>,
    /// Lowest and highest voltage `[low, high]` at the stack, V.
    pub voltage: [f64; 2],
    /// Axial stiffness of the stack, N/m. Above 0, and at least that of each actuated leg.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<f64>,
    /// Force of the blocked stack over the whole of `voltage`, N. Above 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blocked_force: Option<f64>,
    /// Voltage gain of the amplifier (no unit), volts at the stack per volt at the DAC. Negative if
    /// it inverts; not 0.
    pub amplifier_gain: f64,
    /// Capacitance of the stack, F. Above 0. Required if `amplifier_current` is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capacitance: Option<f64>,
    /// Largest current of the amplifier in either direction, A. Above 0. It limits how fast the
    /// force changes. Default: no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub amplifier_current: Option<f64>,
    /// Width of the hysteresis loop over the whole of `voltage`, as a fraction of the stroke (no
    /// unit). From 0 to below 0.4. Default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hysteresis: Option<f64>,
    /// Creep: relative growth of an expansion in each decade of time after 0.1 s (no unit). From 0
    /// to 0.1. Default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub creep: Option<f64>,
}

/// `[board.actuator.voice_coil]`: a voice coil on a current amplifier, beside the spring of a leg.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct VoiceCoilEntry {
    /// Force constant, N/A. Above 0.
    pub force_constant: f64,
    /// Current of the amplifier per volt at the DAC, A/V. Negative if it inverts; not 0.
    pub amplifier_gain: f64,
    /// Largest current in either direction, A. Above 0. That which the coil bears continuously, or
    /// that of the amplifier if it is smaller.
    pub current: f64,
}

/// `[supervision]`: limits and times of the supervisor.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct SupervisionSettings {
    /// Duration of a soft start or soft stop without the waiting time, s.
    pub soft_start: f64,
    /// Waiting time at low gain within a soft start, s. The machine comes to rest, then the
    /// sensor offsets are averaged for the same time.
    pub settle: f64,
    /// Duration of the ramp from a fault to the safe output codes, s.
    pub safe_ramp: f64,
    /// Time that a sensor may stay at an end of the ADC range before it is a fault, s.
    pub rail: f64,
    /// Time that a sensor may stay at one code before it is a fault, s. 0 disables this
    /// check. Default: 0.1, or disabled if sensor and ADC have too little noise.
    pub stuck: Option<f64>,
    /// Smallest difference of a code from those before and after it that counts as a spike,
    /// in ADC codes. 0 disables this check. Default: twenty times the noise, at least 48.
    pub spike: Option<u16>,
    /// Number of spikes within one second that is a fault, at least 1.
    pub spikes: u32,
    /// Number of consecutive unread samples that is a fault, at least 1.
    pub lost: u32,
    /// Number of missed deadlines that is tolerated in a window; more are a fault.
    pub late: u32,
    /// Time for which a force may be clamped before it is a fault, s. Default: one period
    /// of `control.frequency`.
    pub saturated: Option<f64>,
    /// Time without a message on the link, while the legs are driven, that is a fault, s. If
    /// the host is gone, the loop opens. At most 3600 s. 0 disables this check: set it if the
    /// loop is to run without a host. Test signals end after 5 s of silence in any case.
    pub silence: f64,
    /// Length of the windows in which the supervisor computes variances, s.
    pub window: f64,
    /// Ratio of the forces' variances in successive windows (no unit), above 1, that counts
    /// as growth. See `grown` and `level`.
    pub growth: f64,
    /// Number of consecutive windows with growing forces that is a fault (a diverging
    /// loop), at least 1.
    pub grown: u32,
    /// Force level, as a fraction of the force limit (no unit), below which growing forces
    /// are no fault. Above 0, at most 1.
    pub level: f64,
    /// Ratio of a sensor's rms to the median of its kind (no unit), above 1, from which the
    /// sensor is implausible.
    pub wild: f64,
    /// Ratio of the median rms of a kind of sensors to a sensor's rms (no unit), above 1,
    /// from which the sensor is implausible.
    pub dull: f64,
    /// Number of consecutive windows with an implausible sensor that is a fault, at least 1.
    pub strange: u32,
    /// Amplitude of the self-test's sine, as a fraction of the force limit (no unit). Above
    /// 0, at most 1.
    pub test_force: f64,
    /// Measuring time of the self-test for each leg, s.
    pub test_time: f64,
    /// Amplitude of the pilot sine with the loop closed, N. 0 disables the pilot. Default:
    /// its response is 150 times the sensor noise.
    pub pilot: Option<f64>,
    /// Measuring time of the pilot for each leg, s.
    pub pilot_time: f64,
    /// Largest accepted deviation from the expected response in self-test and pilot, as a
    /// fraction of it (no unit). Above 0.
    pub test_tolerance: f64,
}

impl Default for SupervisionSettings {
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
            silence: 600.0,
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

/// `[simulation]`: the standard simulation.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Simulation {
    /// Duration of the measured part, s. Above 0.
    pub duration: f64,
    /// Duration of the simulated time before the measured part, s. Not negative.
    pub settling: f64,
    /// Acceleration of the rigid base along each of x, y and z, rms, m/s². The three are
    /// independent of each other; rotations are as `floor.rotation` says. Not negative.
    pub floor_rms: f64,
    /// Frequency band `[low, high]` of the base's acceleration, Hz.
    pub floor_band: [f64; 2],
    /// Seed of the random numbers.
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

/// `[robustness]`: the Monte Carlo run of `robust`. All numbers are drawn from uniform
/// distributions.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct RobustnessEntry {
    /// Names of the bodies whose mass, inertia and centre of gravity vary. Default: all
    /// bodies without an actuated leg.
    pub payload: Option<Vec<String>>,
    /// Largest relative change of the payload's mass and inertia (no unit), at least 0 and
    /// below 1.
    pub mass: f64,
    /// Largest shift of the payload's centre of gravity along each axis, m. Not negative.
    pub cog: f64,
    /// Largest relative change of each leg's stiffness (no unit), at least 0 and below 1.
    pub leg_stiffness: f64,
    /// Largest relative change of all damping (no unit), at least 0 and below 1.
    pub damping: f64,
    /// Largest relative error of each sensor's gain (no unit), at least 0 and below 1.
    pub sensor_gain: f64,
    /// Largest error of each accelerometer's direction, °. From 0 to 45.
    pub misalignment: f64,
    /// Largest relative error of each actuator's gain (no unit), at least 0 and below 1.
    pub actuator_gain: f64,
    /// Largest change of the delay from the sample to the latched outputs, s. Not negative.
    pub delay: f64,
    /// Number of machines to draw, at least 1.
    pub samples: usize,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Default for RobustnessEntry {
    fn default() -> Self {
        Self {
            payload: None,
            mass: 0.2,
            cog: 0.02,
            leg_stiffness: 0.1,
            damping: 0.3,
            sensor_gain: 0.03,
            misalignment: 1.0,
            actuator_gain: 0.03,
            delay: 1e-6,
            samples: 200,
            seed: 1,
        }
    }
}

/// `[uncertainty]`: how far the machine may be from the numbers of this file, as standard deviations.
/// `fit` weighs a measurement against them.
///
/// The defaults are those of a machine as built from drawings, with parts from a catalogue: masses
/// and second moments within 20 %, centres of gravity within 20 mm, stiffnesses within 30 %, damping
/// within a factor of two, gains of sensors within 3 % and of actuators within 10 %, directions within
/// 2°, all evenly distributed; the standard deviation is the √3rd part of that.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct UncertaintyEntry {
    /// Of the mass of each rigid body and point mass, relative (no unit). Above 0 and below 1.
    pub mass: f64,
    /// Of each second moment ∫x² dm of a rigid body along a principal axis, apart from that of its
    /// mass, relative (no unit). Above 0 and below 1.
    pub inertia: f64,
    /// Of each coordinate of the centre of gravity of a rigid body, m. Above 0.
    pub cog: f64,
    /// Of the stiffness of each beam and spring, and of those of bending and torsion of each beam
    /// apart from that, relative (no unit). Above 0 and below 1.
    pub stiffness: f64,
    /// Of the modal damping of each mode, and of all other damping together, relative (no unit). Above 0 and below 1.
    pub damping: f64,
    /// Of the gain of each sensor, relative (no unit). Above 0 and below 1.
    pub sensor_gain: f64,
    /// Of the direction of each accelerometer about both axes across it, °. Above 0, up to 45.
    pub misalignment: f64,
    /// Of the gain of each actuator, relative (no unit). Above 0 and below 1.
    pub actuator_gain: f64,
    /// Of the delay of amplifiers and sensors beside what this file gives, s. Above 0.
    pub delay: f64,
}

impl Default for UncertaintyEntry {
    fn default() -> Self {
        Self {
            mass: 0.12,
            inertia: 0.12,
            cog: 0.012,
            stiffness: 0.17,
            damping: 0.4,
            sensor_gain: 0.018,
            misalignment: 1.2,
            actuator_gain: 0.06,
            delay: 1e-6,
        }
    }
}

/// `[[provenance]]`: the source of some numbers.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Keys of this file, such as `"nodes.n3"` or `"bodies.lens.cog"`. A key includes all
    /// keys below it.
    pub entries: Vec<String>,
    /// How certain the numbers are: `"published"`, `"reconstructed"`, `"assumed"` or
    /// `"measured"`.
    pub kind: Certainty,
    /// The source, in words.
    pub from: String,
}

/// How certain a number is.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Certainty {
    /// A source states the number.
    Published,
    /// The number follows from what a source states.
    Reconstructed,
    /// The number is a choice or an estimate.
    Assumed,
    /// The number was measured on the machine.
    Measured,
}
