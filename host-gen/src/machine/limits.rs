//! Limits of the numbers in a machine file.
//!
//! They are wide enough for every real machine and narrow enough that no computation overflows or
//! runs without end. Rules of single entries, such as "above 0", are those of `validate`; zero is
//! within every limit here.

use core::fmt::{self, Display, Formatter};

use toml::Value;

use super::error::{EntryError, all};
use super::file::MachineFile;

/// The limits of one number: of its magnitude, if it is not zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// The key, `*` for any name; `.0` for the first place of a point in a table.
    key: &'static str,
    /// Smallest magnitude but zero.
    pub least: f64,
    /// Largest magnitude.
    pub most: f64,
    /// Unit, empty without one.
    pub unit: &'static str,
    /// What has these sizes.
    why: &'static str,
}

impl Limits {
    /// The limits of an entry as the table names it, such as `simulation.duration` or
    /// `bodies.*.mass`. `None` if there is none of this name.
    pub fn of(key: &str) -> Option<Self> {
        ALL.iter().find(|limits| limits.key == key).copied()
    }

    /// Whether a finite number is zero or within the limits.
    pub fn hold(&self, value: f64) -> bool {
        value == 0.0 || (self.least..=self.most).contains(&value.abs())
    }
}

/// As in "must be 1e-6 to 1e9 kg (from a grain of sand to a building)".
impl Display for Limits {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            least,
            most,
            unit,
            why,
            ..
        } = self;
        if *least > 0.0 {
            write!(f, "{} to ", short(*least))?;
        } else {
            write!(f, "at most ")?;
        }
        write!(f, "{}", short(*most))?;
        if !unit.is_empty() {
            write!(f, " {unit}")?;
        }
        write!(f, " ({why})")
    }
}

/// As short as it is exact: 200, 1e-6, 1e14.
fn short(x: f64) -> String {
    let (plain, power) = (x.to_string(), format!("{x:e}"));
    if plain.len() <= power.len() {
        plain
    } else {
        power
    }
}

/// Why gains of single channels are near 1.
const GAINS_WHY: &str = "a common factor or a sign belongs into sensitivity or gain";

const fn limits(
    key: &'static str,
    least: f64,
    most: f64,
    unit: &'static str,
    why: &'static str,
) -> Limits {
    Limits {
        key,
        least,
        most,
        unit,
        why,
    }
}

/// The largest stiffness, N/m and N m: a cube of steel of 1 m has 2e11 N/m, and with 500 times
/// that no result shows any compliance.
const RIGID: f64 = 1e14;

const RIGID_WHY: &str = "stiffer parts are rigid: make one body of what they join";
const PLACE_WHY: &str = "as far as the Earth is wide";
const RATE_WHY: &str = "what converters and processors can do";
const VOLTS_WHY: &str = "what converters and amplifiers can do";
const STACK_WHY: &str = "what piezo stacks have";
const TIME_WHY: &str = "at most a day";
const COUNT_WHY: &str = "more would never be reached";
const CORNER_WHY: &str = "what a controller can filter";
const CORNER_SENSOR_WHY: &str = "what sensors have";
const RATIO_WHY: &str = "more would be no limit";

