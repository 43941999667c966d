//! A rational function through what was measured, and its resonances.

use nalgebra::{Complex, DMatrix};
use serde::{Deserialize, Serialize};
use shared::LEGS;

use super::MeasuredLine;
use crate::numeric::vector_fit::Rational;
use crate::plant::Gain;

/// Pairs of poles that are sought.
const PAIRS: usize = 12;

/// Smallest error of a line, relative to its plant: with less, few lines would make all of the fit.
const EXACT: f64 = 1e-3;

/// A pole of higher damping is no resonance whose peak needs lines of its own.
const RESONANT: f64 = 0.1;

/// Squares of errors, relative to their standard deviations and for each response, that a resonance
/// takes away. Any pole takes away about one.
const CERTAIN: f64 = 25.0;

/// A resonance that was measured.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Resonance {
    /// Natural frequency, Hz.
    pub hz: f64,
    /// Damping ratio.
    pub damping: f64,
}

/// A rational function through measured lines.
#[derive(Clone, Debug)]
pub struct RationalFit {
    /// Frequencies of the lines that are exact enough, Hz, ascending.
    pub hertz: Vec<f64>,
    /// What was measured: a row for each of them, a column for each entry of G22, column by column.
    pub responses: DMatrix<Complex<f64>>,
    /// The inverse of the standard deviation of each entry of `responses`, but at most
    /// a thousand over its kind's size.
    pub weights: DMatrix<f64>,
    /// The covariance of the errors of a column of G22 in a row of `responses`, with those that the
    /// weights allow for: by line, sensors by sensors.
    pub covariances: Vec<DMatrix<Complex<f64>>>,
    /// Resonances that the measurement shows beyond doubt, ascending.
    pub resonances: Vec<Resonance>,
    /// The function, of the responses without the delay.
    rational: Rational,
    /// The loop's delay, s.
    delay: f64,
}

impl RationalFit {
    /// Through lines in ascending order, which are measured with this `delay` from the sample to the
    /// middle of the hold, s. None where there are too few lines.
    pub fn new(lines: &[MeasuredLine], delay: f64) -> Option<Self> {
        let lines: Vec<_> = lines.iter().filter(|line| line.is_clear()).collect();
        let hertz: Vec<_> = lines.iter().map(|line| line.hz).collect();
        let plants: Vec<_> = lines.iter().map(|line| line.gain()).collect();
        let kinds: Vec<_> = lines.iter().map(|line| line.kinds()).collect();
        let [rows, count] = [plants.first()?.nrows(), plants.first()?.len()];
        let responses = DMatrix::from_fn(lines.len(), count, |k, j| plants[k][j]);
        // All entries of a kind of sensors alike.
        let of_kind = |part: usize| {
            DMatrix::from_fn(lines.len(), count, |k, j| {
                kinds[k][j % rows / LEGS][part] / LEGS as f64
            })
        };
        let [errors, sizes] = [0, 1].map(of_kind);
        let weights = errors.zip_map(&sizes, |error, size| 1.0 / error.hypot(EXACT * size));
        let covariance = |(line, kinds): (&&MeasuredLine, &Vec<[f64; 2]>)| {
            let complex = |[re, im]: [f64; 2]| Complex::new(re, im);
            DMatrix::from_fn(rows, rows, |i, j| {
                let exact = EXACT * kinds[i / LEGS][1] / LEGS as f64;
                let own = if i == j { exact.powi(2) } else { 0.0 };
                complex(line.covariance[i][j]) + own
            })
        };
        let covariances = lines.iter().zip(&kinds).map(covariance).collect();
        let pairs = PAIRS.min(hertz.len().saturating_sub(2) / 2);
        let undelayed = delayed(responses.clone(), &hertz, -delay);
        let rational = Rational::fit(&hertz, &undelayed, &weights, pairs)?;
        let misfit = rational.misfit(&hertz, &undelayed, &weights);
        let mut resonances = Vec::new();
        for (index, pole) in rational.poles.iter().enumerate() {
            let found = Resonance {
                hz: pole.norm(),
                damping: -pole.re / pole.norm(),
            };
            let mut others = rational.poles.clone();
            others.remove(index);
            let without = Rational::with_poles(&hertz, &undelayed, &weights, others)?;
            let certainty = without.misfit(&hertz, &undelayed, &weights) - misfit;
            let within = found.hz > hertz[0] && found.hz < hertz[hertz.len() - 1];
            if within && found.damping < RESONANT && certainty > CERTAIN * count as f64 {
                resonances.push(found);
            }
        }
        resonances.sort_by(|a, b| a.hz.total_cmp(&b.hz));
        Some(Self {
            hertz,
            responses,
            weights,
            covariances,
            resonances,
            rational,
            delay,
        })
    }

    /// The responses of the function if every resonance had a damping that is larger by `added`, in
    /// the form of `responses`. `forces` is the row of G22 from which on its sensors are of forces,
    /// and not of accelerations.
    pub fn damped(&self, added: f64, forces: usize) -> DMatrix<Complex<f64>> {
        let rows = self.responses.ncols() / LEGS;
        // Accelerations are s² times the displacements that forces follow.
        let power = |j: usize| if j % rows < forces { 2 } else { 0 };
        let damped = self.rational.damped(added, RESONANT, power);
        let rows = self.hertz.iter().map(|hz| damped.at(*hz).transpose());
        let undelayed = DMatrix::from_rows(&rows.collect::<Vec<_>>());
        delayed(undelayed, &self.hertz, self.delay)
    }

    /// G22 of the function at `hz`, Hz.
    pub fn at(&self, hz: f64) -> Gain {
        let entries = self.rational.at(hz) * turn(hz, self.delay);
        Gain::from_column_slice(entries.as_slice())
    }

    /// Weights for `responses` in the form of those measured, each with an error of this part of its
    /// kind of sensors. Where all are small, far below the resonances, the function is a small
    /// difference of large parts: there it is that part of the middle size.
    pub fn relative_weights(&self, responses: &DMatrix<Complex<f64>>, error: f64) -> DMatrix<f64> {
        let rows = responses.ncols() / LEGS;
        let mut sizes = DMatrix::zeros(responses.nrows(), responses.ncols());
        for first in (0..rows).step_by(LEGS) {
            let own = |j: &usize| (first..first + LEGS).contains(&(j % rows));
            let columns: Vec<_> = (0..responses.ncols()).filter(own).collect();
            let mut all: Vec<_> = responses
                .row_iter()
                .map(|row| {
                    let square: f64 = columns.iter().map(|j| row[*j].norm_sqr()).sum();
                    square.sqrt() / LEGS as f64
                })
                .collect();
            let each = all.clone();
            all.sort_by(f64::total_cmp);
            let middle = all[all.len() / 2];
            for (k, size) in each.into_iter().enumerate() {
                for j in &columns {
                    sizes[(k, *j)] = size.max(middle);
                }
            }
        }
        sizes.map(|size| 1.0 / (error * size))
    }
}

/// e^(−jωτ) at `hz`, Hz: the factor of a `delay` τ, s.
pub fn turn(hz: f64, delay: f64) -> Complex<f64> {
    Complex::cis(-core::f64::consts::TAU * hz * delay)
}

/// Responses with a delay, s, more.
fn delayed(
    mut responses: DMatrix<Complex<f64>>,
    hertz: &[f64],
    delay: f64,
) -> DMatrix<Complex<f64>> {
    for (mut row, hz) in responses.row_iter_mut().zip(hertz) {
        row *= turn(*hz, delay);
    }
    responses
}
