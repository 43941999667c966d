//! Motion from the floor's vibration and the board's noise, without and with control: rms
//! by source, one-third octaves, the criterion met, and whether the legs can do it.

use serde::Serialize;

use crate::closed_loop::budget::{NoiseBudget, Powers, SOURCES};
use crate::design::Study;
use crate::floor::Criterion;
use crate::machine::Board;
use crate::numeric::exposure::Measure;
use crate::numeric::quadrature::singular_hertz;

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
    /// Criteria whose bands lie in the band and for which the floor is given, the least strict
    /// first.
    pub(crate) judged: Vec<&'static str>,
    /// What the controller asks of the legs.
    pub(crate) legs: Demands,
    /// What the results leave out or where they do not hold, in words.
    pub(crate) warnings: Vec<String>,
    pub(crate) open: FloorSide,
    pub(crate) closed: FloorSide,
}

#[derive(Debug, Serialize)]
pub(crate) struct FloorSide {
    /// What is measured of all performance outputs together: roots of the sums of their squares.
    pub(crate) together: Vec<SourceShares>,
    /// The strictest of the judged criteria that the frame meets; none if it meets none of
    /// them.
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
    /// The unit in which people read it, nm for displacements of outputs and µm for strokes, and the
    /// value in it.
    pub(crate) shown_unit: &'static str,
    pub(crate) shown_rms: f64,
    /// Shares of the power, 0 to 1, in the order of the sources.
    pub(crate) shares: Powers,
}

/// The unit of displacements of outputs, and its part of a metre.
const NANOMETRES: (&str, f64) = ("nm", 1e-9);

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

impl SourceShares {
    /// `shown` is the unit in which people read the rms, and its part of `unit`.
    fn new(
        name: String,
        unit: &'static str,
        (shown_unit, part): (&'static str, f64),
        powers: &Powers,
    ) -> Self {
        let (rms, shares) = shares(powers);
        Self {
            name,
            unit,
            rms,
            shown_unit,
            shown_rms: rms / part,
            shares,
        }
    }
}

fn dominant(powers: &Powers) -> &'static str {
    let largest = (0..SOURCES.len()).max_by(|&a, &b| powers[a].total_cmp(&powers[b]));
    SOURCES[largest.unwrap_or(0)]
}

