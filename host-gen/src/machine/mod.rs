//! A machine, read from its file and checked.
//!
//! What only the arrangement as a whole can show (a singular mass, dependent
//! degrees of freedom) is checked by [`crate::multibody`] and
//! [`crate::design`], which [`Machine::load`] does not run.

mod error;
pub mod file;
pub mod schema;
mod source;
mod validate;

use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng};
use sha2::{Digest, Sha256};
use shared::LEGS;
use shared::codes::{Adc, Dac};
use shared::table::ModelDigest;

pub(crate) use error::Fault;
pub use error::MachineError;
pub use file::{Certainty, Feedback, LawName, Minimise, Provenance, Simulation, Supervision};
use source::Source;

/// A machine as checked. SI units.
#[derive(Clone, Debug)]
pub struct Machine {
    /// Name, from the file.
    pub name: String,
    /// All nodes.
    pub nodes: Vec<Node>,
    /// Rigid bodies.
    pub bodies: Vec<Body>,
    /// Beams.
    pub beams: Vec<Beam>,
    /// Degrees of freedom q_d.
    pub coordinates: Vec<Deformation>,
    /// Actuated beams, by index, in channel order.
    pub actuators: [usize; LEGS],
    /// Accelerometers in channel order, none or six.
    pub accelerometers: Option<[Direction; LEGS]>,
    /// Beams with a force sensor by index, in channel order, none or six.
    pub force_sensors: Option<[usize; LEGS]>,
    /// Rheonomic inputs at base nodes.
    pub floor: [Direction; LEGS],
    /// Performance outputs.
    pub performance: Vec<Performance>,
    /// Bands to report peaks in: name, Hz, Hz.
    pub bands: Vec<(String, f64, f64)>,
    /// Acceleration of gravity, m/s².
    pub gravity: Vector3<f64>,
    /// Damping of the whole.
    pub damping: Damping,
    /// Control target.
    pub target: Target,
    /// The board.
    pub board: Board,
    /// When the supervisor acts.
    pub supervision: Supervision,
    /// The standard run in simulation.
    pub simulation: Simulation,
    /// The Monte Carlo run.
    pub robustness: Robustness,
    /// What of the file is published, reconstructed or assumed.
    pub provenance: Vec<Provenance>,
    /// SHA-256 of the description, comments and layout left out.
    pub digest: ModelDigest,
    /// The description as the files give it, merged.
    pub(crate) description: toml::Table,
    pub(crate) source: Source,
}

/// A named point.
#[derive(Clone, Debug)]
pub struct Node {
    /// Name.
    pub name: String,
    /// Position, m.
    pub at: Vector3<f64>,
    /// What it moves with.
    pub carrier: Carrier,
}

/// What a node moves with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carrier {
    /// The moving base.
    Base,
    /// A body, by index.
    Body(usize),
}

/// A rigid body.
#[derive(Clone, Debug)]
pub struct Body {
    /// Name.
    pub name: String,
    /// kg.
    pub mass: f64,
    /// About its centre of gravity, kg m².
    pub inertia: Matrix3<f64>,
    /// Centre of gravity, m.
    pub cog: Vector3<f64>,
}

/// A massless beam between two nodes.
#[derive(Clone, Debug)]
pub struct Beam {
    /// Name.
    pub name: String,
    /// Nodes by index: p, q.
    pub ends: [usize; 2],
    /// Stiffness.
    pub stiffness: Stiffness,
    /// Loss factor of the material.
    pub loss_factor: f64,
    /// A damper along the beam, N s/m.
    pub damper: f64,
    /// Local axes as rows: x from p to q, then y and z.
    pub axes: Matrix3<f64>,
    /// m.
    pub length: f64,
}

/// End stiffnesses of a beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffness {
    /// EA/L, N/m.
    pub axial: f64,
    /// EI/L in the planes of e3, e4 and of e5, e6, N m.
    pub bending: [f64; 2],
    /// GJ/L, N m.
    pub torsion: f64,
}

/// Damping that does not belong to single beams.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damping {
    /// Relative damping of every mode.
    pub modal: f64,
    /// α, 1/s, and β, s, of D = α·M + β·K.
    pub rayleigh: [f64; 2],
}