/// All numbers of a machine file.
const ALL: &[Limits] = &[
    limits("format", 0.0, 1e3, "", "there are few formats"),
    // Components of vectors are often zero up to rounding, so they have no least magnitude.
    limits("gravity", 0.0, 1e3, "m/s²", "100 times that of the Earth"),
    limits("nodes.*", 0.0, 1e7, "m", PLACE_WHY),
    limits(
        "bodies.*.mass",
        1e-6,
        1e9,
        "kg",
        "from a grain of sand to a building",
    ),
    limits("bodies.*.inertia", 0.0, 1e15, "kg m²", "that of a building"),
    limits("bodies.*.cog", 0.0, 1e7, "m", PLACE_WHY),
    limits(
        "flexible_bodies.*.mass",
        1e-6,
        1e9,
        "kg",
        "from a grain of sand to a building",
    ),
    limits(
        "flexible_bodies.*.loss_factor",
        0.0,
        10.0,
        "",
        "rubber has 1",
    ),
    limits(
        "flexible_bodies.*.modal_damping",
        0.0,
        1.0,
        "",
        "at 1 a mode does not vibrate",
    ),
    limits("profiles.*.axial", 1e-6, RIGID, "N/m", RIGID_WHY),
    limits("profiles.*.bending", 1e-9, RIGID, "N m", RIGID_WHY),
    limits("profiles.*.torsion", 1e-9, RIGID, "N m", RIGID_WHY),
    limits(
        "profiles.*.youngs_modulus",
        1.0,
        1e13,
        "Pa",
        "diamond has 1.2e12 Pa",
    ),
    limits(
        "profiles.*.shear_modulus",
        1.0,
        1e13,
        "Pa",
        "diamond has 5e11 Pa",
    ),
    limits(
        "profiles.*.area",
        1e-15,
        1e6,
        "m²",
        "from a fibre to a building",
    ),
    limits(
        "profiles.*.second_moments",
        1e-30,
        1e10,
        "m⁴",
        "from a fibre to a building",
    ),
    limits(
        "profiles.*.torsion_constant",
        1e-30,
        1e10,
        "m⁴",
        "from a fibre to a building",
    ),
    limits("profiles.*.loss_factor", 0.0, 10.0, "", "rubber has 1"),
    limits(
        "profiles.*.damper",
        0.0,
        1e12,
        "N s/m",
        "no damper has more",
    ),
    limits(
        "profiles.*.density",
        1e-3,
        1e5,
        "kg/m³",
        "from a gas to four times osmium",
    ),
    limits(
        "profiles.*.mass",
        1e-12,
        1e9,
        "kg",
        "from a cell to a building",
    ),
    limits(
        "profiles.*.segments",
        0.0,
        100.0,
        "",
        "with more, every element is far stiffer than the beam",
    ),
    limits("beams.*.y_axis", 0.0, 1e6, "", "only its direction counts"),
    limits("springs.*.stiffness", 1e-6, RIGID, "N/m", RIGID_WHY),
    limits(
        "springs.*.rotational_stiffness",
        1e-9,
        RIGID,
        "N m",
        RIGID_WHY,
    ),
    limits("springs.*.damper", 0.0, 1e12, "N s/m", "no damper has more"),
    limits(
        "springs.*.rotational_damper",
        0.0,
        1e12,
        "N m s",
        "no damper has more",
    ),
    limits("springs.*.loss_factor", 0.0, 10.0, "", "rubber has 1"),
    limits(
        "springs.*.x_axis",
        0.0,
        1e6,
        "",
        "only its direction counts",
    ),
    limits(
        "springs.*.y_axis",
        0.0,
        1e6,
        "",
        "only its direction counts",
    ),
    limits(
        "point_masses.*.mass",
        1e-12,
        1e9,
        "kg",
        "from a cell to a building",
    ),
    limits(
        "point_masses.*.inertia",
        0.0,
        1e15,
        "kg m²",
        "that of a building",
    ),
    limits(
        "sensors.acceleration.*.direction",
        0.0,
        2.0,
        "",
        "it is a unit vector",
    ),
    limits(
        "floor.rotation",
        0.0,
        1e3,
        "rad/m",
        "a base that turns by more hardly moves",
    ),
    limits("floor.wave_speed", 1.0, 1e5, "m/s", "from mud to rock"),
    limits(
        "floor.inputs.*.direction",
        0.0,
        2.0,
        "",
        "it is a unit vector",
    ),
    limits(
        "performance.accelerations.*.direction",
        0.0,
        2.0,
        "",
        "it is a unit vector",
    ),
    limits(
        "performance.bands.*",
        1e-4,
        1e6,
        "Hz",
        "where machines vibrate",
    ),
    limits(
        "floor.spectrum",
        0.0,
        1e9,
        "Hz or m/s²/√Hz",
        "no floor has other spectra",
    ),
    limits("performance.exposure", 1e-6, 1e4, "s", TIME_WHY),
    limits(
        "damping.modal",
        0.0,
        1.0,
        "",
        "at 1 a mode does not vibrate",
    ),
    limits(
        "damping.modes",
        0.0,
        1.0,
        "",
        "at 1 a mode does not vibrate",
    ),
    limits(
        "damping.rayleigh",
        0.0,
        1e6,
        "1/s or s",
        "more lets nothing move",
    ),
    limits(
        "control.frequency",
        1e-3,
        1e5,
        "Hz",
        "where machines vibrate",
    ),
    limits("control.damping", 0.0, 100.0, "", "more lets nothing move"),
    limits(
        "control.max_sensitivity",
        1.0,
        1e3,
        "",
        "a robust loop has 2",
    ),
    limits("control.roll_off.hz", 1e-3, 1e8, "Hz", CORNER_WHY),
    limits(
        "control.roll_off.order",
        0.0,
        10.0,
        "",
        "a steeper limit asks for a loop without phase margin",
    ),
    limits(
        "control.shapes.sections.zeros.hz",
        1e-4,
        1e8,
        "Hz",
        CORNER_WHY,
    ),
    limits(
        "control.shapes.sections.zeros.damping",
        1e-6,
        1e6,
        "",
        CORNER_WHY,
    ),
    limits(
        "control.shapes.sections.poles.hz",
        1e-4,
        1e8,
        "Hz",
        CORNER_WHY,
    ),
    limits(
        "control.shapes.sections.poles.damping",
        1e-6,
        1e6,
        "",
        CORNER_WHY,
    ),
    limits("control.shapes.split_hz", 1e-4, 1e8, "Hz", CORNER_WHY),
    limits("board.sample_rate", 1.0, 1e8, "Hz", RATE_WHY),
    limits("board.conversion_delay", 0.0, 10.0, "s", RATE_WHY),
    limits("board.output_delay", 0.0, 10.0, "s", RATE_WHY),
    limits("board.adc.bits", 0.0, 64.0, "", RATE_WHY),
    limits("board.adc.range", 1e-6, 1e6, "V", VOLTS_WHY),
    limits("board.adc.noise", 0.0, 1e6, "V", VOLTS_WHY),
    limits("board.dac.bits", 0.0, 64.0, "", RATE_WHY),
    limits("board.dac.range", 0.0, 1e6, "V", VOLTS_WHY),
    limits("board.dac.noise", 0.0, 1e6, "V", VOLTS_WHY),
    limits(
        "board.accelerometer.sensitivity",
        1e-9,
        1e9,
        "V/(m/s²)",
        VOLTS_WHY,
    ),
    limits(
        "board.accelerometer.noise_density.0",
        1e-6,
        1e8,
        "Hz",
        "slower than tides no sensor is tested",
    ),
    limits(
        "board.accelerometer.noise_density",
        0.0,
        1e3,
        "m/s²/√Hz",
        "louder than any machine",
    ),
    limits("board.accelerometer.offset", 0.0, 1e6, "V", VOLTS_WHY),
    limits("board.accelerometer.bandwidth", 1e-3, 1e12, "Hz", VOLTS_WHY),
    limits(
        "board.accelerometer.lower_corner",
        1e-6,
        1e8,
        "Hz",
        CORNER_SENSOR_WHY,
    ),
    limits(
        "board.accelerometer.lower_order",
        0.0,
        1e3,
        "",
        "there are two",
    ),
    limits(
        "board.accelerometer.resonance.hz",
        1e-3,
        1e12,
        "Hz",
        CORNER_SENSOR_WHY,
    ),
    limits(
        "board.accelerometer.resonance.damping",
        0.0,
        1e3,
        "",
        "that of no sensor",
    ),
    limits(
        "board.force_sensor.sensitivity",
        1e-9,
        1e9,
        "V/N",
        VOLTS_WHY,
    ),
    limits(
        "board.force_sensor.noise_density.0",
        1e-6,
        1e8,
        "Hz",
        "slower than tides no sensor is tested",
    ),
    limits(
        "board.force_sensor.noise_density",
        0.0,
        1e6,
        "N/√Hz",
        "louder than any machine",
    ),
    limits("board.force_sensor.offset", 0.0, 1e6, "V", VOLTS_WHY),
    limits("board.force_sensor.bandwidth", 1e-3, 1e12, "Hz", VOLTS_WHY),
    limits(
        "board.force_sensor.lower_corner",
        1e-6,
        1e8,
        "Hz",
        CORNER_SENSOR_WHY,
    ),
    limits(
        "board.force_sensor.lower_order",
        0.0,
        1e3,
        "",
        "there are two",
    ),
    limits(
        "board.force_sensor.resonance.hz",
        1e-3,
        1e12,
        "Hz",
        CORNER_SENSOR_WHY,
    ),
    limits(
        "board.force_sensor.resonance.damping",
        0.0,
        1e3,
        "",
        "that of no sensor",
    ),
    limits(
        "board.actuator.gain",
        1e-9,
        1e9,
        "N/V",
        "no actuator has other ones",
    ),
    limits(
        "board.actuator.limit",
        1e-9,
        1e9,
        "N",
        "no actuator has other ones",
    ),
    limits("board.accelerometer.transverse", 0.0, 1.0, "", "a fraction"),
    limits("board.force_sensor.transverse", 0.0, 1.0, "", "a fraction"),
    limits("board.actuator.bandwidth", 1e-3, 1e12, "Hz", VOLTS_WHY),
    limits(
        "board.actuator.piezo.free_stroke",
        1e-9,
        1e-2,
        "m",
        "stacks have micrometres",
    ),
    limits("board.actuator.piezo.voltage", 0.0, 1e5, "V", STACK_WHY),
    limits(
        "board.actuator.piezo.stiffness",
        1e3,
        1e12,
        "N/m",
        STACK_WHY,
    ),
    limits(
        "board.actuator.piezo.blocked_force",
        1e-3,
        1e9,
        "N",
        STACK_WHY,
    ),
    limits(
        "board.actuator.piezo.amplifier_gain",
        1e-6,
        1e6,
        "",
        VOLTS_WHY,
    ),
    limits(
        "board.actuator.piezo.capacitance",
        1e-12,
        1.0,
        "F",
        STACK_WHY,
    ),
    limits(
        "board.actuator.piezo.amplifier_current",
        1e-6,
        1e4,
        "A",
        VOLTS_WHY,
    ),
    limits(
        "board.actuator.piezo.hysteresis",
        0.0,
        1.0,
        "",
        "a fraction",
    ),
    limits("board.actuator.piezo.creep", 0.0, 1.0, "", "a fraction"),
    limits(
        "board.actuator.voice_coil.force_constant",
        1e-6,
        1e6,
        "N/A",
        "what voice coils have",
    ),
    limits(
        "board.actuator.voice_coil.amplifier_gain",
        1e-6,
        1e6,
        "A/V",
        VOLTS_WHY,
    ),
    limits(
        "board.actuator.voice_coil.current",
        1e-6,
        1e6,
        "A",
        VOLTS_WHY,
    ),
    limits("supervision.soft_start", 0.0, 1e5, "s", TIME_WHY),
    limits("supervision.settle", 0.0, 1e5, "s", TIME_WHY),
    limits("supervision.safe_ramp", 0.0, 1e5, "s", TIME_WHY),
    limits("supervision.rail", 0.0, 1e5, "s", TIME_WHY),
    limits("supervision.stuck", 0.0, 1e5, "s", TIME_WHY),
    limits("supervision.spike", 0.0, 65_535.0, "", "codes have 16 bits"),
    limits("supervision.spikes", 0.0, 1e9, "", COUNT_WHY),
    limits("supervision.lost", 0.0, 1e9, "", COUNT_WHY),
    limits("supervision.late", 0.0, 1e9, "", COUNT_WHY),
    limits("supervision.saturated", 0.0, 1e5, "s", TIME_WHY),
    limits("supervision.silence", 0.0, 1e5, "s", TIME_WHY),
    limits("supervision.window", 0.0, 1e5, "s", TIME_WHY),
    limits("supervision.growth", 0.0, 1e6, "", RATIO_WHY),
    limits("supervision.grown", 0.0, 1e9, "", COUNT_WHY),
    limits(
        "supervision.level",
        1e-9,
        1.0,
        "",
        "a fraction of the force limit",
    ),
    limits("supervision.wild", 0.0, 1e6, "", RATIO_WHY),
    limits("supervision.dull", 0.0, 1e6, "", RATIO_WHY),
    limits("supervision.strange", 0.0, 1e9, "", COUNT_WHY),
    limits(
        "supervision.test_force",
        1e-9,
        1.0,
        "",
        "a fraction of the force limit",
    ),
    limits("supervision.test_time", 0.0, 1e5, "s", TIME_WHY),
    limits(
        "supervision.pilot",
        1e-12,
        1e9,
        "N",
        "no actuator has other forces",
    ),
    limits("supervision.pilot_time", 0.0, 1e5, "s", TIME_WHY),
    limits("supervision.test_tolerance", 1e-6, 1e6, "", RATIO_WHY),
    limits("simulation.duration", 1e-6, 1e5, "s", TIME_WHY),
    limits("simulation.settling", 0.0, 1e5, "s", TIME_WHY),
    limits(
        "simulation.floor_rms",
        0.0,
        1e3,
        "m/s²",
        "100 times the weight",
    ),
    limits("simulation.floor_band", 1e-3, 1e8, "Hz", "slower is tides"),
    limits("simulation.seed", 0.0, f64::MAX, "", "any"),
    limits("control.penalty.force", 0.0, 1e9, "m/s²/N", RATIO_WHY),
    limits("control.penalty.stroke", 0.0, 1e12, "1/s²", RATIO_WHY),
    limits("beams.*.preload", 1e-9, 1e12, "N", "no beam bears more"),
    limits("loads.*.direction", 0.0, 2.0, "", "it is a unit vector"),
    limits("board.gains.acceleration", 0.1, 10.0, "", GAINS_WHY),
    limits("board.gains.force", 0.1, 10.0, "", GAINS_WHY),
    limits("board.gains.actuators", 0.1, 10.0, "", GAINS_WHY),
    limits("robustness.mass", 0.0, 1.0, "", "a fraction"),
    limits(
        "robustness.cog",
        0.0,
        1e4,
        "m",
        "more than any machine is wide",
    ),
    limits("robustness.leg_stiffness", 0.0, 1.0, "", "a fraction"),
    limits("robustness.damping", 0.0, 1.0, "", "a fraction"),
    limits("robustness.sensor_gain", 0.0, 1.0, "", "a fraction"),
    limits(
        "robustness.misalignment",
        0.0,
        45.0,
        "°",
        "a sensor that is turned more measures another direction",
    ),
    limits("robustness.actuator_gain", 0.0, 1.0, "", "a fraction"),
    limits("robustness.delay", 0.0, 10.0, "s", RATE_WHY),
    limits(
        "robustness.samples",
        0.0,
        1e6,
        "",
        "more takes days and shows nothing new",
    ),
    limits("robustness.seed", 0.0, f64::MAX, "", "any"),
    limits("uncertainty.mass", 0.0, 1.0, "", "a fraction"),
    limits("uncertainty.inertia", 0.0, 1.0, "", "a fraction"),
    limits(
        "uncertainty.cog",
        0.0,
        1e4,
        "m",
        "more than any machine is wide",
    ),
    limits("uncertainty.stiffness", 0.0, 1.0, "", "a fraction"),
    limits("uncertainty.damping", 0.0, 1.0, "", "a fraction"),
    limits("uncertainty.sensor_gain", 0.0, 1.0, "", "a fraction"),
    limits(
        "uncertainty.misalignment",
        0.0,
        45.0,
        "°",
        "a sensor that is turned more measures another direction",
    ),
    limits("uncertainty.actuator_gain", 0.0, 1.0, "", "a fraction"),
    limits("uncertainty.delay", 0.0, 10.0, "s", RATE_WHY),
];

