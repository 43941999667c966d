//! Results as text for people and as JSON for programs (`docs/json.md`).

use std::fmt::{self, Display, Formatter};

use aligned::{TITLE, WARNING, cells, write_table};
use nalgebra::{Complex, Dim, Matrix, RawStorage};
use serde::Serialize;

use crate::design::ideal_poles;
use crate::energy::{Energies, Kind, energies};
use crate::machine::{Certainty, Feedback, Machine, Provenance};
use crate::multibody::reach;
use crate::plant::{Plant, StateSpace};
use crate::shape::Shape;
use crate::shaping::{Shaped, Shaping};
use crate::simulation::Comparison;
use crate::statics::buckling_load;
use crate::study::Study;
use crate::zeros::{grow, transmission_zeros};

mod aligned;
pub mod analysis;
pub mod campaign;
pub mod design;
pub mod floor;

/// A matrix by rows.
type Rows = Vec<Vec<f64>>;

fn rows<R: Dim, C: Dim, S: RawStorage<f64, R, C>>(matrix: &Matrix<f64, R, C, S>) -> Rows {
    matrix
        .row_iter()
        .map(|row| row.iter().copied().collect())
        .collect()
}

fn write_rows(f: &mut Formatter<'_>, title: &str, rows: &Rows) -> fmt::Result {
    writeln!(f, "{title}")?;
    for row in rows {
        for x in row {
            write!(f, "{x:>13.4e}")?;
        }
        writeln!(f)?;
    }
    Ok(())
}

/// `host-gen modes`.
#[derive(Debug, Serialize)]
pub struct Modes {
    machine: String,
    model_sha256: String,
    modes: Vec<Mode>,
    rigid_modes_hz: [f64; 6],
    /// Without gravity, nothing.
    leg_loads: Vec<LegLoad>,
    coordinates: Vec<String>,
    equation_of_motion: Equation,
    #[serde(skip)]
    reach: f64,
}

#[derive(Debug, Serialize)]
struct Mode {
    hz: f64,
    /// Per body: translation, m, and rotation, rad, of its centre of gravity;
    /// mass-normalised.
    shape: Vec<BodyShape>,
    /// The same shape in q_d, m.
    deformations: Vec<f64>,
    #[serde(flatten)]
    energies: Energies,
}

#[derive(Debug, Serialize, PartialEq)]
struct LegLoad {
    beam: String,
    /// N, tension positive.
    axial_force: f64,
    /// N, as a compression.
    buckling_load: f64,
}

#[derive(Debug, Serialize)]
struct BodyShape {
    body: String,
    motion: Vec<f64>,
}

#[derive(Debug, Serialize)]
struct Equation {
    mass: Rows,
    damping: Rows,
    stiffness: Rows,
    rheonomic: Rows,
    input: Rows,
}

impl Modes {
    /// Of a study.
    pub fn new(study: &Study) -> Self {
        let machine = &study.machine;
        let modes = study.model.modes();
        let equation = study.model.equation_of_motion();
        let deformations = &study.model.coordinates * &modes.shapes;
        Self {
            machine: machine.name.clone(),
            model_sha256: digest(machine),
            modes: modes
                .hertz()
                .into_iter()
                .zip(energies(machine, &study.model, &modes))
                .enumerate()
                .map(|(i, (hz, energies))| Mode {
                    energies,
                    hz,
                    shape: machine
                        .bodies
                        .iter()
                        .enumerate()
                        .map(|(b, body)| BodyShape {
                            body: body.name.clone(),
                            motion: modes
                                .shapes
                                .column(i)
                                .rows(6 * b, 6)
                                .iter()
                                .copied()
                                .collect(),
                        })
                        .collect(),
                    deformations: deformations.column(i).iter().copied().collect(),
                })
                .collect(),
            rigid_modes_hz: study.design.hertz(),
            leg_loads: machine
                .beams
                .iter()
                .zip(&study.model.statics.axial)
                .map(|(beam, &axial_force)| LegLoad {
                    beam: beam.name.clone(),
                    axial_force,
                    buckling_load: buckling_load(beam),
                })
                .collect(),
            coordinates: machine
                .coordinates
                .iter()
                .map(|d| machine.deformation_name(*d))
                .collect(),
            equation_of_motion: Equation {
                mass: rows(&equation.mass),
                damping: rows(&equation.damping),
                stiffness: rows(&equation.stiffness),
                rheonomic: rows(&equation.rheonomic),
                input: rows(&equation.input),
            },
            reach: reach(machine),
        }
    }
}

