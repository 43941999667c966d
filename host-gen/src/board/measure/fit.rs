//! A rational function through what was measured, and its resonances.

use nalgebra::DMatrix;
use serde::Serialize;
use shared::LEGS;

use super::Measured;
use crate::numeric::vector_fit::Rational;

/// Pairs of poles that are sought.
const PAIRS: usize = 12;

/// Lines with a larger expected error, relative to the measured plant, say nothing about poles.
const NOISY: f64 = 0.3;

/// Smallest error of a line, relative to its plant: with less, few lines would make all of the fit.
const EXACT: f64 = 1e-3;

/// A pole of higher damping is no resonance whose peak needs lines of its own.
const RESONANT: f64 = 0.2;

/// Mean square of what a resonance adds to a response, summed over the lines, each relative to its
/// error: below it, noise could have made the pole.
const CERTAIN: f64 = 25.0;

/// A resonance that was measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Resonance {
    /// Natural frequency, Hz.
    pub hz: f64,
    /// Damping ratio.
    pub damping: f64,
}

/// A rational function through all responses, and its resonances, ascending.
pub struct Fit {
    pub rational: Rational,
    pub resonances: Vec<Resonance>,
}

impl Fit {
    /// Through lines in ascending order. None where there are too few lines.
    pub fn new(measured: &[Measured]) -> Option<Self> {
        // Errors of a kind of sensors, each like all of them together.
        let kinds = |measured: &Measured| -> Vec<[f64; 2]> {
            let rows = (0..measured.plant.nrows()).step_by(LEGS);
            rows.map(|row| {
                let deviations = measured.line.deviation[row..row + LEGS].as_flattened();
                let square: f64 = deviations.iter().map(|x| x * x).sum();
                [square.sqrt(), measured.plant.rows(row, LEGS).norm()]
            })
            .collect()
        };
        let mut lines: Vec<_> = measured
            .iter()
            .map(|measured| (measured, kinds(measured)))
            .collect();
        lines.retain(|(_, kinds)| kinds.iter().all(|[error, size]| *error < NOISY * size));
        let hertz: Vec<_> = lines.iter().map(|(measured, _)| measured.line.hz).collect();
        let (first, _) = lines.first()?;
        let [rows, count] = [first.plant.nrows(), first.plant.len()];
        let responses = DMatrix::from_fn(lines.len(), count, |k, j| lines[k].0.plant[j]);
        let weights = DMatrix::from_fn(lines.len(), count, |k, j| {
            let [error, size] = lines[k].1[j % rows / LEGS];
            LEGS as f64 / error.hypot(EXACT * size)
        });
        let pairs = PAIRS.min(hertz.len().saturating_sub(2) / 2);
        let rational = Rational::fit(&hertz, &responses, &weights, pairs)?;
        let mut resonances = Vec::new();
        for (index, pole) in rational.poles.iter().enumerate() {
            let found = Resonance {
                hz: pole.norm(),
                damping: -pole.re / pole.norm(),
            };
            let square = |(k, hz): (usize, &f64)| {
                let part = rational.part(index, *hz);
                let parts = (0..count).map(|j| (part[j] * weights[(k, j)]).norm_sqr());
                parts.sum::<f64>()
            };
            let certainty: f64 = hertz.iter().enumerate().map(square).sum();
            if found.damping < RESONANT && certainty > CERTAIN * count as f64 {
                resonances.push(found);
            }
        }
        resonances.sort_by(|a, b| a.hz.total_cmp(&b.hz));
        Some(Self {
            rational,
            resonances,
        })
    }
}
