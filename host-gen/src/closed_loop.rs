//! The sampled loop: plant, delays and the law as the table has it.

use core::ops::Range;

use nalgebra::{Complex, DMatrix, Matrix6};
use shared::LEGS;

use crate::design::Gains;
use crate::law::LinearLaw;
use crate::linear::{eigenvalues, largest_singular_value};
use crate::plant::{Control, Gain, Plant, SampledPlant, pole_peaks};

/// Six by six, complex.
pub type Six = Matrix6<Complex<f64>>;

/// σ = C(jω)·y of the unsampled law, Eqs. (21) and (22).
pub fn ideal_response(gains: &Gains, hz: f64) -> Control {
    let s = Complex::new(0.0, core::f64::consts::TAU * hz);
    let c = -(gains.proportional.map(Complex::from) + gains.integral.map(|i| i / s));
    Control::from_column_slice(c.as_slice())
}

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
    to_modes: Six,
    from_modes: Six,
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
    fn return_difference(&self, opening: Opening, g22: &Gain, c: &Control) -> Six {
        let one = Six::identity();
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
            bounds
                .iter()
                .all(|&(opening, bound)| keeps(self.return_difference(opening, g22, &c), bound))
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

/// Whether no singular value of a return difference is below 1/`bound`.
pub(crate) fn keeps(difference: Six, bound: f64) -> bool {
    let mut square = difference.ad_mul(&difference);
    let floor = 1.0 / (bound * bound);
    for i in 0..LEGS {
        square[(i, i)] -= floor;
    }
    is_positive_definite(square)
}

/// nalgebra's complex Cholesky takes square roots of negative pivots, so the
/// pivots are looked at here.
fn is_positive_definite(mut m: Six) -> bool {
    for k in 0..LEGS {
        let pivot = m[(k, k)].re;
        if pivot.is_nan() || pivot <= 0.0 {
            return false;
        }
        for i in k + 1..LEGS {
            let factor = m[(i, k)] / pivot;
            for j in k + 1..=i {
                let entry = factor * m[(j, k)].conj();
                m[(i, j)] -= entry;
            }
        }
    }
    true
}

/// Frequencies from `low` to `high`, `count` of them evenly in the logarithm,
/// and eleven about every peak (Hz, half width in Hz).
pub fn grid(low: f64, high: f64, count: usize, peaks: &[(f64, f64)]) -> Vec<f64> {
    let steps = (count - 1) as f64;
    let mut all: Vec<f64> = (0..count)
        .map(|i| low * (high / low).powf(i as f64 / steps))
        .collect();
    for (centre, width) in peaks {
        for offset in [-8.0, -4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0] {
            let hz = centre + offset * width;
            if (low..=high).contains(&hz) {
                all.push(hz);
            }
        }
    }
    all.sort_by(f64::total_cmp);
    all.dedup();
    all
}

/// A sampled plant under a law.
#[derive(Clone, Copy, Debug)]
pub struct SampledLoop<'a> {
    /// The plant.
    pub plant: &'a SampledPlant,
    /// The law.
    pub law: LinearLaw,
}

