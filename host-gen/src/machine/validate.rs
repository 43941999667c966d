//! From a file to a machine: every name resolved, every number checked.

use indexmap::IndexMap;
use nalgebra::{Matrix3, RowVector3, Vector3};
use shared::LEGS;
use shared::codes::{Adc, Dac};
use shared::table::ModelDigest;

use super::error::Fault;
use super::file;
use super::file::{Feedback, LawName};
use super::source::{Source, has};
use super::{
    Beam, Board, Body, Carrier, Damping, Deformation, Direction, Machine, Node, Performance,
    Robustness, Sensor, Stiffness, Target,
};

type Checked<T> = Result<T, Fault>;

/// How far from length 1 a direction may be: five typed digits.
const UNIT_SLACK: f64 = 1e-5;

pub(super) fn machine(
    file: file::File,
    table: &toml::Table,
    source: &Source,
    digest: ModelDigest,
) -> Checked<Machine> {
    if file.format != 1 {
        return Err(Fault::new(
            "format",
            format!("layout {} is unknown; this program reads 1", file.format),
        ));
    }
    check_name(&file.name)?;
    let nodes = nodes(&file)?;
    let bodies = bodies(&file.bodies)?;
    let beams = beams(&file, &nodes)?;
    let damping = damping(&file.damping, &beams)?;
    let names = Names { nodes, beams };

    let coordinates =
        names.deformations("coordinates.deformations", &file.coordinates.deformations)?;
    let degrees = 6 * bodies.len();
    if coordinates.len() != degrees {
        return Err(Fault::new(
            "coordinates.deformations",
            format!(
                "{} deformations are given; {} bodies have {degrees} degrees of freedom",
                coordinates.len(),
                bodies.len()
            ),
        ));
    }

    let actuators = file
        .actuators
        .beams
        .iter()
        .map(|name| names.beam("actuators.beams", name))
        .collect::<Checked<Vec<_>>>()?;
    let actuators = six("actuators.beams", actuators)?;
    for (i, beam) in actuators.iter().enumerate() {
        if actuators[..i].contains(beam) {
            return Err(Fault::new(
                "actuators.beams",
                format!("\"{}\" is named twice", names.beams[*beam].name),
            ));
        }
    }

    let accelerometers = if file.sensors.acceleration.is_empty() {
        None
    } else {
        let all = names.directions("sensors.acceleration", &file.sensors.acceleration)?;
        Some(six("sensors.acceleration", all)?)
    };
    let force_sensors = force_sensors(&file.sensors.force, &names, &actuators)?;

    let floor = six(
        "floor.inputs",
        names.directions("floor.inputs", &file.floor.inputs)?,
    )?;
    for input in &floor {
        let node = &names.nodes[input.node];
        if node.carrier != Carrier::Base {
            return Err(Fault::new(
                format!("floor.inputs.{}.node", input.name),
                format!(
                    "node \"{}\" does not move with the base; name one of base.nodes",
                    node.name
                ),
            ));
        }
    }

    let mut performance: Vec<_> = names
        .deformations("performance.deformations", &file.performance.deformations)?
        .into_iter()
        .map(Performance::Deformation)
        .collect();
    performance.extend(
        names
            .directions("performance.accelerations", &file.performance.accelerations)?
            .into_iter()
            .map(Performance::Acceleration),
    );
    if performance.is_empty() {
        return Err(Fault::new(
            "performance",
            "nothing is judged; give deformations or accelerations",
        ));
    }
    let mut bands = Vec::new();
    for (name, &[low, high]) in &file.performance.bands {
        let entry = format!("performance.bands.{name}");
        positive(&entry, low)?;
        if !(high.is_finite() && high > low) {
            return Err(Fault::new(
                entry,
                "a band is [low, high] in Hz with low < high",
            ));
        }
        bands.push((name.clone(), low, high));
    }

    let target = target(&file.control)?;
    match (target.feedback, &accelerometers, &force_sensors) {
        (Feedback::Acceleration | Feedback::Both, None, _) => {
            return Err(Fault::new(
                "sensors",
                "acceleration is fed back, and there are no accelerometers; add six under sensors.acceleration",
            ));
        }
        (Feedback::Force | Feedback::Both, _, None) => {
            return Err(Fault::new(
                "sensors",
                "force is fed back, and there are no force sensors; add one per leg under sensors.force",
            ));
        }
        _ => {}
    }
    let board = board(&file.board, target.feedback)?;
    supervision(&file.supervision, board.sample_rate)?;
    simulation(&file.simulation, board.sample_rate)?;
    let robustness = robustness(&file.robustness, &bodies, &names, &actuators)?;

    for (i, provenance) in file.provenance.iter().enumerate() {
        for entry in &provenance.entries {
            if !has(table, entry) {
                return Err(Fault::new(
                    "provenance",
                    format!(
                        "statement {} is about \"{entry}\", which the file does not have",
                        i + 1
                    ),
                ));
            }
        }
    }

    Ok(Machine {
        name: file.name,
        nodes: names.nodes,
        bodies,
        beams: names.beams,
        coordinates,
        actuators,
        accelerometers,
        force_sensors,
        floor,
        performance,
        bands,
        gravity: finite3("gravity", &file.gravity)?,
        damping,
        target,
        board,
        supervision: file.supervision,
        simulation: file.simulation,
        robustness,
        provenance: file.provenance,
        digest,
        description: table.clone(),
        source: source.clone(),
    })
}