impl FloorSide {
    fn new(study: &Study, budget: NoiseBudget) -> Self {
        let machine = study.machine();
        let legs = |what: &str| {
            let name = |leg: &usize| format!("{what} {}", machine.beams[*leg].name);
            machine.actuators.iter().map(name).collect::<Vec<_>>()
        };
        let axes = ["x", "y", "z"].map(|axis| format!("frame {axis}")).to_vec();
        let names = machine.performance_names();
        let mut together = Vec::new();
        let (mut motions, mut moving) = (Vec::new(), Vec::new());
        for measure in budget.measures() {
            let (what, unit, shown) = match measure {
                Measure::Acceleration => ("acceleration", "m/s²", ("m/s²", 1.0)),
                Measure::Displacement => ("displacement", "m", NANOMETRES),
                Measure::Average(_) => ("moving average", "m", NANOMETRES),
                Measure::Deviation(_) => ("moving deviation", "m", NANOMETRES),
            };
            let of_output = |spectrum: &Vec<Powers>| budget.measured(spectrum, measure);
            let powers: Vec<_> = budget.performance.iter().map(of_output).collect();
            let sum = |source: usize| powers.iter().map(|powers| powers[source]).sum();
            let all = core::array::from_fn(sum);
            together.push(SourceShares::new(what.to_owned(), unit, shown, &all));
            for (name, powers) in names.iter().zip(&powers) {
                let named = format!("{name}, {what}");
                let (rows, name) = match measure {
                    Measure::Acceleration => (&mut motions, name.clone()),
                    Measure::Displacement => (&mut motions, named),
                    Measure::Average(_) | Measure::Deviation(_) => (&mut moving, named),
                };
                rows.push(SourceShares::new(name, unit, shown, powers));
            }
        }
        let groups = [
            (&budget.frame, axes, "m/s", ("m/s", 1.0)),
            (&budget.force, legs("force"), "N", ("N", 1.0)),
            (&budget.stroke, legs("stroke"), "m", ("µm", 1e-6)),
        ];
        let others = groups
            .into_iter()
            .flat_map(|(spectra, names, unit, shown)| {
                spectra
                    .iter()
                    .zip(names)
                    .map(move |(s, name)| (s, name, unit, shown))
            })
            .map(|(spectrum, name, unit, shown)| {
                SourceShares::new(name, unit, shown, &budget.power(spectrum))
            });
        let rms = motions.into_iter().chain(others).chain(moving).collect();
        let thirds = budget.thirds().into_iter();
        let densities = |spectra: &[Vec<Powers>]| {
            let amplitude = |powers: &Powers| powers.iter().sum::<f64>().sqrt();
            let all = spectra.iter();
            all.map(|spectrum| spectrum.iter().map(amplitude).collect())
                .collect()
        };
        Self {
            together,
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

/// Names in words: the first and the last of several in a row.
fn from_to(names: &[&str]) -> String {
    match names {
        [first, second] => format!("{first} and {second}"),
        [first, .., last] => format!("{first} to {last}"),
        names => names.concat(),
    }
}

/// A frequency, Hz, in words, to three digits by `round`.
fn hertz(hz: f64, round: fn(f64) -> f64) -> String {
    let decimals = 2 - hz.log10().floor() as i32;
    let unit = 10f64.powi(-decimals);
    let text = format!("{:.1$}", round(hz / unit) * unit, decimals.max(0) as usize);
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// The part of the floor that is not given, and the criteria that are not judged for it.
fn unseen(budget: &NoiseBudget) -> Vec<String> {
    let mut words = Vec::new();
    let [[low, high], [from, to]] = [budget.band, budget.seen];
    let seen = format!("{} to {} Hz", hertz(from, f64::ceil), hertz(to, f64::floor));
    if from > low || to < high {
        words.push(format!(
            "the spectrum gives {seen} only; elsewhere the floor counts as still, and all rms values lack its part"
        ));
    }
    let judged = budget.judged();
    let open: Vec<_> = Criterion::VC
        .into_iter()
        .filter(|criterion| !judged.contains(criterion))
        .collect();
    // Those that need the same bands are neighbours.
    for alike in open.chunk_by(|a, b| a.needs() == b.needs()) {
        let names: Vec<_> = alike.iter().map(|criterion| criterion.name()).collect();
        let [low, high] = alike[0].needs();
        let verb = if names.len() > 1 { "are" } else { "is" };
        words.push(format!(
            "{} {verb} not judged: the one-third octaves need {} to {} Hz, known are {seen}",
            from_to(&names),
            // A range as said is wide enough.
            hertz(low, f64::floor),
            hertz(high, f64::ceil)
        ));
    }
    words
}

/// What the controller asks of the legs.
#[derive(Debug, Serialize)]
pub(crate) struct Demands {
    /// Largest rms force of a leg, N.
    pub(crate) rms: f64,
    /// Three times that, which a force exceeds in 0.3 % of the time, N.
    pub(crate) three_sigma: f64,
    /// The largest force of a leg in either direction, by its limit or the DAC's range, N.
    pub(crate) limit: f64,
}

impl Demands {
    fn new(board: &Board, closed: &NoiseBudget) -> Self {
        let rms = closed.force.iter().map(|leg| shares(&closed.power(leg)).0);
        let rms = rms.fold(0.0, f64::max);
        Self {
            rms,
            three_sigma: 3.0 * rms,
            limit: board.force_limit.min(board.dac.reach(board.actuator_gain)),
        }
    }

    /// Warns of legs that cannot do what is asked.
    fn excess(&self, board: &Board) -> Option<String> {
        let of = if self.limit < board.force_limit {
            "the DAC's range"
        } else {
            "their limit"
        };
        (self.three_sigma > self.limit).then(|| {
            format!(
                "three sigma of the legs' forces, {:.0} N, exceed {of}, {:.0} N: the outputs will be clamped, and the values with control, which are linear, will not be reached",
                self.three_sigma, self.limit
            )
        })
    }
}

/// Warns of modes without damping in the band, whose rms has no limit.
fn undamped(study: &Study, [low, high]: [f64; 2]) -> Option<String> {
    let poles = &study.plant().plant.poles;
    let at = singular_hertz(poles.iter().map(|pole| &pole.lambda));
    let first = at
        .iter()
        .find(|at| (low..=high).contains(&at.re) && at.im.abs() < 1e-9 * at.re)?;
    Some(format!(
        "without control, the mode at {} Hz has no damping, so that its rms has no limit: the values without control mean nothing",
        hertz(first.re, f64::round)
    ))
}

impl FloorAnalysis {
    /// Summarises the noise budgets of `study` on the floor called `name`: `open` without
    /// control, `closed` with the loop closed, both in the same band.
    pub fn new(study: &Study, name: String, open: NoiseBudget, closed: NoiseBudget) -> Self {
        let machine = study.machine();
        let board = &machine.board;
        let legs = Demands::new(board, &closed);
        let mut warnings = unseen(&closed);
        warnings.extend(undamped(study, closed.band));
        warnings.extend(legs.excess(board));
        let [low_hz, high_hz] = closed.band;
        Self {
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            feedback: study.design_model().feedback.name(),
            floor: name,
            low_hz,
            high_hz,
            sources: SOURCES,
            judged: closed.judged().into_iter().map(Criterion::name).collect(),
            legs,
            warnings,
            open: FloorSide::new(study, open),
            closed: FloorSide::new(study, closed),
        }
    }

    /// The criterion that a side meets, in words.
    pub(crate) fn meets(&self, side: &FloorSide) -> String {
        match side.criterion {
            Some(criterion) => criterion.to_owned(),
            None => format!("none of {}", from_to(&self.judged)),
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
