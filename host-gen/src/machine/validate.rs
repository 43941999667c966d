//! From the file's types to a machine: every name resolved, every number checked.

use core::f64::consts::FRAC_1_SQRT_2;
use core::fmt::Display;

use indexmap::IndexMap;
use nalgebra::{Matrix3, RowVector3, Vector3, Vector6};
use sha2::{Digest, Sha256};
use shared::LEGS;
use shared::codes::{Adc, Dac};
use shared::table::{ModelDigest, SECTIONS};

use super::actuator::actuator;
use super::beam_mass::{BeamMass, beam_mass, check_nodes};
use super::checked::{
    Actuator, Beam, Board, Body, Carrier, ChannelGains, DESIGN_SAMPLES, Damping, Deformation,
    Direction, FlexibleBody, GainErrors, Load, Machine, Node, Performance, PointMass, Robustness,
    Sensor, Spring, Stiffness, Structure, Target, Uncertainty, has_damped_parts,
};
use super::error::{EntryError, MachineError, all, both};
use super::file::{
    BoardEntry, ControlEntry, DampingEntry, DirectionEntry, FeedbackKind, ForceSensorEntry,
    GainsEntry, Inertia, Joint, JointEntry, LawName, LoadEntry, MachineFile, Minimise,
    ProfileEntry, RobustnessEntry, RollOff, Rotation, ShapeEntry, Simulation, SpectrumEntry,
    SupervisionSettings, UncertaintyEntry,
};
use super::flexible::flexible_body;
use super::limits::{self, Limits};
use super::names::find;
use super::sensor::sensor;
use super::source::{Source, has};
use crate::floor::{Floor, Spectrum};

pub(super) type Checked<T> = Result<T, EntryError>;

/// How far from length 1 a direction may be: five typed digits.
const UNIT_SLACK: f64 = 1e-5;

/// Checks a file; errors have their place in `source`.
pub(super) fn machine(file: MachineFile, source: Source) -> Result<Machine, MachineError> {
    match check(file, &source) {
        Ok(mut machine) => {
            machine.structure.source = source;
            Ok(machine)
        }
        Err(error) => Err(source.locate(error)),
    }
}

/// Serialised, the description has neither comments nor layout, and numbers in their
/// shortest form.
/// The matrices of flexible bodies are part of it by their content.
fn digest(file: &MachineFile, flexible: &[FlexibleBody]) -> ModelDigest {
    let robustness = (file.control.law == LawName::Modal).then(|| RobustnessEntry {
        samples: file.robustness.samples.min(DESIGN_SAMPLES),
        ..file.robustness.clone()
    });
    let mut file = file.clone();
    if matches!(file.control.minimise, Minimise::Peaks | Minimise::Rms) {
        file.performance.exposure = None;
    }
    let shaken = match file.control.minimise {
        Minimise::Peaks => {
            file.floor.rotation = None;
            file.floor.wave_speed = None;
            file.floor.spectrum = None;
            None
        }
        Minimise::Rms | Minimise::Average | Minimise::Deviation => {
            let settings = &file.simulation;
            let white = file.floor.spectrum.is_none();
            Some((settings.floor_band, white.then_some(settings.floor_rms)))
        }
    };
    let canonical = serde_json::to_vec(&(file, robustness, shaken));
    let canonical = canonical.expect("numbers and strings serialise");
    let mut digest = Sha256::new_with_prefix(canonical);
    for body in flexible {
        for x in body.mass.iter().chain(&body.stiffness) {
            digest.update(x.to_le_bytes());
        }
    }
    ModelDigest(digest.finalize().into())
}

/// Checks what vibrates of a file, and that alone; errors have their place in `source`.
pub(super) fn structure(file: &MachineFile, source: Source) -> Result<Structure, MachineError> {
    let numbers = check_format(file).and_then(|()| limits::check(file));
    match numbers.and_then(|()| check_structure(file, &source)) {
        Ok(structure) => Ok(Structure {
            source,
            ..structure
        }),
        Err(error) => Err(source.locate(error)),
    }
}

/// Of another format, nothing else is known.
fn check_format(file: &MachineFile) -> Checked<()> {
    match file.format {
        1 => Ok(()),
        other => {
            let message = format!("format {other} is unknown; this program reads format 1");
            Err(EntryError::new("format", message))
        }
    }
}

fn check_structure(file: &MachineFile, source: &Source) -> Checked<Structure> {
    let numbers = both(
        check_name(&file.name),
        finite3("gravity", &file.gravity, ", in m/s²"),
    );
    let held = nodes(file).and_then(|nodes| {
        let flexible = flexible(file, &nodes, source);
        let joined = both(beams(file, &nodes), springs(file, &nodes));
        let ((flexible, point_masses), (beams, springs)) =
            both(both(flexible, point_masses(file, &nodes)), joined)?;
        check_nodes(&nodes, &beams, &springs)?;
        Ok(Structure {
            name: file.name.clone(),
            damping: damping(&file.damping, &beams, &springs, &flexible)?,
            nodes,
            bodies: Vec::new(),
            flexible,
            beams,
            springs,
            point_masses,
            gravity: Vector3::from(file.gravity),
            source: Source::default(),
        })
    });
    let ((_, bodies), structure) = both(both(numbers, bodies(file)), held)?;
    Ok(Structure {
        bodies,
        ..structure
    })
}

/// Checks what does not depend on what vibrates.
fn check_settings(file: &MachineFile) -> Checked<(Target, Uncertainty)> {
    let rate = positive("board.sample_rate", file.board.sample_rate, "Hz");
    let timed = rate.and_then(|rate| {
        both(
            supervision(&file.supervision, rate),
            simulation(&file.simulation, rate),
        )
    });
    let (target, (_, uncertainty)) = both(
        target(&file.control),
        both(timed, uncertainty(&file.uncertainty)),
    )?;
    Ok((target, uncertainty))
}

