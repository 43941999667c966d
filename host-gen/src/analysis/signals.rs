//! The inputs, outputs and states of systems for other programs.

use crate::files::identifier::identifiers;
use crate::machine::{FeedbackKind, Machine};

/// Signals in the order of a system's columns, rows or states.
#[derive(Clone, Debug, Default)]
pub(crate) struct Signals {
    /// As in the machine file.
    pub(crate) names: Vec<String>,
    /// As MATLAB, Octave and python-control accept them.
    pub(crate) identifiers: Vec<String>,
    /// In ASCII, `m/s^2`; `1` for a state without one.
    pub(crate) units: Vec<&'static str>,
}

/// The inputs of the generalised plant, floor accelerations and leg forces, and its outputs,
/// performance and the sensors of one kind of `feedback`. All identifiers are different, so that
/// systems can be connected by them.
pub(crate) fn of_plant(machine: &Machine, feedback: FeedbackKind) -> [Signals; 2] {
    let floor = machine.floor.iter().map(|input| input.name.clone());
    let legs = machine.actuators.iter();
    let legs = legs.map(|&beam| machine.beams[beam].name.clone());
    let sensors = machine.sensor_names(feedback);
    let sensors = sensors.into_iter().zip(machine.sensor_units(feedback));
    let performance = machine.performance_names().into_iter();
    let inputs: Vec<(&str, String, &str)> = floor
        .map(|name| ("floor", name, "m/s^2"))
        .chain(legs.map(|name| ("force", name, "N")))
        .collect();
    let outputs: Vec<_> = performance
        .map(|name| ("performance", name, "m/s^2"))
        .chain(sensors.map(|(name, unit)| ("sensor", name, unit)))
        .collect();
    let all = inputs.iter().chain(&outputs);
    let mut identifiers = identifiers(all.map(|(role, name, _)| (*role, name.as_str())));
    let of_outputs = identifiers.split_off(inputs.len());
    let signals = |all: Vec<(&str, String, &'static str)>, identifiers| {
        let (names, units) = all.into_iter().map(|(_, name, unit)| (name, unit)).unzip();
        Signals {
            names,
            identifiers,
            units,
        }
    };
    [signals(inputs, identifiers), signals(outputs, of_outputs)]
}

/// The states of the generalised plant with so many modes: modal coordinates, then their rates.
pub(crate) fn states(modes: usize) -> Signals {
    let each = |name: &'static str, unit| (1..=modes).map(move |i| (format!("{name}{i}"), unit));
    of_states(each("mode", "sqrt(kg)*m").chain(each("rate", "sqrt(kg)*m/s")))
}

/// States with these names, which are their identifiers too, and units.
pub(crate) fn of_states(states: impl IntoIterator<Item = (String, &'static str)>) -> Signals {
    let (names, units): (Vec<_>, _) = states.into_iter().unzip();
    Signals {
        identifiers: names.clone(),
        names,
        units,
    }
}
