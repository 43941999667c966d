//! What limits the complementary sensitivity of a mode that no other mode couples to.

use core::f64::consts::FRAC_1_SQRT_2;

use nalgebra::{Complex, DMatrix, DVector, Matrix6};
use shared::LEGS;

use crate::closed_loop::isolation::isolation_band;
use crate::control::gains::ModalTransform;
use crate::design::Study;
use crate::design::reach::CORNER_SLACK;
use crate::design::sources::Sources;
use crate::machine::RollOff;
use crate::numeric::discs::Disc;
use crate::numeric::six::ComplexMatrix6;
use crate::plant::Gain;

/// |t − centre| ≤ kept + γ·scaled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Limit {
    pub(super) centre: Complex<f64>,
    pub(super) kept: f64,
    pub(super) scaled: f64,
}

impl Limit {
    pub(super) fn at(&self, factor: f64) -> Disc {
        Disc {
            centre: self.centre,
            radius: self.kept + factor * self.scaled,
        }
    }
}

/// What is multiplied by the factor γ.
#[derive(Clone, Copy, Debug)]
pub(super) enum Question<'a> {
    /// All limits that a controller must keep.
    Requirements,
    /// These levels of σ_max(G11) in the bands; none in a band that does not count.
    Bands(&'a [Option<f64>]),
}

/// Which controllers a bound holds for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Controllers {
    /// Those that feed back each mode by itself, as the modal law does.
    Modal,
    /// All: they may also move other modes when one moves.
    Any,
}

/// A motion that the loop changes: |direct − through·t| exceeds that of the outputs by at most
/// `rest` times the size of the other entries of T in the same row.
#[derive(Clone, Copy, Debug)]
struct Motion {
    direct: Complex<f64>,
    through: Complex<f64>,
    rest: f64,
}

/// What t of one mode changes at one frequency, with either kind of controllers.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    hz: f64,
    /// From the force along the mode to its sensors, in modal coordinates.
    pub(super) own: Complex<f64>,
    /// With [`Controllers::Modal`] and [`Controllers::Any`].
    whole: [Option<Motion>; 2],
    performance: [Option<Motion>; 2],
}

/// The limits of the modes of a study.
pub(super) struct Limits<'a> {
    study: &'a Study,
    transform: ModalTransform,
    roll_off: Option<RollOff>,
}

type Column = DVector<Complex<f64>>;

/// The plant in modal coordinates at one frequency.
struct Modal {
    /// P, from forces along the modes to their sensors.
    own: ComplexMatrix6,
    /// From floor motions along the modes to the sensors.
    sensed: ComplexMatrix6,
    /// P⁻¹·sensed.
    forces: ComplexMatrix6,
}

/// Outputs from forces along the modes and from floor motions along them.
struct Outputs {
    legs: [Column; LEGS],
    floor: [Column; LEGS],
}

impl Outputs {
    fn new(legs: &Gain, floor: &Gain) -> Self {
        let columns = |matrix: &Gain| {
            core::array::from_fn(|k| {
                DVector::from_iterator(matrix.nrows(), matrix.column(k).iter().copied())
            })
        };
        Self {
            legs: columns(legs),
            floor: columns(floor),
        }
    }

    /// The motion of one combination of the outputs, of size 1, with a modal controller: the
    /// combination that mode `k` moves most. A floor motion along the mode has the size `unit`.
    ///
    /// None if the mode couples to another one: then the controller of that one also acts on it.
    fn modal(&self, k: usize, plant: &Modal, unit: f64) -> Option<Motion> {
        let coupled = others(k).any(|j| {
            let between = plant.own[(j, k)].norm().max(plant.own[(k, j)].norm());
            let within = (plant.own[(j, j)].norm() * plant.own[(k, k)].norm()).sqrt();
            between > ALONE * within
                || plant.sensed[(j, k)].norm() > ALONE * plant.sensed[(k, k)].norm()
        });
        let combination = &self.legs[k];
        let size = combination.norm() * unit;
        let force = plant.sensed[(k, k)] / plant.own[(k, k)];
        (!coupled).then(|| Motion {
            direct: combination.dotc(&self.floor[k]) / size,
            through: combination.dotc(&self.legs[k]) * force / size,
            rest: 0.0,
        })
    }