fn check(file: MachineFile, source: &Source) -> Checked<Machine> {
    check_format(&file)?;
    let named = Named::new(&file);
    // What follows from a number beyond its limits is not told.
    if let Err(beyond) = limits::check(&file) {
        return Err(match named {
            Ok(_) => beyond,
            Err(others) => beyond.and(others),
        });
    }
    let named = both(named, check_settings(&file));
    let (structure, (named, (target, uncertainty))) = both(check_structure(&file, source), named)?;
    let bodies = &structure.bodies;
    let Named {
        coordinates,
        actuators,
        accelerometers,
        floor,
        force_sensors,
        deformations,
        accelerations,
        loads,
    } = named;
    check_loads(&loads, &structure)?;
    let degrees = 6 * bodies.len();
    if coordinates.len() != degrees {
        return Err(EntryError::new(
            "coordinates.deformations",
            format!(
                "{} deformations are given; {} bodies need {degrees}, six each",
                coordinates.len(),
                bodies.len()
            ),
        ));
    }

    for (i, beam) in actuators.iter().enumerate() {
        if actuators[..i].contains(beam) {
            return Err(EntryError::new(
                "actuators.beams",
                format!("\"{}\" is listed twice", structure.beams[*beam].name),
            ));
        }
    }

    let of_legs = file.sensors.force.iter().zip(force_sensors);
    let force_sensors = force_sensors_of(of_legs, &actuators)?;

    for input in &floor {
        let node = &structure.nodes[input.node];
        if node.carrier != Carrier::Base {
            return Err(EntryError::new(
                format!("floor.inputs.{}.node", input.name),
                format!("node \"{}\" does not move with the base", node.name),
            )
            .fix("use one of base.nodes"));
        }
    }
    let mut rotation = file.floor.rotation.unwrap_or_default();
    for part in rotation {
        not_negative("floor.rotation", part, "rad/m")?;
    }
    if let Some(speed) = file.floor.wave_speed {
        let slowness = 1.0 / positive("floor.wave_speed", speed, "m/s")?;
        if file.floor.rotation.is_some() {
            let message = "rotation and wave_speed exclude each other";
            return Err(EntryError::new("floor.wave_speed", message).fix("remove one of them"));
        }
        // A slope is the rate over the speed; half of a horizontal one is a rotation. Waves from all
        // directions have half their power in each.
        let rocking = FRAC_1_SQRT_2 * slowness;
        rotation = [rocking, rocking, 0.5 * slowness];
    }

    let spectrum = file.floor.spectrum.as_ref().map(spectrum).transpose()?;

    let mut performance: Vec<_> = deformations
        .into_iter()
        .map(Performance::Deformation)
        .collect();
    performance.extend(accelerations.into_iter().map(Performance::Acceleration));
    if performance.is_empty() {
        return Err(
            EntryError::new("performance", "there is no performance output")
                .fix("give deformations or accelerations"),
        );
    }
    let mut bands = Vec::new();
    for (name, &[low, high]) in &file.performance.bands {
        let entry = format!("performance.bands.{name}");
        positive(&entry, low, "Hz")?;
        if !(high.is_finite() && high > low) {
            return Err(EntryError::new(
                entry,
                "must be [low, high], in Hz, with low < high",
            ));
        }
        bands.push((name.clone(), low, high));
    }

    let exposure = file.performance.exposure;
    let exposure = exposure.map(|exposure| positive("performance.exposure", exposure, "s"));
    let exposure = exposure.transpose()?;

    if exposure.is_none() && matches!(target.minimise, Minimise::Average | Minimise::Deviation) {
        return Err(EntryError::new(
            "control.minimise",
            "a moving average or deviation needs an exposure time",
        )
        .fix("give performance.exposure, in s"));
    }
    match (target.feedback, &accelerometers, &force_sensors) {
        (FeedbackKind::Acceleration | FeedbackKind::Both, None, _) => {
            return Err(
                EntryError::new("sensors", "acceleration feedback needs accelerometers")
                    .fix("add six under sensors.acceleration"),
            );
        }
        (FeedbackKind::Force | FeedbackKind::Both, _, None) => {
            return Err(
                EntryError::new("sensors", "force feedback needs force sensors")
                    .fix("add one for each leg under sensors.force"),
            );
        }
        _ => {}
    }
    let legs = actuators.map(|beam| &structure.beams[beam]);
    let board = board(&file.board, target.feedback, legs);
    let robustness = robustness(&file.robustness, &structure, &actuators);
    let (board, mut robustness) = both(board, robustness)?;
    let shapes = shapes(&file.control, board.sample_rate)?;
    // What a sensor reads across its axis turns the direction that it reads along.
    let across = board.accelerometer.as_ref();
    robustness.misalignment += across.map_or(0.0, |sensor| sensor.transverse.atan());

    if !file.provenance.is_empty() {
        // Numbers were checked, so this does not fail.
        let table = file.to_table();
        let table = table.map_err(|error| EntryError::new("", error.to_string()))?;
        for (i, provenance) in file.provenance.iter().enumerate() {
            if let Some(entry) = provenance.entries.iter().find(|entry| !has(&table, entry)) {
                return Err(EntryError::new(
                    format!("provenance[{i}].entries"),
                    format!("there is no entry \"{entry}\""),
                ));
            }
        }
    }

    Ok(Machine {
        digest: digest(&file, &structure.flexible),
        structure,
        coordinates,
        actuators,
        accelerometers,
        force_sensors,
        floor,
        rotation: Vector3::from(rotation),
        waves: file.floor.wave_speed.is_some(),
        spectrum,
        performance,
        loads,
        bands,
        exposure,
        target,
        shapes,
        board,
        supervision: file.supervision,
        simulation: file.simulation,
        robustness,
        uncertainty,
        gain_errors: GainErrors::default(),
        provenance: file.provenance.clone(),
        description: file,
    })
}

/// What refers to nodes and beams by name. Whether these are right in themselves is not looked at.
struct Named {
    coordinates: Vec<Deformation>,
    actuators: [usize; LEGS],
    accelerometers: Option<[Direction; LEGS]>,
    floor: [Direction; LEGS],
    force_sensors: Vec<usize>,
    deformations: Vec<Deformation>,
    accelerations: Vec<Direction>,
    loads: Vec<Load>,
}

impl Named {
    fn new(file: &MachineFile) -> Checked<Self> {
        let names = Names { file };
        let coordinates = &file.coordinates.deformations;
        let coordinates = names.deformations("coordinates.deformations", coordinates);
        let beams = file.actuators.beams.iter();
        let beams = beams.map(|name| names.beam("actuators.beams", name));
        let actuators = all(beams).and_then(|all| six("actuators.beams", all));
        let sensors = &file.sensors.acceleration;
        let accelerometers = match sensors.is_empty() {
            true => Ok(None),
            false => names
                .directions("sensors.acceleration", sensors)
                .and_then(|all| six("sensors.acceleration", all))
                .map(Some),
        };
        let floor = names
            .directions("floor.inputs", &file.floor.inputs)
            .and_then(|all| six("floor.inputs", all));
        let force_sensors = all(file.sensors.force.iter().map(|(name, spec)| {
            let entry = format!("sensors.force.{name}.beam");
            names.beam(&entry, &spec.beam)
        }));
        let performance = &file.performance;
        let deformations =
            names.deformations("performance.deformations", &performance.deformations);
        let accelerations =
            names.directions("performance.accelerations", &performance.accelerations);
        let loads = loads(&file.loads, &names);
        let (
            ((coordinates, actuators), (accelerometers, floor)),
            ((deformations, accelerations), (loads, force_sensors)),
        ) = both(
            both(both(coordinates, actuators), both(accelerometers, floor)),
            both(
                both(deformations, accelerations),
                both(loads, force_sensors),
            ),
        )?;
        Ok(Self {
            coordinates,
            actuators,
            accelerometers,
            floor,
            force_sensors,
            deformations,
            accelerations,
            loads,
        })
    }
}