/// The name becomes a file name and part of a comment in the table.
fn check_name(name: &str) -> Checked<()> {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    if name.is_empty()
        || !name.chars().all(plain)
        || !name.starts_with(|c: char| c.is_ascii_lowercase())
    {
        return Err(Fault::new(
            "name",
            format!("\"{name}\" must be lower-case letters, digits and hyphens, a letter first"),
        ));
    }
    Ok(())
}

fn finite3(entry: &str, value: &[f64; 3]) -> Checked<Vector3<f64>> {
    if value.iter().all(|x| x.is_finite()) {
        Ok(Vector3::from(*value))
    } else {
        Err(Fault::new(entry, "must be three finite numbers"))
    }
}

fn positive(entry: &str, value: f64) -> Checked<f64> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(Fault::new(
            entry,
            format!("{value} must be positive and finite"),
        ))
    }
}

fn not_negative(entry: &str, value: f64) -> Checked<f64> {
    if value.is_finite() && value >= 0.0 {
        Ok(value)
    } else {
        Err(Fault::new(
            entry,
            format!("{value} must be finite and not negative"),
        ))
    }
}

fn not_zero(entry: &str, value: f64) -> Checked<f64> {
    if value.is_finite() && value != 0.0 {
        Ok(value)
    } else {
        Err(Fault::new(
            entry,
            format!("{value} must be finite and not zero"),
        ))
    }
}

fn six<T>(entry: &str, all: Vec<T>) -> Checked<[T; LEGS]> {
    all.try_into().map_err(|all: Vec<T>| {
        Fault::new(
            entry,
            format!("{} are given; the controller takes six", all.len()),
        )
    })
}

/// Resolves every node and what carries it.
fn nodes(file: &file::File) -> Checked<Vec<Node>> {
    let mut carriers: Vec<Option<Carrier>> = vec![None; file.nodes.len()];
    let mut claim = |entry: &str, name: &str, carrier: Carrier| {
        let Some(index) = file.nodes.get_index_of(name) else {
            return Err(Fault::new(
                entry,
                format!("node \"{name}\" does not exist; declare it under [nodes]"),
            ));
        };
        if carriers[index].is_some() {
            return Err(Fault::new(
                entry,
                format!(
                    "node \"{name}\" is carried twice; a node moves with one body or with the base"
                ),
            ));
        }
        carriers[index] = Some(carrier);
        Ok(())
    };
    for name in &file.base.nodes {
        claim("base.nodes", name, Carrier::Base)?;
    }
    for (index, (body, spec)) in file.bodies.iter().enumerate() {
        for name in &spec.nodes {
            claim(&format!("bodies.{body}.nodes"), name, Carrier::Body(index))?;
        }
    }
    file.nodes
        .iter()
        .zip(carriers)
        .map(|((name, at), carrier)| {
            let entry = format!("nodes.{name}");
            let carrier = carrier.ok_or_else(|| {
                Fault::new(
                    &entry,
                    "moves with nothing; name it in the nodes of a body or of the base",
                )
            })?;
            Ok(Node {
                name: name.clone(),
                at: finite3(&entry, at)?,
                carrier,
            })
        })
        .collect()
}

