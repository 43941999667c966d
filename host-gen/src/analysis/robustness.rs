//! What the controller does on machines that are not quite the one in the file.

use rayon::prelude::*;
use serde::Serialize;
use shared::table::ValidTable;

use super::digest;
use crate::closed_loop::isolation::{corner, highest_db, isolation_band};
use crate::closed_loop::{SLOWEST, SampledLoop, ideal_poles, stable};
use crate::control::LinearLaw;
use crate::design::{Band, Study, StudyError};
use crate::machine::{Machine, Robustness};
use crate::numeric::frequencies::{grid, pole_peaks};
use crate::progress::Progress;

/// Smallest, nominal and largest value over all samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Smallest.
    pub min: f64,
    /// Of the machine as it is in the file.
    pub nominal: f64,
    /// Largest.
    pub max: f64,
}

/// A pole and how far it moves.
#[derive(Clone, Debug, Serialize)]
pub struct MovingPole {
    /// Hz.
    pub hz: Spread,
    /// Relative damping.
    pub damping: Spread,
}

/// A band and how far its peak moves.
#[derive(Clone, Debug, Serialize)]
pub struct MovingBand {
    /// Name.
    pub name: String,
    /// Highest σ_max(G11) of the sampled loop, dB.
    pub sampled_db: Spread,
}

/// What the Monte Carlo run found. The controller is that of the file.
#[derive(Clone, Debug, Serialize)]
pub struct PerturbedSpread {
    /// How often a machine was drawn.
    pub samples: usize,
    /// How many of them the sampled loop is stable on.
    pub stable: usize,
    /// Peak sensitivity of the sampled loop, of the stable ones.
    pub peak_sensitivity: Spread,
    /// Above this the machine does not follow the floor, Hz, of the stable ones.
    pub isolation_from_hz: Spread,
    /// Peaks in the bands, of the stable ones.
    pub bands: Vec<MovingBand>,
    /// Modes without control.
    pub open: Vec<MovingPole>,
    /// Poles under the ideal law.
    pub ideal: Vec<MovingPole>,
    /// Lowest damping of any pole of the sampled loop below the delay's.
    pub lowest_damping: Spread,
}

/// One machine under the controller of another.
struct Sample {
    stable: bool,
    peak_sensitivity: f64,
    isolation_from_hz: f64,
    bands: Vec<f64>,
    open: Vec<(f64, f64)>,
    ideal: Vec<(f64, f64)>,
    lowest_damping: f64,
}

/// Runs the samples over all cores; `progress` is called after each.
///
/// # Errors
/// Where a drawn machine cannot be modelled or an eigenvalue iteration does not
/// converge.
pub fn monte_carlo(
    study: &Study,
    settings: &Robustness,
    table: &ValidTable,
    bands: &[Band],
    progress: &dyn Progress,
) -> Result<PerturbedSpread, StudyError> {
    let samples: Vec<Sample> = (0..settings.samples)
        .into_par_iter()
        .map(|i| {
            let sample = Sample::new(study, study.machine().drawn_with(settings, i), table, bands);
            progress.advance();
            sample
        })
        .collect::<Result<_, _>>()?;
    let nominal = Sample::new(study, study.machine().clone(), table, bands)?;
    Ok(summary(&nominal, &samples, bands))
}