/// One deformation of one beam.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deformation {
    /// Beam by index.
    pub beam: usize,
    /// 0 to 5 for e1 to e6.
    pub component: usize,
}

/// A named direction at a node.
#[derive(Clone, Debug)]
pub struct Direction {
    /// Name.
    pub name: String,
    /// Node by index.
    pub node: usize,
    /// Unit vector.
    pub direction: Vector3<f64>,
}

/// One performance output.
#[derive(Clone, Debug)]
pub enum Performance {
    /// Second time derivative of a deformation, m/s².
    Deformation(Deformation),
    /// Absolute acceleration, m/s².
    Acceleration(Direction),
}

/// What the controller is to do.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// What is fed back.
    pub feedback: Feedback,
    /// ω_n/2π, Hz.
    pub frequency: f64,
    /// ζ_n.
    pub damping: f64,
    /// Bound on the sampled loop's peak sensitivity.
    pub max_sensitivity: f64,
    /// How sensors become forces.
    pub law: LawName,
    /// What the shaping makes small.
    pub minimise: Minimise,
}

impl Target {
    /// ω_n, rad/s.
    pub fn omega(&self) -> f64 {
        core::f64::consts::TAU * self.frequency
    }
}

/// The board and what hangs on its converters.
#[derive(Clone, Copy, Debug)]
pub struct Board {
    /// Hz.
    pub sample_rate: f64,
    /// From the sampling instant until the output is latched, s.
    pub latch_delay: f64,
    /// Inputs.
    pub adc: Adc,
    /// rms, V.
    pub adc_noise: f64,
    /// Outputs.
    pub dac: Dac,
    /// rms, V.
    pub dac_noise: f64,
    /// The sensors that are fed back.
    pub sensor: Sensor,
    /// The force sensors, where they are fed back beside accelerometers.
    pub beside: Option<Sensor>,
    /// Accelerometers, if it has them.
    pub accelerometer: Option<Sensor>,
    /// Force sensors, if it has them.
    pub force_sensor: Option<Sensor>,
    /// N per V at the DAC.
    pub actuator_gain: f64,
    /// Of the amplifier with its piezo, a first-order lag, Hz.
    pub actuator_bandwidth: Option<f64>,
    /// N.
    pub force_limit: f64,
}

impl Board {
    /// Sample period T, s.
    pub fn period(&self) -> f64 {
        1.0 / self.sample_rate
    }

    /// From sample to the middle of the hold: what the loop sees as delay, s.
    pub fn whole_delay(&self) -> f64 {
        self.latch_delay + 0.5 * self.period()
    }
}

/// How machines are drawn about this one, each number even between its limits.
#[derive(Clone, Debug)]
pub struct Robustness {
    /// Bodies by index.
    pub payload: Vec<usize>,
    /// Part of their mass and inertia.
    pub mass: f64,
    /// Shift of their centre of gravity along each axis, m.
    pub cog: f64,
    /// Part of each leg's stiffness.
    pub leg_stiffness: f64,
    /// How many.
    pub samples: usize,
    /// Of the random numbers.
    pub seed: u64,
}

/// A sensor with its amplifier.
#[derive(Clone, Copy, Debug)]
pub struct Sensor {
    /// V per unit.
    pub sensitivity: f64,
    /// Unit/√Hz.
    pub noise_density: f64,
    /// V.
    pub offset: f64,
    /// Of sensor and preamplifier, a first-order lag, Hz.
    pub bandwidth: Option<f64>,
}

impl Machine {
    /// Reads and checks a machine file.
    pub fn load(path: &Path) -> Result<Self, MachineError> {
        let (source, table) = Source::read(path)?;
        Self::check(source, table)
    }

    /// Checks the text of a machine file; `path` is for errors, and for what
    /// the file is based on.
    pub fn parse(path: &Path, text: &str) -> Result<Self, MachineError> {
        let (source, table) = Source::parse(path, text)?;
        Self::check(source, table)
    }

