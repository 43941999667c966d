//! Floors and noise, and what they come to: where the motion of the machine
//! comes from, and which vibration criterion its frame meets.
//!
//! The sources are independent: six floor inputs, six sensors, the ADC and the
//! DAC. Spectra are one-sided power densities.

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

/// Bandwidth of a one-third-octave band over its centre, 2^(1/6) − 2^(−1/6).
const THIRD: f64 = 0.231_563;

/// A floor: the acceleration of each of its six inputs, independent of the
/// others.
#[derive(Clone, Debug, PartialEq)]
pub enum Floor {
    /// As strong as a vibration criterion allows in every band.
    Criterion(Criterion),
    /// White acceleration, m/s²/√Hz.
    White(f64),
    /// Frequency, Hz, ascending, and acceleration density, m/s²/√Hz: straight
    /// between the points on logarithmic axes, nothing beyond them.
    Table(Vec<(f64, f64)>),
}

impl Floor {
    /// Acceleration density at `hz`, m/s²/√Hz.
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

/// A line of a spectrum's text that is not what it must be: a frequency, Hz, above the
/// one before it, and an acceleration density, m/s²/√Hz, not negative.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "line {line}: a line is a frequency, Hz, above the one before, and an acceleration density, m/s²/√Hz, not negative"
)]
pub struct SpectrumError {
    /// From 1.
    pub line: usize,
}

impl FromStr for Floor {
    type Err = SpectrumError;

    /// A table of two numbers a line, separated by white space; `#` begins a comment.
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

/// What moves the machine: floor, sensor noise, ADC (noise and rounding), DAC
/// (noise and rounding), in this order.
pub const SOURCES: [&str; 4] = ["floor", "sensors", "ADC", "DAC"];

/// Power of one quantity from each of [`SOURCES`].
pub type Powers = [f64; SOURCES.len()];

/// Power densities over frequency of the rows of one group of outputs.
pub type Spectra = Vec<Vec<Powers>>;

/// What the floor and the noise come to.
#[derive(Clone, Debug)]
pub struct NoiseBudget {
    /// Hz, finer about every resonance.
    pub hz: Vec<f64>,
    /// Of the performance outputs, (m/s²)²/Hz.
    pub performance: Spectra,
    /// Of the frame's velocity along x, y and z, (m/s)²/Hz.
    pub frame: Spectra,
    /// Of the leg forces, N²/Hz.
    pub force: Spectra,
    /// Of the legs' elongations, m²/Hz.
    pub stroke: Spectra,
}

/// Without control and under `table`, in this order.
///
/// # Errors
/// As [`budget`].
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

/// Power densities on the given floor from `low` to `high` Hz; under `table`, or
/// without one with the outputs held.
///
/// # Errors
/// Where the eigenvalue iteration does not converge.
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
    // Resonances wide enough for the integral: their flanks fall as 1/f².
    let flanks: Vec<_> = peaks
        .iter()
        .flat_map(|&(hz, width)| [0.02, 0.1, 0.5, 2.0, 6.0].map(|part| (hz, part * width)))
        .collect();
    let hz = grid(low, high, 600, &flanks);

    // White up to half the sample rate.
    let nyquist = 0.5 * board.sample_rate;
    let rounding = |noise: f64, lsb: f64| (noise * noise + lsb * lsb / 12.0) / nyquist;
    let adc = rounding(board.adc_noise, board.adc.lsb());
    // By sensor: power densities of its own noise and of the ADC's as its own.
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
        // σ = K·(sensors' floor part + noise), and what a disturbance of the
        // forces comes to in the loop.
        let one = Matrix6::identity();
        let g22 = response.g22();
        let from_dac = (one - &controller * g22)
            .try_inverse()
            .unwrap_or_else(Matrix6::zeros);
        let from_sensors = from_dac * &controller;
        let floor = floor.density(hz).powi(2);
        let add = |spectra: &mut Spectra, by_floor: &Gain, by_force: &Gain, scale: f64| {
            // Of these rows, what the sensors' noise comes to by the forces.
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
    /// Power of a spectrum from `low` to `high` Hz by source: trapezoids.
    pub fn power(&self, spectrum: &[Powers], low: f64, high: f64) -> Powers {
        let mut sum = [0.0; SOURCES.len()];
        for i in 1..self.hz.len() {
            let (from, to) = (self.hz[i - 1].max(low), self.hz[i].min(high));
            if to <= from {
                continue;
            }
            // Straight between the points.
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

    /// The frame's rms velocity in the one-third-octave bands from 1 to 80 Hz
    /// that the spectra cover: centre, Hz, the worst of x, y and z, m/s, and
    /// its powers by source.
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

    /// The strictest criterion that the frame meets in all bands it covers.
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