/// The name becomes a file name and part of a comment in the table.
fn check_name(name: &str) -> Checked<()> {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    if name.is_empty()
        || !name.chars().all(plain)
        || !name.starts_with(|c: char| c.is_ascii_lowercase())
    {
        return Err(
            EntryError::new("name", format!("\"{name}\" is not a valid name"))
                .fix("use lower-case letters, digits and hyphens, a letter first"),
        );
    }
    Ok(())
}

/// The last part of an entry.
fn key(entry: &str) -> &str {
    entry.rsplit_once('.').map_or(entry, |(_, key)| key)
}

fn finite3(entry: &str, value: &[f64; 3], unit: &str) -> Checked<Vector3<f64>> {
    if value.iter().all(|x| x.is_finite()) {
        Ok(Vector3::from(*value))
    } else {
        let message = format!("must be three finite numbers{unit}");
        Err(EntryError::new(entry, message))
    }
}

/// A finite number for which `right` holds; `must` says what it must be.
pub(super) fn number(entry: &str, value: f64, right: bool, must: impl Display) -> Checked<f64> {
    let must = match value.is_finite() {
        true if right => return Ok(value),
        true => must.to_string(),
        false => "be a finite number".to_owned(),
    };
    let message = format!("{} must {must}, not {value}", key(entry));
    Err(EntryError::new(entry, message))
}

/// `" kg"` for kilograms; nothing where there is no unit.
fn after_number(unit: &str) -> String {
    if unit.is_empty() {
        String::new()
    } else {
        format!(" {unit}")
    }
}

pub(super) fn positive(entry: &str, value: f64, unit: &str) -> Checked<f64> {
    let must = format!("be above 0{}", after_number(unit));
    number(entry, value, value > 0.0, must)
}

pub(super) fn not_negative(entry: &str, value: f64, unit: &str) -> Checked<f64> {
    let must = format!("be at least 0{}", after_number(unit));
    number(entry, value, value >= 0.0, must)
}

pub(super) fn not_zero(entry: &str, value: f64) -> Checked<f64> {
    number(entry, value, value != 0.0, "differ from 0")
}

/// At least 0 and below 1.
pub(super) fn fraction(entry: &str, value: f64) -> Checked<f64> {
    let right = (0.0..1.0).contains(&value);
    number(entry, value, right, "be at least 0 and below 1")
}

/// At least 1 of something counted.
fn at_least_one(entry: &str, count: usize) -> Checked<()> {
    if count > 0 {
        Ok(())
    } else {
        let message = format!("{} must be at least 1", key(entry));
        Err(EntryError::new(entry, message))
    }
}

/// TOML's integers have a sign.
fn seed(entry: &str, seed: u64) -> Checked<()> {
    if i64::try_from(seed).is_ok() {
        Ok(())
    } else {
        let message = format!("seed must be at most {}, not {seed}", i64::MAX);
        Err(EntryError::new(entry, message))
    }
}

fn six<T>(entry: &str, all: Vec<T>) -> Checked<[T; LEGS]> {
    all.try_into().map_err(|all: Vec<T>| {
        EntryError::new(entry, format!("{} are given; there must be six", all.len()))
    })
}

/// Resolves every node and what carries it.
fn nodes(file: &MachineFile) -> Checked<Vec<Node>> {
    let mut carriers: Vec<Option<Carrier>> = vec![None; file.nodes.len()];
    let mut claim = |entry: &str, name: &str, carrier: Carrier| {
        let index = node_index(entry, file.nodes.keys(), name)?;
        if carriers[index].is_some() {
            return Err(
                EntryError::new(entry, format!("node \"{name}\" is listed twice"))
                    .fix("list it once: a node moves with one body or with the base, or is free"),
            );
        }
        carriers[index] = Some(carrier);
        Ok(())
    };
    let mut claimed = Vec::new();
    for name in &file.base.nodes {
        claimed.push(claim("base.nodes", name, Carrier::Base));
    }
    for name in &file.free.nodes {
        claimed.push(claim("free.nodes", name, Carrier::Free));
    }
    for (index, (body, spec)) in file.bodies.iter().enumerate() {
        for name in &spec.nodes {
            let entry = format!("bodies.{body}.nodes");
            claimed.push(claim(&entry, name, Carrier::Body(index)));
        }
    }
    for (index, (body, spec)) in file.flexible_bodies.iter().enumerate() {
        for name in &spec.nodes {
            let entry = format!("flexible_bodies.{body}.nodes");
            claimed.push(claim(&entry, name, Carrier::Flexible(index)));
        }
    }
    // A node that is misspelt is not left over as well.
    all(claimed)?;
    let nodes = file
        .nodes
        .iter()
        .zip(carriers)
        .map(|((name, at), carrier)| {
            let entry = format!("nodes.{name}");
            let carrier = carrier.ok_or_else(|| {
                EntryError::new(&entry, "the node is not attached to anything")
                    .fix("list it in the nodes of a body or of the base, or in free.nodes if only beams or springs hold it")
            })?;
            Ok(Node {
                name: name.clone(),
                at: finite3(&entry, at, ", in m")?,
                carrier,
            })
        });
    all(nodes)
}

fn flexible(file: &MachineFile, nodes: &[Node], source: &Source) -> Checked<Vec<FlexibleBody>> {
    let bodies = file.flexible_bodies.iter();
    let bodies = bodies.map(|(name, spec)| {
        let entry = format!("flexible_bodies.{name}.nodes");
        let interface = spec.nodes.iter();
        let interface = interface.map(|node| node_index(&entry, names(nodes), node));
        let folder = source.folder(&format!("flexible_bodies.{name}.mass_matrix"));
        let interface = interface.collect::<Checked<Vec<_>>>()?;
        flexible_body(name, spec, folder, interface, nodes)
    });
    all(bodies)
}