impl Display for Modes {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{TITLE}Modes of {}{TITLE:#}", self.machine)?;
        writeln!(
            f,
            "  Shapes: x, y, z of each centre of gravity, then rotations times {:.2} m; largest 1.",
            self.reach
        )?;
        write!(f, "   #        Hz  {:<10} {:>7}", "kind", "kg")?;
        for shape in self.modes.first().map_or(&[][..], |mode| &mode.shape) {
            write!(f, "   {:<36}", shape.body)?;
        }
        writeln!(f)?;
        for (i, mode) in self.modes.iter().enumerate() {
            let kind = match mode.energies.kind {
                Kind::Suspension => "suspension",
                Kind::Internal => "internal",
            };
            let mass = mode.energies.modal_mass;
            write!(f, "  {:>2} {:>9.3}  {kind:<10} {mass:>7.1}", i + 1, mode.hz)?;
            let scaled = |motion: &[f64]| -> Vec<f64> {
                let scale = |(j, x): (usize, &f64)| if j < 3 { *x } else { x * self.reach };
                motion.iter().enumerate().map(scale).collect()
            };
            let largest = mode
                .shape
                .iter()
                .flat_map(|shape| scaled(&shape.motion))
                .fold(0.0, |a: f64, x| a.max(x.abs()));
            for shape in &mode.shape {
                write!(f, "   ")?;
                for x in scaled(&shape.motion) {
                    // Adding zero turns −0.00 into 0.00.
                    write!(f, "{:>6.2}", (100.0 * x / largest).round() / 100.0 + 0.0)?;
                }
            }
            writeln!(f)?;
        }
        write!(f, "  All bodies as one rigid body, Hz:")?;
        for hz in self.rigid_modes_hz {
            write!(f, " {hz:.3}")?;
        }
        writeln!(f)?;
        if !self.leg_loads.is_empty() {
            let head = cells(["Under gravity", "axial force, N", "buckling load, N", ""]);
            let rows = self.leg_loads.iter().map(|load| {
                let buckles = -load.axial_force > load.buckling_load;
                vec![
                    load.beam.clone(),
                    format!("{:.1}", load.axial_force),
                    format!("{:.1}", load.buckling_load),
                    if buckles { "buckles" } else { "" }.to_owned(),
                ]
            });
            write_table(f, 2, 1, [head].into_iter().chain(rows))?;
        }
        if self.modes.first().is_some_and(|mode| mode.hz < 0.0) {
            writeln!(
                f,
                "  Under gravity the machine is unstable: a negative Hz is the growth rate of such a mode."
            )?;
        }
        Ok(())
    }
}

/// `host-gen gains`.
#[derive(Debug, Serialize)]
pub struct Gains {
    machine: String,
    model_sha256: String,
    feedback: &'static str,
    frequency_hz: f64,
    damping: f64,
    sensors: Vec<String>,
    actuators: Vec<String>,
    rigid_modes_hz: [f64; 6],
    mass: Rows,
    stiffness: Rows,
    rheonomic: Rows,
    sensing: Rows,
    modal: Rows,
    proportional: Rows,
    integral: Rows,
    ideal_poles_rigid: Vec<Pole>,
    ideal_poles_flexible: Vec<Pole>,
}

#[derive(Debug, Serialize, PartialEq)]
struct Pole {
    re: f64,
    im: f64,
    hz: f64,
    damping: f64,
}

impl From<Complex<f64>> for Pole {
    fn from(s: Complex<f64>) -> Self {
        Self {
            re: s.re,
            im: s.im,
            hz: s.norm() / core::f64::consts::TAU,
            damping: -s.re / s.norm(),
        }
    }
}