fn bodies(specs: &IndexMap<String, file::Body>) -> Checked<Vec<Body>> {
    if specs.is_empty() {
        return Err(Fault::new("bodies", "a machine has at least one body"));
    }
    specs
        .iter()
        .map(|(name, spec)| {
            let entry = format!("bodies.{name}");
            let inertia_entry = format!("{entry}.inertia");
            let inertia = match spec.inertia {
                file::Inertia::Diagonal(moments) => Matrix3::from_diagonal(&Vector3::from(moments)),
                file::Inertia::Tensor(rows) => {
                    Matrix3::from_rows(&rows.map(|row| RowVector3::from_row_slice(&row)))
                }
            };
            if inertia.iter().any(|x| !x.is_finite()) {
                return Err(Fault::new(inertia_entry, "must be finite numbers"));
            }
            // Typed numbers: symmetric to the last digit or not meant so.
            if inertia != inertia.transpose() {
                return Err(Fault::new(inertia_entry, "the tensor is not symmetric"));
            }
            let smallest = inertia.symmetric_eigenvalues().min();
            if smallest <= 1e-12 * inertia.amax() {
                return Err(Fault::new(
                    inertia_entry,
                    format!(
                        "singular mass: the smallest principal moment is {smallest:.3e} kg m²; a body's must all be positive"
                    ),
                ));
            }
            Ok(Body {
                name: name.clone(),
                mass: positive(&format!("{entry}.mass"), spec.mass).map_err(|fault| {
                    Fault::new(fault.entry, format!("singular mass: {}", fault.problem))
                })?,
                inertia,
                cog: finite3(&format!("{entry}.cog"), &spec.cog)?,
            })
        })
        .collect()
}

fn beams(file: &file::File, nodes: &[Node]) -> Checked<Vec<Beam>> {
    file.beams
        .iter()
        .map(|(name, spec)| {
            let entry = format!("beams.{name}");
            let mut ends = [0; 2];
            for (end, node) in ends.iter_mut().zip(&spec.nodes) {
                *end = node_index(&format!("{entry}.nodes"), nodes, node)?;
            }
            let along = nodes[ends[1]].at - nodes[ends[0]].at;
            let length = along.norm();
            if length < 1e-9 {
                return Err(Fault::new(
                    format!("{entry}.nodes"),
                    "the ends are at the same place; a beam has a length",
                ));
            }
            let (source, profile) = match (&spec.profile, &spec.stiffness) {
                (Some(profile), None) => {
                    let entry_of_use = format!("{entry}.profile");
                    let set = file.profiles.get(profile).ok_or_else(|| {
                        Fault::new(
                            entry_of_use,
                            format!("profile \"{profile}\" does not exist; declare it under [profiles]"),
                        )
                    })?;
                    (format!("profiles.{profile}"), set)
                }
                (None, Some(own)) => (format!("{entry}.stiffness"), own),
                _ => {
                    return Err(Fault::new(
                        entry,
                        "give either profile, the name of a shared stiffness set, or stiffness, the beam's own",
                    ));
                }
            };
            Ok(Beam {
                name: name.clone(),
                ends,
                stiffness: stiffness(&source, profile, length)?,
                loss_factor: not_negative(&source, profile.loss_factor.unwrap_or(0.0))?,
                damper: not_negative(&source, profile.damper.unwrap_or(0.0))?,
                axes: axes(&entry, along / length, spec.y_axis.as_ref())?,
                length,
            })
        })
        .collect()
}

