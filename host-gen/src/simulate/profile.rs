//! Loads on the machine over time, point by point.

use nalgebra::Vector6;
use shared::LEGS;

use crate::files::columns::{TextError, each_line, in_columns, name_and_unit, number, seconds_in};
use crate::files::without_byte_order_mark;
use crate::machine::Load;

/// Loads over time: straight from point to point, the first value before the first point, and the
/// last one after the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Times, s, ascending, with the loads, N or N m; zero beyond their number.
    points: Vec<(f64, Vector6<f64>)>,
}

impl Profile {
    /// A step of the load number `index` to `size`, N or N m, at `time`, s.
    pub fn step(index: usize, size: f64, time: f64) -> Self {
        let before = Vector6::zeros();
        let mut after = before;
        after[index] = size;
        Self {
            points: vec![(time, before), (time, after)],
        }
    }

    /// Reads comma-separated values, or such with semicolons, tabs or spaces: a line for each point,
    /// in order of time, of which two may be at one time, for a step. `#` starts a comment line.
    ///
    /// The first line names the columns: `time` or `t`, and names of `loads`, with units in
    /// brackets, such as `time [s], stage-x [N]`; without units they are s, N and N m. Loads without
    /// a column are zero. At 0 s the machine is at rest without any load.
    ///
    /// # Errors
    /// If a column is no load, a unit or a number is wrong, times do not ascend, or there is no
    /// point.
    pub fn read(text: &str, loads: &[Load]) -> Result<Self, TextError> {
        let text = without_byte_order_mark(text);
        let mut columns: Option<Vec<Column>> = None;
        let mut points: Vec<(f64, Vector6<f64>)> = Vec::new();
        each_line(text, "profile", |fields, _| {
            let Some(columns) = &columns else {
                columns = Some(heads(fields, loads)?);
                return Ok(());
            };
            let mut time = 0.0;
            let mut values = Vector6::zeros();
            for (column, field) in in_columns(columns, fields)? {
                match column {
                    Column::Time(unit) => time = unit * number(field)?,
                    Column::Load(index, unit) => values[*index] = unit * number(field)?,
                }
            }
            let last = points.last().map_or(0.0, |(time, _)| *time);
            if time < last {
                return Err(format!(
                    "times must ascend from 0 s on, but {time} s comes after {last} s"
                ));
            }
            points.push((time, values));
            Ok(())
        })?;
        if points.is_empty() {
            return Err(TextError::whole(
                "the profile has no points; give lines of a time and the loads",
            ));
        }
        Ok(Self { points })
    }

    /// The loads at a time, s, N or N m; where two points are at one time, those of the last.
    pub fn at(&self, time: f64) -> [f64; LEGS] {
        let next = self.points.partition_point(|(at, _)| *at <= time);
        let before = next.checked_sub(1).map(|i| &self.points[i]);
        let value = match (before, self.points.get(next)) {
            (None, Some((_, value))) | (Some((_, value)), None) => *value,
            (Some((from, a)), Some((to, b))) => a + (b - a) * ((time - from) / (to - from)),
            (None, None) => Vector6::zeros(),
        };
        value.into()
    }

    /// The loads after the last point, N or N m.
    pub fn last(&self) -> Vector6<f64> {
        self.points
            .last()
            .map_or(Vector6::zeros(), |(_, value)| *value)
    }

    /// The time from which on the loads are constant, s.
    pub fn last_change(&self) -> f64 {
        let last = self.last();
        let differs = self.points.iter().rposition(|(_, value)| *value != last);
        let at = differs.map_or(0, |i| i + 1);
        self.points.get(at).map_or(0.0, |(time, _)| *time)
    }
}

/// What a column holds, with the size of its unit.
enum Column {
    Time(f64),
    Load(usize, f64),
}

fn heads(heads: &[&str], loads: &[Load]) -> Result<Vec<Column>, String> {
    let names = || {
        let names = loads.iter().map(|load| format!("\"{}\"", load.at.name));
        names.collect::<Vec<_>>().join(", ")
    };
    let mut columns = Vec::new();
    let mut seen: Vec<String> = Vec::new();
    for head in heads {
        let (name, unit) = name_and_unit(head);
        if seen.contains(&name) {
            return Err(format!("the column \"{name}\" is there twice"));
        }
        let is = |load: &Load| load.at.name.to_lowercase() == name;
        let column = if let "t" | "time" = name.as_str() {
            Column::Time(seconds_in(unit)?)
        } else if let Some(index) = loads.iter().position(is) {
            let size = match (unit, loads[index].moment) {
                (None, _) | (Some("N"), false) | (Some("N m" | "Nm" | "N*m" | "N·m"), true) => 1.0,
                (Some("mN"), false) => 1e-3,
                (Some("kN"), false) => 1e3,
                (Some(unit), moment) => {
                    let right = if moment { "N m" } else { "N, mN or kN" };
                    return Err(format!(
                        "\"{unit}\" is no unit of \"{name}\" here; use {right}"
                    ));
                }
            };
            Column::Load(index, size)
        } else {
            return Err(format!(
                "\"{name}\" is neither time nor one of the loads {}; name the columns in the first line, such as \"time [s], {} [N]\"",
                names(),
                loads.first().map_or("NAME", |load| load.at.name.as_str()),
            ));
        };
        seen.push(name);
        columns.push(column);
    }
    if !columns
        .iter()
        .any(|column| matches!(column, Column::Time(_)))
    {
        return Err(
            "there is no column of time; name it in the first line, \"time [s]\"".to_owned(),
        );
    }
    Ok(columns)
}
