//! Vibration from floor and noise: the sources of the machine's motion, and the vibration
//! criterion that its frame meets.
//!
//! The sources are independent of each other: floor inputs, sensors, ADC channels and DAC
//! channels. Spectra are one-sided power densities.

use core::f64::consts::TAU;
use core::ops::Range;
use core::str::FromStr;

use nalgebra::{DVector, Matrix6};
use shared::LEGS;
use shared::table::ValidTable;

use super::criterion::{Criterion, third_centres};
use crate::closed_loop::SampledLoop;
use crate::control::LinearLaw;
use crate::machine::Board;
use crate::numeric::NumericError;
use crate::numeric::frequencies::{grid, pole_peaks};
use crate::plant::{Control, Gain, SampledPlant};

/// Bandwidth of a one-third-octave band relative to its centre frequency, 2^(1/6) −
/// 2^(−1/6).
const THIRD: f64 = 0.231_563;

/// Vibration of the floor: the acceleration of each of the six floor inputs, independent
/// of each other.
#[derive(Clone, Debug, PartialEq)]
pub enum Floor {
    /// At the limit of a vibration criterion in every one-third-octave band.
    Criterion(Criterion),
    /// White acceleration, one-sided amplitude density, m/s²/√Hz.
    White(f64),
    /// Pairs of frequency, Hz, ascending, and one-sided acceleration density, m/s²/√Hz.
    /// Between the points, the density is a straight line on logarithmic axes; outside
    /// them it is zero.
    Table(Vec<(f64, f64)>),
}

impl Floor {
    /// One-sided acceleration density at `hz`, Hz, in m/s²/√Hz.
    pub fn density(&self, hz: f64) -> f64 {
        match self {
            Self::Criterion(criterion) => TAU * hz * criterion.velocity(hz) / (THIRD * hz).sqrt(),
            Self::White(density) => *density,
            Self::Table(points) => {
                let above = points.partition_point(|(f, _)| *f < hz);
                match (above.checked_sub(1).map(|i| points[i]), points.get(above)) {
                    (_, Some(&(f, density))) if f == hz => density,
                    (Some((f0, d0)), Some(&(f1, d1))) if d0 > 0.0 && d1 > 0.0 => {
                        d0 * (d1 / d0).powf((hz / f0).ln() / (f1 / f0).ln())
                    }
                    _ => 0.0,
                }
            }
        }
    }
}

/// The error of a spectrum's text. Each line must have a frequency, Hz, above the one
/// before it, and an acceleration density, m/s²/√Hz, at least 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "line {line}: expected a frequency, Hz, above the one before, and an acceleration density, m/s²/√Hz, at least 0"
)]
pub struct SpectrumError {
    /// Number of the line at fault, from 1.
    pub line: usize,
}

impl FromStr for Floor {
    type Err = SpectrumError;