/// End stiffnesses as given, or from material and section over the length.
fn stiffness(entry: &str, p: &file::Profile, length: f64) -> Checked<Stiffness> {
    let ends = (p.axial, p.bending, p.torsion);
    let section = (
        p.youngs_modulus,
        p.shear_modulus,
        p.area,
        p.second_moments,
        p.torsion_constant,
    );
    let stiffness = match (ends, section) {
        ((Some(axial), Some(bending), Some(torsion)), (None, None, None, None, None)) => {
            Stiffness {
                axial,
                bending,
                torsion,
            }
        }
        ((None, None, None), (Some(e), Some(g), Some(area), Some(second), Some(constant))) => {
            Stiffness {
                axial: positive(&format!("{entry}.youngs_modulus"), e)? * area / length,
                bending: second.map(|i| e * i / length),
                torsion: positive(&format!("{entry}.shear_modulus"), g)? * constant / length,
            }
        }
        _ => {
            return Err(Fault::new(
                entry,
                "give all of axial, bending, torsion (EA/L, EI/L, GJ/L), or all of youngs_modulus, shear_modulus, area, second_moments, torsion_constant",
            ));
        }
    };
    let [y, z] = stiffness.bending;
    for (what, value) in [
        ("axial stiffness EA/L", stiffness.axial),
        ("bending stiffness EI/L", y),
        ("bending stiffness EI/L", z),
        ("torsional stiffness GJ/L", stiffness.torsion),
    ] {
        if !(value.is_finite() && value >= 0.0) {
            return Err(Fault::new(
                entry,
                format!("{what} comes to {value}; it must be finite and not negative"),
            ));
        }
    }
    Ok(stiffness)
}

/// Local axes as rows. Without a wish, z is as near to the file's z as a
/// beam along `x` allows, and y of an upright beam is the file's y.
fn axes(entry: &str, x: Vector3<f64>, wish: Option<&[f64; 3]>) -> Checked<Matrix3<f64>> {
    let y = match wish {
        Some(wish) => {
            let entry = format!("{entry}.y_axis");
            let wish = finite3(&entry, wish)?;
            let across = wish - x * x.dot(&wish);
            if across.norm() <= 1e-6 * wish.norm() {
                return Err(Fault::new(
                    entry,
                    "lies along the beam; give a direction across it",
                ));
            }
            across.normalize()
        }
        // Within 0.6° of upright.
        None if x.z.abs() > 0.999_95 => (Vector3::y() - x * x.y).normalize(),
        None => Vector3::z().cross(&x).normalize(),
    };
    let z = x.cross(&y);
    Ok(Matrix3::from_rows(&[
        x.transpose(),
        y.transpose(),
        z.transpose(),
    ]))
}

/// Half a per cent on every mode, unless the file says how else it is damped.
fn damping(spec: &file::Damping, beams: &[Beam]) -> Checked<Damping> {
    let elsewhere = spec.rayleigh.is_some()
        || beams
            .iter()
            .any(|beam| beam.loss_factor != 0.0 || beam.damper != 0.0);
    let modal = spec.modal.unwrap_or(if elsewhere { 0.0 } else { 0.005 });
    if !(0.0..1.0).contains(&modal) {
        return Err(Fault::new(
            "damping.modal",
            "relative damping is at least 0 and below 1",
        ));
    }
    let rayleigh = spec.rayleigh.unwrap_or_default();
    for x in rayleigh {
        not_negative("damping.rayleigh", x)?;
    }
    Ok(Damping { modal, rayleigh })
}

fn force_sensors(
    specs: &IndexMap<String, file::ForceSensor>,
    names: &Names,
    actuators: &[usize; LEGS],
) -> Checked<Option<[usize; LEGS]>> {
    if specs.is_empty() {
        return Ok(None);
    }
    let mut beams = Vec::new();
    for (name, spec) in specs {
        let entry = format!("sensors.force.{name}.beam");
        let beam = names.beam(&entry, &spec.beam)?;
        if !actuators.contains(&beam) {
            return Err(Fault::new(
                entry,
                format!(
                    "\"{}\" has no actuator; a force sensor sits in an actuated leg",
                    spec.beam
                ),
            ));
        }
        if beams.contains(&beam) {
            return Err(Fault::new(
                entry,
                format!("\"{}\" already has a force sensor", spec.beam),
            ));
        }
        beams.push(beam);
    }
    six("sensors.force", beams).map(Some)
}