impl Gains {
    /// Of a study.
    pub fn new(study: &Study) -> Self {
        let machine = &study.machine;
        let design = &study.design;
        let poles = |plant: &StateSpace| {
            // Empty where the iteration did not end; the text then says so.
            let poles = ideal_poles(plant, &study.gains).unwrap_or_default();
            poles.into_iter().map(Pole::from).collect()
        };
        let beam = |i: &usize| machine.beams[*i].name.clone();
        Self {
            machine: machine.name.clone(),
            model_sha256: digest(machine),
            feedback: design.feedback.name(),
            frequency_hz: machine.target.frequency,
            damping: machine.target.damping,
            // The gains of both kinds are the accelerations'.
            sensors: machine.sensor_names(match design.feedback {
                Feedback::Both => Feedback::Acceleration,
                one => one,
            }),
            actuators: machine.actuators.iter().map(beam).collect(),
            rigid_modes_hz: design.hertz(),
            mass: rows(&design.rigid.mass),
            stiffness: rows(&design.rigid.stiffness),
            rheonomic: rows(&design.rigid.rheonomic),
            sensing: rows(&design.sensing),
            modal: rows(&design.modal),
            proportional: rows(&study.gains.proportional),
            integral: rows(&study.gains.integral),
            ideal_poles_rigid: poles(&Plant::of_design(design)),
            ideal_poles_flexible: poles(&study.plant.plant.state_space),
        }
    }

    fn write_gains(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (p, i) = if self.feedback == "force" {
            ("K_P, Eq. (22)", "K_I, 1/s, Eq. (22)")
        } else {
            ("K_a, N/(m/s²), Eq. (19)", "K_v, N/(m/s), Eq. (20)")
        };
        writeln!(
            f,
            "{TITLE}Gains for {} feedback, {} Hz, damping {}{TITLE:#}",
            self.feedback, self.frequency_hz, self.damping
        )?;
        for (title, gains) in [(p, &self.proportional), (i, &self.integral)] {
            let head = [title.to_owned()].into_iter().chain(self.sensors.clone());
            let rows = self.actuators.iter().zip(gains).map(|(leg, row)| {
                let gains = row.iter().map(|x| format!("{x:.4e}"));
                [leg.clone()].into_iter().chain(gains).collect()
            });
            write_table(f, 2, 1, [head.collect()].into_iter().chain(rows))?;
        }
        Ok(())
    }
}

fn write_poles(f: &mut Formatter<'_>, title: &str, poles: &[Pole]) -> fmt::Result {
    writeln!(f, "{title}")?;
    if poles.is_empty() {
        writeln!(
            f,
            "    not found: the eigenvalue iteration did not converge"
        )?;
    }
    // One of each conjugate pair.
    for pole in poles.iter().filter(|pole| pole.im >= 0.0) {
        writeln!(f, "  {:>10.4} Hz  damping {:>8.4}", pole.hz, pole.damping)?;
    }
    Ok(())
}

impl Display for Gains {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Design model of {}: all bodies as one rigid body{TITLE:#}",
            self.machine
        )?;
        write_rows(f, "  M_d, kg, Eq. (13)", &self.mass)?;
        write_rows(f, "  K_d, N/m, Eq. (13)", &self.stiffness)?;
        write_rows(f, "  T_c, Eq. (15)", &self.sensing)?;
        write_rows(f, "  S, 1/√kg, Eq. (17)", &self.modal)?;
        self.write_gains(f)?;
        write_poles(
            f,
            "  Ideal loop on the design model:",
            &self.ideal_poles_rigid,
        )?;
        write_poles(
            f,
            "  Ideal loop on the flexible machine:",
            &self.ideal_poles_flexible,
        )
    }
}

/// `host-gen simulate`.
#[derive(Debug, Serialize)]
pub struct Simulated {
    machine: String,
    model_sha256: String,
    shaped: Shaped,
    simulation: Comparison,
}

impl Simulated {
    /// Of a study's loop.
    pub fn new(study: &Study, shaped: Shaped, simulation: Comparison) -> Self {
        Self {
            machine: study.machine.name.clone(),
            model_sha256: digest(&study.machine),
            shaped,
            simulation,
        }
    }
}

impl Display for Simulated {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{TITLE}Loop of {}{TITLE:#}", self.machine)?;
        write_shaped(f, &self.shaped)?;
        write_simulation(f, &self.simulation)
    }
}