    /// Parses a table with two numbers on each line, separated by white space; `#` starts
    /// a comment.
    fn from_str(text: &str) -> Result<Self, SpectrumError> {
        let mut points: Vec<(f64, f64)> = Vec::new();
        for (i, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default();
            let numbers: Vec<Option<f64>> = line
                .split_whitespace()
                .map(|word| word.parse().ok())
                .collect();
            let last = points.last().map_or(0.0, |(hz, _)| *hz);
            match numbers[..] {
                [] => {}
                [Some(hz), Some(density)]
                    if hz.is_finite() && hz > last && density.is_finite() && density >= 0.0 =>
                {
                    points.push((hz, density));
                }
                _ => return Err(SpectrumError { line: i + 1 }),
            }
        }
        Ok(Self::Table(points))
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
    /// Frequencies, ascending, closer together around every resonance, Hz.
    pub hz: Vec<f64>,
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

/// The noise budget on `floor` from `low` to `high`, Hz: with the loop closed under
/// `table`, or without a table with constant outputs.
///
/// # Errors
/// [`NumericError`] if an eigenvalue iteration does not converge.
pub fn budget(
    plant: &SampledPlant,
    board: &Board,
    table: Option<&ValidTable>,
    floor: &Floor,
    [low, high]: [f64; 2],
) -> Result<NoiseBudget, NumericError> {
    let law = table.map(LinearLaw::new);
    let mut peaks = plant.plant.peaks();
    if let Some(law) = law {
        peaks = pole_peaks(&SampledLoop { plant, law }.poles()?);
    }
    // Points also on the flanks of the resonances, which fall as 1/f²: the integral needs
    // them.
    let flanks: Vec<_> = peaks
        .iter()
        .flat_map(|&(hz, width)| [0.02, 0.1, 0.5, 2.0, 6.0].map(|part| (hz, part * width)))
        .collect();
    let hz = grid(low, high, 600, &flanks);

    // White up to half the sample rate.
    let nyquist = 0.5 * board.sample_rate;
    let rounding = |noise: f64, lsb: f64| (noise * noise + lsb * lsb / 12.0) / nyquist;
    let adc = rounding(board.adc_noise, board.adc.lsb());
    // By sensor: power densities of its own noise, and of the ADC's noise referred to the
    // sensor.
    let (sensor_noise, adc_noise): (Vec<_>, Vec<_>) = [Some(board.sensor), board.beside]
        .into_iter()
        .flatten()
        .flat_map(|sensor| {
            let powers = (
                sensor.noise_density.powi(2),
                adc / sensor.sensitivity.powi(2),
            );
            [powers; LEGS]
        })
        .unzip();
    let [sensor_noise, adc_noise] = [sensor_noise, adc_noise].map(DVector::from_vec);
    let dac = rounding(board.dac_noise, board.dac.lsb()) * board.actuator_gain.powi(2);

    let model = &plant.plant;
    let mut budget = NoiseBudget {
        performance: vec![Vec::new(); model.performance().len()],
        frame: vec![Vec::new(); 3],
        force: vec![Vec::new(); LEGS],
        stroke: vec![Vec::new(); LEGS],
        hz,
    };
    for &hz in &budget.hz {
        let response = plant.response(hz);
        let none = || Control::zeros(model.sensors().len());
        let controller = law.map_or_else(none, |law| law.response(plant.z(hz)));
        // σ = K·(floor part of the sensors + noise); `from_dac` is the response of the
        // forces to a disturbance of the forces.
        let one = Matrix6::identity();
        let g22 = response.g22();
        let from_dac = (one - &controller * g22)
            .try_inverse()
            .unwrap_or_else(Matrix6::zeros);
        let from_sensors = from_dac * &controller;
        let floor = floor.density(hz).powi(2);
        let add = |spectra: &mut Spectra, by_floor: &Gain, by_force: &Gain, scale: f64| {
            // The part of these rows that sensor noise causes through the forces.
            let by_noise = (by_force * &from_sensors).map(|z| z.norm_sqr());
            let [sensors, adc] = [&sensor_noise, &adc_noise].map(|noise| &by_noise * noise);
            let by_dac = by_force * from_dac;
            for (i, spectrum) in spectra.iter_mut().enumerate() {
                spectrum.push([
                    scale * by_floor.row(i).norm_squared() * floor,
                    scale * sensors[i],
                    scale * adc[i],
                    scale * by_dac.row(i).norm_squared() * dac,
                ]);
            }
        };
        let outputs = |spectra: &mut Spectra, rows: Range<usize>, scale: f64| {
            let legs = response.from_legs(rows.clone());
            let by_floor = response.close(rows, &controller);
            add(spectra, &by_floor, &legs, scale);
        };
        let per_second = (TAU * hz).powi(-2);
        outputs(&mut budget.performance, model.performance(), 1.0);
        outputs(&mut budget.frame, model.frame(), per_second);
        outputs(&mut budget.stroke, model.legs(), per_second * per_second);
        let by_floor = &from_sensors * response.from_floor(model.sensors());
        let all = |m: Matrix6<_>| Gain::from_column_slice(m.as_slice());
        add(&mut budget.force, &all(by_floor), &all(one), 1.0);
    }
    Ok(budget)
}

impl NoiseBudget {
    /// Power of `spectrum` between `low` and `high`, Hz, by source; by the trapezoidal
    /// rule.
    pub fn power(&self, spectrum: &[Powers], low: f64, high: f64) -> Powers {
        let mut sum = [0.0; SOURCES.len()];
        for i in 1..self.hz.len() {
            let (from, to) = (self.hz[i - 1].max(low), self.hz[i].min(high));
            if to <= from {
                continue;
            }
            // Linear between the points.
            let at = |hz: f64, source: usize| {
                let part = (hz - self.hz[i - 1]) / (self.hz[i] - self.hz[i - 1]);
                spectrum[i - 1][source] * (1.0 - part) + spectrum[i][source] * part
            };
            for (source, sum) in sum.iter_mut().enumerate() {
                *sum += 0.5 * (at(from, source) + at(to, source)) * (to - from);
            }
        }
        sum
    }

    /// The frame's velocity in each one-third-octave band from 1 to 80 Hz that lies
    /// within the spectra: centre, Hz; rms velocity, the largest of x, y and z, m/s; its
    /// powers by source, (m/s)².
    pub fn thirds(&self) -> Vec<(f64, f64, Powers)> {
        let (first, last) = (self.hz[0], self.hz[self.hz.len() - 1]);
        third_centres()
            .filter_map(|centre| {
                let half = 2f64.powf(1.0 / 6.0);
                let (low, high) = (centre / half, centre * half);
                if low < first || high > last {
                    return None;
                }
                let worst = self
                    .frame
                    .iter()
                    .map(|spectrum| self.power(spectrum, low, high))
                    .max_by(|a, b| a.iter().sum::<f64>().total_cmp(&b.iter().sum()))?;
                Some((centre, worst.iter().sum::<f64>().sqrt(), worst))
            })
            .collect()
    }

    /// The strictest of VC-A to VC-G whose limit the frame meets in all bands that lie
    /// within the spectra; none if it meets none.
    pub fn criterion(&self) -> Option<Criterion> {
        let thirds = self.thirds();
        let met = |criterion: &Criterion| {
            thirds
                .iter()
                .filter(|(hz, ..)| criterion.covers(*hz))
                .all(|(hz, velocity, _)| *velocity <= criterion.velocity(*hz))
        };
        Criterion::VC.into_iter().rev().find(met)
    }
}
