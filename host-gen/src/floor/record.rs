//! Recorded floors: motion along x, y and z over time, and its spectra by Welch's method.

use core::f64::consts::TAU;

use nalgebra::Complex;
use rustfft::FftPlanner;

use super::spectrum::Spectrum;
use super::{AXES, Floor};
use crate::files::columns::{
    TextError, each_line, in_columns, line_at, name_and_unit, number, seconds_in,
};
use crate::files::without_byte_order_mark;

/// Motion of the floor along x, y and z, evenly sampled.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Samples per second, Hz.
    rate: f64,
    /// What is recorded: the acceleration, or its first or second integral over time.
    integrals: i32,
    /// Samples along x, y and z, m/s², m/s or m.
    axes: [Vec<f64>; AXES],
}

/// Spectra of a record, and how they were found.
#[derive(Clone, Debug, PartialEq)]
pub struct Welch {
    /// The floor with these spectra.
    pub floor: Floor,
    /// Number of windows: Hann's, each half over the next, without their means.
    pub windows: usize,
    /// Length of a window, s.
    pub window: f64,
}

/// Windows in a record.
const WINDOWS: usize = 16;

/// A longer window would resolve more than any machine has, s.
const LONGEST: f64 = 100.0;

/// Fewest samples of a record.
const FEWEST: usize = 512;

/// Largest difference between two steps of time, as a part of a step.
const JITTER: f64 = 0.05;

/// Part of a record's duration in which it fades in or out.
const FADE: f64 = 0.02;

/// Names of units, their size, and how often the acceleration was integrated.
const UNITS: [(&str, f64, i32); 15] = [
    ("m/s²", 1.0, 0),
    ("m/s^2", 1.0, 0),
    ("m/s2", 1.0, 0),
    ("g", 9.80665, 0),
    ("mg", 9.80665e-3, 0),
    ("µg", 9.80665e-6, 0),
    ("ug", 9.80665e-6, 0),
    ("m/s", 1.0, 1),
    ("mm/s", 1e-3, 1),
    ("µm/s", 1e-6, 1),
    ("um/s", 1e-6, 1),
    ("nm/s", 1e-9, 1),
    ("µm", 1e-6, 2),
    ("um", 1e-6, 2),
    ("nm", 1e-9, 2),
];

/// What a column holds.
enum Column {
    /// Time, with the size of its unit, s.
    Time(f64),
    /// An axis, 0 to 2, with the size of its unit and its integrals.
    Axis(usize, f64, i32),
    /// Something else.
    Other,
}

impl Column {
    fn new(head: &str) -> Result<Self, String> {
        let (name, unit) = name_and_unit(head);
        if let "t" | "time" = name.as_str() {
            return seconds_in(unit).map(Self::Time);
        }
        let axis = match name.as_str() {
            "x" | "ax" | "a_x" | "acc_x" | "vx" | "v_x" => 0,
            "y" | "ay" | "a_y" | "acc_y" | "vy" | "v_y" => 1,
            "z" | "az" | "a_z" | "acc_z" | "vz" | "v_z" => 2,
            _ => return Ok(Self::Other),
        };
        let Some(unit) = unit else {
            if name.starts_with('v') {
                return Ok(Self::Axis(axis, 1.0, 1));
            }
            return Ok(Self::Axis(axis, 1.0, 0));
        };
        let found = UNITS.iter().find(|(name, ..)| *name == unit);
        let Some(&(_, size, integrals)) = found else {
            let names = UNITS.map(|(name, ..)| name).join(", ");
            return Err(format!(
                "\"{unit}\" is no unit of a floor's motion here; use one of {names}"
            ));
        };
        Ok(Self::Axis(axis, size, integrals))
    }
}

