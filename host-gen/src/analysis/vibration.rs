//! Vibration from floor and noise: the sources of the machine's motion, and the vibration
//! criterion that its frame meets.
//!
//! The sources are independent of each other: motions of the base, sensors, ADC channels and DAC
//! channels. Spectra are one-sided power densities.

use core::f64::consts::TAU;
use core::ops::Range;
use core::str::FromStr;

use nalgebra::{Complex, DVector, Matrix6};
use rayon::prelude::*;
use shared::LEGS;
use shared::table::ValidTable;

use super::criterion::{Criterion, third_centres, third_edges};
use crate::closed_loop::SampledLoop;
use crate::control::LinearLaw;
use crate::files::without_byte_order_mark;
use crate::machine::{Board, Sensor};
use crate::numeric::NumericError;
use crate::numeric::frequencies::grid;
use crate::numeric::power_law::{exponent, power_law};
use crate::numeric::quadrature::{nodes, singular_hertz};
use crate::numeric::six::ComplexMatrix6;
use crate::plant::{Control, Gain, SampledPlant};

/// Bandwidth of a one-third-octave band relative to its centre frequency, 2^(1/6) −
/// 2^(−1/6).
const THIRD: f64 = 0.231_563;

/// The highest acceleration density that a floor may have, m/s²/√Hz. Squared and integrated, it
/// stays a number.
pub const STRONGEST: f64 = 1e6;

/// The lowest frequency of a noise budget, Hz: further below, displacements from accelerations
/// are rounding errors.
pub const LOWEST: f64 = 1e-4;

/// Vibration of the floor: the acceleration of the rigid base along each of x, y and z,
/// independent of each other, and of its rotations as the machine's file says.
#[derive(Clone, Debug, PartialEq)]
pub enum Floor {
    /// At the limit of a vibration criterion in every one-third-octave band.
    Criterion(Criterion),
    /// White acceleration, one-sided amplitude density, m/s²/√Hz.
    White(f64),
    /// A spectrum given point by point.
    Table(Spectrum),
}

impl Floor {
    /// One-sided acceleration density at `hz`, Hz, in m/s²/√Hz.
    pub fn density(&self, hz: f64) -> f64 {
        match self {
            Self::Criterion(criterion) => TAU * hz * criterion.velocity(hz) / (THIRD * hz).sqrt(),
            Self::White(density) => *density,
            Self::Table(spectrum) => spectrum.density(hz),
        }
    }

    /// The frequencies for which the floor is given, lowest and highest, Hz.
    pub fn range(&self) -> [f64; 2] {
        match self {
            Self::Criterion(_) | Self::White(_) => [0.0, f64::INFINITY],
            Self::Table(spectrum) => spectrum.range(),
        }
    }

    /// The frequencies at which the density is not smooth, Hz.
    fn breaks(&self) -> Vec<f64> {
        match self {
            Self::Criterion(criterion) => criterion.breaks().to_vec(),
            Self::White(_) => Vec::new(),
            Self::Table(spectrum) => spectrum.points.iter().map(|(hz, _)| *hz).collect(),
        }
    }

    /// How steep the power density is at `hz`, Hz, where it is steeper than a criterion: about
    /// d ln density²/d ln hz.
    fn exponent(&self, hz: f64) -> f64 {
        match self {
            Self::Criterion(_) | Self::White(_) => 0.0,
            Self::Table(spectrum) => spectrum.exponent(hz),
        }
    }
}

/// A floor's spectrum, given point by point.
///
/// Between two points, the density is a straight line on logarithmic axes or, if it is zero at
/// one of them, on linear axes. Outside the points it is zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    /// Frequencies, Hz, above 0 and ascending, and one-sided acceleration densities, m/s²/√Hz.
    points: Vec<(f64, f64)>,
}

/// Why a text is not a spectrum.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct SpectrumError {
    /// Number of the line at fault, from 1; none if it is the text as a whole.
    pub line: Option<usize>,
    /// The cause and the fix.
    pub message: String,
}

