//! Template of a machine file, filled in from a few numbers: a frame on three mounts with
//! two legs each or on six mounts with one leg each, with or without a payload above or below it.
//!
//! The frame is a disc, the payload a cylinder. All other values are those of
//! `models/metrology-frame.toml` and are listed as assumed in the file.

use core::f64::consts::TAU;
use core::fmt::{Display, Write as _};
use std::path::Path;

use super::energy::{Kind, energies};
use super::multibody::Multibody;
use crate::machine::parts::{self, Part};
use crate::machine::{FeedbackKind, Machine, MachineError};

/// Number of mounts on the frame. There are six legs in all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mounts {
    /// Three mounts with two legs each, inclined in opposite directions.
    Three,
    /// Six mounts with one leg each, inclined in alternating directions.
    Six,
}

/// A board whose timing a file takes over from one in the folder `models`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadyBoard {
    /// 16 bits at 20 kHz, as in `metrology-frame.toml`.
    Example,
    /// The reference board at 20 kHz, `nucleo-h743.toml`.
    Nucleo,
    /// The reference board at 50 kHz, `nucleo-h743-fast.toml`.
    NucleoFast,
}

impl ReadyBoard {
    /// All boards.
    pub const ALL: [Self; 3] = [Self::Example, Self::Nucleo, Self::NucleoFast];

    /// A name in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Example => "example",
            Self::Nucleo => "nucleo-h743",
            Self::NucleoFast => "nucleo-h743-fast",
        }
    }

    /// Sample rate, conversion delay and output delay as in the file.
    fn timing(self) -> [&'static str; 3] {
        match self {
            Self::Example => ["20e3", "10e-6", "40e-6"],
            Self::Nucleo => ["20e3", "8.2e-6", "16.8e-6"],
            Self::NucleoFast => ["50e3", "8.2e-6", "6.8e-6"],
        }
    }
}

/// The keys that a [`ReadyBoard`] gives.
const TIMING: [&str; 3] = [
    "board.sample_rate",
    "board.conversion_delay",
    "board.output_delay",
];

/// The accelerometers of the library that need no figure beside their own, by name.
pub fn ready_accelerometers() -> impl Iterator<Item = (&'static str, &'static Part)> {
    let all = parts::all().get("accelerometer").into_iter().flatten();
    let whole = all.filter(|(_, part)| part.figures.contains_key("sensitivity"));
    whole.map(|(name, part)| (name.as_str(), part))
}

/// Root mean square of the frequencies of a machine along x, y and z on legs of
/// [`usual_leg_stiffness`], Hz: that of the paper's machine, 1590 kg on legs of 8.4e6 N/m.
pub const USUAL_MEAN_HERTZ: f64 = 16.36;

/// A leg stiffness EA/L, N/m, for a machine of this mass, kg, in two digits: the suspension is as
/// hard as that of the paper's machine.
///
/// Six legs of stiffness k at an angle α with the floor hold the machine with 6·k·sin²α upward
/// and 3·k·cos²α along x and along y, 6·k in all: the mean square of the three frequencies is
/// 2·k/m/(2π)², whatever the angle. A certain target then needs gains as on the paper's machine.
/// It may still be out of reach: geometry and payload are not considered.
pub fn usual_leg_stiffness(mass: f64) -> f64 {
    let stiffness = 0.5 * mass * (TAU * USUAL_MEAN_HERTZ).powi(2);
    format!("{stiffness:.1e}").parse().unwrap_or(stiffness)
}

