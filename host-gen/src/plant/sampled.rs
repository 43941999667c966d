//! The plant as the board samples it.

use core::f64::consts::TAU;

use nalgebra::{Complex, DMatrix, MatrixXx6};
use shared::LEGS;

use super::generalised::Plant;
use super::lags::Lagged;
use super::response::{Part, Response, continuous, gains};
use crate::machine::Board;

/// One pole over a sample period, exactly, for inputs held in between.
#[derive(Clone, Copy, Debug)]
struct SampledPole {
    /// e^(λT).
    transition: Complex<f64>,
    /// From an input at the period's start and at its end, straight between.
    now: Complex<f64>,
    next: Complex<f64>,
    /// From one held from the start until the latch.
    before: Complex<f64>,
    /// From one held from the latch until the end.
    after: Complex<f64>,
    /// The mean over the period, from the state at its start and from the same
    /// inputs.
    mean: Means,
}

/// See [`SampledPole::mean`].
#[derive(Clone, Copy, Debug)]
struct Means {
    state: Complex<f64>,
    now: Complex<f64>,
    next: Complex<f64>,
    before: Complex<f64>,
    after: Complex<f64>,
}

/// (eˣ − 1 − x − … − xⁿ⁻¹/(n−1)!)/xⁿ: integrals of eˣ over and over.
fn phi(n: u32, x: Complex<f64>) -> Complex<f64> {
    if x.norm() < 0.5 {
        // Σ xᵏ/(k + n)!, to double precision.
        let mut term = Complex::from(1.0 / (1..=n).map(f64::from).product::<f64>());
        let mut sum = term;
        for k in 1..16 {
            term *= x / f64::from(k + n);
            sum += term;
        }
        sum
    } else if n == 0 {
        x.exp()
    } else {
        let before = 1.0 / (1..n).map(f64::from).product::<f64>();
        (phi(n - 1, x) - before) / x
    }
}

/// The plant as the board sees it: sampled at kT, forces latched a while later
/// and held for T.
///
/// With a latch delay of m·T + θ, 0 ≤ θ < T, the force of sample k acts from
/// (k + m)T + θ on. A sample sees what was latched before its instant; where a
/// latch and a sample coincide the sample comes first, as it does on a board
/// whose converter samples on the edge that also latches. The floor moves
/// straight from sample to sample.
///
/// Frequency responses from forces to sensors are from sample to sample; to all
/// else they are to the continuous signal at that frequency, for the samples of
/// an acceleration also hold the steps that the held forces make.
///
/// Amplifier and sensors with a bandwidth are first-order lags here, between
/// converters and machine; the continuous plant does not have them.
#[derive(Clone, Debug)]
pub struct SampledPlant {
    poles: Vec<SampledPole>,
    lagged: Lagged,
    /// m.
    pub(crate) whole_periods: usize,
    /// θ/T.
    part: f64,
    /// T, s.
    pub period: f64,
    /// The continuous plant.
    pub plant: Plant,
}

/// The sampled plant as real matrices: a block of one or two states a pole.
pub(crate) struct SampledStateSpace {
    /// The diagonal blocks, by pole: first state, real and imaginary part of
    /// e^(λT), and whether there are two states.
    pub(crate) blocks: Vec<(usize, Complex<f64>, bool)>,
    /// The change over a period.
    pub(crate) change: ByInput,
    /// All outputs at the start of a period from the states.
    pub(crate) output: DMatrix<f64>,
    /// The mean of all outputs over a period from the states at its start.
    pub(crate) mean: DMatrix<f64>,
    /// The same from the inputs.
    pub(crate) mean_by: ByInput,
}

/// By what happens in a period.
pub(crate) struct ByInput {
    /// From floor accelerations at its start.
    pub(crate) now: MatrixXx6<f64>,
    /// At its end.
    pub(crate) next: MatrixXx6<f64>,
    /// From the forces latched in it.
    pub(crate) after: MatrixXx6<f64>,
    /// From the forces they take over from.
    pub(crate) before: MatrixXx6<f64>,
}

impl SampledPlant {
    /// Samples `plant` with the timing of `board`.
    pub fn new(plant: Plant, board: &Board) -> Self {
        let period = board.period();
        let periods = board.latch_delay / period;
        // A delay typed as a whole number of periods is one.
        let nearest = periods.round();
        let (whole_periods, part) = if (periods - nearest).abs() < 1e-9 {
            (nearest, 0.0)
        } else {
            (periods.floor(), (periods - periods.floor()) * period)
        };
        let lagged = Lagged::new(&plant, board);
        let poles = lagged
            .poles
            .iter()
            .map(|pole| {
                let x = pole.lambda * period;
                let rest = period - part;
                // Held for t, and the mean over the period of being held
                // since a while t before its end.
                let held = |t: f64| phi(1, pole.lambda * t) * t;
                let since = |t: f64| phi(2, pole.lambda * t) * (t * t / period);
                let ramp = phi(2, x) * period;
                let mean_ramp = phi(3, x) * period;
                SampledPole {
                    transition: x.exp(),
                    now: held(period) - ramp,
                    next: ramp,
                    before: (pole.lambda * rest).exp() * held(part),
                    after: held(rest),
                    mean: Means {
                        state: phi(1, x),
                        now: since(period) - mean_ramp,
                        next: mean_ramp,
                        before: since(period) - since(rest),
                        after: since(rest),
                    },
                }
            })
            .collect();
        Self {
            poles,
            lagged,
            // At most eight: checked with the file.
            whole_periods: whole_periods as usize,
            part: part / period,
            period,
            plant,
        }
    }

