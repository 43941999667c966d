//! The sensitivity of the sampled loop on a grid of frequencies.

use nalgebra::{Complex, Matrix6};
use shared::LEGS;

use crate::control::LinearLaw;
use crate::numeric::frequencies::grid;
use crate::numeric::singular::smallest_is_above;
use crate::numeric::six::ComplexMatrix6;
use crate::plant::{Control, Gain, SampledPlant};

/// Where a loop is opened to look at its sensitivity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Opening {
    /// At the forces along the modes of the design model.
    Modes,
    /// At the six forces.
    Legs,
    /// At the six sensors from this one on; those of another kind stay in the
    /// loop.
    Sensors(usize),
}

/// The peak of the sensitivity, max over frequency of σ_max((1 + L)⁻¹).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PeakSensitivity {
    /// Ms with the loop open at the forces along the modes, whose coordinates
    /// give every mode the same weight: what is bounded.
    pub value: f64,
    /// Hz.
    pub at: f64,
    /// With the loop open at the six legs.
    pub at_legs: f64,
    /// With the loop open at the six sensors, of the worse kind.
    pub at_sensors: f64,
}

/// Legs and sensors, whose coordinates mix the modes, may have this many times
/// the peak of the modes.
pub const ELSEWHERE: f64 = 1.5;

impl PeakSensitivity {
    /// What the bound is for: Ms, or what legs and sensors have over
    /// [`ELSEWHERE`] if that is more.
    pub fn bounded(&self) -> f64 {
        self.value
            .max(self.at_legs.max(self.at_sensors) / ELSEWHERE)
    }
}

/// The sampled plant on a grid of frequencies, for trying many laws.
#[derive(Clone, Debug)]
pub struct LoopGrid {
    points: Vec<(f64, Complex<f64>, Gain)>,
    /// Sᵀ and S⁻ᵀ.
    to_modes: ComplexMatrix6,
    from_modes: ComplexMatrix6,
}

impl LoopGrid {
    /// From `low` Hz to half the sample rate, finer about the plant's modes and
    /// about `sharp`, more peaks as Hz and half width. `modal` is S of Eq. (17).
    pub fn new(plant: &SampledPlant, modal: &Matrix6<f64>, low: f64, sharp: &[(f64, f64)]) -> Self {
        let high = 0.5 / plant.period;
        let peaks = [&plant.plant.peaks(), sharp].concat();
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

    /// 1 + L.
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
                    // Exactly on a pole of the other kind's loop: as if open.
                    own = (one - beside).lu().solve(&own).unwrap_or(own);
                }
                one - g * own
            }
        }
    }

    /// Whether the sensitivity is within `bound` everywhere on the grid, as
    /// [`PeakSensitivity::bounded`]. Says nothing about stability.
    pub fn within(&self, law: &LinearLaw, bound: f64) -> bool {
        // σ_min(1 + L) ≥ 1/bound where (1 + L)ᴴ(1 + L) − 1/bound² is positive
        // definite, which a Cholesky factorisation tells much faster than
        // singular values do.
        let mut bounds = vec![(Opening::Modes, bound), (Opening::Legs, ELSEWHERE * bound)];
        bounds.extend(sensors(law).map(|opening| (opening, ELSEWHERE * bound)));
        self.points.iter().all(|(_, z, g22)| {
            let c = law.response(*z);
            bounds.iter().all(|&(opening, bound)| {
                smallest_is_above(self.return_difference(opening, g22, &c), bound)
            })
        })
    }

    /// The highest peaks, found on the grid and climbed to their tops. `plant`
    /// is the one the grid was made from.
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

    /// The highest peak at one opening, and its frequency, Hz.
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

/// The openings at each kind of sensors.
fn sensors(law: &LinearLaw) -> impl Iterator<Item = Opening> {
    (0..law.sensors()).step_by(LEGS).map(Opening::Sensors)
}