/// Checks every number of `file`. Numbers that are not finite are left to the validation of
/// their entry.
pub(super) fn check(file: &MachineFile) -> Result<(), EntryError> {
    // Integers beyond those of TOML are left to validation, too.
    let Ok(table) = file.to_table() else {
        return Ok(());
    };
    let mut beyond = Vec::new();
    numbers(&Value::Table(table), &mut |keys, entry, value| {
        if let Some(limits) = find(keys)
            && value.is_finite()
            && !limits.hold(value)
        {
            let name = keys.iter().rfind(|key| !is_place(key));
            let name = name.copied().unwrap_or_default();
            let message = format!("{name} must be {limits}, not {}", short(value));
            beyond.push(Err(EntryError::new(entry, message).fix("check its unit")));
        }
    });
    all(beyond).map(|_: Vec<()>| ())
}

/// The limits of the number under `keys`.
fn find(keys: &[&str]) -> Option<&'static Limits> {
    // A beam's own stiffness has the limits of a shared one.
    let shared;
    let keys = match keys {
        ["beams", name, "stiffness", key] => {
            shared = ["profiles", name, key];
            &shared[..]
        }
        keys => keys,
    };
    let own = ALL.iter().find(|limits| {
        let mut parts = limits.key.split('.');
        let fits = |key: &&str| parts.next().is_some_and(|part| part == "*" || part == *key);
        keys.iter().all(fits) && parts.next().is_none()
    });
    match keys {
        // All places of most arrays have the same limits.
        [above @ .., place] if own.is_none() && is_place(place) => find(above),
        _ => own,
    }
}

