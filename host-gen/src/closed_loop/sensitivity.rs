//! The sensitivity of the sampled loop on a grid of frequencies.

use nalgebra::{Complex, Matrix6};
use shared::LEGS;

use crate::control::LinearLaw;
use crate::machine::RollOff;
use crate::numeric::frequencies::grid;
use crate::numeric::singular::smallest_is_above;
use crate::numeric::six::ComplexMatrix6;
use crate::plant::{Control, Gain, SampledPlant};

/// The point at which a loop is opened to compute its sensitivity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Opening {
    /// At the modal forces of the design model.
    Modes,
    /// At the six leg forces.
    Legs,
    /// At the six sensors from this index on. The loop stays closed over sensors of the other
    /// kind.
    Sensors(usize),
}

/// The peak sensitivity Ms of a loop: the maximum over frequency of σ_max((1 + L)⁻¹), for loops
/// opened at three points.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PeakSensitivity {
    /// Ms with the loop opened at the modal forces, whose coordinates give every mode the same
    /// weight.
    pub value: f64,
    /// Frequency of the peak in `value`, Hz.
    pub at: f64,
    /// Ms with the loop opened at the six leg forces.
    pub at_legs: f64,
    /// Ms with the loop opened at the six sensors; with both kinds of sensors, the larger value.
    pub at_sensors: f64,
}

/// How much of the limit of a roll-off a loop uses.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct RollOffUse {
    /// The highest σ_max(T) over its limit at the same frequency (no unit); above 1 the limit is
    /// exceeded.
    pub part: f64,
    /// Frequency of that, Hz.
    pub at: f64,
}

/// Factor by which the peak sensitivity at the legs and at the sensors, whose coordinates mix the
/// modes, may exceed the bound for the modes.
pub const ELSEWHERE: f64 = 1.5;

impl PeakSensitivity {
    /// The value to compare with the bound: the largest of `value`, and `at_legs` and `at_sensors`
    /// divided by [`ELSEWHERE`].
    pub fn bounded(&self) -> f64 {
        self.value
            .max(self.at_legs.max(self.at_sensors) / ELSEWHERE)
    }
}

/// The frequency response of a sampled plant on a grid, to evaluate many laws with.
#[derive(Clone, Debug)]
pub struct LoopGrid {
    points: Vec<(f64, Complex<f64>, Gain)>,
    /// Sᵀ and S⁻ᵀ.
    to_modes: ComplexMatrix6,
    from_modes: ComplexMatrix6,
}

impl LoopGrid {
    /// A grid from `low`, Hz, to half the sample rate.
    ///
    /// It is refined at the modes of the plant, at the resonances of its sensors, and at the peaks `sharp` (centre and half width,
    /// Hz). `modal` is S of Eq. (17).
    pub fn new(plant: &SampledPlant, modal: &Matrix6<f64>, low: f64, sharp: &[(f64, f64)]) -> Self {
        let high = 0.5 / plant.period;
        let peaks = [&plant.peaks(), sharp].concat();
        let points = grid(low, high, 500, &peaks)
            .into_iter()
            .map(|hz| (hz, plant.z(hz), plant.response(hz).g22()))
            .collect();
        let to_modes = modal.transpose();
        let from_modes = to_modes.try_inverse().expect("modes are independent");
        Self {
            points,
            to_modes: to_modes.map(Complex::from),
            from_modes: from_modes.map(Complex::from),
        }
    }

    /// The return difference 1 + L with the loop opened at `opening`.
    fn return_difference(&self, opening: Opening, g22: &Gain, c: &Control) -> ComplexMatrix6 {
        let one = ComplexMatrix6::identity();
        match opening {
            Opening::Modes => one + self.to_modes * -(c * g22) * self.from_modes,
            Opening::Legs => one - c * g22,
            Opening::Sensors(first) => {
                let g = g22.fixed_rows::<LEGS>(first);
                let mut own = c.fixed_columns::<LEGS>(first).into_owned();
                if c.ncols() > LEGS {
                    let other = LEGS - first;
                    let beside = c.fixed_columns::<LEGS>(other) * g22.fixed_rows::<LEGS>(other);
                    // Exactly at a pole of the loop over the other kind of sensors: taken as open.
                    own = (one - beside).lu().solve(&own).unwrap_or(own);
                }
                one - g * own
            }
        }
    }