/// The numbers that a machine file is made from. SI units; the leg angle in degrees.
#[derive(Clone, Debug)]
pub struct Outline {
    /// Name of the machine: lower-case letters, digits and hyphens, a letter first.
    pub name: String,
    /// Number of mounts.
    pub mounts: Mounts,
    /// Radius of the circle of mounts, m.
    pub radius: f64,
    /// Mount height above the feet, m.
    pub height: f64,
    /// Angle between a leg and the floor, degrees.
    pub leg_angle: f64,
    /// Axial stiffness EA/L of a leg, N/m.
    pub leg_stiffness: f64,
    /// Mass of the frame, kg.
    pub frame_mass: f64,
    /// Mass of the payload, kg; 0 for no payload.
    pub payload_mass: f64,
    /// The payload's centre of gravity from that of the frame, in the middle of the mounts, m: z
    /// is upward and not 0, because the blocks between payload and frame have this length.
    pub payload_at: [f64; 3],
    /// Approximate frequency of the payload's internal modes on the frame, Hz.
    pub internal: f64,
    /// Sensors to feed back.
    pub feedback: FeedbackKind,
    /// Target suspension frequency, Hz.
    pub frequency: f64,
    /// The board.
    pub board: ReadyBoard,
    /// An accelerometer of the library by name, one of [`ready_accelerometers`]; the usual figures
    /// if there is none.
    pub accelerometer: Option<&'static str>,
}

impl Default for Outline {
    /// Close to the paper's machine.
    fn default() -> Self {
        Self {
            name: "machine".to_owned(),
            mounts: Mounts::Three,
            radius: 0.5,
            height: 0.2,
            leg_angle: 45.0,
            leg_stiffness: 8.4e6,
            frame_mass: 740.0,
            payload_mass: 850.0,
            payload_at: [0.0, 0.0, -0.1],
            internal: 90.0,
            feedback: FeedbackKind::Acceleration,
            frequency: 1.0,
            board: ReadyBoard::Example,
            accelerometer: None,
        }
    }
}

/// A leg: its name, the index of its mount, and the position of its foot, m.
struct Leg {
    name: String,
    mount: usize,
    foot: [f64; 3],
}

/// `x` rounded to ten digits, without negative zero.
fn digits(x: f64) -> f64 {
    let rounded: f64 = format!("{x:.9e}").parse().unwrap_or(x);
    if rounded.abs() < 1e-12 { 0.0 } else { rounded }
}

fn vector(v: [f64; 3]) -> String {
    let [x, y, z] = v.map(digits);
    format!("[{x:?}, {y:?}, {z:?}]")
}

fn names(names: impl IntoIterator<Item = impl Display>) -> String {
    let names = names.into_iter().map(|name| format!("\"{name}\""));
    names.collect::<Vec<_>>().join(", ")
}

impl Outline {
    fn mount_count(&self) -> usize {
        match self.mounts {
            Mounts::Three => 3,
            Mounts::Six => 6,
        }
    }

    /// Polar angle of mount `i`, rad; the first is at 90°.
    fn bearing(&self, i: usize) -> f64 {
        TAU * (0.25 + i as f64 / self.mount_count() as f64)
    }

    /// Index of the mount of leg `n`.
    fn mount_of(&self, n: usize) -> usize {
        match self.mounts {
            Mounts::Three => n / 2,
            Mounts::Six => n,
        }
    }

    /// Unit vector along the circle (tangential) at mount `i`.
    fn along(&self, i: usize) -> [f64; 3] {
        let (sin, cos) = self.bearing(i).sin_cos();
        [-sin, cos, 0.0]
    }

    /// Direction number `n` of six at the mounts: three along the circle and three upward.
    fn direction(&self, n: usize) -> (&'static str, [f64; 3]) {
        if n.is_multiple_of(2) {
            ("along", self.along(self.mount_of(n)))
        } else {
            ("up", [0.0, 0.0, 1.0])
        }
    }

    fn on_circle(&self, i: usize, radius: f64, z: f64) -> [f64; 3] {
        let (sin, cos) = self.bearing(i).sin_cos();
        [radius * cos, radius * sin, z]
    }

    fn legs(&self) -> Vec<Leg> {
        let out = self.leg_out();
        let leg = |n: usize| {
            let mount = self.mount_of(n);
            let side = if n.is_multiple_of(2) { out } else { -out };
            let at = self.on_circle(mount, self.radius, -self.height);
            let along = self.along(mount);
            Leg {
                name: format!("leg{}", n + 1),
                mount,
                foot: core::array::from_fn(|k| at[k] + side * along[k]),
            }
        };
        (0..6).map(leg).collect()
    }