    fn check(source: Source, table: toml::Table) -> Result<Self, MachineError> {
        let value = toml::Value::Table(table.clone());
        let file: file::File = serde_path_to_error::deserialize(value).map_err(|error| {
            let entry = match error.path().to_string().as_str() {
                // The file as a whole.
                "." => String::new(),
                path => path.to_owned(),
            };
            source.locate(Fault::new(entry, error.inner().message()))
        })?;
        // Serialised, the description has neither comments nor layout, and
        // numbers in their shortest form.
        let canonical = serde_json::to_vec(&file).expect("numbers and strings serialise");
        let digest = ModelDigest(Sha256::digest(canonical).into());
        validate::machine(file, &table, &source, digest).map_err(|fault| source.locate(fault))
    }

    /// The same machine with the other sensors fed back; None if it or its
    /// board does not have them.
    pub fn with_feedback(&self, feedback: Feedback) -> Option<Self> {
        let accelerometer = self.accelerometers.as_ref().and(self.board.accelerometer);
        let force_sensor = self.force_sensors.and(self.board.force_sensor);
        let (sensor, beside) = match feedback {
            Feedback::Acceleration => (accelerometer?, None),
            Feedback::Force => (force_sensor?, None),
            Feedback::Both => (accelerometer?, Some(force_sensor?)),
        };
        let mut machine = self.clone();
        machine.target.feedback = feedback;
        let control = machine.description.get_mut("control");
        if let Some(toml::Value::Table(control)) = control {
            control.insert("feedback".to_owned(), feedback.name().into());
        }
        machine.board.sensor = sensor;
        machine.board.beside = beside;
        Some(machine)
    }

    /// The same machine once with each kind of feedback that it has sensors for,
    /// and with both at once.
    pub fn by_feedback(&self) -> Vec<Self> {
        let mut machines = Vec::new();
        for feedback in [Feedback::Acceleration, Feedback::Force, Feedback::Both] {
            // Both kinds meet in the modes only.
            if feedback == Feedback::Both && self.target.law == LawName::Direct {
                continue;
            }
            machines.extend(self.with_feedback(feedback));
        }
        machines
    }

    /// Machine `index` of those drawn about this one: payload heavier or lighter
    /// and its centre of gravity elsewhere, every leg stiffer or softer. Each
    /// has a random stream of its own, so the order does not matter.
    pub fn drawn(&self, index: usize) -> Self {
        self.drawn_with(&self.robustness, index)
    }

    /// The same with other `settings` than the file's.
    pub fn drawn_with(&self, settings: &Robustness, index: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(settings.seed);
        random.set_stream(index as u64);
        // Even between −1 and 1.
        let mut even = || (random.next_u64() >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
        let mut machine = self.clone();
        for &i in &settings.payload {
            let body = &mut machine.bodies[i];
            let factor = 1.0 + settings.mass * even();
            body.mass *= factor;
            body.inertia *= factor;
            for x in body.cog.iter_mut() {
                *x += settings.cog * even();
            }
        }
        for &leg in &machine.actuators {
            let stiffness = &mut machine.beams[leg].stiffness;
            let factor = 1.0 + settings.leg_stiffness * even();
            stiffness.axial *= factor;
            stiffness.torsion *= factor;
            stiffness.bending = stiffness.bending.map(|x| x * factor);
        }
        machine
    }

    /// `fault`, placed in this machine's file.
    pub(crate) fn locate(&self, fault: Fault) -> MachineError {
        self.source.locate(fault)
    }

    /// `"beam.e1"` and so on.
    pub fn deformation_name(&self, deformation: Deformation) -> String {
        format!(
            "{}.e{}",
            self.beams[deformation.beam].name,
            deformation.component + 1
        )
    }

    /// The files it was read from and their texts: the one asked for, then what
    /// that is based on.
    pub fn files(&self) -> impl Iterator<Item = (&Path, &str)> {
        self.source.files()
    }

    /// What the sensors that `feedback` takes are called, in channel order.
    pub fn sensor_names(&self, feedback: Feedback) -> Vec<String> {
        let accelerometers = || self.accelerometers.iter().flatten();
        let legs = || self.force_sensors.iter().flatten();
        let mut names = Vec::new();
        if feedback != Feedback::Force {
            names.extend(accelerometers().map(|sensor| sensor.name.clone()));
        }
        if feedback != Feedback::Acceleration {
            names.extend(legs().map(|&leg| self.beams[leg].name.clone()));
        }
        names
    }

    /// What the performance outputs are called.
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