    /// D of the outputs as the ADC sees them.
    pub(crate) fn direct(&self) -> &DMatrix<f64> {
        &self.lagged.direct
    }

    /// How many samples old the force is that a sample sees.
    pub fn seen_delay(&self) -> usize {
        self.whole_periods + 1
    }

    /// e^(jωT) at `hz`.
    pub fn z(&self, hz: f64) -> Complex<f64> {
        Complex::cis(TAU * hz * self.period)
    }

    /// All transfer functions of the sampled plant at `hz`, forces counted from
    /// the sample they were computed from.
    pub fn response(&self, hz: f64) -> Response<'_> {
        let z = self.z(hz);
        let delay = z.powi(-(self.whole_periods as i32));
        let seen = delay / z;
        let passes = |k: usize, lambda| {
            let pole = &self.poles[k];
            let of = |x: Complex<f64>| {
                if lambda == self.lagged.poles[k].lambda {
                    x
                } else {
                    x.conj()
                }
            };
            let gain = (z - of(pole.transition)).inv();
            let force = gain * (of(pole.after) * delay + of(pole.before) * seen);
            [Complex::ZERO, force]
        };
        // Latched, then held for T.
        let turn = Complex::new(0.0, TAU * hz * self.period);
        let hold = delay * (-turn * self.part).exp() * phi(1, -turn);
        let Lagged {
            poles,
            terms,
            direct,
            slow,
        } = &self.lagged;
        Response {
            terms,
            sensors: self.plant.sensors,
            part: continuous(poles, slow, hz, hold),
            sampled: Some(Part {
                direct: [Some((direct, [Complex::ZERO, seen])), None],
                gains: gains(poles, passes),
            }),
        }
    }

    /// As real matrices, for marching and for eigenvalues.
    pub(crate) fn state_space(&self) -> SampledStateSpace {
        let mut blocks = Vec::new();
        let mut states = 0;
        for (sampled, pole) in self.poles.iter().zip(&self.lagged.poles) {
            blocks.push((states, sampled.transition, pole.pair));
            states += 1 + usize::from(pole.pair);
        }
        let outputs = self.plant.state_space.c.nrows();
        let mut output = DMatrix::zeros(outputs, states);
        let mut mean = DMatrix::zeros(outputs, states);
        let blank = |rows| MatrixXx6::zeros(rows);
        let by_input = |rows| ByInput {
            now: blank(rows),
            next: blank(rows),
            after: blank(rows),
            before: blank(rows),
        };
        let mut change = by_input(states);
        let mut mean_by = by_input(outputs);
        for ((sampled, pole), &(at, _, pair)) in
            self.poles.iter().zip(&self.lagged.poles).zip(&blocks)
        {
            for j in 0..LEGS {
                let (by_floor, by_leg) = (pole.input[j], pole.input[LEGS + j]);
                let mut put = |matrix: fn(&mut ByInput) -> &mut MatrixXx6<f64>, x: Complex<f64>| {
                    let matrix = matrix(&mut change);
                    matrix[(at, j)] = x.re;
                    if pair {
                        matrix[(at + 1, j)] = x.im;
                    }
                };
                put(|by| &mut by.now, sampled.now * by_floor);
                put(|by| &mut by.next, sampled.next * by_floor);
                put(|by| &mut by.after, sampled.after * by_leg);
                put(|by| &mut by.before, sampled.before * by_leg);
            }
            // y = output·ξ plus its conjugate for a pair.
            let twice = if pair { 2.0 } else { 1.0 };
            for (i, &c) in pole.output.iter().enumerate() {
                let c = twice * c;
                let put = |matrix: &mut DMatrix<f64>, c: Complex<f64>| {
                    matrix[(i, at)] = c.re;
                    if pair {
                        matrix[(i, at + 1)] = -c.im;
                    }
                };
                put(&mut output, c);
                put(&mut mean, c * sampled.mean.state);
                for j in 0..LEGS {
                    let (by_floor, by_leg) = (c * pole.input[j], c * pole.input[LEGS + j]);
                    mean_by.now[(i, j)] += (by_floor * sampled.mean.now).re;
                    mean_by.next[(i, j)] += (by_floor * sampled.mean.next).re;
                    mean_by.after[(i, j)] += (by_leg * sampled.mean.after).re;
                    mean_by.before[(i, j)] += (by_leg * sampled.mean.before).re;
                }
            }
        }
        let by_floor = self.lagged.direct.fixed_columns::<LEGS>(0);
        let by_leg = self.lagged.direct.fixed_columns::<LEGS>(LEGS);
        mean_by.now += by_floor * 0.5;
        mean_by.next += by_floor * 0.5;
        mean_by.after += by_leg * (1.0 - self.part);
        mean_by.before += by_leg * self.part;
        SampledStateSpace {
            blocks,
            change,
            output,
            mean,
            mean_by,
        }
    }
}