    /// What looks wrong in the geometry, with what to change; empty if there is nothing.
    pub fn doubts(&self) -> Vec<String> {
        let mut doubts = Vec::new();
        let [x, y, z] = self.payload_at;
        if self.payload_mass > 0.0 {
            let depth = -2.0 * z;
            if depth > self.height * (1.0 + 1e-9) {
                doubts.push(format!(
                    "the payload reaches {depth:.3} m below the mounts, and the feet are {:.3} m below them: unless the feet stand on pedestals, increase the mount height or put the payload's centre of gravity at most {:.3} m below the frame, or above it",
                    self.height,
                    0.5 * self.height
                ));
            }
            let aside = x.hypot(y);
            if aside > self.radius {
                doubts.push(format!(
                    "the payload's centre of gravity is {aside:.3} m beside the middle, outside the circle of mounts of {:.3} m: the machine tips over unless its feet are fastened; increase the radius or move the payload",
                    self.radius
                ));
            }
        }
        // Legs in opposite directions, on neighbouring mounts, meet where their tangents do.
        let out = self.leg_out();
        let meeting = self.radius * (0.5 * TAU / self.mount_count() as f64).tan();
        if out > meeting * (1.0 + 1e-9) {
            doubts.push(format!(
                "the legs of neighbouring mounts cross: each foot is {out:.3} m beside its mount, and they meet at {meeting:.3} m; make the legs steeper, the mount height smaller or the radius larger"
            ));
        }
        doubts
    }

    /// Horizontal distance of a foot from its mount, m.
    fn leg_out(&self) -> f64 {
        self.height / self.leg_angle.to_radians().tan()
    }

    /// The text of the machine file with comments. The performance bands are chosen from the
    /// natural frequencies.
    ///
    /// # Errors
    /// If the numbers do not give a valid machine. The error's place is in the text that
    /// would have been written to `path`.
    pub fn machine_file(&self, path: &Path) -> Result<String, MachineError> {
        let machine = Machine::parse(path, &self.text([5.0, 40.0, 300.0]))?;
        let model = Multibody::new(&machine)?;
        let modes = model.modes();
        let kinds = energies(&machine, &model, &modes);
        let of = |kind: Kind| {
            let all = modes.hertz().into_iter().zip(&kinds);
            let own = all.filter(move |(_, e)| e.kind == kind).map(|(hz, _)| hz);
            own.collect::<Vec<_>>()
        };
        let highest = of(Kind::Suspension).into_iter().fold(1.0, f64::max);
        let (lowest, last) = of(Kind::Internal)
            .into_iter()
            .fold((f64::INFINITY, highest), |(low, high), hz| {
                (low.min(hz), high.max(hz))
            });
        let between = if lowest > highest && lowest.is_finite() {
            (lowest * highest).sqrt()
        } else {
            2.0 * highest
        };
        // A target among the suspension modes, which no controller reaches, has bands, too.
        let low = (5.0 * self.frequency).min(0.5 * between);
        let bands = [low, between, 3.0 * last.max(between)];
        let text = self.text(bands.map(|hz| format!("{hz:.1e}").parse().unwrap_or(hz)));
        Machine::parse(path, &text)?;
        Ok(text)
    }

    fn text(&self, bands: [f64; 3]) -> String {
        let mut text = String::new();
        // Writing to a String cannot fail.
        self.write(&mut text, bands).unwrap_or_default();
        text
    }