fn write_shaped(f: &mut Formatter<'_>, r: &Shaped) -> fmt::Result {
    writeln!(f, "{TITLE}Shaping on the sampled, delayed loop{TITLE:#}")?;
    match &r.shaping {
        Shaping::Common { corner_hz } => {
            writeln!(f, "  all channels: low-pass {corner_hz} Hz")?;
        }
        Shaping::Modes { shapes } => {
            let split = shapes.iter().any(|shape| shape.split_hz.is_some());
            writeln!(
                f,
                "  mode        lags, Hz    zero, Hz    zeros, Hz  damping     poles, Hz  damping{}",
                if split { "   split, Hz" } else { "" }
            )?;
            for (i, shape) in shapes.iter().enumerate() {
                let Shape {
                    lags_hz: [a, b],
                    zero_hz,
                    notch,
                    notch_poles,
                    split_hz,
                } = shape;
                write!(
                    f,
                    "  {:>4} {:>8.3} {:>8.1} {:>11.1} {:>12.1} {:>8.3} {:>13.1} {:>8.3}",
                    i + 1,
                    a.min(*b),
                    a.max(*b),
                    zero_hz,
                    notch.hz,
                    notch.damping,
                    notch_poles.hz,
                    notch_poles.damping
                )?;
                if let Some(hz) = split_hz {
                    write!(f, " {hz:>11.1}")?;
                }
                writeln!(f)?;
            }
        }
    }
    writeln!(
        f,
        "  AC coupling {:.4} Hz (second order), leak {:.4} Hz",
        r.ac_coupling_hz, r.leak_hz
    )?;
    writeln!(
        f,
        "  stable; peak sensitivity {:.3} at {:.4} Hz (at the legs {:.3}, at the sensors {:.3}); slowest pole {:.3} 1/s",
        r.peak_sensitivity.value,
        r.peak_sensitivity.at,
        r.peak_sensitivity.at_legs,
        r.peak_sensitivity.at_sensors,
        r.slowest_decay
    )?;
    if !r.soft_start {
        writeln!(
            f,
            "  {WARNING}Warning:{WARNING:#} the loop is not stable at every gain of the soft start."
        )?;
    }
    if let Some(drawn) = r.drawn {
        writeln!(
            f,
            "  on randomly perturbed machines: stable on {} of {}, peak sensitivity up to {:.3}",
            drawn.stable, drawn.samples, drawn.peak_sensitivity
        )?;
    }
    writeln!(
        f,
        "  isolates from {:.2} Hz (ideal loop: from {:.2} Hz)",
        r.isolation_from_hz, r.isolation_from_ideal_hz
    )?;
    let bands = r.bands.iter().map(|band| {
        let mut row = vec![
            band.name.clone(),
            format!("{} to {} Hz", band.low_hz, band.high_hz),
        ];
        let cost = band.sampled_db - band.ideal_db;
        let levels = [band.open_db, band.ideal_db, band.sampled_db, cost];
        row.extend(levels.map(|db| format!("{db:.1}")));
        row
    });
    if r.bands.is_empty() {
        return Ok(());
    }
    writeln!(f, "  Highest peak of σ_max(G11), dB")?;
    let head = cells(["", "", "open", "ideal", "sampled", "sampled minus ideal"]);
    write_table(f, 4, 2, [head].into_iter().chain(bands))
}

fn write_simulation(f: &mut Formatter<'_>, s: &Comparison) -> fmt::Result {
    writeln!(
        f,
        "{TITLE}Software in the loop: {} s on a floor of {:.1e} m/s² rms, {} to {} Hz, seed {}{TITLE:#}",
        s.duration_s, s.floor_rms, s.floor_band_hz[0], s.floor_band_hz[1], s.seed
    )?;
    let head = cells([
        "m/s²",
        "rms open",
        "rms closed",
        "peak open",
        "peak closed",
        "rms, dB",
    ]);
    let rows = s.outputs.iter().enumerate().map(|(i, name)| {
        let [open, closed] = [&s.open, &s.closed];
        let mut row = vec![name.clone()];
        let values = [open.rms[i], closed.rms[i], open.peak[i], closed.peak[i]];
        row.extend(values.map(|x| format!("{x:.3e}")));
        row.push(format!(
            "{:.1}",
            20.0 * (closed.rms[i] / open.rms[i]).log10()
        ));
        row
    });
    write_table(f, 2, 1, [head].into_iter().chain(rows))?;
    writeln!(
        f,
        "  largest leg force {:.1} N; clamp active in {}, sensor at a rail in {} of {} steps",
        s.closed.force_peak, s.closed.clamped_steps, s.closed.railed_steps, s.closed.steps
    )
}