fn bodies(file: &MachineFile) -> Checked<Vec<Body>> {
    let own = file
        .beams
        .values()
        .filter_map(|beam| beam.stiffness.as_ref());
    let mut sets = file.profiles.values().chain(own);
    if file.bodies.is_empty()
        && file.flexible_bodies.is_empty()
        && file.point_masses.is_empty()
        && !sets.any(|set| set.density.is_some() || set.mass.is_some())
    {
        return Err(EntryError::new("bodies", "there must be at least one body"));
    }
    all(file.bodies.iter().map(|(name, spec)| {
        let entry = format!("bodies.{name}");
        let mass = positive(&format!("{entry}.mass"), spec.mass, "kg");
        let inertia = inertia(&format!("{entry}.inertia"), &spec.inertia);
        let cog = finite3(&format!("{entry}.cog"), &spec.cog, ", in m");
        let (mass, (inertia, cog)) = both(mass, both(inertia, cog))?;
        Ok(Body {
            name: name.clone(),
            mass,
            inertia,
            cog,
        })
    }))
}

/// The tensor of an inertia that some body can have, kg m².
fn inertia(entry: &str, spec: &Inertia) -> Checked<Matrix3<f64>> {
    let inertia = match spec {
        Inertia::Diagonal(moments) => Matrix3::from_diagonal(&Vector3::from(*moments)),
        Inertia::Tensor(rows) => {
            Matrix3::from_rows(&rows.map(|row| RowVector3::from_row_slice(&row)))
        }
    };
    if inertia.iter().any(|x| !x.is_finite()) {
        return Err(EntryError::new(entry, "must be finite numbers, in kg m²"));
    }
    let largest = inertia.amax();
    if (inertia - inertia.transpose()).amax() > 1e-9 * largest {
        return Err(EntryError::new(
            entry,
            "the inertia tensor must be symmetric",
        ));
    }
    // What a rotation of axes leaves in the last digits.
    let inertia = 0.5 * (inertia + inertia.transpose());
    let mut moments = inertia.symmetric_eigenvalues();
    moments.as_mut_slice().sort_by(f64::total_cmp);
    let [small, middle, large] = moments.into();
    // A plate of 0.833, 0.833 and 1.67 kg m² was typed with three digits.
    let rounding = 5e-3 * large.abs();
    if small < -1e-9 * largest {
        return Err(EntryError::new(
            entry,
            format!(
                "the principal moments of inertia must not be below 0 kg m²; the smallest is {small:.3e}"
            ),
        ));
    }
    if large > small + middle + rounding {
        return Err(EntryError::new(
            entry,
            format!(
                "no body has principal moments of inertia of {small:.4e}, {middle:.4e} and {large:.4e} kg m²: the largest must not exceed the sum of the others"
            ),
        )
        .fix("check units and decimal points; off-diagonals have the tensor's sign, Ixy = −∫xy dm"));
    }
    Ok(inertia)
}

fn springs(file: &MachineFile, nodes: &[Node]) -> Checked<Vec<Spring>> {
    let springs = file.springs.iter().map(|(name, spec)| {
        let entry = format!("springs.{name}");
        let key = |key: &str| format!("{entry}.{key}");
        let mut ends = [0; 2];
        for (end, node) in ends.iter_mut().zip(&spec.nodes) {
            *end = node_index(&key("nodes"), names(nodes), node)?;
        }
        let [p, q] = ends;
        if p == q {
            return Err(EntryError::new(
                key("nodes"),
                "a spring joins two nodes, and these are the same",
            )
            .fix("give the second part a node of its own, which may be at the same position"));
        }
        let six = |[translation, rotation]: [&Option<[f64; 3]>; 2]| {
            let halves = [translation, rotation].map(|half| half.unwrap_or_default());
            Vector6::from_column_slice(halves.as_flattened())
        };
        let stiffness = six([&spec.stiffness, &spec.rotational_stiffness]);
        let damper = six([&spec.damper, &spec.rotational_damper]);
        let keys = ["stiffness", "rotational_stiffness"];
        for (name, unit, half) in [
            (keys[0], "N/m", stiffness.fixed_rows::<3>(0)),
            (keys[1], "N m", stiffness.fixed_rows::<3>(3)),
        ] {
            finite3(
                &key(name),
                &half.into_owned().into(),
                &format!(", in {unit}"),
            )?;
        }
        for (name, unit, half) in [
            ("damper", "N s/m", damper.fixed_rows::<3>(0)),
            ("rotational_damper", "N m s", damper.fixed_rows::<3>(3)),
        ] {
            for x in half.iter() {
                not_negative(&key(name), *x, unit)?;
            }
        }
        if stiffness.amax() == 0.0 && damper.amax() == 0.0 {
            return Err(EntryError::new(
                entry,
                "a spring without stiffness and damper does nothing",
            )
            .fix("give stiffness, rotational_stiffness, damper or rotational_damper"));
        }
        let along = finite3(&key("x_axis"), &spec.x_axis.unwrap_or([1.0, 0.0, 0.0]), "")?;
        if along == Vector3::zeros() {
            return Err(EntryError::new(
                key("x_axis"),
                "a direction must differ from [0, 0, 0]",
            ));
        }
        Ok(Spring {
            name: name.clone(),
            ends,
            at: nodes[p].at.lerp(&nodes[q].at, 0.5),
            axes: axes(
                &entry,
                "the local x axis",
                along.normalize(),
                spec.y_axis.as_ref(),
            )?,
            stiffness,
            damper,
            loss_factor: not_negative(&key("loss_factor"), spec.loss_factor.unwrap_or(0.0), "")?,
        })
    });
    all(springs)
}

fn point_masses(file: &MachineFile, nodes: &[Node]) -> Checked<Vec<PointMass>> {
    let masses = file.point_masses.iter().map(|(name, spec)| {
        let entry = format!("point_masses.{name}");
        let node_entry = format!("{entry}.node");
        let node = node_index(&node_entry, names(nodes), &spec.node)?;
        if nodes[node].carrier == Carrier::Base {
            return Err(EntryError::new(
                node_entry,
                format!(
                    "node \"{}\" moves with the base, whose motion is given: a mass there changes nothing",
                    spec.node
                ),
            )
            .fix("use a node of a body or a free one"));
        }
        let no_inertia = Inertia::Diagonal([0.0; 3]);
        let spec_inertia = spec.inertia.as_ref().unwrap_or(&no_inertia);
        Ok(PointMass {
            node,
            body: Body {
                name: name.clone(),
                mass: positive(&format!("{entry}.mass"), spec.mass, "kg")?,
                inertia: inertia(&format!("{entry}.inertia"), spec_inertia)?,
                cog: nodes[node].at,
            },
        })
    });
    all(masses)
}