/// The places of an array as keys.
const PLACES: [&str; 3] = ["0", "1", "2"];

fn is_place(key: &str) -> bool {
    PLACES.contains(&key)
}

/// Calls `visit` for every number within `value`, with its keys, its entry and its value.
fn numbers(value: &Value, visit: &mut impl FnMut(&[&str], &str, f64)) {
    fn walk<'a>(
        value: &'a Value,
        keys: &mut Vec<&'a str>,
        entry: &str,
        visit: &mut impl FnMut(&[&str], &str, f64),
    ) {
        match value {
            Value::Table(table) => {
                for (key, value) in table {
                    let dot = if entry.is_empty() { "" } else { "." };
                    keys.push(key);
                    walk(value, keys, &format!("{entry}{dot}{key}"), visit);
                    keys.pop();
                }
            }
            Value::Array(array) => {
                for (i, value) in array.iter().enumerate() {
                    let place = PLACES
                        .get(i)
                        .filter(|_| !value.is_array() && !value.is_table());
                    keys.extend(place);
                    walk(value, keys, &format!("{entry}[{i}]"), visit);
                    keys.truncate(keys.len() - place.iter().count());
                }
            }
            Value::Float(x) => visit(keys, entry, *x),
            Value::Integer(x) => visit(keys, entry, *x as f64),
            _ => {}
        }
    }
    walk(value, &mut Vec::new(), "", visit);
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::schema::schema;
    use super::*;
    use crate::machine::Machine;

    /// The schema knows every number; whoever adds one adds its limits.
    #[test]
    fn every_number_has_limits() {
        let schema: serde_json::Value = serde_json::from_str(&schema()).unwrap();
        let mut keys = Vec::new();
        of_schema(&schema, &schema, "", &mut keys);
        assert!(keys.len() > 60, "{keys:?}");
        for key in &keys {
            let parts: Vec<&str> = key.split('.').collect();
            assert!(find(&parts).is_some(), "{key} has no limits");
        }
        for limits in ALL {
            let there = keys.iter().any(|key| key == limits.key);
            assert!(there, "there is no {}", limits.key);
        }
    }

    /// The keys of all numbers below `node`.
    fn of_schema(
        root: &serde_json::Value,
        node: &serde_json::Value,
        key: &str,
        keys: &mut Vec<String>,
    ) {
        if let Some(reference) = node["$ref"].as_str() {
            let place = reference.trim_start_matches('#');
            return of_schema(root, root.pointer(place).unwrap(), key, keys);
        }
        let is = |kind: &str| {
            node["type"] == kind
                || node["type"]
                    .as_array()
                    .is_some_and(|kinds| kinds.iter().any(|k| k == kind))
        };
        if (is("number") || is("integer")) && !keys.contains(&key.to_owned()) {
            keys.push(key.to_owned());
        }
        let below = |name: &str| {
            if key.is_empty() {
                name.to_owned()
            } else {
                format!("{key}.{name}")
            }
        };
        for (name, child) in node["properties"].as_object().into_iter().flatten() {
            of_schema(root, child, &below(name), keys);
        }
        if node["additionalProperties"].is_object() {
            of_schema(root, &node["additionalProperties"], &below("*"), keys);
        }
        for list in ["items", "prefixItems", "anyOf", "oneOf", "allOf"] {
            match &node[list] {
                serde_json::Value::Array(children) => {
                    for (i, child) in children.iter().enumerate() {
                        let place = format!("{key}.{i}");
                        // The places of a tuple have limits of their own.
                        let own = list == "prefixItems" && Limits::of(&place).is_some();
                        of_schema(root, child, if own { &place } else { key }, keys);
                    }
                }
                child if child.is_object() => of_schema(root, child, key, keys),
                _ => {}
            }
        }
    }

    #[test]
    fn a_number_beyond_its_limits_is_named() {
        const FRAME: &str = include_str!("../../../models/metrology-frame.toml");
        for (old, new, entry, says) in [
            (
                "mass = 742.0",
                "mass = 1e-300",
                "bodies.frame.mass",
                "1e-6 to 1e9 kg",
            ),
            (
                "n3 = [0.0, 0.5, 0.0]",
                "n3 = [0.0, -1e9, 0.0]",
                "nodes.n3[1]",
                "at most 1e7 m",
            ),
            (
                "axial = 4.5e7",
                "axial = 1e18",
                "profiles.block.axial",
                "1e-6 to 1e14 N/m",
            ),
            (
                "floor_band = [1.0,",
                "floor_band = [1e-9,",
                "simulation.floor_band[0]",
                "Hz",
            ),
        ] {
            let text = FRAME.replace(old, new);
            let error = Machine::parse(Path::new("m.toml"), &text).unwrap_err();
            assert_eq!(error.entry(), entry);
            assert!(error.message().contains(says), "{error}");
            let line = text.lines().position(|line| line.contains(new)).unwrap() + 1;
            assert_eq!(error.place().map(|place| place.0), Some(line));
        }
    }
}
