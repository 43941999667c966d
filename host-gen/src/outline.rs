//! A machine file from a few numbers: a frame on three mounts of two legs or six of
//! one, and if there is one a payload below it.
//!
//! The frame is a disc, the payload a cylinder; what the numbers do not say is as in
//! `models/metrology-frame.toml`, and marked as assumed.

use core::f64::consts::TAU;
use core::fmt::{Display, Write as _};
use std::path::Path;

use crate::model::energy::{Kind, energies};
use crate::machine::{Feedback, Machine, MachineError};
use crate::model::multibody::Multibody;

/// Mounts about the frame: six legs in all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mounts {
    /// Two legs each, leaning apart.
    Three,
    /// One leg each, leaning to either side by turns.
    Six,
}

/// What a machine file is made from. SI units.
#[derive(Clone, Debug)]
pub struct Outline {
    /// Name.
    pub name: String,
    /// How many mounts.
    pub mounts: Mounts,
    /// Radius of their circle, m.
    pub radius: f64,
    /// Of the mounts above the feet, m.
    pub height: f64,
    /// Of a leg with the floor, degrees.
    pub leg_angle: f64,
    /// EA/L of a leg, N/m.
    pub leg_stiffness: f64,
    /// kg.
    pub frame_mass: f64,
    /// kg; 0 for a frame alone.
    pub payload_mass: f64,
    /// Of the payload's centre of gravity below the frame, m.
    pub payload_below: f64,
    /// About where the payload is to move on the frame, Hz.
    pub internal: f64,
    /// What is fed back.
    pub feedback: Feedback,
    /// What the mounts are to look like, Hz.
    pub frequency: f64,
}

impl Default for Outline {
    /// Near to the paper's machine.
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
            payload_below: 0.1,
            internal: 90.0,
            feedback: Feedback::Acceleration,
            frequency: 1.0,
        }
    }
}

/// A leg: its name, its mount and its foot.
struct Leg {
    name: String,
    mount: usize,
    foot: [f64; 3],
}