fn target(control: &file::Control) -> Checked<Target> {
    let max_sensitivity = control.max_sensitivity;
    if !(max_sensitivity.is_finite() && max_sensitivity > 1.0) {
        return Err(Fault::new(
            "control.max_sensitivity",
            format!("{max_sensitivity} must be above 1: no loop has less"),
        ));
    }
    if control.feedback == Feedback::Both && control.law == LawName::Direct {
        return Err(Fault::new(
            "control.law",
            "both kinds of sensors meet in the modes: with feedback = \"both\" the law is \"modal\"",
        ));
    }
    Ok(Target {
        feedback: control.feedback,
        frequency: positive("control.frequency", control.frequency)?,
        damping: not_negative("control.damping", control.damping)?,
        max_sensitivity,
        law: control.law,
        minimise: control.minimise,
    })
}

fn board(spec: &file::Board, feedback: Feedback) -> Checked<Board> {
    let accelerometer = board_sensor("board.accelerometer", spec.accelerometer.as_ref())?;
    let force_sensor = board_sensor("board.force_sensor", spec.force_sensor.as_ref())?;
    let there = |sensor: Option<Sensor>, name| {
        sensor.ok_or_else(|| {
            Fault::new(
                "board",
                format!("[board.{name}] is missing; that sensor is fed back"),
            )
        })
    };
    let (sensor, beside) = match feedback {
        Feedback::Acceleration => (there(accelerometer, "accelerometer")?, None),
        Feedback::Force => (there(force_sensor, "force_sensor")?, None),
        Feedback::Both => (
            there(accelerometer, "accelerometer")?,
            Some(there(force_sensor, "force_sensor")?),
        ),
    };
    let adc = Adc::new(spec.adc.bits, spec.adc.range)
        .map_err(|error| Fault::new("board.adc", error.to_string()))?;
    let dac = Dac::new(spec.dac.bits, spec.dac.range[0], spec.dac.range[1])
        .map_err(|error| Fault::new("board.dac", error.to_string()))?;
    let gain = not_zero("board.actuator.gain", spec.actuator.gain)?;
    let limit = positive("board.actuator.limit", spec.actuator.limit)?;
    let reach = dac.reach(gain);
    if limit > reach {
        return Err(Fault::new(
            "board.actuator.limit",
            format!("{limit} N is past what the DAC can ask for, {reach:.6} N; lower it to that"),
        ));
    }
    let board = Board {
        sample_rate: positive("board.sample_rate", spec.sample_rate)?,
        latch_delay: not_negative("board.conversion_delay", spec.conversion_delay)?
            + not_negative("board.output_delay", spec.output_delay)?,
        adc,
        adc_noise: not_negative("board.adc.noise", spec.adc.noise)?,
        dac,
        dac_noise: not_negative("board.dac.noise", spec.dac.noise)?,
        sensor,
        beside,
        accelerometer,
        force_sensor,
        actuator_gain: gain,
        actuator_bandwidth: bandwidth("board.actuator.bandwidth", spec.actuator.bandwidth)?,
        force_limit: limit,
    };
    // More would mean hundreds of controller states for no real board.
    if board.latch_delay > 8.0 * board.period() {
        return Err(Fault::new(
            "board.output_delay",
            "the output is latched more than eight periods after the sample; lower the sample rate",
        ));
    }
    Ok(board)
}