impl Sample {
    fn new(
        study: &Study,
        machine: Machine,
        table: &ValidTable,
        bands: &[Band],
    ) -> Result<Self, StudyError> {
        // The machine is its own, the controller the study's.
        let own = Study::new(machine)?;
        let sampled = own.plant();
        let plant = &sampled.plant;
        let ideal = ideal_poles(&plant.state_space, study.gains())?;
        let open = plant
            .poles
            .iter()
            .map(|pole| pole.lambda)
            .collect::<Vec<_>>();
        let law = LinearLaw::new(table);
        let closed = SampledLoop {
            plant: sampled,
            law,
        };
        let poles = closed.poles()?;
        let frequency = own.machine().target.frequency;
        let peaks = pole_peaks(&poles);
        let [low, high] = isolation_band(own.design_model(), frequency);
        let rows = sampled.plant.performance();
        let upper = |poles: &[nalgebra::Complex<f64>]| {
            poles
                .iter()
                .filter(|s| s.im >= 0.0)
                .map(|s| (s.norm() / core::f64::consts::TAU, -s.re / s.norm()))
                .collect::<Vec<_>>()
        };
        let fastest = core::f64::consts::PI / sampled.period;
        Ok(Self {
            stable: stable(&poles),
            // In the controller's own modal coordinates.
            peak_sensitivity: closed
                .peak_sensitivity(&study.design_model().modal, SLOWEST * frequency, &poles)
                .value,
            isolation_from_hz: corner(low, high, &peaks, |hz| closed.transmissibility(hz)),
            bands: bands
                .iter()
                .map(|band| {
                    let points = grid(band.low_hz, band.high_hz, 150, &peaks);
                    highest_db(&points, |hz| closed.close(hz, rows.clone()))
                })
                .collect(),
            open: upper(&open),
            ideal: upper(&ideal),
            lowest_damping: poles
                .iter()
                .filter(|s| s.norm() < fastest)
                .map(|s| -s.re / s.norm())
                .fold(1.0, f64::min),
        })
    }
}

fn spread<'a>(nominal: f64, values: impl Iterator<Item = f64> + 'a) -> Spread {
    let start = Spread {
        min: nominal,
        nominal,
        max: nominal,
    };
    values.fold(start, |spread, x| Spread {
        min: spread.min.min(x),
        nominal,
        max: spread.max.max(x),
    })
}

fn summary(nominal: &Sample, samples: &[Sample], bands: &[Band]) -> PerturbedSpread {
    let stable: Vec<&Sample> = samples.iter().filter(|s| s.stable).collect();
    let of_stable = |of: &dyn Fn(&Sample) -> f64| spread(of(nominal), stable.iter().map(|s| of(s)));
    let moving = |of: &dyn Fn(&Sample) -> &[(f64, f64)]| {
        (0..of(nominal).len())
            .map(|i| {
                // A pole that became real has no place in the list.
                let at = |part: fn((f64, f64)) -> f64| {
                    let values = samples.iter().filter_map(|s| of(s).get(i).copied());
                    spread(part(of(nominal)[i]), values.map(part))
                };
                MovingPole {
                    hz: at(|(hz, _)| hz),
                    damping: at(|(_, damping)| damping),
                }
            })
            .collect()
    };
    PerturbedSpread {
        samples: samples.len(),
        stable: stable.len(),
        peak_sensitivity: of_stable(&|s| s.peak_sensitivity),
        isolation_from_hz: of_stable(&|s| s.isolation_from_hz),
        bands: bands
            .iter()
            .enumerate()
            .map(|(i, band)| MovingBand {
                name: band.name.clone(),
                sampled_db: of_stable(&|s| s.bands[i]),
            })
            .collect(),
        open: moving(&|s| &s.open),
        ideal: moving(&|s| &s.ideal),
        lowest_damping: spread(
            nominal.lowest_damping,
            samples.iter().map(|s| s.lowest_damping),
        ),
    }
}

/// `host-gen robust`.
#[derive(Debug, Serialize)]
pub struct RobustnessAnalysis {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) payload: Vec<String>,
    pub(crate) mass: f64,
    pub(crate) cog: f64,
    pub(crate) leg_stiffness: f64,
    pub(crate) seed: u64,
    #[serde(flatten)]
    pub(crate) result: PerturbedSpread,
}

impl RobustnessAnalysis {
    /// Of a machine, how it was perturbed, and what was found.
    pub fn new(machine: &Machine, settings: &Robustness, result: PerturbedSpread) -> Self {
        let name = |i: &usize| machine.bodies[*i].name.clone();
        Self {
            machine: machine.name.clone(),
            model_sha256: digest(machine),
            payload: settings.payload.iter().map(name).collect(),
            mass: settings.mass,
            cog: settings.cog,
            leg_stiffness: settings.leg_stiffness,
            seed: settings.seed,
            result,
        }
    }
}
