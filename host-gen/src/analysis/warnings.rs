//! Warnings about a machine, and the sources of its numbers.

use nalgebra::Vector3;
use serde::Serialize;

use crate::design::Study;
use crate::design::study::Growth;
use crate::machine::{Beam, Body, Carrier, Certainty, FeedbackKind, Machine, Provenance};
use crate::model::gravity::buckling_load;
use crate::model::independence::reach;

/// The source of some of a machine's numbers.
#[derive(Debug, Serialize)]
pub(crate) struct Statement {
    pub(crate) kind: &'static str,
    pub(crate) entries: Vec<String>,
    pub(crate) from: String,
}

impl Statement {
    /// From an entry in the machine's file.
    pub(crate) fn new(provenance: &Provenance) -> Self {
        Self {
            kind: match provenance.kind {
                Certainty::Published => "published",
                Certainty::Reconstructed => "reconstructed",
                Certainty::Assumed => "assumed",
                Certainty::Measured => "measured",
            },
            entries: provenance.entries.clone(),
            from: provenance.from.clone(),
        }
    }
}

/// What is suspicious about a machine, in words: numbers that look like another unit, legs that
/// buckle, and instability under gravity. Empty if there is nothing.
pub fn warnings(study: &Study) -> Vec<String> {
    let mut warnings = units(study.machine());
    let statics = &study.model().statics;
    let loads = statics.axial.iter().zip(&statics.buckled);
    for (beam, (load, buckled)) in study.machine().beams.iter().zip(loads) {
        if let Some(limit) = buckling_load(beam)
            && -load > limit
        {
            warnings.push(format!(
                "{} buckles: its load is {:.0} N, its buckling load {limit:.0} N",
                beam.name, -load
            ));
        } else if *buckled {
            warnings.push(format!(
                "{} buckles between its ends under its bending moments and its axial force of {load:.0} N",
                beam.name
            ));
        }
    }
    if let Some(hz) = study.falls() {
        warnings.push(format!(
            "the machine does not stand: a mode grows at {hz:.3} Hz"
        ));
    }
    if study.design_model().feedback != FeedbackKind::Both {
        match study.zeros().and_then(|zeros| study.growth(&zeros)) {
            Ok(None) => {}
            Err(error) => warnings.push(format!("no transmission zeros are known: {error}")),
            Ok(Some(Growth::Weight)) => warnings.push(
                "with the sensor outputs held at zero, the machine is unstable under gravity: see host-gen zeros"
                    .to_owned(),
            ),
            Ok(Some(Growth::Springs)) => warnings.push(
                "with the sensor outputs held at zero, the machine is unstable by its springs of negative stiffness: see host-gen zeros"
                    .to_owned(),
            ),
            Ok(Some(Growth::Placement)) => warnings.push(
                "from leg forces to sensors there is an unstable zero, which limits the gain: see host-gen zeros"
                    .to_owned(),
            ),
        }
    }
    warnings
}

/// A distance and a radius of gyration, a section and a length, whose ratio exceeds this do not
/// belong to one body.
const APART: f64 = 20.0;

/// Mass over the cube of the radius of gyration, kg/m³, of a solid ball of the densest metal,
/// 22.6e3 kg/m³, is 2e5. Frames and shells have less, down to that of a soap bubble.
const DENSITY: [f64; 2] = [0.05, 5e5];

/// Moduli, Pa, of soft rubber and of diamond.
const MODULUS: [f64; 2] = [5e5, 2e12];

/// Below this stiffness, N/m, a leg is softer than the air springs that hard mounts replace.
const SOFT_LEG: f64 = 1e3;

/// A damping ratio above this is that of a damper, not of a structure.
const DAMPED: f64 = 0.3;

/// The lowest sample rate, Hz, of a loop against vibration.
const SLOW: f64 = 100.0;