    fn write(&self, f: &mut String, [low, between, high]: [f64; 3]) -> core::fmt::Result {
        let legs = self.legs();
        let mounts = self.mount_count();
        let payload = self.payload_mass > 0.0;
        let inner = 0.66 * self.radius;
        let [x, y, z] = self.payload_at;
        let place = if z < 0.0 { "below" } else { "above" };
        let each = match self.mounts {
            Mounts::Three => "three mounts with two legs each",
            Mounts::Six => "six mounts with one leg each",
        };
        writeln!(
            f,
            "#:schema machine.schema.json\n# {}: a frame on {each}{}.\n#\n# Made by `host-gen new`. Assumed values are listed at the end, under provenance; replace\n# them with your own. SI units. All keys are described in docs/machine-file.md. With\n# machine.schema.json, editors complete and check the keys.\n\nformat = 1\nname = \"{}\"\n",
            self.name,
            if payload {
                format!(", a payload {place} it")
            } else {
                String::new()
            },
            self.name
        )?;
        writeln!(f, "[nodes]\n# Mounts, on the frame.")?;
        for i in 0..mounts {
            let at = self.on_circle(i, self.radius, 0.0);
            writeln!(f, "mount{} = {}", i + 1, vector(at))?;
        }
        writeln!(f, "# Feet, on the base, one for each leg.")?;
        for (n, leg) in legs.iter().enumerate() {
            writeln!(f, "foot{} = {}", n + 1, vector(leg.foot))?;
        }
        // Between the mounts, so that blocks and legs do not overlap in drawings.
        let turned = |i: usize, z: f64| {
            let (sin, cos) = (TAU * (i as f64 / 3.0 + 5.0 / 12.0)).sin_cos();
            [x + inner * cos, y + inner * sin, z]
        };
        if payload {
            writeln!(
                f,
                "# End nodes of the blocks: on the payload, and on the frame."
            )?;
            for i in 0..3 {
                writeln!(f, "payload{} = {}", i + 1, vector(turned(i, z)))?;
                writeln!(f, "frame{} = {}", i + 1, vector(turned(i, 0.0)))?;
            }
        }
        writeln!(
            f,
            "\n[base]\nnodes = [{}]",
            names((1..=6).map(|n| format!("foot{n}")))
        )?;

        let disc = self.frame_mass * self.radius * self.radius;
        let mut on_frame: Vec<String> = (1..=mounts).map(|i| format!("mount{i}")).collect();
        if payload {
            on_frame.extend((1..=3).map(|i| format!("frame{i}")));
        }
        writeln!(
            f,
            "\n[bodies.frame]\nmass = {:?} # kg\ninertia = {} # kg m², about the centre of gravity: a disc with the radius of the mounts\ncog = [0.0, 0.0, 0.0] # m, in the plane of the mounts\nnodes = [{}]",
            self.frame_mass,
            vector([0.25 * disc, 0.25 * disc, 0.5 * disc]),
            names(&on_frame)
        )?;
        if payload {
            // A cylinder, its centre halfway up.
            let length = 2.0 * z;
            let across = self.payload_mass * (3.0 * inner * inner + length * length) / 12.0;
            let along = 0.5 * self.payload_mass * inner * inner;
            writeln!(
                f,
                "\n[bodies.payload]\nmass = {:?}\ninertia = {} # kg m², a cylinder with the radius of the blocks\ncog = {}\nnodes = [\"payload1\", \"payload2\", \"payload3\"]",
                self.payload_mass,
                vector([across, across, along]),
                vector(self.payload_at)
            )?;
        }
        self.write_beams(f, &legs)?;
        self.write_channels(f, &legs)?;

        writeln!(
            f,
            "\n# Performance outputs, and the bands in which the highest peak is reported, Hz."
        )?;
        writeln!(f, "[performance]")?;
        if payload {
            writeln!(
                f,
                "deformations = [{}]",
                names((1..=6).map(|k| format!("block1.e{k}")))
            )?;
            writeln!(
                f,
                "bands = {{ suspension = [{low:?}, {between:?}], internal = [{between:?}, {high:?}] }}"
            )?;
        } else {
            writeln!(f, "bands = {{ suspension = [{low:?}, {between:?}] }}")?;
            writeln!(f, "\n[performance.accelerations]")?;
            for (name, axis) in [("x", 0), ("y", 1), ("z", 2)] {
                let direction = core::array::from_fn(|k| if k == axis { 1.0 } else { 0.0 });
                writeln!(
                    f,
                    "frame-{name} = {{ node = \"mount1\", direction = {} }}",
                    vector(direction)
                )?;
            }
        }
        self.write_rest(f, payload)
    }