fn board_sensor(entry: &str, spec: Option<&file::Sensor>) -> Checked<Option<Sensor>> {
    let Some(spec) = spec else {
        return Ok(None);
    };
    if !spec.offset.is_finite() {
        return Err(Fault::new(format!("{entry}.offset"), "must be finite"));
    }
    Ok(Some(Sensor {
        sensitivity: not_zero(&format!("{entry}.sensitivity"), spec.sensitivity)?,
        noise_density: not_negative(&format!("{entry}.noise_density"), spec.noise_density)?,
        offset: spec.offset,
        bandwidth: bandwidth(&format!("{entry}.bandwidth"), spec.bandwidth)?,
    }))
}

fn bandwidth(entry: &str, hz: Option<f64>) -> Checked<Option<f64>> {
    hz.map(|hz| positive(entry, hz)).transpose()
}

fn supervision(s: &file::Supervision, sample_rate: f64) -> Checked<()> {
    // What fits the table's counters, and a window's sums.
    let longest = f64::from(1 << 20) / sample_rate;
    for (key, time) in [
        ("soft_start", s.soft_start),
        ("settle", s.settle),
        ("safe_ramp", s.safe_ramp),
        ("rail", s.rail),
        ("saturated", s.saturated.unwrap_or(s.settle)),
    ] {
        let entry = format!("supervision.{key}");
        positive(&entry, time)?;
        if time > longest || time * sample_rate < 2.0 {
            return Err(Fault::new(
                entry,
                format!("{time} s is not between two samples and {longest:.0} s"),
            ));
        }
    }
    // What follows a window takes a sample a sensor.
    for (key, time) in [
        ("window", s.window),
        ("test_time", s.test_time),
        ("pilot_time", s.pilot_time),
    ] {
        positive(&format!("supervision.{key}"), time)?;
        if time > longest || time * sample_rate < 16.0 {
            return Err(Fault::new(
                format!("supervision.{key}"),
                format!("{time} s is not between sixteen samples and {longest:.0} s"),
            ));
        }
    }
    for (key, time) in [("stuck", s.stuck.unwrap_or(0.0)), ("silence", s.silence)] {
        let entry = format!("supervision.{key}");
        not_negative(&entry, time)?;
        if time > longest {
            return Err(Fault::new(
                entry,
                format!("{time} s is above {longest:.0} s"),
            ));
        }
    }
    for (key, factor) in [("growth", s.growth), ("wild", s.wild), ("dull", s.dull)] {
        if !(factor.is_finite() && factor > 1.0) {
            return Err(Fault::new(
                format!("supervision.{key}"),
                format!("{factor} must be above 1"),
            ));
        }
    }
    for (key, part) in [("level", s.level), ("test_force", s.test_force)] {
        if !(part > 0.0 && part <= 1.0) {
            return Err(Fault::new(
                format!("supervision.{key}"),
                "is a part of the legs' limit, above 0 and up to 1",
            ));
        }
    }
    positive("supervision.test_tolerance", s.test_tolerance)?;
    not_negative("supervision.pilot", s.pilot.unwrap_or(0.0))?;
    for (key, count) in [
        ("lost", s.lost),
        ("grown", s.grown),
        ("strange", s.strange),
        ("spikes", s.spikes),
    ] {
        if count == 0 {
            return Err(Fault::new(format!("supervision.{key}"), "is at least 1"));
        }
    }
    Ok(())
}

fn simulation(s: &file::Simulation, sample_rate: f64) -> Checked<()> {
    positive("simulation.duration", s.duration)?;
    not_negative("simulation.settling", s.settling)?;
    not_negative("simulation.floor_rms", s.floor_rms)?;
    let [low, high] = s.floor_band;
    positive("simulation.floor_band", low)?;
    if !(high > low && high < 0.45 * sample_rate) {
        return Err(Fault::new(
            "simulation.floor_band",
            "is [low, high] in Hz with low < high, well below half the sample rate",
        ));
    }
    Ok(())
}