impl FromStr for Spectrum {
    type Err = SpectrumError;

    /// Parses lines of two numbers, a frequency, Hz, and an acceleration density, m/s²/√Hz, with
    /// spaces, tabs, a comma or a semicolon between them; `#` starts a comment.
    ///
    /// # Errors
    /// If a line is not two numbers, a frequency is not above 0 and above the one before it, a
    /// density is not from 0 to [`STRONGEST`], or there are fewer than two points.
    fn from_str(text: &str) -> Result<Self, SpectrumError> {
        let text = without_byte_order_mark(text);
        let mut points: Vec<(f64, f64)> = Vec::new();
        for (i, line) in text.lines().enumerate() {
            let at_line = |message| SpectrumError {
                line: Some(i + 1),
                message,
            };
            let last = points.last().map_or(0.0, |(hz, _)| *hz);
            points.extend(point(line, last).map_err(at_line)?);
        }
        let whole = |message: &str| SpectrumError {
            line: None,
            message: format!(
                "{message}; give at least two lines, each with a frequency, Hz, and an acceleration density, m/s²/√Hz"
            ),
        };
        match points[..] {
            [] => Err(whole("the file has no point of a spectrum")),
            [_] => Err(whole(
                "one point is no spectrum, because the density is interpolated between points",
            )),
            _ => Ok(Self { points }),
        }
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
    if hz == 0.0 {
        return Err(
            "a spectrum cannot begin at 0 Hz, because it is interpolated on logarithmic axes; remove this line or give its lowest frequency"
                .to_owned(),
        );
    }
    if !(hz.is_finite() && hz > 0.0) {
        return Err(format!("a frequency must be above 0 Hz, not {}", words[0]));
    }
    if hz <= last {
        return Err(format!(
            "frequencies must ascend, but {hz} Hz comes after {last} Hz; sort the lines, and give each frequency once"
        ));
    }
    if !(0.0..=STRONGEST).contains(&density) {
        return Err(format!(
            "a density must be from 0 to {STRONGEST:e} m/s²/√Hz, not {}",
            words[1]
        ));
    }
    Ok(Some((hz, density)))
}

impl Spectrum {
    /// The points on either side of `hz`, Hz; none outside.
    fn around(&self, hz: f64) -> Option<[(f64, f64); 2]> {
        let [first, last] = self.range();
        if !(first..=last).contains(&hz) {
            return None;
        }
        let above = self.points.partition_point(|(f, _)| *f < hz).max(1);
        Some([self.points[above - 1], self.points[above]])
    }

    /// One-sided acceleration density at `hz`, Hz, in m/s²/√Hz.
    fn density(&self, hz: f64) -> f64 {
        let Some([(f0, d0), (f1, d1)]) = self.around(hz) else {
            return 0.0;
        };
        if d0 > 0.0 && d1 > 0.0 {
            power_law([(f0, d0), (f1, d1)], hz)
        } else {
            d0 + (d1 - d0) * (hz - f0) / (f1 - f0)
        }
    }