/// Numbers that look as if they were given in another unit than that of the file.
fn units(machine: &Machine) -> Vec<String> {
    let mut warnings = Vec::new();
    for (i, body) in machine.bodies.iter().enumerate() {
        warnings.extend(of_body(machine, i, body));
    }
    let file = machine.description();
    let own = file.beams.iter().filter_map(|(name, beam)| {
        let stiffness = beam.stiffness.as_ref()?;
        Some((format!("beams.{name}.stiffness"), stiffness))
    });
    let shared = file.profiles.iter();
    let shared = shared.map(|(name, profile)| (format!("profiles.{name}"), profile));
    for (entry, profile) in own.chain(shared) {
        for (key, modulus) in [
            ("youngs_modulus", profile.youngs_modulus),
            ("shear_modulus", profile.shear_modulus),
        ] {
            let Some(modulus) = modulus else { continue };
            if modulus < MODULUS[0] {
                warnings.push(format!(
                    "{entry}.{key} is {modulus} Pa, softer than rubber: is it in GPa or in N/mm²?"
                ));
            } else if modulus > MODULUS[1] {
                warnings.push(format!(
                    "{entry}.{key} is {modulus:e} Pa, stiffer than diamond: is it in Pa?"
                ));
            }
        }
        if let (Some(area), Some(second)) = (profile.area, profile.second_moments) {
            let size = area.sqrt();
            for second in second {
                let gyration = (second / area).sqrt();
                if area > 0.0 && second > 0.0 && !(1e-3..=100.0).contains(&(gyration / size)) {
                    warnings.push(format!(
                        "{entry}: no section has an area of {area:e} m² and a second moment of {second:e} m⁴: are they in mm² and mm⁴?"
                    ));
                    break;
                }
            }
        }
        if profile.loss_factor.is_some_and(|loss| loss > 2.0) {
            warnings.push(format!(
                "{entry}.loss_factor is above 2, more than rubber has: is it in percent?"
            ));
        }
    }
    for beam in &machine.beams {
        let spec = &file.beams[&beam.name];
        let profile = spec
            .profile
            .as_ref()
            .and_then(|name| file.profiles.get(name));
        let area = profile.or(spec.stiffness.as_ref()).and_then(|p| p.area);
        if area.is_some_and(|area| area.sqrt() > APART * beam.length) {
            warnings.push(format!(
                "beams.{}: its section is far wider than it is long, {:.3e} m: is the area in mm²?",
                beam.name, beam.length
            ));
        }
    }
    let size = (0..machine.bodies.len()).map(|body| {
        let own = machine.nodes.iter();
        let own = own.filter(|node| node.carrier == Carrier::Body(body));
        let body = &machine.bodies[body];
        let reach = own.map(|node| (node.at - body.cog).norm());
        reach.fold(body.gyration(), f64::max)
    });
    let flexible = machine.flexible.iter().flat_map(|body| {
        let nodes = body.nodes.iter();
        nodes.map(|&node| (machine.nodes[node].at - body.cog).norm())
    });
    let size = size.chain(flexible).fold(0.0, f64::max);
    let longest = machine.beams.iter();
    let longest = longest.max_by(|a, b| a.length.total_cmp(&b.length));
    if let Some(beam) = longest
        && beam.length > 100.0 * size
    {
        warnings.push(format!(
            "beams.{} is {:.3e} m long, and no body is larger than {size:.3e} m: are all nodes in m?",
            beam.name, beam.length
        ));
    }
    for &leg in &machine.actuators {
        let Beam {
            name, stiffness, ..
        } = &machine.beams[leg];
        if stiffness.axial < SOFT_LEG {
            warnings.push(format!(
                "the actuated beam {name} has an axial stiffness of {:e} N/m, softer than an air spring: is it in N/µm (1e6 N/m)?",
                stiffness.axial
            ));
        }
    }
    let gravity = machine.gravity.norm();
    if gravity > 0.0 && !(1.0..=30.0).contains(&gravity) {
        warnings.push(format!(
            "gravity is {gravity:.3e} m/s², not that of a planet: is it in m/s²?"
        ));
    }
    let damping = &machine.damping;
    let ratios = [("modal", damping.modal)].into_iter();
    for (key, ratio) in ratios.chain(damping.modes.iter().map(|ratio| ("modes", *ratio))) {
        if ratio > DAMPED {
            warnings.push(format!(
                "damping.{key} is {ratio}, more than any structure has: is it in percent?"
            ));
        }
    }
    let board = &machine.board;
    let range = file.board.adc.range;
    if board.sample_rate < SLOW {
        warnings.push(format!(
            "board.sample_rate is {} Hz: is it in kHz?",
            board.sample_rate
        ));
    }
    for (kind, sensor) in [
        ("accelerometer", &board.accelerometer),
        ("force_sensor", &board.force_sensor),
    ] {
        let Some(sensor) = sensor else { continue };
        let volts = sensor.noise_density.rms(board.sample_rate) * sensor.sensitivity;
        if volts.abs() > range {
            warnings.push(format!(
                "board.{kind}.noise_density makes {:.1e} V rms at a converter of ±{} V: is it in the unit of the file?",
                volts.abs(),
                range
            ));
        }
        if let Some(corner) = sensor.lower_corner
            && corner.hz() > machine.target.frequency
        {
            warnings.push(format!(
                "board.{kind}.lower_corner is {} Hz, above control.frequency: these sensors do not see the suspension",
                corner.hz()
            ));
        }
        if sensor.offset.abs() >= range {
            warnings.push(format!(
                "board.{kind}.offset is beyond the converter's range of ±{range} V: is it in mV?"
            ));
        }
    }
    warnings
}

/// The same for one body: its size by its inertia against its size by its nodes, and its density.
fn of_body(machine: &Machine, index: usize, body: &Body) -> Option<String> {
    let entry = format!("bodies.{}", body.name);
    let gyration = body.gyration();
    let own = machine.nodes.iter();
    let own: Vec<_> = own
        .filter(|node| node.carrier == Carrier::Body(index))
        .map(|node| node.at)
        .collect();
    let count = own.len() as f64;
    let middle = own.iter().sum::<Vector3<f64>>() / count.max(1.0);
    let spread = own
        .iter()
        .map(|at| (at - middle).norm())
        .fold(0.0, f64::max);
    let offset = (body.cog - middle).norm();
    if !own.is_empty() && offset > APART * reach(machine).max(spread) {
        return Some(format!(
            "{entry}.cog is {offset:.3e} m from the body's nodes, in a machine of {:.3e} m: is it in mm?",
            reach(machine)
        ));
    }
    if gyration == 0.0 {
        return None;
    }
    let farthest = own
        .iter()
        .map(|at| (at - body.cog).norm())
        .fold(0.0, f64::max);
    let why = "are nodes and cog in m, mass in kg and inertia in kg m²?";
    if farthest > APART * gyration || (farthest > 0.0 && gyration > APART * farthest) {
        return Some(format!(
            "{entry}: the radius of gyration is {gyration:.3e} m by inertia and mass, but the nodes are {farthest:.3e} m from the centre of gravity: {why}"
        ));
    }
    let density = body.mass / gyration.powi(3);
    if !(DENSITY[0]..=DENSITY[1]).contains(&density) {
        let word = if density < DENSITY[0] {
            "lighter"
        } else {
            "denser"
        };
        return Some(format!(
            "{entry}: {} kg with a radius of gyration of {gyration:.3e} m is {word} than any part: {why}",
            body.mass
        ));
    }
    None
}
