//! The largest singular value of G11 over frequency: the paper's Fig. 5.

use rayon::prelude::*;
use serde::Serialize;

use crate::closed_loop::{SampledLoop, close_ideal, ideal_poles, stable};
use crate::design::DesignedStudy;
use crate::machine::{FeedbackKind, Machine};
use crate::numeric::NumericError;
use crate::numeric::frequencies::{grid, pole_peaks};
use crate::numeric::singular::largest_singular_value;

/// Result of `host-gen sigma`: the largest singular value of G11 over frequency for
/// several loops.
#[derive(Debug, Serialize)]
pub struct SigmaAnalysis {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) hz: Vec<f64>,
    pub(crate) curves: Vec<SigmaCurve>,
    /// Loops without a curve, each with the reason.
    pub(crate) missing: Vec<String>,
}

#[derive(Debug, Serialize)]
pub(crate) struct SigmaCurve {
    pub(crate) name: String,
    /// The largest singular value of G11 at every `hz`.
    pub(crate) sigma_max: Vec<f64>,
    /// Kind of feedback and law; none without control.
    #[serde(skip)]
    pub(crate) of: Option<(FeedbackKind, LawKind)>,
}

/// The ideal law of the paper, or the sampled law of the board.
#[derive(Clone, Copy, Debug)]
pub(crate) enum LawKind {
    Ideal,
    Sampled,
}

/// Frequencies at which singular values are evaluated.
#[derive(Clone, Debug)]
pub enum Frequencies {
    /// `count` frequencies from `low` to `high`, evenly spaced in the logarithm, and more
    /// around every lightly damped pole of all loops, so that no peak lies between two
    /// frequencies.
    Adaptive {
        /// Lowest frequency, Hz.
        low: f64,
        /// Highest frequency, Hz.
        high: f64,
        /// Number of evenly spaced frequencies, at least 2.
        count: usize,
    },
    /// Only these frequencies, Hz.
    At(Vec<f64>),
}

impl Frequencies {
    /// The usual band, Hz.
    pub const BAND: [f64; 2] = [0.1, 300.0];
    /// The usual number of evenly spaced frequencies.
    pub const COUNT: usize = 500;
    /// What `host-gen sigma` has without options.
    pub const USUAL: Self = Self::Adaptive {
        low: Self::BAND[0],
        high: Self::BAND[1],
        count: Self::COUNT,
    };
}

impl SigmaAnalysis {
    /// σ_max(G11) of `machine` at `frequencies`: without control, and for each of
    /// `studies` with the ideal and with the sampled law.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn new(
        machine: &Machine,
        studies: &[DesignedStudy],
        frequencies: Frequencies,
    ) -> Result<Self, NumericError> {
        let mut missing = Vec::new();
        let mut peaks = Vec::new();
        let mut loops = Vec::new();
        for DesignedStudy { study, design } in studies {
            let plant = &study.plant().plant;
            peaks.extend(plant.peaks());
            let ideal = ideal_poles(&plant.state_space, study.gains())?;
            peaks.extend(pole_peaks(&ideal));
            let name = study.design_model().feedback.name();
            // With both kinds of feedback, the ideal law is that of acceleration
            // feedback.
            let own = study.design_model().feedback != FeedbackKind::Both;
            let ideal_holds = own && stable(&ideal);
            if own && !ideal_holds {
                missing.push(format!("{name}, ideal: that loop is unstable"));
            }
            let sampled = match design {
                Ok(design) => {
                    let closed = SampledLoop::new(study.plant(), &design.table);
                    peaks.extend(pole_peaks(&closed.poles()?));
                    Some(closed)
                }
                Err(reason) => {
                    missing.push(format!("{name}, sampled: {reason}"));
                    None
                }
            };
            loops.push((study, ideal_holds, sampled));
        }
        let hz = match frequencies {
            Frequencies::Adaptive { low, high, count } => grid(low, high, count, &peaks),
            Frequencies::At(hz) => hz,
        };
        let curve =
            |of: Option<(FeedbackKind, LawKind)>, sigma: &(dyn Fn(f64) -> f64 + Sync)| SigmaCurve {
                name: match of {
                    None => "open".to_owned(),
                    Some((kind, LawKind::Ideal)) => format!("{}, ideal", kind.name()),
                    Some((kind, LawKind::Sampled)) => format!("{}, sampled", kind.name()),
                },
                of,
                sigma_max: hz.par_iter().map(|&hz| sigma(hz)).collect(),
            };
        let mut curves = Vec::new();
        for (i, (study, ideal_holds, sampled)) in loops.iter().enumerate() {
            let plant = &study.plant().plant;
            let rows = plant.performance();
            if i == 0 {
                curves.push(curve(None, &|hz| {
                    largest_singular_value(&plant.open(hz, rows.clone()))
                }));
            }
            let kind = study.design_model().feedback;
            if *ideal_holds {
                curves.push(curve(Some((kind, LawKind::Ideal)), &|hz| {
                    largest_singular_value(&close_ideal(plant, study.gains(), hz, rows.clone()))
                }));
            }
            if let Some(closed) = sampled {
                curves.push(curve(Some((kind, LawKind::Sampled)), &|hz| {
                    largest_singular_value(&closed.close(hz, rows.clone()))
                }));
            }
        }
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            hz,
            curves,
            missing,
        })
    }
}
