//! Vibration from floor and noise: the sources of the machine's motion, and the vibration
//! criterion that its frame meets.
//!
//! The sources are independent of each other: motions of the base, sensors, ADC channels and DAC
//! channels. Spectra are one-sided power densities.

use core::f64::consts::TAU;
use core::ops::Range;

use nalgebra::{Complex, Matrix6};
use rayon::prelude::*;
use shared::table::ValidTable;

use super::SampledLoop;
use crate::control::LinearLaw;
use crate::floor::Floor;
use crate::floor::criterion::{Criterion, third_centres, third_edges};
use crate::machine::Board;
use crate::numeric::NumericError;
use crate::numeric::exposure::{Measure, about_mean};
use crate::numeric::frequencies::grid;
use crate::numeric::power_law::steeper;
use crate::numeric::quadrature::{nodes, singular_hertz};
use crate::numeric::six::ComplexMatrix6;
use crate::plant::noise::Noise;
use crate::plant::{Control, Gain, SampledPlant};

/// The lowest frequency of a noise budget, Hz: further below, displacements from accelerations
/// are rounding errors.
pub const LOWEST: f64 = 1e-4;

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
    /// Exposure time of moving averages and deviations, s.
    exposure: Option<f64>,
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
/// upper end of `band`, Hz; as [`budget`].
///
/// # Errors
/// [`NumericError`] if an eigenvalue iteration does not converge.
pub fn both_budgets(
    plant: &SampledPlant,
    board: &Board,
    table: &ValidTable,
    floor: &Floor,
    band: [f64; 2],
    exposure: Option<f64>,
) -> Result<[NoiseBudget; 2], NumericError> {
    let of = |table| budget(plant, board, table, floor, band, exposure);
    Ok([of(None)?, of(Some(table))?])
}

/// The noise budget on `floor` in `band`, Hz, at least [`LOWEST`] and at most half the sample
/// rate: with the loop closed under `table`, or without a table with constant outputs. With an
/// `exposure`, s, also moving averages and deviations over it can be had.
///
/// # Errors
/// [`NumericError`] if an eigenvalue iteration does not converge.
pub fn budget(
    plant: &SampledPlant,
    board: &Board,
    table: Option<&ValidTable>,
    floor: &Floor,
    band: [f64; 2],
    exposure: Option<f64>,
) -> Result<NoiseBudget, NumericError> {
    let law = table.map(LinearLaw::new);
    let sources = Sources {
        plant,
        law,
        floor,
        noise: Noise::new(board, law.is_some()),
        exposure,
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
        exposure,
        performance,
        frame,
        force,
        stroke,
    })
}

/// Everything that moves a machine.
struct Sources<'a> {
    plant: &'a SampledPlant,
    law: Option<LinearLaw>,
    floor: &'a Floor,
    noise: Noise,
    exposure: Option<f64>,
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
        let average = self.exposure.map(Measure::Average);
        breaks.extend(average.into_iter().flat_map(|measure| measure.breaks(band)));
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
        let motions = Matrix6::from_diagonal(&self.floor.motions(hz, model.waves));
        let base = (model.base_at(hz) * motions).map(Complex::from);
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
                    by_base.row(i).norm_squared(),
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
        self.measured(spectrum, Measure::Acceleration)
    }

    /// What can be measured of the performance outputs: their accelerations, their displacements and,
    /// with an exposure time, moving averages and deviations of their displacements.
    pub fn measures(&self) -> impl Iterator<Item = Measure> {
        let moving = |exposure| [Measure::Average(exposure), Measure::Deviation(exposure)];
        let moving = self.exposure.into_iter().flat_map(moving);
        [Measure::Acceleration, Measure::Displacement]
            .into_iter()
            .chain(moving)
    }

    /// The power that `measure` makes of `spectrum`, one of accelerations, in the band, by source:
    /// (m/s²)² or m².
    pub fn measured(&self, spectrum: &[Powers], measure: Measure) -> Powers {
        self.weighted(spectrum, self.band, |hz| measure.weight(hz))
    }

    /// Power of `spectrum` in the band about the mean over each `time`, s, by source. Exact if the
    /// budget has this exposure time.
    pub fn about_mean(&self, spectrum: &[Powers], time: f64) -> Powers {
        self.weighted(spectrum, self.band, |hz| about_mean(hz, time))
    }

    /// Power of `spectrum` times `factor` between two frequencies, Hz, between which and others no
    /// interval of the quadrature extends: the ends of the band or of one-third-octave bands.
    fn weighted(
        &self,
        spectrum: &[Powers],
        [low, high]: [f64; 2],
        factor: impl Fn(f64) -> f64,
    ) -> Powers {
        let first = self.hz.partition_point(|hz| *hz < low);
        let end = self.hz.partition_point(|hz| *hz <= high);
        let mut sum = [0.0; SOURCES.len()];
        for (i, powers) in (first..end).zip(&spectrum[first..end]) {
            let weight = self.weights[i] * factor(self.hz[i]);
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
                    .map(|spectrum| self.weighted(spectrum, edges, |_| 1.0))
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
