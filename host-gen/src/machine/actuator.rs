//! The actuators of the legs with their amplifiers, from the file's form.

use shared::LEGS;
use shared::codes::Dac;

use super::checked::{Actuator, Beam, Piezo};
use super::error::EntryError;
use super::file::{ActuatorEntry, PiezoEntry, VoiceCoilEntry};
use super::sensor::bandwidth;
use super::validate::{Checked, not_zero, number, positive};

/// The largest hysteresis, below which small signals still have more than a fifth of the stroke.
const MOST_HYSTERESIS: f64 = 0.4;

/// The largest creep per decade.
const MOST_CREEP: f64 = 0.1;

/// How far free stroke times stiffness may be from the blocked force, as a factor: data sheets give
/// the stiffness for small signals, and the stroke for large ones.
const TOGETHER: f64 = 1.6;

/// How much stiffer than its stack a leg may be: typed digits.
const STIFFER: f64 = 1.001;

/// The actuators that `spec` describes, in these `legs` in channel order, driven by `dac`.
pub(super) fn actuator(spec: &ActuatorEntry, legs: [&Beam; LEGS], dac: &Dac) -> Checked<Actuator> {
    let plain = Actuator {
        gain: 1.0,
        shares: [1.0; LEGS],
        limit: f64::INFINITY,
        bandwidth: bandwidth("board.actuator.bandwidth", spec.bandwidth)?,
        piezo: None,
    };
    let mut actuator = match (&spec.piezo, &spec.voice_coil) {
        (Some(_), Some(_)) => {
            return Err(EntryError::new(
                "board.actuator",
                "piezo and voice_coil exclude each other",
            )
            .fix("remove one of them"));
        }
        // A leg as measured may be stiffer than the data sheet of its stack says.
        (Some(piezo), None) => stack(piezo, legs, spec.gain.is_some(), plain)?,
        (None, Some(coil)) => voice_coil(coil, plain)?,
        (None, None) => {
            let key = match (spec.gain, spec.limit) {
                (Some(_), Some(_)) => None,
                (None, _) => Some("gain"),
                (Some(_), None) => Some("limit"),
            };
            if let Some(key) = key {
                let message = format!("missing key `{key}`");
                return Err(EntryError::new("board.actuator", message).fix(
                    "give gain, in N/V, and limit, in N; or the figures of a data sheet in [board.actuator.piezo] or [board.actuator.voice_coil]",
                ));
            }
            plain
        }
    };
    let derived = actuator.gain;
    if let Some(gain) = spec.gain {
        actuator.gain = not_zero("board.actuator.gain", gain)?;
        // What was measured is that of every leg; board.gains says how they differ.
        actuator.shares = [1.0; LEGS];
        actuator.piezo = actuator
            .piezo
            .map(|piezo| piezo.scaled((actuator.gain / derived).abs()));
    }
    actuator.limit = match spec.limit {
        Some(limit) => positive("board.actuator.limit", limit, "N")?,
        None => {
            let least = actuator.shares.into_iter().fold(f64::INFINITY, f64::min);
            let own = match &actuator.piezo {
                Some(piezo) => piezo.half_range,
                None => actuator.limit,
            };
            dac.reach(actuator.gain * least).min(own * least)
        }
    };
    Ok(actuator)
}