impl Record {
    /// Reads comma-separated values, or such with semicolons, tabs or spaces: a line for each
    /// sample. `#` starts a comment line.
    ///
    /// The first line names the columns, in any order: `time` or `t`, and `x`, `y`, `z`, with units
    /// in brackets, such as `time [s], x [mg], y [mg], z [mg]`; without units they are s and m/s².
    /// Without names, one column is one axis, three are x, y and z, and one more before them is
    /// the time. If there is only one axis, all three are like it. Other columns are left out.
    /// `rate`, Hz, is that of a record without time.
    ///
    /// # Errors
    /// If there is neither a time nor a rate, or both; an axis, a unit or a number is wrong; the
    /// samples are not evenly spaced; or there are fewer than 512.
    pub fn read(text: &str, rate: Option<f64>) -> Result<Self, TextError> {
        let text = without_byte_order_mark(text);
        let mut columns: Vec<Column> = Vec::new();
        let mut time = Vec::new();
        let mut axes: [Vec<f64>; AXES] = Default::default();
        let mut begins = Vec::new();
        each_line(text, "record", |fields, begin| {
            if columns.is_empty() {
                let named = fields.iter().any(|field| field.parse::<f64>().is_err());
                columns = if named {
                    let all = fields.iter().map(|head| Column::new(head));
                    all.collect::<Result<_, _>>()?
                } else {
                    unnamed(fields.len())?
                };
                if named {
                    return Ok(());
                }
            }
            for (column, field) in in_columns(&columns, fields)? {
                match column {
                    Column::Time(unit) => time.push(unit * number(field)?),
                    Column::Axis(axis, size, _) => axes[*axis].push(size * number(field)?),
                    Column::Other => {}
                }
            }
            begins.push(begin);
            Ok(())
        })?;
        let integrals = integrals(&columns)?;
        alike(&mut axes)?;
        let count = axes[0].len();
        if count < FEWEST {
            return Err(TextError::whole(format!(
                "{count} samples are no record of a floor: give at least {FEWEST}"
            )));
        }
        let rate = match (rate, time.is_empty()) {
            (Some(rate), true) => rate,
            (None, false) => evenly(&time)
                .map_err(|(i, message)| TextError::at(line_at(text, begins[i]), message))?,
            (Some(_), false) => {
                return Err(TextError::whole(
                    "the record has a column of time, which says its rate; leave --rate out",
                ));
            }
            (None, true) => {
                return Err(TextError::whole(
                    "the record has no column of time; give --rate, in Hz, or a column \"time [s]\"",
                ));
            }
        };
        Ok(Self {
            rate,
            integrals,
            axes,
        })
    }

    /// Its accelerations along x, y and z, m/s², sampled at about `rate`, Hz: so that they repeat
    /// after a whole number of samples. One list for each axis.
    ///
    /// Interpolated by its Fourier series, without the mean. Its ends fade out within
    /// 2 % of the duration each, so that it can be repeated.
    pub(crate) fn accelerations(&self, rate: f64) -> [Vec<f64>; AXES] {
        let count = self.axes[0].len();
        let wanted = (count as f64 * rate / self.rate).round().max(1.0) as usize;
        let fade = FADE * count as f64;
        let mut planner = FftPlanner::new();
        let (forward, back) = (
            planner.plan_fft_forward(count),
            planner.plan_fft_inverse(wanted),
        );
        self.axes.each_ref().map(|samples| {
            let mean = samples.iter().sum::<f64>() / count as f64;
            let faded = samples.iter().enumerate().map(|(i, x)| {
                let end = (i as f64).min((count - 1 - i) as f64);
                let part = (0.25 * TAU * (end / fade).min(1.0)).sin().powi(2);
                Complex::from((x - mean) * part)
            });
            let mut of_line: Vec<_> = faded.collect();
            forward.process(&mut of_line);
            let mut at = vec![Complex::ZERO; wanted];
            // Up to half of either rate; a line at half a rate is left out.
            for k in 1..count.min(wanted).div_ceil(2) {
                let hz = k as f64 * self.rate / count as f64;
                let derived = Complex::new(0.0, TAU * hz).powi(self.integrals);
                at[k] = of_line[k] * derived;
                at[wanted - k] = at[k].conj();
            }
            back.process(&mut at);
            at.iter().map(|z| z.re / count as f64).collect()
        })
    }

    /// Its spectra by Welch's method.
    ///
    /// # Errors
    /// If a spectrum is higher than one may be.
    pub fn welch(&self) -> Result<Welch, TextError> {
        let count = self.axes[0].len();
        // n windows, each half over the next, are n + 1 halves.
        let half = (count / (WINDOWS + 1)).min((0.5 * LONGEST * self.rate) as usize);
        let length = 2 * half;
        let windows = count / half - 1;
        let shape: Vec<f64> = (0..length)
            .map(|i| (0.5 * TAU * i as f64 / length as f64).sin().powi(2))
            .collect();
        let energy: f64 = shape.iter().map(|w| w * w).sum();
        let fft = FftPlanner::new().plan_fft_forward(length);
        let of_axis = |samples: &Vec<f64>| {
            let mut power = vec![0.0; half];
            for begin in (0..windows).map(|n| n * half) {
                let part = &samples[begin..begin + length];
                let mean = part.iter().sum::<f64>() / length as f64;
                let mut at: Vec<_> = part
                    .iter()
                    .zip(&shape)
                    .map(|(x, w)| Complex::from((x - mean) * w))
                    .collect();
                fft.process(&mut at);
                for (sum, z) in power.iter_mut().zip(&at) {
                    *sum += z.norm_sqr();
                }
            }
            let scale = 2.0 / (self.rate * energy * windows as f64);
            // Without the mean, which a window spreads over the next line.
            let points = (2..half).map(|k| {
                let hz = k as f64 * self.rate / length as f64;
                let derived = (TAU * hz).powi(self.integrals);
                [hz, (power[k] * scale).sqrt() * derived]
            });
            Spectrum::new(&points.collect::<Vec<_>>())
        };
        let [x, y, z] = self.axes.each_ref().map(of_axis);
        Ok(Welch {
            floor: Floor::Axes(Box::new([x?, y?, z?])),
            windows,
            window: length as f64 / self.rate,
        })
    }
}