    /// As [`Floor::exponent`].
    fn exponent(&self, hz: f64) -> f64 {
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
    fn range(&self) -> [f64; 2] {
        // A spectrum has at least two points.
        [0, self.points.len() - 1].map(|i| self.points[i].0)
    }
}

/// Sources of the machine's motion: floor, sensor noise, ADC (noise and rounding), DAC
/// (noise and rounding).
pub const SOURCES: [&str; 4] = ["floor", "sensors", "ADC", "DAC"];

/// Power, or power density, of one quantity by source, in the order of [`SOURCES`].
pub type Powers = [f64; SOURCES.len()];

/// Power densities of a group of outputs: by output, then by frequency.
pub type Spectra = Vec<Vec<Powers>>;

/// One-sided power densities of a machine's motion and forces, by source.
#[derive(Clone, Debug)]
pub struct NoiseBudget {
    /// Lower and upper end of the band, Hz.
    pub band: [f64; 2],
    /// The part of the band in which the floor is given, lower and upper end, Hz.
    pub seen: [f64; 2],
    /// Frequencies, ascending, closer together where the spectra are steep, Hz.
    pub hz: Vec<f64>,
    /// The weight of each frequency in an integral over the band, Hz.
    weights: Vec<f64>,
    /// Power densities of the performance outputs, (m/s²)²/Hz.
    pub performance: Spectra,
    /// Power densities of the frame's velocity along x, y and z, (m/s)²/Hz.
    pub frame: Spectra,
    /// Power densities of the leg forces, N²/Hz.
    pub force: Spectra,
    /// Power densities of the legs' elongations, m²/Hz.
    pub stroke: Spectra,
}

/// Noise budgets without control and with `table`, in this order, from the lower to the
/// upper end of `band`, Hz.
///
/// # Errors
/// [`NumericError`] if an eigenvalue iteration does not converge.
pub fn both_budgets(
    plant: &SampledPlant,
    board: &Board,
    table: &ValidTable,
    floor: &Floor,
    band: [f64; 2],
) -> Result<[NoiseBudget; 2], NumericError> {
    let of = |table| budget(plant, board, table, floor, band);
    Ok([of(None)?, of(Some(table))?])
}

/// The noise budget on `floor` in `band`, Hz, at least [`LOWEST`] and at most half the sample
/// rate: with the loop closed under `table`, or without a table with constant outputs.
///
/// # Errors
/// [`NumericError`] if an eigenvalue iteration does not converge.
pub fn budget(
    plant: &SampledPlant,
    board: &Board,
    table: Option<&ValidTable>,
    floor: &Floor,
    band: [f64; 2],
) -> Result<NoiseBudget, NumericError> {
    let law = table.map(LinearLaw::new);
    let sources = Sources {
        plant,
        law,
        floor,
        noise: Noise::new(board, law.is_some()),
    };
    let (hz, weights) = sources.nodes(board, band)?.into_iter().unzip();
    let points: Vec<[Vec<Powers>; 4]> = Vec::par_iter(&hz).map(|hz| sources.at(*hz)).collect();
    let [performance, frame, force, stroke] = [0, 1, 2, 3].map(|group| {
        let count = points.first().map_or(0, |point| point[group].len());
        let of_output = |i: usize| points.iter().map(|point| point[group][i]).collect();
        (0..count).map(of_output).collect()
    });
    let [low, high] = floor.range();
    Ok(NoiseBudget {
        band,
        seen: [band[0].max(low), band[1].min(high)],
        hz,
        weights,
        performance,
        frame,
        force,
        stroke,
    })
}

/// The power densities of the board's noise up to half the sample rate; those of the converters
/// are white.
struct Noise {
    /// The kinds of sensors that are fed back.
    kinds: Vec<Sensor>,
    /// Of the ADC referred to each sensor, (m/s²)²/Hz or N²/Hz.
    adc: DVector<f64>,
    /// Of the DAC, N²/Hz.
    dac: f64,
}

impl Noise {
    /// `moving`: whether the outputs change from sample to sample. The rounding of a constant
    /// output is constant.
    fn new(board: &Board, moving: bool) -> Self {
        let nyquist = 0.5 * board.sample_rate;
        let rounding = |lsb: f64| lsb * lsb / 12.0;
        let adc = (board.adc_noise.powi(2) + rounding(board.adc.lsb())) / nyquist;
        let adc = board
            .fed_back()
            .flat_map(|sensor| [adc / sensor.sensitivity.powi(2); LEGS])
            .collect();
        let rounded = if moving {
            rounding(board.dac.lsb())
        } else {
            0.0
        };
        Self {
            kinds: board.fed_back().cloned().collect(),
            adc: DVector::from_vec(adc),
            dac: (board.dac_noise.powi(2) + rounded) / nyquist * board.actuator_gain.powi(2),
        }
    }
}

impl Noise {
    /// The power density of each sensor's own noise at `hz`, Hz, in (m/s²)²/Hz or N²/Hz.
    fn sensors(&self, hz: f64) -> DVector<f64> {
        let of_kind = |sensor: &Sensor| [sensor.noise_density.at(hz).powi(2); LEGS];
        DVector::from_vec(self.kinds.iter().flat_map(of_kind).collect())
    }

