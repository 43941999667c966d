//! What of a machine is uncertain, and how much before it is measured.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use serde::Serialize;
use shared::LEGS;

use crate::machine::{Damping, FeedbackKind, Machine};

/// A quantity of a machine that is not known exactly, by the indices of the machine's parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Mass of a body, its inertia in proportion.
    Mass(usize),
    /// A second moment of the mass of a body about its centre of gravity, along a principal axis,
    /// beside that of its mass. Whatever it is, there is a body with it.
    Inertia(usize, usize),
    /// A coordinate of the centre of gravity of a body.
    Cog(usize, usize),
    /// All stiffnesses of a beam.
    Stiffness(usize),
    /// Bending stiffness of a beam, apart from that.
    Bending(usize),
    /// Torsional stiffness of a beam, apart from that.
    Torsion(usize),
    /// All stiffnesses of a spring.
    Spring(usize),
    /// Mass of a point mass, and its inertia with it.
    PointMass(usize),
    /// Modal damping of a mode, in ascending order of their frequency.
    ModeDamping(usize),
    /// All other damping.
    Damping,
    /// Gain of a sensor: its kind, accelerometers first, and its number.
    SensorGain(usize, usize),
    /// Direction of an accelerometer, about the first or the second axis across it.
    Tilt(usize, usize),
    /// Gain of a leg.
    ActuatorGain(usize),
    /// Delay of amplifiers and sensors beside what the file gives.
    Delay,
}

impl Quantity {
    /// Whether it is one of the machine itself, and not of sensors and legs' drives.
    pub fn is_mechanical(self) -> bool {
        match self {
            Self::Mass(_)
            | Self::Inertia(..)
            | Self::Cog(..)
            | Self::Stiffness(_)
            | Self::Bending(_)
            | Self::Torsion(_)
            | Self::Spring(_)
            | Self::PointMass(_)
            | Self::Damping
            | Self::ModeDamping(_) => true,
            Self::SensorGain(..) | Self::Tilt(..) | Self::ActuatorGain(_) | Self::Delay => false,
        }
    }
}

/// Unit in which the change of a quantity is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Scale {
    /// The natural logarithm of the factor on the file's value: about the relative change.
    #[serde(rename = "relative")]
    Relative,
    /// m.
    #[serde(rename = "m")]
    Metres,
    /// rad.
    #[serde(rename = "rad")]
    Radians,
    /// s.
    #[serde(rename = "s")]
    Seconds,
}

impl Scale {
    /// The factor and the unit in which a change is shown.
    pub fn shown(self) -> (f64, &'static str) {
        match self {
            Self::Relative => (100.0, "%"),
            Self::Metres => (1e3, "mm"),
            Self::Radians => (1f64.to_degrees(), "°"),
            Self::Seconds => (1e6, "µs"),
        }
    }
}

/// An uncertain quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Which one.
    pub quantity: Quantity,
    /// Its name in reports.
    pub name: String,
    /// Unit of its change.
    pub scale: Scale,
    /// Standard deviation of its change before the measurement.
    pub deviation: f64,
}

/// The uncertain quantities of `machine`, among them the damping of so many `modes`.
pub fn parameters(machine: &Machine, modes: usize) -> Vec<Parameter> {
    let known = &machine.uncertainty;
    let mut all = Vec::new();
    let mut add = |quantity, name: String, scale, deviation: f64| {
        all.push(Parameter {
            quantity,
            name,
            scale,
            deviation,
        });
    };
    let relative = Scale::Relative;
    for (i, body) in machine.bodies.iter().enumerate() {
        let name = &body.name;
        add(
            Quantity::Mass(i),
            format!("mass of {name}"),
            relative,
            known.mass,
        );
        let (moments, _) = body.principal();
        for k in 0..3 {
            // Nothing is spread across a flat body.
            if spread(&moments, k) > FLAT * moments.max() {
                let name = format!("spread of the mass of {name} along its axis {}", k + 1);
                add(Quantity::Inertia(i, k), name, relative, known.inertia);
            }
        }
        for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
            let name = format!("centre of gravity of {name}, {axis}");
            add(Quantity::Cog(i, k), name, Scale::Metres, known.cog);
        }
    }
    for (i, beam) in machine.beams.iter().enumerate() {
        let name = &beam.name;
        for (quantity, what) in [
            (Quantity::Stiffness(i), format!("stiffness of {name}")),
            (
                Quantity::Bending(i),
                format!("bending stiffness of {name} apart from that"),
            ),
            (
                Quantity::Torsion(i),
                format!("torsional stiffness of {name} apart from that"),
            ),
        ] {
            add(quantity, what, relative, known.stiffness);
        }
    }
    for (i, spring) in machine.springs.iter().enumerate() {
        let name = format!("stiffness of {}", spring.name);
        add(Quantity::Spring(i), name, relative, known.stiffness);
    }
    for (i, point) in machine.point_masses.iter().enumerate() {
        let name = format!("mass of {}", point.body.name);
        add(Quantity::PointMass(i), name, relative, known.mass);
    }
    for k in 0..modes {
        if *machine
            .damping
            .modes
            .get(k)
            .unwrap_or(&machine.damping.modal)
            > 0.0
        {
            let name = format!("damping of mode {}", k + 1);
            add(Quantity::ModeDamping(k), name, relative, known.damping);
        }
    }
    if machine.has_other_damping() {
        let name = "damping that is not modal".to_owned();
        add(Quantity::Damping, name, relative, known.damping);
    }
    let feedback = machine.target.feedback;
    if feedback != FeedbackKind::Force {
        for (i, sensor) in machine.accelerometers.iter().flatten().enumerate() {
            let name = &sensor.name;
            let quantity = Quantity::SensorGain(0, i);
            add(
                quantity,
                format!("gain of {name}"),
                relative,
                known.sensor_gain,
            );
            for axis in 0..2 {
                let tilt = format!("direction {} of {name}", axis + 1);
                add(
                    Quantity::Tilt(i, axis),
                    tilt,
                    Scale::Radians,
                    known.misalignment,
                );
            }
        }
    }
    if feedback != FeedbackKind::Acceleration {
        for (i, &beam) in machine.force_sensors.iter().flatten().enumerate() {
            let name = format!("gain of the force sensor in {}", machine.beams[beam].name);
            add(
                Quantity::SensorGain(1, i),
                name,
                relative,
                known.sensor_gain,
            );
        }
    }
    for (i, &beam) in machine.actuators.iter().enumerate() {
        let name = format!("force of {} per volt", machine.beams[beam].name);
        add(
            Quantity::ActuatorGain(i),
            name,
            relative,
            known.actuator_gain,
        );
    }
    add(
        Quantity::Delay,
        "delay".to_owned(),
        Scale::Seconds,
        known.delay,
    );
    all
}