    /// The same with any controller: the combination that no other mode moves.
    ///
    /// The forces are T·P⁻¹ times what the sensors measure of the floor.
    fn any(&self, k: usize, plant: &Modal, unit: f64) -> Option<Motion> {
        let mut combination = self.legs[k].clone();
        let others_of: Vec<_> = others(k).map(|j| self.legs[j].clone()).collect();
        let svd = DMatrix::from_columns(&others_of).svd(true, false);
        let highest = svd.singular_values.max();
        let directions = svd.u.expect("it was asked for");
        for (direction, size) in directions.column_iter().zip(&svd.singular_values) {
            if *size > NOTHING * highest {
                let part = direction.dotc(&combination);
                combination -= direction * part;
            }
        }
        let size = combination.norm() * unit;
        let own = combination.dotc(&self.legs[k]) / size;
        let beside = others(k).map(|j| plant.forces[(j, k)].norm_sqr());
        Some(Motion {
            direct: combination.dotc(&self.floor[k]) / size,
            through: own * plant.forces[(k, k)],
            rest: own.norm() * beside.sum::<f64>().sqrt(),
        })
    }
}

/// The other modes.
fn others(k: usize) -> impl Iterator<Item = usize> {
    (0..LEGS).filter(move |j| *j != k)
}

/// Coupling below which a mode counts as one by itself: what other modes do with it is far below
/// every level.
const ALONE: f64 = 1e-8;

/// Size below which a singular value is rounding, as a part of the largest.
const NOTHING: f64 = 1e-12;

impl<'a> Limits<'a> {
    pub(super) fn new(study: &'a Study, roll_off: Option<RollOff>) -> Self {
        Self {
            transform: ModalTransform::new(study.design_model()),
            study,
            roll_off,
        }
    }

    /// Where the roll-off begins, Hz.
    pub(super) fn roll_off_hz(&self) -> Option<f64> {
        self.roll_off.map(|limit| limit.hz)
    }

    /// The largest σ_max(T) at `hz`, Hz; infinite for no limit.
    pub(super) fn roll_off(&self, hz: f64) -> f64 {
        self.roll_off.map_or(f64::INFINITY, |limit| limit.limit(hz))
    }

    /// From where to where the machine as a whole must be isolated, Hz.
    pub(super) fn isolated(&self) -> [f64; 2] {
        let target = &self.study.machine().target;
        let [_, high] = isolation_band(self.study.design_model(), target.frequency);
        [CORNER_SLACK * target.isolation_hz(), high]
    }

    /// Frequencies at which a limit begins or ends, Hz, not in order.
    pub(super) fn edges(&self) -> Vec<f64> {
        let bands = self.study.machine().bands.iter();
        let bands = bands.flat_map(|(_, low, high)| [*low, *high]);
        bands
            .chain(self.isolated())
            .chain(self.roll_off_hz())
            .collect()
    }

    /// P at `hz`, Hz: from forces along the modes to their sensors, in modal coordinates.
    fn own(&self, hz: f64) -> ComplexMatrix6 {
        let [input, output] = [self.transform.input, self.transform.output];
        let response = self.study.plant().response(hz);
        let sensed = response.from_legs(self.study.plant().plant.sensors());
        input.map(Complex::from) * sensed.fixed_rows::<LEGS>(0) * output.map(Complex::from)
    }

    /// The modes in blocks that do not couple to each other at any of the frequencies `hz`, Hz.
    pub(super) fn coupled(&self, hz: impl Iterator<Item = f64>) -> Vec<Vec<usize>> {
        let mut block: [usize; LEGS] = core::array::from_fn(|k| k);
        for own in hz.map(|hz| self.own(hz)) {
            for (i, j) in (0..LEGS).flat_map(|i| (0..i).map(move |j| (i, j))) {
                let between = own[(i, j)].norm().max(own[(j, i)].norm());
                let within = (own[(i, i)].norm() * own[(j, j)].norm()).sqrt();
                if between > ALONE * within {
                    let [from, to] = [block[i], block[j]];
                    block
                        .iter_mut()
                        .filter(|of| **of == from)
                        .for_each(|of| *of = to);
                }
            }
        }
        let of = |k: usize| {
            (0..LEGS)
                .filter(|mode| block[*mode] == k)
                .collect::<Vec<_>>()
        };
        (0..LEGS)
            .map(of)
            .filter(|modes| !modes.is_empty())
            .collect()
    }