/// `host-gen generate`.
#[derive(Debug, Serialize)]
pub struct Generated {
    machine: String,
    model_sha256: String,
    modes: Modes,
    gains: Gains,
    shaped: Shaped,
    table: String,
    simulation: Comparison,
    not_published: Vec<Statement>,
    warnings: Vec<String>,
}

/// What numbers rest on.
#[derive(Debug, Serialize)]
pub(crate) struct Statement {
    kind: &'static str,
    entries: Vec<String>,
    from: String,
}

impl Statement {
    /// As the machine's file has it.
    pub(crate) fn new(provenance: &Provenance) -> Self {
        Self {
            kind: match provenance.kind {
                Certainty::Published => "published",
                Certainty::Reconstructed => "reconstructed",
                Certainty::Assumed => "assumed",
            },
            entries: provenance.entries.clone(),
            from: provenance.from.clone(),
        }
    }
}

impl Generated {
    /// Of a study whose table was written to `table`.
    pub fn new(study: &Study, shaped: Shaped, table: String, simulation: Comparison) -> Self {
        let machine = &study.machine;
        Self {
            machine: machine.name.clone(),
            model_sha256: digest(machine),
            modes: Modes::new(study),
            gains: Gains::new(study),
            shaped,
            table,
            simulation,
            warnings: warnings(study),
            not_published: machine
                .provenance
                .iter()
                .filter(|p| p.kind != Certainty::Published)
                .map(Statement::new)
                .collect(),
        }
    }
}

impl Display for Generated {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.modes)?;
        self.gains.write_gains(f)?;
        writeln!(f)?;
        write_shaped(f, &self.shaped)?;
        writeln!(f)?;
        write_simulation(f, &self.simulation)?;
        if !self.not_published.is_empty() {
            writeln!(
                f,
                "\n{TITLE}Not published, but reconstructed or assumed{TITLE:#}"
            )?;
        }
        for statement in &self.not_published {
            writeln!(
                f,
                "  {:<14} {}\n{:17}{}",
                statement.kind,
                statement.entries.join(", "),
                "",
                statement.from
            )?;
        }
        for warning in &self.warnings {
            writeln!(f, "\n{WARNING}Warning:{WARNING:#} {warning}")?;
        }
        writeln!(f, "\nTable written to {}", self.table)
    }
}

/// What gravity does to a machine that an engineer would want to be told.
pub(crate) fn warnings(study: &Study) -> Vec<String> {
    let mut warnings = Vec::new();
    let loads = study.model.statics.axial.iter();
    for (beam, load) in study.machine.beams.iter().zip(loads) {
        let limit = buckling_load(beam);
        if -load > limit {
            warnings.push(format!(
                "{} buckles: its load is {:.0} N, its buckling load {limit:.0} N",
                beam.name, -load
            ));
        }
    }
    if study.model.modes().squares[0] < 0.0 {
        warnings.push("the machine is unstable under its own weight".to_owned());
    }
    let feedback = study.design.feedback;
    if feedback != Feedback::Both
        && transmission_zeros(&study.plant.plant.state_space, feedback)
            .is_some_and(|zeros| grow(&zeros))
    {
        warnings.push(
            "with the sensor outputs held at zero, the machine is unstable under gravity: see host-gen zeros"
                .to_owned(),
        );
    }
    warnings
}

pub(crate) fn digest(machine: &Machine) -> String {
    use std::fmt::Write as _;
    let mut text = String::new();
    for byte in machine.digest.0 {
        // Writing to a String cannot fail.
        write!(text, "{byte:02x}").unwrap_or_default();
    }
    text
}
