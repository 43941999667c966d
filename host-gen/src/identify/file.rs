//! The fitted machine as a file that is based on the one that was fitted.

use nalgebra::Matrix3;
use toml::{Table, Value};

use super::{Identification, Quantity};
use crate::machine::file::ProfileEntry;
use crate::machine::{FeedbackKind, Machine, MachineFile};

/// Significant digits of what is written: more than any measurement has.
const DIGITS: usize = 7;

/// The text of a machine file that is `based_on` the one of `machine`, the machine that was fitted,
/// and holds what the measurement has changed. `from` says where the numbers are from.
///
/// A delay beside that of the file is not in it. Gains are those of each channel.
pub fn fitted_file(
    machine: &Machine,
    found: &Identification,
    based_on: &str,
    name: &str,
    from: &str,
) -> String {
    let fitted = &found.machine;
    let description = machine.description();
    let mut root = Table::new();
    let mut entries = Vec::new();
    let mut put = |path: &[&str], value: Value| {
        let mut table = &mut root;
        let Some((last, path)) = path.split_last() else {
            return;
        };
        for key in path {
            let next = table.entry(*key).or_insert_with(|| Table::new().into());
            let Value::Table(next) = next else { return };
            table = next;
        }
        table.insert((*last).to_owned(), value);
    };
    for body in &fitted.bodies {
        let at = |key: &'static str| ["bodies", body.name.as_str(), key];
        put(&at("mass"), number(body.mass));
        put(&at("inertia"), tensor(&body.inertia));
        put(&at("cog"), numbers(body.cog.iter().copied()));
        for key in ["mass", "inertia", "cog"] {
            entries.push(format!("bodies.{}.{key}", body.name));
        }
    }
    let factor = |quantity| change(found, quantity).exp();
    let damping = factor(Quantity::Damping);
    for (i, beam) in fitted.beams.iter().enumerate() {
        let whole = factor(Quantity::Stiffness(i));
        let apart = [Quantity::Bending(i), Quantity::Torsion(i)].map(factor);
        let Some((entry, own)) = stiffness(description, &beam.name) else {
            continue;
        };
        let profile = free_name(description, &beam.name);
        let section = if own {
            entries.push(format!("beams.{}.stiffness", beam.name));
            ["beams", &beam.name, "stiffness"].to_vec()
        } else {
            entries.push(format!("profiles.{profile}"));
            put(&["beams", &beam.name, "profile"], profile.clone().into());
            ["profiles", &profile].to_vec()
        };
        for (name, value) in scaled(&entry, whole, apart, damping) {
            put(&[&section[..], &[&name]].concat(), value);
        }
    }
    for spring in &fitted.springs {
        for (key, values, from) in [
            ("stiffness", &spring.stiffness, 0),
            ("rotational_stiffness", &spring.stiffness, 3),
            ("damper", &spring.damper, 0),
            ("rotational_damper", &spring.damper, 3),
        ] {
            let values = &values.as_slice()[from..from + 3];
            if values.iter().any(|value| *value != 0.0) {
                put(
                    &["springs", &spring.name, key],
                    numbers(values.iter().copied()),
                );
                entries.push(format!("springs.{}.{key}", spring.name));
            }
        }
        if spring.loss_factor > 0.0 {
            put(
                &["springs", &spring.name, "loss_factor"],
                number(spring.loss_factor),
            );
            entries.push(format!("springs.{}.loss_factor", spring.name));
        }
    }
    for point in &fitted.point_masses {
        let body = &point.body;
        put(&["point_masses", &body.name, "mass"], number(body.mass));
        entries.push(format!("point_masses.{}.mass", body.name));
        if body.inertia.amax() > 0.0 {
            put(
                &["point_masses", &body.name, "inertia"],
                tensor(&body.inertia),
            );
            entries.push(format!("point_masses.{}.inertia", body.name));
        }
    }
    for body in &fitted.flexible {
        for (key, value) in [
            ("loss_factor", body.loss_factor),
            ("modal_damping", body.modal_damping),
        ] {
            if value > 0.0 {
                put(&["flexible_bodies", &body.name, key], number(value));
                entries.push(format!("flexible_bodies.{}.{key}", body.name));
            }
        }
    }
    if !fitted.damping.modes.is_empty() {
        put(
            &["damping", "modes"],
            numbers(fitted.damping.modes.iter().copied()),
        );
        entries.push("damping.modes".to_owned());
    }
    if fitted.damping.rayleigh != [0.0; 2] {
        put(&["damping", "rayleigh"], numbers(fitted.damping.rayleigh));
        entries.push("damping.rayleigh".to_owned());
    }
    let before = machine.accelerometers.iter().flatten();
    let after = fitted.accelerometers.iter().flatten();
    for (_, sensor) in before.zip(after).filter(|(before, after)| before != after) {
        let path = ["sensors", "acceleration", sensor.name.as_str(), "direction"];
        put(&path, numbers(sensor.direction.iter().copied()));
        entries.push(format!("sensors.acceleration.{}.direction", sensor.name));
    }
    // Errors are by kind, accelerometers first; gains of a board begin with what is fed back.
    let [first, second] = machine.board.gains.sensors;
    let known = match machine.target.feedback {
        FeedbackKind::Acceleration | FeedbackKind::Both => [first, second],
        FeedbackKind::Force => [second, first],
    };
    let errors = &fitted.gain_errors;
    let all = [
        ("acceleration", known[0], errors.sensors[0]),
        ("force", known[1], errors.sensors[1]),
        ("actuators", machine.board.gains.actuators, errors.actuators),
    ];
    // What follows from the stiffness of the legs in the file would follow from the fitted one.
    let actuator = &machine.description().board.actuator;
    let follows = actuator.gain.is_none();
    if follows {
        let gain = machine.board.actuator_gain;
        put(&["board", "actuator", "gain"], number(gain));
        entries.push("board.actuator.gain".to_owned());
    }
    if actuator.limit.is_none() {
        let limit = machine.board.force_limit;
        put(&["board", "actuator", "limit"], number(limit));
    }
    for (key, known, errors) in all {
        if errors.iter().any(|error| *error != 0.0) || (follows && key == "actuators") {
            let gains = known
                .iter()
                .zip(errors)
                .map(|(known, error)| known * (1.0 + error));
            put(&["board", "gains", key], numbers(gains));
            entries.push(format!("board.gains.{key}"));
        }
    }
    let mut provenance = Table::new();
    let entries: Vec<Value> = entries.into_iter().map(Value::from).collect();
    provenance.insert("entries".to_owned(), entries.into());
    provenance.insert("kind".to_owned(), "measured".into());
    provenance.insert("from".to_owned(), from.into());
    root.insert(
        "provenance".to_owned(),
        Value::Array(vec![provenance.into()]),
    );
    let mut top = Table::new();
    top.insert("based_on".to_owned(), based_on.into());
    top.insert("name".to_owned(), name.into());
    format!("{top}\n{root}")
}