/// A stack in series with flexures; `measured` if the force per volt is known without it.
fn stack(
    spec: &PiezoEntry,
    legs: [&Beam; LEGS],
    measured: bool,
    plain: Actuator,
) -> Checked<Actuator> {
    let key = |key: &str| format!("board.actuator.piezo.{key}");
    let optional = |name: &str, value: Option<f64>, unit: &str| {
        value
            .map(|value| positive(&key(name), value, unit))
            .transpose()
    };
    let stroke = optional("free_stroke", spec.free_stroke, "m")?;
    let stiffness = optional("stiffness", spec.stiffness, "N/m")?;
    let blocked = optional("blocked_force", spec.blocked_force, "N")?;
    let stroke = match (stroke, stiffness, blocked) {
        (Some(stroke), Some(stiffness), Some(blocked)) => {
            let product = stroke * stiffness;
            if !(1.0 / TOGETHER..=TOGETHER).contains(&(blocked / product)) {
                let message = format!(
                    "blocked_force is {blocked} N, but free_stroke times stiffness is {product:.4} N: they are not of one stack"
                );
                return Err(EntryError::new(key("blocked_force"), message)
                    .fix("check their units, or leave blocked_force away"));
            }
            stroke
        }
        (Some(stroke), _, _) => stroke,
        (None, Some(stiffness), Some(blocked)) => blocked / stiffness,
        (None, _, _) => {
            let message = "missing key `free_stroke`";
            return Err(EntryError::new("board.actuator.piezo", message)
                .fix("give free_stroke, in m; or blocked_force, in N, and stiffness, in N/m"));
        }
    };
    let [low, high] = spec.voltage;
    let swing = high - low;
    if !(swing > 0.0 && swing.is_finite()) {
        let message = "voltage must be [low, high], in V, with low < high, both finite";
        return Err(EntryError::new(key("voltage"), message));
    }
    for leg in legs {
        let axial = leg.stiffness.axial;
        if axial == 0.0 {
            let message = format!(
                "the actuated beam \"{}\" has no axial stiffness, so that its stack makes no force",
                leg.name
            );
            return Err(EntryError::new("board.actuator.piezo", message)
                .fix("give the beam the stiffness of stack and flexures in series"));
        }
        if let Some(stiffness) = stiffness
            && axial > STIFFER * stiffness
            && !measured
        {
            let message = format!(
                "the stack, {stiffness} N/m, is softer than the actuated beam \"{}\", {axial} N/m, that it is a part of",
                leg.name
            );
            return Err(EntryError::new(key("stiffness"), message)
                .fix("give the beam the axial stiffness of stack and flexures in series"));
        }
    }
    let hysteresis = spec.hysteresis.unwrap_or(0.0);
    let right = (0.0..MOST_HYSTERESIS).contains(&hysteresis);
    let must = "be 0 to below 0.4, a fraction of the stroke";
    number(&key("hysteresis"), hysteresis, right, must)?;
    let creep = spec.creep.unwrap_or(0.0);
    let right = (0.0..=MOST_CREEP).contains(&creep);
    number(
        &key("creep"),
        creep,
        right,
        "be 0 to 0.1, a part of an expansion",
    )?;
    let capacitance = optional("capacitance", spec.capacitance, "F")?;
    let current = optional("amplifier_current", spec.amplifier_current, "A")?;
    let amplifier = not_zero(&key("amplifier_gain"), spec.amplifier_gain)?;

    let mean = legs.map(|leg| leg.stiffness.axial).iter().sum::<f64>() / LEGS as f64;
    // Small signals move the stack less than its stroke says.
    let per_volt = mean * stroke / swing * (1.0 - 2.0 * hysteresis);
    let rate = match (current, capacitance) {
        (Some(current), Some(capacitance)) => Some(per_volt * current / capacitance),
        (Some(_), None) => {
            let message = "missing key `capacitance`, which amplifier_current needs";
            return Err(EntryError::new("board.actuator.piezo", message)
                .fix("give the capacitance of the stack, in F"));
        }
        (None, _) => None,
    };
    Ok(Actuator {
        gain: per_volt * amplifier,
        shares: legs.map(|leg| leg.stiffness.axial / mean),
        piezo: Some(Piezo {
            half_range: 0.5 * per_volt * swing,
            hysteresis,
            creep,
            rate,
        }),
        ..plain
    })
}

fn voice_coil(spec: &VoiceCoilEntry, plain: Actuator) -> Checked<Actuator> {
    let key = |key: &str| format!("board.actuator.voice_coil.{key}");
    let constant = positive(&key("force_constant"), spec.force_constant, "N/A")?;
    let amplifier = not_zero(&key("amplifier_gain"), spec.amplifier_gain)?;
    let current = positive(&key("current"), spec.current, "A")?;
    Ok(Actuator {
        gain: constant * amplifier,
        limit: constant * current,
        ..plain
    })
}