fn beams(file: &MachineFile, nodes: &[Node]) -> Checked<Vec<Beam>> {
    let beams = file.beams
        .iter()
        .map(|(name, spec)| {
            let entry = format!("beams.{name}");
            let mut ends = [0; 2];
            for (end, node) in ends.iter_mut().zip(&spec.nodes) {
                *end = node_index(&format!("{entry}.nodes"), names(nodes), node)?;
            }
            let along = nodes[ends[1]].at - nodes[ends[0]].at;
            let length = along.norm();
            if !length.is_finite() {
                return Err(EntryError::new(
                    format!("{entry}.nodes"),
                    "the two nodes are too far apart to compute the length of the beam",
                ));
            }
            // Less is the rounding of positions.
            if length < 1e-9 {
                return Err(EntryError::new(
                    format!("{entry}.nodes"),
                    "the two nodes are at the same position; a beam must have a length",
                ));
            }
            let (source, profile) = match (&spec.profile, &spec.stiffness) {
                (Some(profile), None) => {
                    let known = file.profiles.keys().map(String::as_str);
                    let fix = "add it under [profiles]";
                    let set = find(format!("{entry}.profile"), "profile", profile, known, fix)?;
                    (format!("profiles.{profile}"), &file.profiles[set])
                }
                (None, Some(own)) => (format!("{entry}.stiffness"), own),
                _ => {
                    return Err(EntryError::new(
                        entry,
                        "a beam must have either profile, the name of a shared stiffness set, or its own stiffness",
                    ));
                }
            };
            let stiffness = stiffness(&source, profile, length)?;
            let BeamMass { mass, polar_inertia, segments } =
                beam_mass(&source, profile, &stiffness, length)?;
            Ok(Beam {
                name: name.clone(),
                ends,
                stiffness,
                mass,
                polar_inertia,
                segments,
                released: released(&entry, spec.joints.as_ref())?,
                loss_factor: not_negative(&format!("{source}.loss_factor"), profile.loss_factor.unwrap_or(0.0), "")?,
                damper: not_negative(&format!("{source}.damper"), profile.damper.unwrap_or(0.0), "N s/m")?,
                preload: number(&format!("{entry}.preload"), spec.preload.unwrap_or(0.0), true, "")?,
                axes: axes(&entry, "the beam", along / length, spec.y_axis.as_ref())?,
                length,
            })
        });
    all(beams)
}

/// The rotations that the joints at the two ends of a beam release, about its local axes.
fn released(entry: &str, joints: Option<&[JointEntry; 2]>) -> Checked<[[bool; 3]; 2]> {
    let Some(joints) = joints else {
        return Ok([[false; 3]; 2]);
    };
    let released = joints.each_ref().map(|joint| match joint {
        JointEntry::Named(Joint::Fixed) => [false; 3],
        JointEntry::Named(Joint::Ball) => [true; 3],
        JointEntry::Named(Joint::Universal) => [false, true, true],
        JointEntry::Released(all) => {
            [Rotation::Rx, Rotation::Ry, Rotation::Rz].map(|rotation| all.contains(&rotation))
        }
    });
    if released.iter().all(|[about_own, ..]| *about_own) {
        return Err(EntryError::new(
            format!("{entry}.joints"),
            "a mechanism: both joints release rx, so that nothing keeps the beam from turning about its own axis",
        )
        .fix("let one joint hold rx, such as \"universal\" instead of \"ball\""));
    }
    Ok(released)
}

/// End stiffnesses as given, or from material and section over the length.
fn stiffness(entry: &str, p: &ProfileEntry, length: f64) -> Checked<Stiffness> {
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
                axial: positive(&format!("{entry}.youngs_modulus"), e, "Pa")? * area / length,
                bending: second.map(|i| e * i / length),
                torsion: positive(&format!("{entry}.shear_modulus"), g, "Pa")? * constant / length,
            }
        }
        _ => {
            return Err(EntryError::new(
                entry,
                "a stiffness set must have either axial, bending and torsion, or youngs_modulus, shear_modulus, area, second_moments and torsion_constant",
            ));
        }
    };
    let [y, z] = stiffness.bending;
    for (name, key, value, unit) in [
        ("axial stiffness EA/L", "axial", stiffness.axial, "N/m"),
        ("bending stiffness EI/L", "bending", y, "N m"),
        ("bending stiffness EI/L", "bending", z, "N m"),
        (
            "torsional stiffness GJ/L",
            "torsion",
            stiffness.torsion,
            "N m",
        ),
    ] {
        if !(value.is_finite() && value >= 0.0) {
            return Err(EntryError::new(
                entry,
                format!("{name} must be finite and at least 0 {unit}, not {value}"),
            ));
        }
        // It may come from a section and a length.
        if let Some(limits) = Limits::of(&format!("profiles.*.{key}"))
            && !limits.hold(value)
        {
            return Err(
                EntryError::new(entry, format!("{name} must be {limits}, not {value:e}"))
                    .fix("check the units of the section and of the nodes"),
            );
        }
    }
    Ok(stiffness)
}

