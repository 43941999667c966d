//! Sensors and legs that are swapped or reversed.

use nalgebra::{Complex, DMatrix};
use shared::LEGS;

use super::first_force;
use crate::machine::Machine;

/// How the rows and columns of a measured G22 go with those of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct Wiring {
    /// For each sensor of the model the one that was measured as it.
    sensors: Vec<End>,
    /// For each leg of the model the one that was driven as it.
    legs: Vec<End>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct End {
    index: usize,
    reversed: bool,
}

impl Wiring {
    /// That of the file, with this number of sensors.
    pub fn as_filed(sensors: usize) -> Self {
        let ends = |count| {
            let end = |index| End {
                index,
                reversed: false,
            };
            (0..count).map(end).collect()
        };
        Self {
            sensors: ends(sensors),
            legs: ends(LEGS),
        }
    }

    /// Whether it is another one than that of the file.
    pub fn is_other(&self) -> bool {
        *self != Self::as_filed(self.sensors.len())
    }

    /// All with one sensor or leg more that is reversed, or two of a kind that are swapped.
    pub fn with_a_mistake_more(&self) -> impl Iterator<Item = Self> {
        let count = self.sensors.len() + LEGS;
        let pairs = (0..count).flat_map(move |i| (0..=i).map(move |j| (i, j)));
        pairs
            // A kind is six in a row.
            .filter(|(i, j)| i / LEGS == j / LEGS)
            .map(|(i, j)| {
                let mut other = self.clone();
                if i == j {
                    other.end(i).reversed ^= true;
                } else {
                    let (first, second) = (*other.end(i), *other.end(j));
                    (*other.end(i), *other.end(j)) = (second, first);
                }
                other
            })
    }

    /// The sensors, then the legs.
    fn end(&mut self, index: usize) -> &mut End {
        let sensors = self.sensors.len();
        match index.checked_sub(sensors) {
            Some(leg) => &mut self.legs[leg],
            None => &mut self.sensors[index],
        }
    }

    /// Measured responses, a row for each frequency and a column for each entry of G22, column by
    /// column, in the order of the model.
    pub fn applied(&self, responses: &DMatrix<Complex<f64>>) -> DMatrix<Complex<f64>> {
        let rows = self.sensors.len();
        DMatrix::from_fn(responses.nrows(), responses.ncols(), |k, entry| {
            let (sensor, leg) = (self.sensors[entry % rows], self.legs[entry / rows]);
            let measured = responses[(k, sensor.index + rows * leg.index)];
            if sensor.reversed == leg.reversed {
                measured
            } else {
                -measured
            }
        })
    }

    /// What is otherwise than in the file of `machine`, in words.
    pub fn mistakes(&self, machine: &Machine) -> Vec<String> {
        let forces = first_force(machine);
        let names = machine.sensor_names(machine.target.feedback);
        let sensor = |(i, name): (usize, String)| match i < forces {
            true => format!("accelerometer {name}"),
            false => format!("the force sensor in {name}"),
        };
        let sensors: Vec<_> = names.into_iter().enumerate().map(sensor).collect();
        let legs = machine.actuators.map(|beam| &machine.beams[beam].name);
        let legs = legs.map(|name| format!("the drive of {name}"));
        let mut found = of_ends(&sensors, &self.sensors);
        found.extend(of_ends(&legs, &self.legs));
        found
    }
}

/// What is otherwise at these ends, which the file has in this order and under these names.
fn of_ends(names: &[String], ends: &[End]) -> Vec<String> {
    let other = |(i, end): (usize, &End)| {
        let name = &names[i];
        if end.index == i {
            return end.reversed.then(|| format!("{name} is reversed"));
        }
        let partner = &names[end.index];
        let back = ends[end.index];
        if back.index == i && !end.reversed && !back.reversed {
            // Once for both.
            return (i < end.index).then(|| format!("{name} and {partner} are swapped"));
        }
        let reversed = if end.reversed { ", reversed" } else { "" };
        Some(format!("{partner} is connected as {name}{reversed}"))
    };
    ends.iter().enumerate().filter_map(other).collect()
}