    fn write_beams(&self, f: &mut String, legs: &[Leg]) -> core::fmt::Result {
        let payload = self.payload_mass > 0.0;
        let length = self.height / self.leg_angle.to_radians().sin();
        // Bending relative to axial stiffness as for the legs of Table 1.
        let bending = digits(5.53e-4 * self.leg_stiffness * length * length);
        writeln!(
            f,
            "\n[profiles.leg]\naxial = {:?} # EA/L, N/m\nbending = [{bending:?}, {bending:?}] # EI/L, N m\ntorsion = {:?} # GJ/L, N m",
            self.leg_stiffness,
            digits(bending / 63.5)
        )?;
        if payload {
            let both = self.frame_mass + self.payload_mass;
            let reduced = self.frame_mass * self.payload_mass / both;
            let axial = (TAU * self.internal).powi(2) * reduced / 3.0;
            // Lateral stiffness 12·(EI/L)/L², 0.8 of the axial.
            let bending = digits(0.8 * axial * self.payload_at[2].powi(2) / 12.0);
            writeln!(
                f,
                "\n# Three blocks between payload and frame; internal modes at about {} Hz.\n[profiles.block]\naxial = {:?}\nbending = [{bending:?}, {bending:?}]\ntorsion = {:?}",
                self.internal,
                digits(axial),
                digits(bending / 3.0)
            )?;
        }
        writeln!(f, "\n# Legs, from the foot to the mount.\n[beams]")?;
        for (n, leg) in legs.iter().enumerate() {
            writeln!(
                f,
                "{} = {{ nodes = [\"foot{}\", \"mount{}\"], profile = \"leg\" }}",
                leg.name,
                n + 1,
                leg.mount + 1
            )?;
        }
        if payload {
            writeln!(f, "# Blocks, from the payload to the frame.")?;
            for i in 1..=3 {
                writeln!(
                    f,
                    "block{i} = {{ nodes = [\"payload{i}\", \"frame{i}\"], profile = \"block\" }}"
                )?;
            }
        }
        writeln!(
            f,
            "\n# Degrees of freedom, six for each body: elongations of the legs{}.\n[coordinates]\ndeformations = [\n    {},",
            if payload {
                ", and all deformations of one block"
            } else {
                ""
            },
            names(legs.iter().map(|leg| format!("{}.e1", leg.name)))
        )?;
        if payload {
            writeln!(f, "    {},", names((1..=6).map(|k| format!("block1.e{k}"))))?;
        }
        writeln!(f, "]")
    }

    fn write_channels(&self, f: &mut String, legs: &[Leg]) -> core::fmt::Result {
        writeln!(
            f,
            "\n# Actuated legs, channels 1 to 6.\n[actuators]\nbeams = [{}]",
            names(legs.iter().map(|leg| &leg.name))
        )?;
        writeln!(
            f,
            "\n# Accelerometers, channels 1 to 6: along the circle of mounts and upward.\n[sensors.acceleration]"
        )?;
        let direction = |f: &mut String, name: &str, node: &str, d: [f64; 3]| {
            writeln!(
                f,
                "{name} = {{ node = \"{node}\", direction = {} }}",
                vector(d)
            )
        };
        for n in 0..6 {
            let mount = self.mount_of(n);
            let (name, d) = self.direction(n);
            let node = format!("mount{}", mount + 1);
            direction(f, &format!("{name}{}", mount + 1), &node, d)?;
        }
        writeln!(
            f,
            "\n# Force sensors in the legs, channels 1 to 6.\n[sensors.force]"
        )?;
        for (n, leg) in legs.iter().enumerate() {
            writeln!(f, "f{} = {{ beam = \"{}\" }}", n + 1, leg.name)?;
        }
        writeln!(
            f,
            "\n# Floor inputs: six directions that fix the motion of the base.\n[floor.inputs]"
        )?;
        for n in 0..6 {
            let (name, d) = self.direction(n);
            let node = format!("foot{}", n + 1);
            direction(f, &format!("floor-{name}{}", n + 1), &node, d)?;
        }
        Ok(())
    }

