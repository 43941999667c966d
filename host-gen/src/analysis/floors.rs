//! Motion from the floor's vibration and the board's noise, without and with control: rms
//! by source, one-third octaves, the criterion met.

use serde::Serialize;

use super::criterion::Criterion;
use super::digest;
use super::vibration::{NoiseBudget, Powers, SOURCES};
use crate::design::Study;

/// Result of `host-gen floor`: the motion caused by the floor and the board's noise,
/// without and with control.
#[derive(Debug, Serialize)]
pub struct FloorAnalysis {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) feedback: &'static str,
    pub(crate) floor: String,
    pub(crate) low_hz: f64,
    pub(crate) high_hz: f64,
    pub(crate) sources: [&'static str; SOURCES.len()],
    pub(crate) open: FloorSide,
    pub(crate) closed: FloorSide,
}

#[derive(Debug, Serialize)]
pub(crate) struct FloorSide {
    /// The strictest criterion that the frame meets; none if it meets none of VC-A to
    /// VC-G.
    pub(crate) criterion: Option<&'static str>,
    pub(crate) rms: Vec<SourceShares>,
    pub(crate) thirds: Vec<ThirdOctave>,
    pub(crate) hz: Vec<f64>,
    /// Amplitude densities of the performance outputs, all sources together, (m/s²)/√Hz.
    pub(crate) performance: Vec<Vec<f64>>,
    /// Amplitude densities of the frame's velocity along x, y, z, all sources together,
    /// (m/s)/√Hz.
    pub(crate) frame_velocity: Vec<Vec<f64>>,
}

#[derive(Debug, Serialize)]
pub(crate) struct SourceShares {
    pub(crate) name: String,
    pub(crate) unit: &'static str,
    pub(crate) rms: f64,
    /// Shares of the power, 0 to 1, in the order of the sources.
    pub(crate) shares: Powers,
}

#[derive(Debug, Serialize)]
pub(crate) struct ThirdOctave {
    pub(crate) hz: f64,
    /// Rms velocity, the largest of x, y and z, m/s.
    pub(crate) velocity: f64,
    pub(crate) dominant: &'static str,
}

fn shares(powers: &Powers) -> (f64, Powers) {
    let total: f64 = powers.iter().sum();
    let share = |power: f64| if total > 0.0 { power / total } else { 0.0 };
    (total.sqrt(), powers.map(share))
}

fn dominant(powers: &Powers) -> &'static str {
    let largest = (0..SOURCES.len()).max_by(|&a, &b| powers[a].total_cmp(&powers[b]));
    SOURCES[largest.unwrap_or(0)]
}

impl FloorSide {
    fn new(study: &Study, budget: NoiseBudget, [low, high]: [f64; 2]) -> Self {
        let machine = study.machine();
        let legs = |what: &str| {
            let name = |leg: &usize| format!("{what} {}", machine.beams[*leg].name);
            machine.actuators.iter().map(name).collect::<Vec<_>>()
        };
        let axes = ["x", "y", "z"].map(|axis| format!("frame {axis}")).to_vec();
        let groups = [
            (&budget.performance, machine.performance_names(), "m/s²"),
            (&budget.frame, axes, "m/s"),
            (&budget.force, legs("force"), "N"),
            (&budget.stroke, legs("stroke"), "m"),
        ];
        let rms = groups
            .into_iter()
            .flat_map(|(spectra, names, unit)| {
                spectra
                    .iter()
                    .zip(names)
                    .map(move |(s, name)| (s, name, unit))
            })
            .map(|(spectrum, name, unit)| {
                let (rms, shares) = shares(&budget.power(spectrum, low, high));
                SourceShares {
                    name,
                    unit,
                    rms,
                    shares,
                }
            })
            .collect();
        let thirds = budget.thirds().into_iter();
        let densities = |spectra: &[Vec<Powers>]| {
            let amplitude = |powers: &Powers| powers.iter().sum::<f64>().sqrt();
            let all = spectra.iter();
            all.map(|spectrum| spectrum.iter().map(amplitude).collect())
                .collect()
        };
        Self {
            criterion: budget.criterion().map(Criterion::name),
            rms,
            thirds: thirds
                .map(|(hz, velocity, powers)| ThirdOctave {
                    hz,
                    velocity,
                    dominant: dominant(&powers),
                })
                .collect(),
            performance: densities(&budget.performance),
            frame_velocity: densities(&budget.frame),
            hz: budget.hz,
        }
    }
}

impl FloorAnalysis {
    /// Summarises the noise budgets of `study` on the floor called `name`: `open` without
    /// control, `closed` with the loop closed. `band`: lower and upper end of the rms
    /// values, Hz.
    pub fn new(
        study: &Study,
        name: String,
        band: [f64; 2],
        open: NoiseBudget,
        closed: NoiseBudget,
    ) -> Self {
        Self {
            machine: study.machine().name.clone(),
            model_sha256: digest(study.machine()),
            feedback: study.design_model().feedback.name(),
            floor: name,
            low_hz: band[0],
            high_hz: band[1],
            sources: SOURCES,
            open: FloorSide::new(study, open, band),
            closed: FloorSide::new(study, closed, band),
        }
    }
}

impl FloorAnalysis {
    /// Empties the lists over frequency.
    pub(crate) fn without_spectra(mut self) -> Self {
        for side in [&mut self.open, &mut self.closed] {
            side.hz.clear();
            side.performance.clear();
            side.frame_velocity.clear();
        }
        self
    }
}