/// Part of the largest moment of inertia below which a second moment is rounding.
const FLAT: f64 = 1e-6;

/// The second moment of mass ∫x² dm along principal axis `k`, kg m².
fn spread(moments: &Vector3<f64>, k: usize) -> f64 {
    0.5 * moments.sum() - moments[k]
}

/// Two axes across a direction of length 1.
fn across(direction: &Vector3<f64>) -> [Unit<Vector3<f64>>; 2] {
    let least = direction.iamin();
    let first = Unit::new_normalize(direction.cross(&Vector3::ith(least, 1.0)));
    [first, Unit::new_normalize(direction.cross(&first))]
}

/// `original` with changed quantities, but for the delay; gains as errors that the controller does not
/// know.
pub fn changed(original: &Machine, parameters: &[Parameter], changes: &[f64]) -> Machine {
    let mut machine = original.clone();
    // All tilts of a sensor are about axes across the file's direction.
    let mut tilts = [Vector3::zeros(); LEGS];
    for (parameter, &change) in parameters.iter().zip(changes) {
        match parameter.quantity {
            Quantity::Mass(i) => {
                machine.bodies[i].mass *= change.exp();
                machine.bodies[i].inertia *= change.exp();
            }
            Quantity::Inertia(i, k) => {
                // They stay the axes of the changed tensor. A second moment is part of the moments of
                // inertia about both other axes.
                let (moments, axes) = original.bodies[i].principal();
                let (before, after) = (original.bodies[i].mass, machine.bodies[i].mass);
                let more = spread(&moments, k) * after / before * change.exp_m1();
                let axis = axes.column(k);
                machine.bodies[i].inertia += (Matrix3::identity() - axis * axis.transpose()) * more;
            }
            Quantity::Cog(i, k) => machine.bodies[i].cog[k] += change,
            Quantity::Stiffness(i) => {
                let stiffness = &mut machine.beams[i].stiffness;
                stiffness.axial *= change.exp();
                stiffness.torsion *= change.exp();
                stiffness.bending = stiffness.bending.map(|x| x * change.exp());
            }
            Quantity::Bending(i) => {
                let bending = &mut machine.beams[i].stiffness.bending;
                *bending = bending.map(|x| x * change.exp());
            }
            Quantity::Torsion(i) => machine.beams[i].stiffness.torsion *= change.exp(),
            Quantity::Spring(i) => machine.springs[i].stiffness *= change.exp(),
            Quantity::PointMass(i) => {
                let body = &mut machine.point_masses[i].body;
                body.mass *= change.exp();
                body.inertia *= change.exp();
            }
            Quantity::Damping => {
                let modal = machine.damping.clone();
                machine.scale_damping(change.exp());
                machine.damping = Damping {
                    rayleigh: machine.damping.rayleigh,
                    ..modal
                };
            }
            Quantity::ModeDamping(k) => {
                let Damping { modal, modes, .. } = &mut machine.damping;
                while modes.len() <= k {
                    modes.push(*modal);
                }
                modes[k] *= change.exp();
            }
            Quantity::SensorGain(kind, i) => {
                machine.gain_errors.sensors[kind][i] = change.exp_m1();
            }
            Quantity::Tilt(i, axis) => tilts[i][axis] = change,
            Quantity::ActuatorGain(i) => machine.gain_errors.actuators[i] = change.exp_m1(),
            // Not of the machine: a board latches when it is told to.
            Quantity::Delay => {}
        }
    }
    for (sensor, tilt) in machine.accelerometers.iter_mut().flatten().zip(tilts) {
        let [first, second] = across(&sensor.direction);
        let turn = first.into_inner() * tilt[0] + second.into_inner() * tilt[1];
        sensor.direction = Rotation3::new(turn) * sensor.direction;
    }
    machine
}