    /// A, M and R at `hz`, Hz: with T, the outputs' motion is A − M·T·R, with an A and an R for
    /// each six of the `sources`, and M for forces along the modes. None where P has no inverse.
    pub(super) fn moved(
        &self,
        hz: f64,
        sources: &Sources<'_>,
    ) -> Option<(Vec<Gain>, Gain, Vec<Gain>)> {
        let (from_legs, moving) = sources.at(hz);
        let sensing = self.own(hz).try_inverse()? * self.transform.input.map(Complex::from);
        let moving = moving.into_iter().map(|source| {
            let sensed = sensing * source.sensed.fixed_rows::<LEGS>(0);
            (source.direct, Gain::from_column_slice(sensed.as_slice()))
        });
        let (a, r) = moving.unzip();
        Some((a, from_legs * self.transform.output.map(Complex::from), r))
    }

    /// Mode `k` at `hz`, Hz.
    pub(super) fn see(&self, hz: f64, k: usize) -> Seen {
        let sampled = self.study.plant();
        let plant = &sampled.plant;
        let response = sampled.response(hz);
        let complex = |m: &Matrix6<f64>| m.map(Complex::from);
        let input = complex(&self.transform.input);
        let output = complex(&self.transform.output);
        let floor = complex(&plant.rigid_floor);
        let sensors = plant.sensors();
        let own = input * response.from_legs(sensors.clone()).fixed_rows::<LEGS>(0) * output;
        let sensed = input * response.from_floor(sensors).fixed_rows::<LEGS>(0) * floor;
        let singular = Complex::from(f64::INFINITY);
        let inverse = own.try_inverse();
        let modal = Modal {
            forces: inverse.map_or(ComplexMatrix6::repeat(singular), |p| p * sensed),
            own,
            sensed,
        };
        let [whole, performance] = [plant.whole(), plant.performance()].map(|rows| {
            Outputs::new(
                &(response.from_legs(rows.clone()) * output),
                &(response.from_floor(rows) * floor),
            )
        });
        let motions = |outputs: &Outputs, unit: f64| {
            [outputs.modal(k, &modal, unit), outputs.any(k, &modal, unit)]
        };
        Seen {
            hz,
            own: own[(k, k)],
            whole: motions(&whole, 1.0),
            // Along a floor motion of size 1.
            performance: motions(&performance, plant.rigid_floor.column(k).norm()),
        }
    }

    /// The limits of t at the frequency of `seen` for a `question`.
    pub(super) fn limits(
        &self,
        seen: &Seen,
        controllers: Controllers,
        question: Question<'_>,
    ) -> Vec<Limit> {
        let machine = self.study.machine();
        let sensitivity = machine.target.max_sensitivity;
        let all = matches!(question, Question::Requirements);
        // A disc with the radius of a requirement, and a part that widens with γ in any case.
        let disc = |centre: Complex<f64>, required: f64, scaled: f64| Limit {
            centre,
            kept: if all { 0.0 } else { required },
            scaled: scaled + if all { required } else { 0.0 },
        };
        let mut limits = vec![disc(Complex::ONE, sensitivity, 0.0)];
        let roll_off = self.roll_off(seen.hz);
        if roll_off.is_finite() {
            limits.push(disc(Complex::ZERO, roll_off, 0.0));
        }
        let kind = match controllers {
            Controllers::Modal => 0,
            Controllers::Any => 1,
        };
        let largest = sensitivity.min(roll_off);
        let mut below = |motion: Option<Motion>, required: f64, scaled: f64| {
            let Some(motion) = motion else {
                return;
            };
            let size = motion.through.norm();
            let required = required + motion.rest * largest;
            let limit = disc(
                motion.direct / motion.through,
                required / size,
                scaled / size,
            );
            // Not at a pole or zero on the axis.
            if limit.centre.is_finite() && (limit.kept + limit.scaled).is_finite() {
                limits.push(limit);
            }
        };
        let [low, high] = self.isolated();
        if (low..=high).contains(&seen.hz) {
            below(seen.whole[kind], FRAC_1_SQRT_2, 0.0);
        }
        if let Question::Bands(levels) = question {
            for ((_, low, high), level) in machine.bands.iter().zip(levels) {
                if let Some(level) = level
                    && (*low..=*high).contains(&seen.hz)
                {
                    below(seen.performance[kind], 0.0, *level);
                }
            }
        }
        limits
    }
}
