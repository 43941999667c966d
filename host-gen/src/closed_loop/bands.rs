//! The highest σ_max(G11) in a band of frequencies.

use nalgebra::Complex;

use super::ideal::{IdealLoop, close_ideal};
use super::poles::stable;
use super::sampled::SampledLoop;
use crate::numeric::frequencies::{grid, pole_peaks};
use crate::numeric::singular::largest_singular_value;
use crate::plant::{Gain, Plant};

/// Frequencies of the grid in a band, besides those at the peaks.
const POINTS: usize = 300;

/// The highest σ_max of the transfer function `gain` from `low` to `high` Hz, as 20·lg σ_max, dB:
/// on a grid of `count` points, refined at `peaks` (centre and half width, Hz).
pub fn highest_db(
    [low, high]: [f64; 2],
    count: usize,
    peaks: &[(f64, f64)],
    gain: impl Fn(f64) -> Gain,
) -> f64 {
    let points = grid(low, high, count, peaks).into_iter();
    let highest = points.map(|hz| largest_singular_value(&gain(hz)));
    20.0 * highest.fold(0.0, f64::max).log10()
}

/// From `low` to `high` Hz without control, dB.
pub fn open_db(plant: &Plant, low: f64, high: f64) -> f64 {
    highest_db([low, high], POINTS, &plant.peaks(), |hz| {
        plant.open(hz, plant.performance())
    })
}

/// From `low` to `high` Hz with the ideal law, dB; none if that loop is unstable.
pub fn ideal_db(plant: &Plant, ideal: &IdealLoop, low: f64, high: f64) -> Option<f64> {
    stable(&ideal.poles).then(|| {
        highest_db([low, high], POINTS, &pole_peaks(&ideal.poles), |hz| {
            close_ideal(plant, &ideal.gains, hz, plant.performance())
        })
    })
}

/// From `low` to `high` Hz of the sampled loop `closed` with its `poles`, rad/s, dB.
pub fn sampled_db(closed: &SampledLoop<'_>, poles: &[Complex<f64>], low: f64, high: f64) -> f64 {
    let rows = closed.plant.plant.performance();
    highest_db([low, high], POINTS, &pole_peaks(poles), |hz| {
        closed.close(hz, rows.clone())
    })
}

/// The most by which the sampled loop `closed` raises σ_max(G11) between `low` and `high` Hz, dB,
/// and the frequency of that, Hz. Negative if it lowers it everywhere. `poles` are those of the
/// loop, rad/s.
pub fn amplification(
    closed: &SampledLoop<'_>,
    poles: &[Complex<f64>],
    low: f64,
    high: f64,
) -> (f64, f64) {
    let plant = &closed.plant.plant;
    let rows = plant.performance();
    let ratio = |hz: f64| {
        largest_singular_value(&closed.close(hz, rows.clone()))
            / largest_singular_value(&plant.open(hz, rows.clone()))
    };
    let points = grid(low, high, POINTS, &pole_peaks(poles)).into_iter();
    let highest = points.map(|hz| (ratio(hz), hz));
    let highest = highest.fold((0.0, low), |a, b| if b.0 > a.0 { b } else { a });
    (20.0 * f64::log10(highest.0), highest.1)
}