    fn write_rest(&self, f: &mut String, payload: bool) -> core::fmt::Result {
        let kinds = [
            FeedbackKind::Acceleration,
            FeedbackKind::Force,
            FeedbackKind::Both,
        ];
        let [rate, conversion, output] = self.board.timing();
        let accelerometer = match self.accelerometer {
            Some(name) => {
                format!("sensor = \"{name}\" # its figures and their source: host-gen parts\n")
            }
            None => "sensitivity = 20.0   # V/(m/s²), with the amplifier\nnoise_density = 1e-7 # m/s²/√Hz\n".to_owned(),
        };
        let others = kinds.into_iter().filter(|kind| *kind != self.feedback);
        writeln!(
            f,
            r#"
[damping]
modal = 0.005 # damping ratio of every mode

[control]
feedback = "{}" # or {}
frequency = {:?} # Hz, target suspension frequency
damping = 0.7 # target damping ratio
max_sensitivity = 2.0 # limit for the peak sensitivity

# The board with its converters, sensors and actuators; see docs/board.md.
[board]
sample_rate = {rate}       # Hz
conversion_delay = {conversion} # s, from the sample until the ADC codes are read
output_delay = {output}     # s, from reading the codes until the outputs are latched

[board.adc]
bits = 16
range = 10.0   # V, in either direction
noise = 0.2e-3 # rms, V

[board.dac]
bits = 16
range = [0.0, 5.0] # V; mid-range is zero force
noise = 50e-6      # rms, V

[board.accelerometer]
{accelerometer}offset = 2e-3        # V

[board.force_sensor]
sensitivity = 0.02   # V/N
noise_density = 1e-4 # N/√Hz
offset = 2e-3        # V

[board.actuator]
gain = 100.0  # N/V at the DAC, with the piezo amplifier
limit = 200.0 # N, in either direction

# Floor motion in the simulation.
[simulation]
floor_rms = 1e-3          # m/s² rms, along each of x, y and z
floor_band = [1.0, 200.0] # Hz

# Sources of the numbers. State the sources of yours here.
[[provenance]]
kind = "assumed"
from = "host-gen new: a disc on a circle of mounts, legs as slender as in Table 1 of the paper"
entries = ["nodes", "bodies.frame", "profiles.leg"]
"#,
            self.feedback.name(),
            names(others.map(FeedbackKind::name)),
            self.frequency,
        )?;
        if payload {
            writeln!(
                f,
                r#"[[provenance]]
kind = "assumed"
from = "host-gen new: a cylinder on three blocks; internal modes at about {} Hz"
entries = ["bodies.payload", "profiles.block"]
"#,
                self.internal
            )?;
        }
        let mut typical = vec!["damping", "control", "simulation"];
        if self.board == ReadyBoard::Example {
            typical.extend(TIMING);
        } else {
            writeln!(
                f,
                r#"[[provenance]]
kind = "assumed"
from = "models/{}.toml; docs/board.md gives the parts of the delays"
entries = [{}]
"#,
                self.board.name(),
                names(TIMING)
            )?;
        }
        let named = ready_accelerometers().find(|(name, _)| Some(*name) == self.accelerometer);
        if let Some((_, part)) = named {
            typical.push("board.accelerometer.offset");
            writeln!(
                f,
                r#"[[provenance]]
kind = "published"
from = {:?}
entries = [{}]
"#,
                part.source,
                names(
                    part.figures
                        .keys()
                        .map(|key| format!("board.accelerometer.{key}"))
                )
            )?;
        } else {
            typical.push("board.accelerometer");
        }
        typical.extend([
            "board.adc",
            "board.dac",
            "board.force_sensor",
            "board.actuator",
        ]);
        writeln!(
            f,
            r#"[[provenance]]
kind = "assumed"
from = "host-gen new: typical values for such machines"
entries = [{}]"#,
            names(typical)
        )
    }
}