impl SampledLoop<'_> {
    /// One period of the closed loop as a matrix: the modes, the forces still
    /// to act, and the law's states.
    fn transition(&self) -> DMatrix<f64> {
        let plant = self.plant.state_space();
        let law = self.law.state_space();
        let n = plant.output.ncols();
        let delays = self.plant.seen_delay();
        let inner = n + LEGS * delays;
        let states = inner + law.a.nrows();
        let held = |age: usize| n + LEGS * (age - 1);
        // A signal is its row of coefficients on the states before the step.
        let state = |at: usize| {
            let mut rows = DMatrix::zeros(LEGS, states);
            rows.view_mut((0, at), (LEGS, LEGS)).fill_with_identity();
            rows
        };
        let sensors = 0..self.law.sensors();
        let direct = self.plant.direct();
        let mut y = direct.view((0, LEGS), (sensors.len(), LEGS)) * state(held(delays));
        let mut modes = y.columns_mut(0, n);
        modes += plant.output.rows_range(sensors);

        let mut next = DMatrix::zeros(states, states);
        let mut own = next.rows_range_mut(inner..);
        own += law.b * &y;
        let mut own = own.columns_range_mut(inner..);
        own += law.a;
        let mut force = law.d * y;
        let mut own = force.columns_range_mut(inner..);
        own += law.c;
        let mut set = |at: usize, rows: &DMatrix<f64>| next.rows_mut(at, LEGS).copy_from(rows);
        set(held(1), &force);
        for age in 2..=delays {
            set(held(age), &state(held(age - 1)));
        }
        let age = self.plant.whole_periods;
        let new = if age == 0 { force } else { state(held(age)) };
        let old = state(held(age + 1));
        let mut modes = next.rows_mut(0, n);
        modes += plant.change.after * new + plant.change.before * old;
        for (at, z, pair) in plant.blocks {
            next[(at, at)] += z.re;
            if pair {
                next[(at, at + 1)] -= z.im;
                next[(at + 1, at)] += z.im;
                next[(at + 1, at + 1)] += z.re;
            }
        }
        next
    }

    /// The closed loop's poles as continuous ones, ln(z)/T, rad/s, slowest
    /// first; poles at z = 0 are left out. None if the eigenvalue iteration
    /// does not end.
    pub fn poles(&self) -> Option<Vec<Complex<f64>>> {
        let mut poles: Vec<_> = eigenvalues(&self.transition())?
            .into_iter()
            .filter(|z| z.norm() > 1e-12)
            .map(|z| z.ln() / self.plant.period)
            .collect();
        poles.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
        Some(poles)
    }

    /// The peak sensitivity from `low` Hz on of the loop with these `poles`, its
    /// modes those of `modal`, S of Eq. (17).
    pub fn peak_sensitivity(
        &self,
        modal: &Matrix6<f64>,
        low: f64,
        poles: &[Complex<f64>],
    ) -> PeakSensitivity {
        LoopGrid::new(self.plant, modal, low, &pole_peaks(poles)).peak(self.plant, &self.law)
    }

    /// The loop gain L by Hz, opened at the forces along the modes of `modal`, S of
    /// Eq. (17); the sensitivity is (1 + L)⁻¹.
    pub fn modal_loop(&self, modal: &Matrix6<f64>) -> impl Fn(f64) -> Six {
        let to_modes = modal.transpose().map(Complex::from);
        let from_modes = to_modes.try_inverse().expect("modes are independent");
        move |hz| {
            let law = self.law.response(self.plant.z(hz));
            to_modes * -(law * self.plant.response(hz).g22()) * from_modes
        }
    }

    /// Floor accelerations to `rows` of the plant's outputs at `hz`.
    pub fn close(&self, hz: f64, rows: Range<usize>) -> Gain {
        let controller = self.law.response(self.plant.z(hz));
        self.plant.response(hz).close(rows, &controller)
    }

    /// Rigid floor motion to the rigid whole at `hz`.
    pub fn transmissibility(&self, hz: f64) -> Gain {
        let plant = &self.plant.plant;
        self.close(hz, plant.whole()) * plant.rigid_floor.map(Complex::from)
    }
}

/// Floor accelerations to `rows` of the plant's outputs at `hz`, under the
/// unsampled law.
pub fn close_ideal(plant: &Plant, gains: &Gains, hz: f64, rows: Range<usize>) -> Gain {
    plant.response(hz).close(rows, &ideal_response(gains, hz))
}

/// The highest σ_max of a transfer function at some frequencies, dB.
pub fn highest_db(hz: &[f64], gain: impl Fn(f64) -> Gain) -> f64 {
    let highest = hz
        .iter()
        .map(|&hz| largest_singular_value(&gain(hz)))
        .fold(0.0, f64::max);
    20.0 * highest.log10()
}

/// Whether all poles lie in the left half plane.
pub fn stable(poles: &[Complex<f64>]) -> bool {
    poles.iter().all(|s| s.re < 0.0)
}

/// The frequency above which the whole no longer follows the floor: σ_max of
/// rigid floor motion → rigid whole stays under 1/√2. Searched upward to
/// `high` Hz, `closed` giving that transfer function.
pub fn corner(low: f64, high: f64, peaks: &[(f64, f64)], closed: impl Fn(f64) -> Gain) -> f64 {
    let level = core::f64::consts::FRAC_1_SQRT_2;
    let follows = |hz: f64| largest_singular_value(&closed(hz)) > level;
    let points = grid(low, high, 300, peaks);
    let Some(last) = points.iter().rposition(|&hz| follows(hz)) else {
        return low;
    };
    let Some(&beyond) = points.get(last + 1) else {
        return high;
    };
    let (mut inside, mut outside) = (points[last], beyond);
    for _ in 0..30 {
        let middle = 0.5 * (inside + outside);
        if follows(middle) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    outside
}