/// The change of a quantity, in the unit of its scale.
fn change(found: &Identification, quantity: Quantity) -> f64 {
    let mut own = found
        .changes
        .iter()
        .filter(|(parameter, _)| parameter.quantity == quantity);
    own.next().map_or(0.0, |(_, change)| *change)
}

/// The stiffness set of a beam, and whether it is its own.
fn stiffness(description: &MachineFile, beam: &str) -> Option<(ProfileEntry, bool)> {
    let entry = description.beams.get(beam)?;
    if let Some(own) = &entry.stiffness {
        return Some((own.clone(), true));
    }
    let profile = description.profiles.get(entry.profile.as_deref()?)?;
    Some((profile.clone(), false))
}

/// A name for a profile that the file does not have yet.
fn free_name(description: &MachineFile, beam: &str) -> String {
    let mut name = beam.to_owned();
    while description.profiles.contains_key(&name) {
        name.push_str("-fitted");
    }
    name
}

/// A stiffness set with all stiffnesses `whole` times as large, those of bending and torsion by the
/// factors `apart` more, and with other damping. Its mass stays.
fn scaled(entry: &ProfileEntry, whole: f64, apart: [f64; 2], damping: f64) -> Table {
    let mut entry = entry.clone();
    let [bending, torsion] = apart;
    for (value, factor) in [
        (&mut entry.axial, whole),
        (&mut entry.torsion, whole * torsion),
        (&mut entry.youngs_modulus, whole),
        (&mut entry.shear_modulus, whole),
        (&mut entry.torsion_constant, torsion),
        (&mut entry.loss_factor, damping),
        (&mut entry.damper, damping),
    ] {
        if let Some(value) = value {
            *value = rounded(*value * factor);
        }
    }
    for (value, factor) in [
        (&mut entry.bending, whole * bending),
        (&mut entry.second_moments, bending),
    ] {
        if let Some(value) = value {
            *value = value.map(|x| rounded(x * factor));
        }
    }
    Table::try_from(&entry).unwrap_or_default()
}

/// A number with as many digits as are written.
fn rounded(x: f64) -> f64 {
    format!("{x:.*e}", DIGITS - 1).parse().unwrap_or(x)
}

fn number(x: f64) -> Value {
    rounded(x).into()
}

fn tensor(inertia: &Matrix3<f64>) -> Value {
    let rows = (0..3).map(|i| numbers((0..3).map(|j| inertia[(i, j)])));
    Value::Array(rows.collect())
}

fn numbers(all: impl IntoIterator<Item = f64>) -> Value {
    Value::Array(all.into_iter().map(number).collect())
}