/// Local axes with x along `what`, as rows. If `given` does not say where y is, z is as near
/// to the file's z as possible, and where x is upright, y is the file's y.
fn axes(
    entry: &str,
    what: &str,
    x: Vector3<f64>,
    given: Option<&[f64; 3]>,
) -> Checked<Matrix3<f64>> {
    let y = match given {
        Some(given) => {
            let entry = format!("{entry}.y_axis");
            let given = finite3(&entry, given, "")?;
            let across = given - x * x.dot(&given);
            if across.norm() <= 1e-6 * given.norm() {
                let message = format!("y_axis is parallel to {what}");
                let fix = format!("give a direction across {what}");
                return Err(EntryError::new(entry, message).fix(fix));
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

/// A damping ratio of 0.005 for every mode, unless the file gives any other damping.
fn damping(
    spec: &DampingEntry,
    beams: &[Beam],
    springs: &[Spring],
    flexible: &[FlexibleBody],
) -> Checked<Damping> {
    let elsewhere = spec.rayleigh.is_some() || has_damped_parts(beams, springs, flexible);
    let modal = spec.modal.unwrap_or(if elsewhere { 0.0 } else { 0.005 });
    fraction("damping.modal", modal)?;
    for (i, ratio) in spec.modes.iter().enumerate() {
        fraction(&format!("damping.modes[{i}]"), *ratio)?;
    }
    let rayleigh = spec.rayleigh.unwrap_or_default();
    for (x, unit) in rayleigh.into_iter().zip(["1/s", "s"]) {
        not_negative("damping.rayleigh", x, unit)?;
    }
    Ok(Damping {
        modal,
        modes: spec.modes.clone(),
        rayleigh,
    })
}

/// The beams of the force sensors, each with its name and its entry in the file.
fn force_sensors_of<'a>(
    specs: impl ExactSizeIterator<Item = ((&'a String, &'a ForceSensorEntry), usize)>,
    actuators: &[usize; LEGS],
) -> Checked<Option<[usize; LEGS]>> {
    if specs.len() == 0 {
        return Ok(None);
    }
    let mut known = Vec::new();
    let beams = all(specs.map(|((name, spec), beam)| {
        let entry = format!("sensors.force.{name}.beam");
        if !actuators.contains(&beam) {
            return Err(
                EntryError::new(entry, format!("beam \"{}\" has no actuator", spec.beam))
                    .fix("use one of actuators.beams"),
            );
        }
        if known.contains(&beam) {
            let message = format!("beam \"{}\" has two force sensors", spec.beam);
            return Err(EntryError::new(entry, message));
        }
        known.push(beam);
        Ok(beam)
    }))?;
    six("sensors.force", beams).map(Some)
}

fn target(control: &ControlEntry) -> Checked<Target> {
    let max_sensitivity = control.max_sensitivity;
    // The peak sensitivity of a loop is never below 1.
    number(
        "control.max_sensitivity",
        max_sensitivity,
        max_sensitivity > 1.0,
        "be above 1",
    )?;
    let roll_off = control.roll_off.map(|entry| {
        Ok(RollOff {
            hz: positive("control.roll_off.hz", entry.hz, "Hz")?,
            order: not_negative("control.roll_off.order", entry.order, "")?,
        })
    });
    let roll_off = roll_off.transpose()?;
    if let Some(penalty) = control.penalty {
        not_negative("control.penalty.force", penalty.force, "m/s²/N")?;
        not_negative("control.penalty.stroke", penalty.stroke, "1/s²")?;
        if control.minimise != Minimise::Rms {
            return Err(EntryError::new(
                "control.penalty",
                "only an rms can have a penalty on forces and strokes",
            )
            .fix("set control.minimise = \"rms\", or remove penalty"));
        }
    }
    if control.feedback == FeedbackKind::Both && control.law == LawName::Direct {
        return Err(EntryError::new(
            "control.law",
            "feedback = \"both\" needs law = \"modal\"",
        ));
    }
    Ok(Target {
        feedback: control.feedback,
        frequency: positive("control.frequency", control.frequency, "Hz")?,
        damping: not_negative("control.damping", control.damping, "")?,
        max_sensitivity,
        roll_off,
        law: control.law,
        minimise: control.minimise,
        penalty: control.penalty,
    })
}

fn shapes(control: &ControlEntry, sample_rate: f64) -> Checked<Option<[ShapeEntry; LEGS]>> {
    let Some(shapes) = &control.shapes else {
        return Ok(None);
    };
    let place = "control.shapes";
    if control.law == LawName::Direct {
        return Err(EntryError::new(place, "shapes need law = \"modal\""));
    }
    let Ok(six) = <[ShapeEntry; LEGS]>::try_from(shapes.clone()) else {
        let count = shapes.len();
        return Err(
            EntryError::new(place, format!("there must be {LEGS} shapes, not {count}"))
                .fix("give one for each mode, slowest mode first, as host-gen design prints them"),
        );
    };
    // A corner at half the sample rate or above has no section.
    let corner = |key: &str, hz: f64| {
        let limit = 0.5 * sample_rate;
        number(
            key,
            hz,
            hz > 0.0 && hz < limit,
            format!("be above 0 and below half the sample rate, {limit} Hz"),
        )
    };
    for (i, shape) in six.iter().enumerate() {
        let key = |key: &str| format!("{place}[{i}].{key}");
        let count = shape.sections.len();
        if count == 0 || count > SECTIONS {
            return Err(EntryError::new(
                key("sections"),
                format!("there must be 1 to {SECTIONS} sections, not {count}"),
            ));
        }
        for (j, filter) in shape.sections.iter().enumerate() {
            for (name, pair) in [("zeros", &filter.zeros), ("poles", &filter.poles)] {
                let key = |part: &str| key(&format!("sections[{j}].{name}.{part}"));
                corner(&key("hz"), pair.hz)?;
                positive(&key("damping"), pair.damping, "")?;
            }
        }
        match (shape.split_hz, control.feedback) {
            (Some(hz), FeedbackKind::Both) => {
                corner(&key("split_hz"), hz)?;
            }
            (None, FeedbackKind::Acceleration | FeedbackKind::Force) => {}
            (None, FeedbackKind::Both) => {
                return Err(EntryError::new(
                    format!("{place}[{i}]"),
                    "missing key `split_hz`, which feedback = \"both\" needs",
                ));
            }
            (Some(_), FeedbackKind::Acceleration | FeedbackKind::Force) => {
                return Err(EntryError::new(
                    key("split_hz"),
                    "there is nothing to split: only feedback = \"both\" has two kinds of sensors",
                ));
            }
        }
    }
    Ok(Some(six))
}

fn board(spec: &BoardEntry, feedback: FeedbackKind, legs: [&Beam; LEGS]) -> Checked<Board> {
    let accelerometer = sensor("board.accelerometer", spec.accelerometer.as_ref())?;
    let force_sensor = sensor("board.force_sensor", spec.force_sensor.as_ref())?;
    let there = |sensor: &Option<Sensor>, name| {
        sensor.clone().ok_or_else(|| {
            EntryError::new(
                "board",
                format!("[board.{name}] is missing; these sensors are fed back"),
            )
        })
    };
    let (sensor, beside) = match feedback {
        FeedbackKind::Acceleration => (there(&accelerometer, "accelerometer")?, None),
        FeedbackKind::Force => (there(&force_sensor, "force_sensor")?, None),
        FeedbackKind::Both => (
            there(&accelerometer, "accelerometer")?,
            Some(there(&force_sensor, "force_sensor")?),
        ),
    };
    for (key, bits) in [("adc", spec.adc.bits), ("dac", spec.dac.bits)] {
        if !(8..=16).contains(&bits) {
            return Err(EntryError::new(
                format!("board.{key}.bits"),
                format!("bits must be 8 to 16, not {bits}"),
            ));
        }
    }
    let adc = Adc::new(
        spec.adc.bits,
        positive("board.adc.range", spec.adc.range, "V")?,
    )
    .map_err(|error| EntryError::new("board.adc", error.to_string()))?;
    let [low, high] = spec.dac.range;
    let dac = Dac::new(spec.dac.bits, low, high).map_err(|_| {
        let message = "range must be [low, high], in V, with low < high, both finite";
        EntryError::new("board.dac.range", message)
    })?;
    if high - low < 1e-6 {
        let message = "range must be at least 1e-6 V wide";
        return Err(EntryError::new("board.dac.range", message));
    }
    let Actuator {
        gain,
        shares,
        limit,
        bandwidth,
        piezo,
    } = actuator(&spec.actuator, legs, &dac)?;
    let mut gains = gains(&spec.gains, feedback)?;
    for (gain, share) in gains.actuators.iter_mut().zip(shares) {
        *gain *= share;
    }
    let least = gains.actuators.into_iter().fold(f64::INFINITY, f64::min);
    let reach = dac.reach(gain * least);
    if spec.actuator.limit.is_some() && limit > reach {
        return Err(EntryError::new(
            "board.actuator.limit",
            format!(
                "limit must be at most {reach:.6} N, the force at the end of the DAC's range, not {limit}"
            ),
        ));
    }
    let board = Board {
        sample_rate: positive("board.sample_rate", spec.sample_rate, "Hz")?,
        latch_delay: not_negative("board.conversion_delay", spec.conversion_delay, "s")?
            + not_negative("board.output_delay", spec.output_delay, "s")?,
        adc,
        adc_noise: not_negative("board.adc.noise", spec.adc.noise, "V")?,
        dac,
        dac_noise: not_negative("board.dac.noise", spec.dac.noise, "V")?,
        sensor,
        beside,
        accelerometer,
        force_sensor,
        gains,
        actuator_gain: gain,
        actuator_bandwidth: bandwidth,
        force_limit: limit.min(reach),
        piezo,
    };
    // More would mean hundreds of controller states for no real board.
    if board.latch_delay > 8.0 * board.period() {
        return Err(EntryError::new(
            "board.output_delay",
            "conversion_delay + output_delay must be at most eight sample periods",
        )
        .fix("lower the sample rate or the delays"));
    }
    Ok(board)
}

/// The gains of single channels.
fn gains(spec: &GainsEntry, feedback: FeedbackKind) -> Checked<ChannelGains> {
    let six = |key: &str, gains: Option<[f64; LEGS]>| {
        let gains = gains.unwrap_or([1.0; LEGS]);
        for gain in gains {
            positive(&format!("board.gains.{key}"), gain, "")?;
        }
        Ok(gains)
    };
    let accelerometers = six("acceleration", spec.acceleration)?;
    let force_sensors = six("force", spec.force)?;
    Ok(ChannelGains {
        sensors: match feedback {
            FeedbackKind::Acceleration | FeedbackKind::Both => [accelerometers, force_sensors],
            FeedbackKind::Force => [force_sensors, accelerometers],
        },
        actuators: six("actuators", spec.actuators)?,
    })
}

fn uncertainty(spec: &UncertaintyEntry) -> Checked<Uncertainty> {
    let part = |key: &str, value: f64| {
        let entry = format!("uncertainty.{key}");
        let value = fraction(&entry, value)?;
        positive(&entry, value, "")
    };
    Ok(Uncertainty {
        mass: part("mass", spec.mass)?,
        inertia: part("inertia", spec.inertia)?,
        cog: positive("uncertainty.cog", spec.cog, "m")?,
        stiffness: part("stiffness", spec.stiffness)?,
        damping: part("damping", spec.damping)?,
        sensor_gain: part("sensor_gain", spec.sensor_gain)?,
        misalignment: positive("uncertainty.misalignment", spec.misalignment, "°")?.to_radians(),
        actuator_gain: part("actuator_gain", spec.actuator_gain)?,
        delay: positive("uncertainty.delay", spec.delay, "s")?,
    })
}

/// Longest silence of the link, s: at any sample rate it fits the table's counter.
const LONGEST_SILENCE: f64 = 3600.0;

fn supervision(s: &SupervisionSettings, sample_rate: f64) -> Checked<()> {
    let within = |key: &str, time: f64, samples: u32, longest: f64| {
        let right = time * sample_rate >= f64::from(samples) && time <= longest;
        let least = match samples {
            0 => "0 s".to_owned(),
            samples => format!("{samples} sample periods"),
        };
        let must = format!("be at least {least} and at most {longest:.0} s");
        number(&format!("supervision.{key}"), time, right, must)
    };
    // What fits the table's counters, and the sums over a window.
    let longest = f64::from(1 << 20) / sample_rate;
    let time = |key: &str, time: f64, samples| within(key, time, samples, longest);
    time("soft_start", s.soft_start, 2)?;
    time("settle", s.settle, 2)?;
    time("safe_ramp", s.safe_ramp, 2)?;
    time("rail", s.rail, 2)?;
    if let Some(saturated) = s.saturated {
        time("saturated", saturated, 2)?;
    }
    // After a window, each sample judges one sensor.
    time("window", s.window, 16)?;
    time("test_time", s.test_time, 16)?;
    time("pilot_time", s.pilot_time, 16)?;
    time("stuck", s.stuck.unwrap_or(0.0), 0)?;
    within("silence", s.silence, 0, LONGEST_SILENCE)?;
    for (key, ratio) in [("growth", s.growth), ("wild", s.wild), ("dull", s.dull)] {
        let entry = format!("supervision.{key}");
        number(&entry, ratio, ratio > 1.0, "be above 1")?;
    }
    for (key, part) in [("level", s.level), ("test_force", s.test_force)] {
        let right = part > 0.0 && part <= 1.0;
        let must = "be above 0 and at most 1, a fraction of the force limit";
        number(&format!("supervision.{key}"), part, right, must)?;
    }
    positive("supervision.test_tolerance", s.test_tolerance, "")?;
    not_negative("supervision.pilot", s.pilot.unwrap_or(0.0), "N")?;
    at_least_one("supervision.lost", s.lost as usize)?;
    at_least_one("supervision.grown", s.grown as usize)?;
    at_least_one("supervision.strange", s.strange as usize)?;
    at_least_one("supervision.spikes", s.spikes as usize)
}

fn loads(specs: &IndexMap<String, LoadEntry>, names: &Names) -> Checked<Vec<Load>> {
    if specs.len() > LEGS {
        return Err(EntryError::new(
            "loads",
            format!("{} loads are given; there may be six", specs.len()),
        )
        .fix("leave some away, or give them in another file that is based on this one"));
    }
    let direction = |spec: &LoadEntry| DirectionEntry {
        node: spec.node.clone(),
        direction: spec.direction,
    };
    let directions = specs
        .iter()
        .map(|(name, spec)| (name.clone(), direction(spec)));
    let directions = names.directions("loads", &directions.collect())?;
    let moments = specs.values().map(|spec| spec.moment);
    let load = |(at, moment)| Load { at, moment };
    Ok(directions.into_iter().zip(moments).map(load).collect())
}

/// Checks that all loads act on the machine.
fn check_loads(loads: &[Load], structure: &Structure) -> Checked<()> {
    for Load { at, .. } in loads {
        let node = &structure.nodes[at.node];
        if node.carrier == Carrier::Base {
            let message = format!(
                "node \"{}\" moves with the base, which does not yield",
                node.name
            );
            return Err(EntryError::new(format!("loads.{}.node", at.name), message)
                .fix("choose a node of the machine"));
        }
    }
    Ok(())
}

fn spectrum(entry: &SpectrumEntry) -> Checked<Floor> {
    let wrong = |message| EntryError::new("floor.spectrum", message);
    match entry {
        SpectrumEntry::Criterion(name) => match name.parse() {
            Ok(criterion) => Ok(Floor::Criterion(criterion)),
            Err(error) => Err(wrong(format!(
                "\"{name}\" is {error}, or points [[Hz, m/s²/√Hz], …]"
            ))),
        },
        SpectrumEntry::Points(points) => match Spectrum::new(points) {
            Ok(spectrum) => Ok(Floor::Table(spectrum)),
            Err(error) => Err(wrong(error.message)),
        },
    }
}

fn simulation(s: &Simulation, sample_rate: f64) -> Checked<()> {
    positive("simulation.duration", s.duration, "s")?;
    not_negative("simulation.settling", s.settling, "s")?;
    not_negative("simulation.floor_rms", s.floor_rms, "m/s²")?;
    let [low, high] = s.floor_band;
    let top = 0.45 * sample_rate;
    if !(low > 0.0 && high > low && high < top) {
        return Err(EntryError::new(
            "simulation.floor_band",
            format!(
                "must be [low, high], in Hz, with 0 < low < high < {top} (0.45 times the sample rate)"
            ),
        ));
    }
    seed("simulation.seed", s.seed)
}

fn robustness(
    spec: &RobustnessEntry,
    structure: &Structure,
    actuators: &[usize; LEGS],
) -> Checked<Robustness> {
    let bodies = &structure.bodies;
    let payload = match &spec.payload {
        Some(payload) => payload
            .iter()
            .map(|name| {
                let known = bodies.iter().map(|body| body.name.as_str());
                let fix = "use names under [bodies]";
                find("robustness.payload", "body", name, known, fix)
            })
            .collect::<Checked<Vec<_>>>()?,
        None => {
            let on_legs = |body: usize| {
                let ends = actuators.iter().flat_map(|&leg| structure.beams[leg].ends);
                let mut carriers = ends.map(|end| structure.nodes[end].carrier);
                carriers.any(|carrier| carrier == Carrier::Body(body))
            };
            (0..bodies.len()).filter(|&body| !on_legs(body)).collect()
        }
    };
    at_least_one("robustness.samples", spec.samples)?;
    seed("robustness.seed", spec.seed)?;
    Ok(Robustness {
        payload,
        mass: fraction("robustness.mass", spec.mass)?,
        cog: not_negative("robustness.cog", spec.cog, "m")?,
        leg_stiffness: fraction("robustness.leg_stiffness", spec.leg_stiffness)?,
        damping: fraction("robustness.damping", spec.damping)?,
        sensor_gain: fraction("robustness.sensor_gain", spec.sensor_gain)?,
        misalignment: not_negative("robustness.misalignment", spec.misalignment, "°")?.to_radians(),
        actuator_gain: fraction("robustness.actuator_gain", spec.actuator_gain)?,
        delay: not_negative("robustness.delay", spec.delay, "s")?,
        samples: spec.samples,
        seed: spec.seed,
    })
}

fn names(nodes: &[Node]) -> impl Iterator<Item = &String> + Clone {
    nodes.iter().map(|node| &node.name)
}

fn node_index<'a>(
    entry: &str,
    nodes: impl Iterator<Item = &'a String> + Clone,
    name: &str,
) -> Checked<usize> {
    let known = nodes.map(String::as_str);
    find(entry, "node", name, known, "add it under [nodes]")
}

/// The nodes and beams of a file, by name. Their numbers are those in a [`Structure`].
struct Names<'a> {
    file: &'a MachineFile,
}

impl Names<'_> {
    fn beam(&self, entry: &str, name: &str) -> Checked<usize> {
        let known = self.file.beams.keys().map(String::as_str);
        find(entry, "beam", name, known, "add it under [beams]")
    }

    fn deformations(&self, entry: &str, names: &[String]) -> Checked<Vec<Deformation>> {
        let mut known = Vec::new();
        all(names.iter().map(|name| {
            let deformation = self.deformation(entry, name)?;
            if known.contains(&deformation) {
                let message = format!("\"{name}\" is listed twice");
                return Err(EntryError::new(entry, message));
            }
            known.push(deformation);
            Ok(deformation)
        }))
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
            _ => Err(
                EntryError::new(entry, format!("\"{name}\" is not a deformation"))
                    .fix("use \"BEAM.e1\" to \"BEAM.e6\""),
            ),
        }
    }

    fn directions(
        &self,
        entry: &str,
        specs: &IndexMap<String, DirectionEntry>,
    ) -> Checked<Vec<Direction>> {
        let directions = specs.iter().map(|(name, spec)| {
            let entry = format!("{entry}.{name}");
            let direction_entry = format!("{entry}.direction");
            let unit = |direction: Vector3<f64>| {
                let norm = direction.norm();
                if (norm - 1.0).abs() > UNIT_SLACK {
                    return Err(EntryError::new(
                        &direction_entry,
                        format!("direction must be a unit vector; its length is {norm:.6}"),
                    ));
                }
                Ok(direction / norm)
            };
            let direction = finite3(&direction_entry, &spec.direction, "").and_then(unit);
            let node = node_index(&format!("{entry}.node"), self.file.nodes.keys(), &spec.node);
            let (direction, node) = both(direction, node)?;
            Ok(Direction {
                name: name.clone(),
                node,
                direction,
            })
        });
        all(directions)
    }
}