    /// The frequencies at which a density is not smooth, Hz.
    fn breaks(&self) -> impl Iterator<Item = f64> {
        let of_kind = |sensor: &'_ Sensor| sensor.noise_density.breaks().collect::<Vec<_>>();
        self.kinds.iter().flat_map(of_kind)
    }

    /// d ln density²/d ln hz at `hz`, Hz, of the sensor where it is steepest.
    fn exponent(&self, hz: f64) -> f64 {
        let slopes = self.kinds.iter();
        let slopes = slopes.map(|sensor| 2.0 * sensor.noise_density.slope(hz));
        slopes.fold(0.0, steeper)
    }
}

/// The exponent of the greater magnitude.
fn steeper(a: f64, b: f64) -> f64 {
    if b.abs() > a.abs() { b } else { a }
}

/// Everything that moves a machine.
struct Sources<'a> {
    plant: &'a SampledPlant,
    law: Option<LinearLaw>,
    floor: &'a Floor,
    noise: Noise,
}

impl Sources<'_> {
    /// Frequencies in `band`, Hz, with their weights: all that is integrated is singular at poles
    /// and smooth between the points of floor and noise and the edges of the bands.
    fn nodes(&self, board: &Board, band: [f64; 2]) -> Result<Vec<(f64, f64)>, NumericError> {
        let plant = self.plant;
        let mut singular = match self.law {
            None => singular_hertz(plant.plant.poles.iter().map(|pole| &pole.lambda)),
            Some(law) => singular_hertz(&SampledLoop { plant, law }.poles()?),
        };
        // Those of a sampled law come again mirrored at half the sample rate.
        let mirrored = |at: &Complex<f64>| Complex::new(board.sample_rate - at.re, at.im);
        let aliases: Vec<_> = singular.iter().map(mirrored).collect();
        singular.extend(aliases);
        let amplifier = board.actuator_bandwidth;
        singular.extend(amplifier.map(|hz| Complex::new(0.0, hz)));
        let [low, high] = band;
        // Enough points for a smooth curve.
        let mut breaks = grid(low, high, 150, &[]);
        let edges = third_centres().flat_map(third_edges);
        let inside = |hz: &f64| low < *hz && *hz < high;
        let points = self.floor.breaks().into_iter().chain(self.noise.breaks());
        breaks.extend(edges.chain(points).filter(inside));
        breaks.sort_by(f64::total_cmp);
        breaks.dedup();
        let exponent = |hz: f64| steeper(self.floor.exponent(hz), self.noise.exponent(hz));
        Ok(nodes(&breaks, &singular, exponent))
    }

