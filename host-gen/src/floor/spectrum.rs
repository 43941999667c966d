//! Spectra that are given point by point.

use core::str::FromStr;

use crate::files::columns::TextError;
use crate::files::without_byte_order_mark;
use crate::numeric::power_law::{exponent, power_law};

/// The highest acceleration density that a floor may have, m/s²/√Hz. Squared and integrated, it
/// stays a number.
pub const STRONGEST: f64 = 1e6;

/// A floor's spectrum, given point by point.
///
/// Between two points, the density is a straight line on logarithmic axes or, if it is zero at
/// one of them, on linear axes. Outside the points it is zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    /// Frequencies, Hz, above 0 and ascending, and one-sided acceleration densities, m/s²/√Hz.
    points: Vec<(f64, f64)>,
}

impl FromStr for Spectrum {
    type Err = TextError;

    /// Parses lines of two numbers, a frequency, Hz, and an acceleration density, m/s²/√Hz, with
    /// spaces, tabs, a comma or a semicolon between them; `#` starts a comment.
    ///
    /// # Errors
    /// If a line is not two numbers, a frequency is not above 0 and above the one before it, a
    /// density is not from 0 to [`STRONGEST`], or there are fewer than two points.
    fn from_str(text: &str) -> Result<Self, TextError> {
        let text = without_byte_order_mark(text);
        let mut points: Vec<(f64, f64)> = Vec::new();
        for (i, line) in text.lines().enumerate() {
            let at_line = |message| TextError::at(i + 1, message);
            let last = points.last().map_or(0.0, |(hz, _)| *hz);
            points.extend(point(line, last).map_err(at_line)?);
        }
        Self::of(points)
    }
}

/// The point on a line of a spectrum, after a frequency of `last`, Hz; none on an empty line.
fn point(line: &str, last: f64) -> Result<Option<(f64, f64)>, String> {
    let line = line.split('#').next().unwrap_or_default();
    let words: Vec<_> = line
        .split(|c: char| c.is_whitespace() || c == ',' || c == ';')
        .filter(|word| !word.is_empty())
        .collect();
    let mut numbers = Vec::new();
    for word in &words {
        numbers.push(word.parse::<f64>().map_err(|_| {
            format!(
                "\"{word}\" is not a number; write a frequency, Hz, and an acceleration density, m/s²/√Hz, and # before what is not data"
            )
        })?);
    }
    let (hz, density) = match numbers[..] {
        [] => return Ok(None),
        [hz, density] => (hz, density),
        _ => {
            return Err(format!(
                "expected two numbers, a frequency, Hz, and an acceleration density, m/s²/√Hz, found {}; decimals have a point",
                numbers.len()
            ));
        }
    };
    checked(hz, density, last).map(Some)
}

/// A point of a spectrum after a frequency of `last`, Hz.
fn checked(hz: f64, density: f64, last: f64) -> Result<(f64, f64), String> {
    if hz == 0.0 {
        return Err(
            "a spectrum cannot begin at 0 Hz, because it is interpolated on logarithmic axes; remove this line or give its lowest frequency"
                .to_owned(),
        );
    }
    if !(hz.is_finite() && hz > 0.0) {
        return Err(format!("a frequency must be above 0 Hz, not {hz}"));
    }
    if hz <= last {
        return Err(format!(
            "frequencies must ascend, but {hz} Hz comes after {last} Hz; sort the lines, and give each frequency once"
        ));
    }
    if !(0.0..=STRONGEST).contains(&density) {
        return Err(format!(
            "a density must be from 0 to {STRONGEST:e} m/s²/√Hz, not {density:?}"
        ));
    }
    Ok((hz, density))
}

impl Spectrum {
    /// A spectrum with these points: frequencies, Hz, and acceleration densities, m/s²/√Hz.
    ///
    /// # Errors
    /// If a frequency is not above 0 and above the one before it, a density is not from 0 to
    /// [`STRONGEST`], or there are fewer than two points; without a line.
    pub fn new(points: &[[f64; 2]]) -> Result<Self, TextError> {
        let mut all = Vec::with_capacity(points.len());
        let mut last = 0.0;
        for &[hz, density] in points {
            all.push(checked(hz, density, last).map_err(TextError::whole)?);
            last = hz;
        }
        Self::of(all)
    }

    /// A spectrum with these points, each of them checked.
    fn of(points: Vec<(f64, f64)>) -> Result<Self, TextError> {
        let few = match points[..] {
            [] => "there is no point of a spectrum",
            [_] => "one point is no spectrum, because the density is interpolated between points",
            _ => return Ok(Self { points }),
        };
        Err(TextError::whole(format!(
            "{few}; give at least two, each with a frequency, Hz, and an acceleration density, m/s²/√Hz"
        )))
    }

    /// The points on either side of `hz`, Hz; none outside.
    fn around(&self, hz: f64) -> Option<[(f64, f64); 2]> {
        let [first, last] = self.range();
        if !(first..=last).contains(&hz) {
            return None;
        }
        let above = self.points.partition_point(|(f, _)| *f < hz).max(1);
        Some([self.points[above - 1], self.points[above]])
    }

    /// The frequencies of its points, Hz.
    pub(super) fn hertz(&self) -> impl Iterator<Item = f64> {
        self.points.iter().map(|(hz, _)| *hz)
    }

    /// One-sided acceleration density at `hz`, Hz, in m/s²/√Hz.
    pub(super) fn density(&self, hz: f64) -> f64 {
        let Some([(f0, d0), (f1, d1)]) = self.around(hz) else {
            return 0.0;
        };
        if d0 > 0.0 && d1 > 0.0 {
            power_law([(f0, d0), (f1, d1)], hz)
        } else {
            d0 + (d1 - d0) * (hz - f0) / (f1 - f0)
        }
    }

    /// As [`super::Floor::exponent`].
    pub(super) fn exponent(&self, hz: f64) -> f64 {
        match self.around(hz) {
            Some([(f0, d0), (f1, d1)]) if d0 > 0.0 && d1 > 0.0 => {
                2.0 * exponent([(f0, d0), (f1, d1)])
            }
            // A parabola takes more than one node.
            Some([(f0, _), (f1, _)]) => 3.0 * hz / (f1 - f0),
            None => 0.0,
        }
    }

    /// Its lowest and its highest frequency, Hz.
    pub(super) fn range(&self) -> [f64; 2] {
        // A spectrum has at least two points.
        [0, self.points.len() - 1].map(|i| self.points[i].0)
    }
}