/// Ten digits, and no sign at a zero.
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

    /// Of mount `i`, rad; the first at 90°.
    fn bearing(&self, i: usize) -> f64 {
        TAU * (0.25 + i as f64 / self.mount_count() as f64)
    }

    /// The mount that leg `n` stands under.
    fn mount_of(&self, n: usize) -> usize {
        match self.mounts {
            Mounts::Three => n / 2,
            Mounts::Six => n,
        }
    }

    /// Along the circle at mount `i`.
    fn along(&self, i: usize) -> [f64; 3] {
        let (sin, cos) = self.bearing(i).sin_cos();
        [-sin, cos, 0.0]
    }

    /// The nth of six directions at the mounts, three along the circle and three up.
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
        let out = self.height / self.leg_angle.to_radians().tan();
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

    /// The text of the machine file, commented, its bands laid by its modes.
    ///
    /// # Errors
    /// Where the numbers make no machine; the place is in the text that would have
    /// been `path`.
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
        let bands = [5.0 * self.frequency, between, 3.0 * last.max(between)];
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
        let below = -self.payload_below;
        let each = match self.mounts {
            Mounts::Three => "three mounts of two legs",
            Mounts::Six => "six mounts of one leg",
        };
        writeln!(
            f,
            "#:schema machine.schema.json\n# {}: a frame on {each}{}.\n#\n# Made by `host-gen new`. What it took for granted is at the end, under provenance;\n# put your own numbers in their place. SI units. Every key is described in\n# docs/machine-file.md; the schema beside this file has editors complete and check them.\n\nformat = 1\nname = \"{}\"\n",
            self.name,
            if payload { ", a payload below it" } else { "" },
            self.name
        )?;
        writeln!(f, "[nodes]\n# Mounts, on the frame.")?;
        for i in 0..mounts {
            let at = self.on_circle(i, self.radius, 0.0);
            writeln!(f, "mount{} = {}", i + 1, vector(at))?;
        }
        writeln!(f, "# Feet, on the base, one to a leg.")?;
        for (n, leg) in legs.iter().enumerate() {
            writeln!(f, "foot{} = {}", n + 1, vector(leg.foot))?;
        }
        // Between mounts, so that legs and blocks can be told apart.
        let turned = |i: usize, z: f64| {
            let (sin, cos) = (TAU * (i as f64 / 3.0 + 5.0 / 12.0)).sin_cos();
            [inner * cos, inner * sin, z]
        };
        if payload {
            writeln!(
                f,
                "# Ends of the blocks: on the payload, and above it on the frame."
            )?;
            for i in 0..3 {
                writeln!(f, "payload{} = {}", i + 1, vector(turned(i, below)))?;
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
            "\n[bodies.frame]\nmass = {:?} # kg\ninertia = {} # kg m², about its centre of gravity: a disc of the mounts' radius\ncog = [0.0, 0.0, 0.0] # m, in the plane of the mounts\nnodes = [{}]",
            self.frame_mass,
            vector([0.25 * disc, 0.25 * disc, 0.5 * disc]),
            names(&on_frame)
        )?;
        if payload {
            // A cylinder that reaches as far above its centre as below.
            let length = 2.0 * self.payload_below;
            let across = self.payload_mass * (3.0 * inner * inner + length * length) / 12.0;
            let along = 0.5 * self.payload_mass * inner * inner;
            writeln!(
                f,
                "\n[bodies.payload]\nmass = {:?}\ninertia = {} # a cylinder on the blocks' circle\ncog = {}\nnodes = [\"payload1\", \"payload2\", \"payload3\"]",
                self.payload_mass,
                vector([across, across, along]),
                vector([0.0, 0.0, below])
            )?;
        }
        self.write_beams(f, &legs)?;
        self.write_channels(f, &legs)?;

        writeln!(
            f,
            "\n# What is judged, and the bands, Hz, in which the worst peak is told."
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
        // As slender as the legs of Table 1.
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
            // Sideways 12·(EI/L)/L², four fifths as stiff.
            let bending = digits(0.8 * axial * self.payload_below.powi(2) / 12.0);
            writeln!(
                f,
                "\n# Three blocks that let the payload move on the frame at about {} Hz.\n[profiles.block]\naxial = {:?}\nbending = [{bending:?}, {bending:?}]\ntorsion = {:?}",
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
            "\n# Degrees of freedom, six to a body: lengths of the legs{}.\n[coordinates]\ndeformations = [\n    {},",
            if payload {
                ", and all of one block"
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
            "\n# Channels 1 to 6.\n[actuators]\nbeams = [{}]",
            names(legs.iter().map(|leg| &leg.name))
        )?;
        writeln!(
            f,
            "\n# Accelerometers, channels 1 to 6: along the circle of the mounts and upward.\n[sensors.acceleration]"
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
        writeln!(f, "\n# Force sensors in the legs.\n[sensors.force]")?;
        for (n, leg) in legs.iter().enumerate() {
            writeln!(f, "f{} = {{ beam = \"{}\" }}", n + 1, leg.name)?;
        }
        writeln!(
            f,
            "\n# Six motions that say how the base moves.\n[floor.inputs]"
        )?;
        for n in 0..6 {
            let (name, d) = self.direction(n);
            let node = format!("foot{}", n + 1);
            direction(f, &format!("floor-{name}{}", n + 1), &node, d)?;
        }
        Ok(())
    }

    fn write_rest(&self, f: &mut String, payload: bool) -> core::fmt::Result {
        writeln!(
            f,
            r#"
[damping]
modal = 0.005 # of every mode

[control]
feedback = "{}" # or "acceleration", "force", "both"
frequency = {:?} # Hz, as if on springs so soft
damping = 0.7
max_sensitivity = 2.0

# The board and what hangs on its converters; docs/board.md is the reference board.
[board]
sample_rate = 20e3       # Hz
conversion_delay = 10e-6 # s, until the codes are read
output_delay = 40e-6     # s, from there until the outputs are latched

[board.adc]
bits = 16
range = 10.0   # ±, V
noise = 0.2e-3 # rms, V

[board.dac]
bits = 16
range = [0.0, 5.0] # V
noise = 50e-6      # rms, V

[board.accelerometer]
sensitivity = 20.0   # V/(m/s²), preamplifier included
noise_density = 1e-7 # m/s²/√Hz
offset = 2e-3        # V

[board.force_sensor]
sensitivity = 0.02   # V/N
noise_density = 1e-4 # N/√Hz
offset = 2e-3        # V

[board.actuator]
gain = 100.0  # N per V at the DAC, piezo amplifier included
limit = 200.0 # N

# The floor of the simulation.
[simulation]
floor_rms = 1e-3          # m/s², each floor input
floor_band = [1.0, 200.0] # Hz

# What the numbers rest on. Say here where yours come from.
[[provenance]]
kind = "assumed"
from = "host-gen new: a disc on a circle of mounts, legs as slender as those of the paper's Table 1"
entries = ["nodes", "bodies.frame", "profiles.leg"]
"#,
            self.feedback.name(),
            self.frequency
        )?;
        if payload {
            writeln!(
                f,
                r#"[[provenance]]
kind = "assumed"
from = "host-gen new: a cylinder on three blocks, stiff enough that it moves on the frame at about {} Hz"
entries = ["bodies.payload", "profiles.block"]
"#,
                self.internal
            )?;
        }
        writeln!(
            f,
            r#"[[provenance]]
kind = "assumed"
from = "host-gen new: usual for such machines"
entries = ["damping", "control", "board", "simulation"]"#
        )
    }
}