    /// The power densities at `hz`, Hz, of performance, frame, forces and strokes.
    fn at(&self, hz: f64) -> [Vec<Powers>; 4] {
        let response = self.plant.response(hz);
        let model = &self.plant.plant;
        let none = || Control::zeros(model.sensors().len());
        let controller = self
            .law
            .map_or_else(none, |law| law.response(self.plant.z(hz)));
        // σ = K·(floor part of the sensors + noise); `from_dac` is the response of the
        // forces to a disturbance of the forces.
        let one = ComplexMatrix6::identity();
        let from_dac = (one - &controller * response.g22())
            .try_inverse()
            .unwrap_or_else(Matrix6::zeros);
        let from_sensors = from_dac * &controller;
        let base = model.base.map(Complex::from);
        let floor = self.floor.density(hz).powi(2);
        let own = self.noise.sensors(hz);
        let Noise { adc, dac, .. } = &self.noise;
        let powers = |by_floor: &Gain, by_force: &Gain, scale: f64| -> Vec<Powers> {
            let by_base = by_floor * base;
            // The part of these rows that sensor noise causes through the forces.
            let by_noise = (by_force * &from_sensors).map(|z| z.norm_sqr());
            let [sensors, adc] = [&own, adc].map(|noise| &by_noise * noise);
            let by_dac = by_force * from_dac;
            let of_row = |i| {
                let powers = [
                    by_base.row(i).norm_squared() * floor,
                    sensors[i],
                    adc[i],
                    by_dac.row(i).norm_squared() * dac,
                ];
                powers.map(|power| scale * power)
            };
            (0..by_floor.nrows()).map(of_row).collect()
        };
        let outputs = |rows: Range<usize>, scale: f64| {
            let by_floor = response.close(rows.clone(), &controller);
            powers(&by_floor, &response.from_legs(rows), scale)
        };
        let per_second = (TAU * hz).powi(-2);
        let force_by_floor = &from_sensors * response.from_floor(model.sensors());
        let all = |m: ComplexMatrix6| Gain::from_column_slice(m.as_slice());
        [
            outputs(model.performance(), 1.0),
            outputs(model.frame(), per_second),
            powers(&all(force_by_floor), &all(one), 1.0),
            outputs(model.legs(), per_second * per_second),
        ]
    }
}

impl NoiseBudget {
    /// Power of `spectrum` in the band, by source.
    pub fn power(&self, spectrum: &[Powers]) -> Powers {
        self.power_within(spectrum, self.band)
    }

    /// Power of `spectrum` between two frequencies, Hz, between which and others no interval of
    /// the quadrature extends: the ends of the band or of one-third-octave bands.
    fn power_within(&self, spectrum: &[Powers], [low, high]: [f64; 2]) -> Powers {
        let first = self.hz.partition_point(|hz| *hz < low);
        let end = self.hz.partition_point(|hz| *hz <= high);
        let mut sum = [0.0; SOURCES.len()];
        for (weight, powers) in self.weights[first..end].iter().zip(&spectrum[first..end]) {
            for (sum, power) in sum.iter_mut().zip(powers) {
                *sum += weight * power;
            }
        }
        sum
    }

    /// The frame's velocity in each one-third-octave band from 1 to 80 Hz that lies in the band
    /// and for which the floor is given: centre, Hz; rms velocity, the largest of x, y and z,
    /// m/s; its powers by source, (m/s)².
    pub fn thirds(&self) -> Vec<(f64, f64, Powers)> {
        third_centres()
            .filter_map(|centre| {
                let edges = third_edges(centre);
                if !self.sees(edges) {
                    return None;
                }
                let worst = self
                    .frame
                    .iter()
                    .map(|spectrum| self.power_within(spectrum, edges))
                    .max_by(|a, b| a.iter().sum::<f64>().total_cmp(&b.iter().sum()))?;
                Some((centre, worst.iter().sum::<f64>().sqrt(), worst))
            })
            .collect()
    }

    fn sees(&self, [low, high]: [f64; 2]) -> bool {
        self.seen[0] <= low && high <= self.seen[1]
    }

    /// Those of VC-A to VC-G for which the velocity is known in all their bands, the least strict
    /// first.
    pub fn judged(&self) -> Vec<Criterion> {
        let seen = |criterion: &Criterion| self.sees(criterion.needs());
        Criterion::VC.into_iter().filter(seen).collect()
    }

    /// The strictest of the criteria that are [`judged`](Self::judged) whose limits the frame
    /// meets in all their bands; none if it meets none of them.
    pub fn criterion(&self) -> Option<Criterion> {
        let thirds = self.thirds();
        let met = |criterion: &Criterion| {
            thirds
                .iter()
                .filter(|(hz, ..)| criterion.covers(*hz))
                .all(|(hz, velocity, _)| *velocity <= criterion.velocity(*hz))
        };
        self.judged().into_iter().rev().find(met)
    }
}