/// The columns of a record that does not name them.
fn unnamed(count: usize) -> Result<Vec<Column>, String> {
    let axis = |axis| Column::Axis(axis, 1.0, 0);
    let axes = match count {
        1 | 2 => vec![axis(0)],
        3 | 4 => (0..AXES).map(axis).collect(),
        _ => {
            return Err(format!(
                "{count} columns without names; write a first line, such as \"time [s], x [m/s²], y [m/s²], z [m/s²]\""
            ));
        }
    };
    let time = count.is_multiple_of(2).then_some(Column::Time(1.0));
    Ok(time.into_iter().chain(axes).collect())
}

/// How often the acceleration of all axes was integrated.
fn integrals(columns: &[Column]) -> Result<i32, TextError> {
    let mut all = columns.iter().filter_map(|column| match column {
        Column::Axis(_, _, integrals) => Some(*integrals),
        _ => None,
    });
    let Some(first) = all.next() else {
        return Err(TextError::whole(
            "no column is called x, y or z; name them in the first line, such as \"time [s], x [m/s²], y [m/s²], z [m/s²]\"",
        ));
    };
    if all.any(|other| other != first) {
        return Err(TextError::whole(
            "some axes are accelerations and others velocities or displacements; give one kind",
        ));
    }
    Ok(first)
}

/// Copies the only axis to the others, if there is only one.
fn alike(axes: &mut [Vec<f64>; AXES]) -> Result<(), TextError> {
    let given: Vec<usize> = (0..AXES).filter(|i| !axes[*i].is_empty()).collect();
    match given[..] {
        [only] => {
            let samples = axes[only].clone();
            axes.fill(samples);
            Ok(())
        }
        [_, _] => Err(TextError::whole(
            "there are two axes; give x, y and z, or one axis for all",
        )),
        _ => Ok(()),
    }
}

/// The rate of evenly spaced times, s; Hz. If they are not, the number of the first that is not, and
/// why.
fn evenly(time: &[f64]) -> Result<f64, (usize, String)> {
    let steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut sorted = steps.clone();
    sorted.sort_by(f64::total_cmp);
    let usual = sorted[sorted.len() / 2];
    let uneven = |step: &f64| *step <= 0.0 || (step - usual).abs() > JITTER * usual;
    let Some(i) = steps.iter().position(uneven) else {
        // What is rounded in single times is not in the whole.
        return Ok(steps.len() as f64 / steps.iter().sum::<f64>());
    };
    let message = if steps[i] <= 0.0 {
        "times must increase".to_owned()
    } else {
        format!(
            "a step of {:e} s, but the others are {usual:e} s; a record has even steps, without gaps",
            steps[i]
        )
    };
    Err((i + 1, message))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sines of 7 Hz at another rate, with units and integrals: away from the ends, those of the
    /// closed form.
    #[test]
    fn a_sine_is_sampled_again() {
        let omega = TAU * 7.0;
        for (unit, size, order) in [("m/s²", 1.0, 0), ("mm/s", 1e-3, 1), ("µm", 1e-6, 2)] {
            let mut text = format!("x [{unit}],y [{unit}],z [{unit}]\n");
            for i in 0..4000 {
                let sine = (omega * f64::from(i) / 200.0).sin();
                text += &format!("{sine},{},1\n", -2.0 * sine);
            }
            let record = Record::read(&text, Some(200.0)).unwrap();
            let [x, y, z] = record.accelerations(1e4);
            assert_eq!(x.len(), 200_000);
            for i in 20_000..180_000 {
                let t = i as f64 / 1e4;
                // d/dt turns a sine by a quarter.
                let turned = omega * t + 0.25 * TAU * f64::from(order);
                let expected = size * omega.powi(order) * turned.sin();
                let least = 1e-3 * size * omega.powi(order);
                assert!((x[i] - expected).abs() < least, "{unit} at {t} s");
                assert!(
                    (y[i] + 2.0 * expected).abs() < 2.0 * least,
                    "{unit} at {t} s"
                );
                assert!(z[i].abs() < 1e-9);
            }
        }
    }
}