fn robustness(
    spec: &file::Robustness,
    bodies: &[Body],
    names: &Names,
    actuators: &[usize; LEGS],
) -> Checked<Robustness> {
    let payload = match &spec.payload {
        Some(payload) => payload
            .iter()
            .map(|name| {
                let found = bodies.iter().position(|body| body.name == *name);
                found.ok_or_else(|| {
                    Fault::new(
                        "robustness.payload",
                        format!("body \"{name}\" does not exist; declare it under [bodies]"),
                    )
                })
            })
            .collect::<Checked<Vec<_>>>()?,
        None => {
            let on_legs = |body: usize| {
                let ends = actuators.iter().flat_map(|&leg| names.beams[leg].ends);
                let mut carriers = ends.map(|end| names.nodes[end].carrier);
                carriers.any(|carrier| carrier == Carrier::Body(body))
            };
            (0..bodies.len()).filter(|&body| !on_legs(body)).collect()
        }
    };
    for (key, part) in [("mass", spec.mass), ("leg_stiffness", spec.leg_stiffness)] {
        if !(0.0..1.0).contains(&part) {
            return Err(Fault::new(
                format!("robustness.{key}"),
                "is a part, at least 0 and below 1",
            ));
        }
    }
    not_negative("robustness.cog", spec.cog)?;
    if spec.samples == 0 {
        return Err(Fault::new("robustness.samples", "is at least 1"));
    }
    Ok(Robustness {
        payload,
        mass: spec.mass,
        cog: spec.cog,
        leg_stiffness: spec.leg_stiffness,
        samples: spec.samples,
        seed: spec.seed,
    })
}

fn node_index(entry: &str, nodes: &[Node], name: &str) -> Checked<usize> {
    nodes
        .iter()
        .position(|node| node.name == name)
        .ok_or_else(|| {
            Fault::new(
                entry,
                format!("node \"{name}\" does not exist; declare it under [nodes]"),
            )
        })
}

/// What the rest of the file refers to.
struct Names {
    nodes: Vec<Node>,
    beams: Vec<Beam>,
}

impl Names {
    fn beam(&self, entry: &str, name: &str) -> Checked<usize> {
        self.beams
            .iter()
            .position(|beam| beam.name == name)
            .ok_or_else(|| {
                Fault::new(
                    entry,
                    format!("beam \"{name}\" does not exist; declare it under [beams]"),
                )
            })
    }

    fn deformations(&self, entry: &str, names: &[String]) -> Checked<Vec<Deformation>> {
        let mut all = Vec::new();
        for name in names {
            let deformation = self.deformation(entry, name)?;
            if all.contains(&deformation) {
                return Err(Fault::new(entry, format!("\"{name}\" is named twice")));
            }
            all.push(deformation);
        }
        Ok(all)
    }

    fn deformation(&self, entry: &str, name: &str) -> Checked<Deformation> {
        let component = |part: &str| match part {
            "e1" => Some(0),
            "e2" => Some(1),
            "e3" => Some(2),
            "e4" => Some(3),
            "e5" => Some(4),
            "e6" => Some(5),
            _ => None,
        };
        match name.rsplit_once('.').map(|(beam, e)| (beam, component(e))) {
            Some((beam, Some(component))) => Ok(Deformation {
                beam: self.beam(entry, beam)?,
                component,
            }),
            _ => Err(Fault::new(
                entry,
                format!("\"{name}\" is no deformation; write \"BEAM.e1\" to \"BEAM.e6\""),
            )),
        }
    }

    fn directions(
        &self,
        entry: &str,
        specs: &IndexMap<String, file::NodeDirection>,
    ) -> Checked<Vec<Direction>> {
        specs
            .iter()
            .map(|(name, spec)| {
                let entry = format!("{entry}.{name}");
                let direction_entry = format!("{entry}.direction");
                let direction = finite3(&direction_entry, &spec.direction)?;
                let norm = direction.norm();
                if (norm - 1.0).abs() > UNIT_SLACK {
                    return Err(Fault::new(
                        direction_entry,
                        format!("has length {norm:.6}; a direction is a unit vector"),
                    ));
                }
                Ok(Direction {
                    name: name.clone(),
                    node: node_index(&format!("{entry}.node"), &self.nodes, &spec.node)?,
                    direction: direction / norm,
                })
            })
            .collect()
    }
}
