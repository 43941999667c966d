//! The controller on randomly perturbed machines.

use rayon::prelude::*;
use serde::Serialize;
use shared::table::ValidTable;

use crate::closed_loop::bands::highest_db;
use crate::closed_loop::isolation::{corner, isolation_band};
use crate::closed_loop::{SLOWEST, SampledLoop, ideal_poles, stable};
use crate::control::LinearLaw;
use crate::design::{Band, Study, StudyError};
use crate::machine::{Machine, Robustness};
use crate::numeric::frequencies::pole_peaks;
use crate::progress::Progress;

/// Range of a value over the perturbed machines; the nominal value is within it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Smallest value.
    pub min: f64,
    /// Value for the machine in the file.
    pub nominal: f64,
    /// Largest value.
    pub max: f64,
}

/// Range of a pole over the perturbed machines.
#[derive(Clone, Debug, Serialize)]
pub struct MovingPole {
    /// Natural frequency, Hz.
    pub hz: Spread,
    /// Relative damping.
    pub damping: Spread,
}

/// Range of a band's peak over the perturbed machines.
#[derive(Clone, Debug, Serialize)]
pub struct MovingBand {
    /// Name of the band.
    pub name: String,
    /// Highest σ_max(G11) of the sampled loop, dB.
    pub sampled_db: Spread,
}

/// Result of a Monte Carlo run: one controller on many randomly perturbed machines.
#[derive(Clone, Debug, Serialize)]
pub struct PerturbedSpread {
    /// Number of perturbed machines.
    pub samples: usize,
    /// Number of machines on which the sampled loop is stable.
    pub stable: usize,
    /// Peak sensitivity of the sampled loop, over the stable loops.
    pub peak_sensitivity: Spread,
    /// Frequency above which the machine is isolated from the floor (transmissibility
    /// below 1/√2), Hz, over the stable loops.
    pub isolation_from_hz: Spread,
    /// Highest σ_max(G11) in each band, over the stable loops.
    pub bands: Vec<MovingBand>,
    /// Poles without control, one of each conjugate pair.
    pub open: Vec<MovingPole>,
    /// Poles with the ideal law, one of each conjugate pair.
    pub ideal: Vec<MovingPole>,
    /// Lowest relative damping of the sampled loop's poles, except poles faster than half
    /// the sample rate.
    pub lowest_damping: Spread,
}

/// One perturbed machine with the controller of the nominal one.
struct Sample {
    stable: bool,
    peak_sensitivity: f64,
    isolation_from_hz: f64,
    bands: Vec<f64>,
    open: Vec<(f64, f64)>,
    ideal: Vec<(f64, f64)>,
    lowest_damping: f64,
}

/// Evaluates `table`, the controller of `study`, on randomly perturbed machines as
/// `settings` describes them, on all cores. `bands` are the bands whose peaks are
/// reported. `progress` is called after each machine.
///
/// # Errors
/// [`StudyError`] if a perturbed machine gives no valid model or an eigenvalue iteration
/// does not converge.
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
        // The machine is the perturbed one, the controller that of `study`.
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
            // In the modal coordinates of the controller.
            peak_sensitivity: closed
                .peak_sensitivity(&study.design_model().modal, SLOWEST * frequency, &poles)
                .value,
            isolation_from_hz: corner(low, high, &peaks, |hz| closed.transmissibility(hz)),
            bands: bands
                .iter()
                .map(|band| {
                    highest_db([band.low_hz, band.high_hz], 150, &peaks, |hz| {
                        closed.close(hz, rows.clone())
                    })
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
                // Lists may differ in length: a pair of poles may become real.
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

/// Result of `host-gen robust`: how the machine was perturbed, and the ranges found.
#[derive(Debug, Serialize)]
pub struct RobustnessAnalysis {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) payload: Vec<String>,
    pub(crate) mass: f64,
    pub(crate) cog: f64,
    pub(crate) leg_stiffness: f64,
    pub(crate) damping: f64,
    pub(crate) sensor_gain: f64,
    pub(crate) misalignment: f64,
    pub(crate) actuator_gain: f64,
    pub(crate) delay: f64,
    pub(crate) seed: u64,
    #[serde(flatten)]
    pub(crate) result: PerturbedSpread,
}

impl RobustnessAnalysis {
    /// The `result` of a run on `machine` with `settings`.
    pub fn new(machine: &Machine, settings: &Robustness, result: PerturbedSpread) -> Self {
        let name = |i: &usize| machine.bodies[*i].name.clone();
        Self {
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            payload: settings.payload.iter().map(name).collect(),
            mass: settings.mass,
            cog: settings.cog,
            leg_stiffness: settings.leg_stiffness,
            damping: settings.damping,
            sensor_gain: settings.sensor_gain,
            misalignment: settings.misalignment.to_degrees(),
            actuator_gain: settings.actuator_gain,
            delay: settings.delay,
            seed: settings.seed,
            result,
        }
    }
}
