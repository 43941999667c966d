//! What no controller can pass, beside what the design reaches.

use serde::Serialize;

use crate::closed_loop::budget::budget;
use crate::closed_loop::{LoopGrid, SLOWEST, SampledLoop};
use crate::design::bound::{Asked, Bounds, ByControllers, MeanSquareBound, ModeBound};
use crate::design::{Band, Design, Study};
use crate::machine::{Minimise, RollOff};
use crate::numeric::NumericError;
use crate::numeric::frequencies::pole_peaks;

/// Result of `host-gen bound`: certified bounds for a machine and its board.
#[derive(Debug, Serialize)]
pub struct BoundAnalysis {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) feedback: &'static str,
    pub(crate) both: bool,
    pub(crate) delay_samples: usize,
    pub(crate) sample_rate: f64,
    pub(crate) max_sensitivity: f64,
    /// From where to where the machine as a whole must be isolated, Hz.
    pub(crate) isolated_hz: [f64; 2],
    /// That of the file, else that of the design.
    pub(crate) roll_off: Option<RollOff>,
    /// Whether the file asks for the roll-off.
    pub(crate) asked: bool,
    #[serde(flatten)]
    pub(crate) bounds: BoundsOf,
    /// Beside a design that minimises an rms.
    pub(crate) rms: Option<RmsBound>,
}

/// The rms that a design minimises, of all performance outputs together, beside its lower bounds.
#[derive(Debug, Serialize)]
pub struct RmsBound {
    /// What is minimised, as `control.minimise` says.
    pub minimise: Minimise,
    /// That of the design, m/s²; of displacements, m. With what forces and strokes cost.
    pub reached: f64,
    /// None where no bound was found.
    pub found: ByControllers<Option<MeanSquareBound>>,
}

impl RmsBound {
    fn new(
        study: &Study,
        bounds: &Bounds<'_>,
        design: &Design,
    ) -> Result<Option<Self>, NumericError> {
        let machine = study.machine();
        let (Some(measure), Some(found)) = (machine.measure(), bounds.mean_square()?) else {
            return Ok(None);
        };
        let budget = budget(
            study.plant(),
            &machine.board,
            Some(&design.table),
            &machine.floor_motion(),
            machine.simulation.floor_band,
            machine.exposure,
        )?;
        let outputs = budget.performance.iter();
        let penalty = machine.target.penalty.unwrap_or_default();
        let costs = [
            (&budget.force, penalty.force),
            (&budget.stroke, penalty.stroke),
        ];
        let costs = costs.into_iter().flat_map(|(legs, cost)| {
            let own = legs.iter().flat_map(|leg| budget.power(leg));
            own.map(move |power| cost * cost * power)
        });
        let powers = outputs
            .flat_map(|of| budget.measured(of, measure))
            .chain(costs);
        Ok(Some(Self {
            minimise: machine.target.minimise,
            reached: powers.sum::<f64>().sqrt(),
            found,
        }))
    }

    /// By how much the design is above its bounds, dB; none where none was found.
    pub fn above_db(&self) -> ByControllers<Option<f64>> {
        let above = |found: &Option<MeanSquareBound>| {
            let bound = found.as_ref()?;
            Some(20.0 * (self.reached / bound.rms).log10())
        };
        ByControllers {
            modal: above(&self.found.modal),
            any: above(&self.found.any),
        }
    }
}

/// What is bounded.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum BoundsOf {
    /// The bands of a design.
    Design {
        reached: Vec<Band>,
        /// For each band by itself: bounds of the highest σ_max(G11), dB.
        bands: Vec<Vec<ModeBound>>,
        /// For all bands at once, as a part of what is reached, dB.
        together: Vec<ModeBound>,
    },
    /// Without a design: by how much all requirements must be widened before a controller can meet
    /// them, dB.
    Requirements(Vec<ModeBound>),
}

/// The order of the roll-off that is compared with where the file asks for none.
const ORDER: f64 = 2.0;

impl BoundAnalysis {
    /// The bounds for `study`, beside what `design` reaches if there is one.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn new(study: &Study, design: Option<&Design>) -> Result<Self, NumericError> {
        let machine = study.machine();
        let asked = machine.target.roll_off;
        let roll_off = match (asked, design) {
            (None, Some(design)) => Some(own_roll_off(study, design)?),
            _ => asked,
        };
        let bounds = Bounds::new(study, roll_off)?;
        let alone = |design: &Design| {
            let count = design.bands.len();
            let of = (0..count).map(|band| {
                let levels: Vec<_> = (0..count).map(|k| (k == band).then_some(0.0)).collect();
                bounds.of(Asked::Bands(&levels))
            });
            of.collect()
        };
        let rms = match design {
            Some(design) => RmsBound::new(study, &bounds, design)?,
            None => None,
        };
        Ok(Self {
            rms,
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            feedback: study.design_model().feedback.name(),
            both: study.design_model().beside.is_some(),
            delay_samples: study.plant().seen_delay(),
            sample_rate: machine.board.sample_rate,
            max_sensitivity: machine.target.max_sensitivity,
            isolated_hz: bounds.isolated(),
            roll_off,
            asked: asked.is_some(),
            bounds: match design {
                Some(design) => BoundsOf::Design {
                    bands: alone(design),
                    together: together(&bounds, design),
                    reached: design.bands.clone(),
                },
                None => BoundsOf::Requirements(bounds.of(Asked::Requirements)),
            },
        })
    }
}

/// Bounds for all bands at once, as a part of what `design` reaches.
fn together(bounds: &Bounds<'_>, design: &Design) -> Vec<ModeBound> {
    let levels = design.bands.iter().map(|band| Some(band.sampled_db));
    bounds.of(Asked::Bands(&levels.collect::<Vec<_>>()))
}

/// The lowest roll-off of second order that the loop of `design` keeps.
fn own_roll_off(study: &Study, design: &Design) -> Result<RollOff, NumericError> {
    let sampled = SampledLoop::new(study.plant(), &design.table);
    let sharp = pole_peaks(&sampled.poles()?);
    let low = SLOWEST * study.machine().target.frequency;
    let model = study.design_model();
    let grid = LoopGrid::new(study.plant(), &model.modal, low, &sharp);
    // Upward to a round number.
    let hz = 10.0 * (grid.lowest_roll_off(&sampled.law, ORDER) / 10.0).ceil();
    Ok(RollOff { hz, order: ORDER })
}

/// By how much all bands of a design can be lowered at most, dB; none where no certificate says so.
pub type Room = ByControllers<Option<f64>>;

/// The room that `design` leaves, if its study has a limit at high frequency: without one, a
/// machine that is known exactly can be isolated far better than a real one. And by how much the rms
/// that it minimises can be lower at most; none if it minimises peaks.
///
/// # Errors
/// [`NumericError`] if an eigenvalue iteration does not converge.
pub(super) fn room(study: &Study, design: &Design) -> Result<[Option<Room>; 2], NumericError> {
    let Some(roll_off) = study.machine().target.roll_off else {
        return Ok([None, None]);
    };
    let bounds = Bounds::new(study, Some(roll_off))?;
    let rms = RmsBound::new(study, &bounds, design)?;
    let modes = together(&bounds, design);
    Ok([Some(least(&modes)), rms.map(|rms| rms.above_db())])
}

/// The least room of all modes, dB.
pub(crate) fn least(modes: &[ModeBound]) -> Room {
    ByControllers::most(modes).map(|db| db.map(|db| -db))
}