    /// Whether the sensitivity is below `bound` at every frequency of the grid, in the sense of
    /// [`PeakSensitivity::bounded`]. This does not show that the loop is stable.
    pub fn within(&self, law: &LinearLaw, bound: f64) -> bool {
        let mut bounds = vec![(Opening::Modes, bound), (Opening::Legs, ELSEWHERE * bound)];
        bounds.extend(sensors(law).map(|opening| (opening, ELSEWHERE * bound)));
        self.points.iter().all(|(_, z, g22)| {
            let c = law.response(*z);
            bounds.iter().all(|&(opening, bound)| {
                smallest_is_above(self.return_difference(opening, g22, &c), bound)
            })
        })
    }

    /// The peak sensitivity with `law`: the highest point of the grid, refined between its
    /// neighbours. `plant` must be the plant of the grid.
    pub fn peak(&self, plant: &SampledPlant, law: &LinearLaw) -> PeakSensitivity {
        let (value, at) = self.climb(plant, law, Opening::Modes);
        PeakSensitivity {
            value,
            at,
            at_legs: self.climb(plant, law, Opening::Legs).0,
            at_sensors: sensors(law)
                .map(|opening| self.climb(plant, law, opening).0)
                .fold(0.0, f64::max),
        }
    }

    /// Each frequency, Hz, with σ_max(T) there with `law`; with the loop opened at the modal forces,
    /// T = 1 − (1 + L)⁻¹.
    fn complementary(&self, law: &LinearLaw) -> impl DoubleEndedIterator<Item = (f64, f64)> {
        let one = ComplexMatrix6::identity();
        self.points.iter().map(move |(hz, z, g22)| {
            let difference = self.return_difference(Opening::Modes, g22, &law.response(*z));
            let sensitivity = difference.try_inverse();
            let highest = sensitivity.map(|s| (one - s).singular_values().max());
            (*hz, highest.unwrap_or(f64::INFINITY))
        })
    }

    /// The lowest frequency, Hz, from which on σ_max(T) with `law` keeps a roll-off of this `order`,
    /// as [`RollOff`]; half the sample rate if it keeps none below that.
    pub fn lowest_roll_off(&self, law: &LinearLaw, order: f64) -> f64 {
        let mut needed = self.points.last().map_or(0.0, |(hz, ..)| *hz);
        let mut highest = 0.0_f64;
        for (hz, size) in self.complementary(law).rev() {
            // From here on, the limit would have to begin at `highest` or above.
            highest = highest.max(hz * size.powf(order.recip()));
            if highest > hz {
                return needed.max(hz);
            }
            needed = highest;
        }
        needed
    }

    /// The highest σ_max(T) with `law` as a part of the `limit`, and its frequency, Hz.
    pub fn roll_off(&self, law: &LinearLaw, limit: &RollOff) -> RollOffUse {
        let used = self.complementary(law).filter(|(hz, _)| *hz >= limit.hz);
        let used = used.map(|(hz, highest)| RollOffUse {
            part: highest / limit.limit(hz),
            at: hz,
        });
        let none = RollOffUse {
            part: 0.0,
            at: limit.hz,
        };
        used.fold(none, |a, b| if b.part > a.part { b } else { a })
    }

    /// The peak sensitivity with the loop opened at `opening`, and its frequency, Hz, by ternary
    /// search.
    fn climb(&self, plant: &SampledPlant, law: &LinearLaw, opening: Opening) -> (f64, f64) {
        let at = |hz: f64, g22: &Gain| {
            let difference = self.return_difference(opening, g22, &law.response(plant.z(hz)));
            1.0 / difference.singular_values().min()
        };
        let (index, mut best) = self
            .points
            .iter()
            .map(|(hz, _, g22)| (at(*hz, g22), *hz))
            .enumerate()
            .max_by(|(_, a), (_, b)| a.0.total_cmp(&b.0))
            .expect("a grid has points");
        let hz = |i: usize| self.points[i.min(self.points.len() - 1)].0;
        let (mut low, mut high) = (hz(index.saturating_sub(1)), hz(index + 1));
        while high - low > 1e-6 * high {
            let third = (high - low) / 3.0;
            let [left, right] =
                [low + third, high - third].map(|hz| (at(hz, &plant.response(hz).g22()), hz));
            if left.0 < right.0 {
                low = left.1;
            } else {
                high = right.1;
            }
            for peak in [left, right] {
                if peak.0 > best.0 {
                    best = peak;
                }
            }
        }
        best
    }
}

/// One opening for each kind of sensors of `law`.
fn sensors(law: &LinearLaw) -> impl Iterator<Item = Opening> {
    (0..law.sensors()).step_by(LEGS).map(Opening::Sensors)
}
