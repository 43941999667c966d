//! How far loads on the machine displace it, over frequency.

use rayon::prelude::*;
use serde::Serialize;

use crate::closed_loop::{SLOWEST, SampledLoop};
use crate::control::LinearLaw;
use crate::design::{Design, Study, StudyError};
use crate::machine::Machine;
use crate::numeric::NumericError;
use crate::numeric::frequencies::{grid, pole_peaks};
use crate::plant::{Gain, SampledPlant};

/// Highest frequency, Hz, of what is shown: that of the charts of σ_max.
const TOP: f64 = 300.0;

/// A displacement that is at most frequencies below this part of the largest to the same load there is
/// given as zero: symmetry makes it so, but for rounding.
const ROUNDING: f64 = 1e-10;

/// The displacements for every load of a machine over frequency.
#[derive(Clone, Debug, Serialize)]
pub struct Compliance {
    /// Frequencies, Hz.
    pub(crate) hz: Vec<f64>,
    pub(crate) loads: Vec<LoadCompliance>,
}

/// The displacements for one load.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct LoadCompliance {
    pub(crate) name: String,
    /// `"N"` or `"N m"`.
    pub(crate) unit: &'static str,
    /// The performance outputs, then the nodes of all loads.
    pub(crate) outputs: Vec<OutputCompliance>,
    /// Index of the load's own node in `outputs`.
    #[serde(skip)]
    own: usize,
}

impl LoadCompliance {
    /// The displacement of the load's own node along or about it.
    pub(crate) fn own(&self) -> &OutputCompliance {
        &self.outputs[self.own]
    }
}

/// One displacement for one load.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct OutputCompliance {
    /// Name of the performance output, or of the load whose node moves.
    pub(crate) name: String,
    /// `"m"` or `"rad"`.
    pub(crate) unit: &'static str,
    /// Without control at rest, signed, unit over unit of the load. With control it is the same,
    /// because the loop does not act on constant accelerations.
    pub(crate) fixed: f64,
    /// Magnitudes at every frequency, without control, and with it if there is a design.
    pub(crate) open: Vec<f64>,
    pub(crate) closed: Option<Vec<f64>>,
    /// The highest of these.
    pub(crate) open_highest: Highest,
    pub(crate) closed_highest: Option<Highest>,
}

/// The highest magnitude over frequency.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Highest {
    pub(crate) magnitude: f64,
    pub(crate) hz: f64,
}

impl Highest {
    fn new(hz: &[f64], magnitudes: &[f64]) -> Self {
        let all = hz.iter().zip(magnitudes);
        let top = all.max_by(|a, b| a.1.total_cmp(b.1));
        let (hz, magnitude) = top.expect("a grid has both its ends");
        Self {
            magnitude: *magnitude,
            hz: *hz,
        }
    }
}

impl Compliance {
    /// The compliance of `study`'s machine to its loads, without control and, if there is one, with
    /// `design`; none if the machine has no loads.
    ///
    /// # Errors
    /// [`StudyError`] if the machine gives no valid model with its loads or an eigenvalue iteration
    /// does not converge.
    pub fn of(study: &Study, design: Option<&Design>) -> Result<Option<Self>, StudyError> {
        if study.machine().loads.is_empty() {
            return Ok(None);
        }
        let plant = study.loaded_plant()?;
        Ok(Some(Self::new(study, &plant, design)?))
    }

    /// As [`Compliance::of`] on `plant`, the [`Study::loaded_plant`] of a machine with loads.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn new(
        study: &Study,
        plant: &SampledPlant,
        design: Option<&Design>,
    ) -> Result<Self, NumericError> {
        let machine = study.machine();
        let closed = design.map(|design| SampledLoop {
            plant,
            law: LinearLaw::new(&design.table),
        });
        let rows = plant.plant.performance();
        let mut peaks = plant.peaks();
        if let Some(closed) = &closed {
            peaks.extend(pole_peaks(&closed.poles()?));
        }
        let low = SLOWEST * machine.target.frequency;
        let top = TOP.min(0.4 * machine.board.sample_rate);
        let hz = grid(low, top, 400, &peaks);
        let at_all = |gain: &(dyn Fn(f64) -> Gain + Sync)| -> Vec<Gain> {
            hz.par_iter().map(|&hz| gain(hz)).collect()
        };
        let open = at_all(&|hz| plant.plant.open(hz, rows.clone()));
        let closed = closed.map(|closed| at_all(&|hz| closed.close(hz, rows.clone())));
        let at_rest = plant.plant.at_rest(rows);
        let names = displacements(machine);
        let loads = machine.loads.iter().enumerate().map(|(j, load)| {
            let magnitudes = |gains: &[Gain], i: usize| -> Vec<f64> {
                gains.iter().map(|gain| gain[(i, j)].norm()).collect()
            };
            // Frequency by frequency, and not at all of them: a resonance without damping is no measure
            // of the rest, and enlarges what rounding leaves.
            let largest = |gain: &Gain| {
                let all = gain.column(j).iter().map(|x| x.norm()).fold(0.0, f64::max);
                ROUNDING * all
            };
            let outputs = names.iter().enumerate().map(|(i, (name, unit))| {
                let of = |gains: &Vec<Gain>| {
                    let mut all = magnitudes(gains, i);
                    let least = gains.iter().map(largest);
                    let rounded = all.iter().zip(least).filter(|(x, least)| *x < least);
                    if 2 * rounded.count() > all.len() {
                        all.fill(0.0);
                    }
                    all
                };
                let (open, closed) = (of(&open), closed.as_ref().map(of));
                let fixed = at_rest[(i, j)];
                OutputCompliance {
                    name: name.clone(),
                    unit,
                    fixed: if fixed.abs() < ROUNDING * at_rest.column(j).amax() {
                        0.0
                    } else {
                        fixed
                    },
                    open_highest: Highest::new(&hz, &open),
                    closed_highest: closed.as_ref().map(|closed| Highest::new(&hz, closed)),
                    open,
                    closed,
                }
            });
            LoadCompliance {
                name: load.at.name.clone(),
                unit: load.unit(),
                outputs: outputs.collect(),
                own: names.len() - machine.loads.len() + j,
            }
        });
        let loads = loads.collect();
        Ok(Self { hz, loads })
    }

    /// Empties the lists over frequency.
    pub(crate) fn without_spectra(mut self) -> Self {
        self.hz.clear();
        for output in self.loads.iter_mut().flat_map(|load| &mut load.outputs) {
            output.open.clear();
            output.closed = None;
        }
        self
    }
}

/// Names and units of the displacements of a loaded plant: of the performance outputs, then of the
/// nodes of the loads.
pub(crate) fn displacements(machine: &Machine) -> Vec<(String, &'static str)> {
    let performance = machine.performance_names().into_iter();
    let own = machine.loads.iter().map(|load| {
        let unit = if load.moment { "rad" } else { "m" };
        (format!("at {}", load.at.name), unit)
    });
    performance.map(|name| (name, "m")).chain(own).collect()
}
