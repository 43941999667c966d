//! The plant as the board samples it: zero-order hold, latch delay, and samples of the sensors.

use core::f64::consts::TAU;

use nalgebra::{Complex, DMatrix, MatrixXx6};
use shared::LEGS;

use super::generalised::Plant;
use super::lags::Lagged;
use super::response::{Response, ResponsePart, continuous, contour, gains};
use super::state_space::{DiscreteStateSpace, INPUTS};
use crate::machine::Board;
use crate::numeric::frequencies::pole_peaks;

/// The exact change of one pole's state over a sample period T.
#[derive(Clone, Copy, Debug)]
struct SampledPole {
    /// e^(λT).
    transition: Complex<f64>,
    /// Effect of an input that moves in a straight line over the period: from its value at the
    /// start, and from its value at the end.
    now: Complex<f64>,
    next: Complex<f64>,
    /// Effect of an input that is held from the start of the period until the latch.
    before: Complex<f64>,
    /// Effect of an input that is held from the latch until the end of the period.
    after: Complex<f64>,
    /// The mean of the state over the period.
    mean: Means,
}

/// The mean of a pole's state over a period, from the state at its start and from the inputs of
/// [`SampledPole`].
#[derive(Clone, Copy, Debug)]
struct Means {
    state: Complex<f64>,
    now: Complex<f64>,
    next: Complex<f64>,
    before: Complex<f64>,
    after: Complex<f64>,
}

/// φ_n(x) = (eˣ − 1 − x − … − xⁿ⁻¹/(n−1)!)/xⁿ, the n-fold integral of eˣ over xⁿ.
fn phi(n: u32, x: Complex<f64>) -> Complex<f64> {
    if x.norm() < 0.5 {
        // The series Σ xᵏ/(k + n)!, which avoids cancellation, to double precision.
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

/// The plant between the board's converters: sensors sampled at kT, forces latched after a delay
/// and held for one period T.
///
/// With a latch delay of m·T + θ, 0 ≤ θ < T, the force of sample k acts from (k + m)·T + θ for
/// one period. A sample measures the effect of forces latched before its instant. If a latch and
/// a sample coincide, the sample comes first, as on a board whose timer edge both starts the
/// conversion and latches. Floor accelerations are interpolated linearly between samples.
///
/// Frequency responses from forces to sensors relate samples to samples. Those to all other
/// outputs give the component of the continuous signal at the frequency itself. Samples of an
/// acceleration would also contain the steps of the held forces.
///
/// The dynamics of amplifiers and sensors are part of it. The continuous plant does not have them.
#[derive(Clone, Debug)]
pub struct SampledPlant {
    poles: Vec<SampledPole>,
    lagged: Lagged,
    /// m, the whole periods of the latch delay.
    pub(crate) whole_periods: usize,
    /// θ/T, the rest of the latch delay in periods, 0 to below 1.
    part: f64,
    /// The sample period T, s.
    pub period: f64,
    /// The continuous plant, without the dynamics of amplifiers and sensors.
    pub plant: Plant,
}

/// The sampled plant as real matrices, with one state for each real pole and two for each pair.
pub(crate) struct SampledStateSpace {
    /// The diagonal blocks of the transition matrix, for each pole: its first state, e^(λT), and
    /// whether it has two states.
    pub(crate) blocks: Vec<(usize, Complex<f64>, bool)>,
    /// Change of the states over a period from the inputs.
    pub(crate) change: ByInput,
    /// All outputs at the start of a period from the states. Direct feedthrough is apart, in
    /// [`SampledPlant::direct`].
    pub(crate) output: DMatrix<f64>,
    /// Mean of all outputs over a period from the states at its start.
    pub(crate) mean: DMatrix<f64>,
    /// Mean of all outputs over a period from the inputs.
    pub(crate) mean_by: ByInput,
}

/// Effects of the inputs over a period, each with one row for each state or output.
pub(crate) struct ByInput {
    /// From the floor accelerations at the start of the period, m/s².
    pub(crate) now: MatrixXx6<f64>,
    /// From the floor accelerations at the end of the period, m/s².
    pub(crate) next: MatrixXx6<f64>,
    /// From the leg forces latched in the period, N.
    pub(crate) after: MatrixXx6<f64>,
    /// From the leg forces held before that latch, N.
    pub(crate) before: MatrixXx6<f64>,
}

impl SampledPlant {
    /// Samples `plant` with the sample period and the latch delay of `board`, and adds the dynamics
    /// of its amplifiers and sensors.
    pub fn new(plant: Plant, board: &Board) -> Self {
        let period = board.period();
        let periods = board.latch_delay / period;
        // A delay that is a whole number of periods to rounding is taken as exactly that.
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
                // State at the end of a hold of length t; and the mean over the period if the hold
                // begins a time t before its end.
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
            // At most eight, by validation of the machine.
            whole_periods: whole_periods as usize,
            part: part / period,
            period,
            plant,
        }
    }

    /// D of the outputs with the dynamics of amplifiers and sensors; columns are floor, then forces.
    pub(crate) fn direct(&self) -> &DMatrix<f64> {
        &self.lagged.direct
    }

    /// The resonances of machine and sensors, as centre and half width, Hz, for a frequency grid.
    pub fn peaks(&self) -> Vec<(f64, f64)> {
        pole_peaks(self.lagged.poles.iter().map(|pole| &pole.lambda))
    }

    /// The age, in samples, of the newest force that a sample measures: m + 1.
    pub fn seen_delay(&self) -> usize {
        self.whole_periods + 1
    }

    /// z = e^(jωT) at `hz`, Hz.
    pub fn z(&self, hz: f64) -> Complex<f64> {
        Complex::cis(TAU * hz * self.period)
    }

    /// The frequency response of the sampled plant at `hz`, Hz. The phase of a force is that of
    /// the sample from which it was computed. At an undamped pole of the plant it is that a little
    /// beside it.
    pub fn response(&self, hz: f64) -> Response<'_> {
        let (s, at_pole) = contour(&self.lagged.poles, hz);
        let z = (s * self.period).exp();
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
        // The latch delay and the zero-order hold.
        let turn = s * self.period;
        let hold = delay * (-turn * self.part).exp() * phi(1, -turn);
        let Lagged {
            poles,
            terms,
            direct,
            slow,
        } = &self.lagged;
        Response {
            terms,
            tilt: self.plant.tilt.as_ref().map(|tilt| (tilt, s)),
            sensors: self.plant.sensors,
            at_pole,
            part: continuous(poles, slow, s, hold),
            sampled: Some(ResponsePart {
                direct: [Some((direct, [Complex::ZERO, seen])), None],
                gains: gains(poles, passes),
            }),
        }
    }

    /// The sampled plant as a discrete system, from the floor accelerations at the samples, m/s², and
    /// the leg forces that are computed from the samples, N, to all outputs at the samples, in the rows
    /// of the continuous plant.
    ///
    /// A sample sees no force that is computed from it: the last six columns of D are zero. The states
    /// are those of the plant's poles, of no unit, one for a real pole and two for a pair, and then the
    /// forces that are computed but still act or have yet to, N, the newest six first. Between samples
    /// the floor acceleration f is straight, so the states of the poles at a sample, ξ, are ξ̃ + E·f with
    /// the effect E of its value at the end of the period; ξ̃ is the state here.
    pub fn discrete(&self) -> DiscreteStateSpace {
        let plant = self.state_space();
        let n = plant.output.ncols();
        let delays = self.seen_delay();
        let states = n + LEGS * delays;
        let held = |age: usize| n + LEGS * (age - 1);
        let mut a = DMatrix::zeros(states, states);
        let mut b = DMatrix::zeros(states, INPUTS);
        b.view_mut((held(1), LEGS), (LEGS, LEGS))
            .fill_with_identity();
        for age in 2..=delays {
            a.view_mut((held(age), held(age - 1)), (LEGS, LEGS))
                .fill_with_identity();
        }
        let mut old = a.view_mut((0, held(delays)), (n, LEGS));
        old += &plant.change.before;
        match self.whole_periods {
            0 => b
                .view_mut((0, LEGS), (n, LEGS))
                .copy_from(&plant.change.after),
            age => a
                .view_mut((0, held(age)), (n, LEGS))
                .copy_from(&plant.change.after),
        }
        for (at, z, pair) in plant.blocks {
            a[(at, at)] += z.re;
            if pair {
                a[(at, at + 1)] -= z.im;
                a[(at + 1, at)] += z.im;
                a[(at + 1, at + 1)] += z.re;
            }
        }
        let end = &plant.change.next;
        let by_floor = a.view((0, 0), (n, n)) * end + &plant.change.now;
        b.view_mut((0, 0), (n, LEGS)).copy_from(&by_floor);

        let direct = self.direct();
        let mut c = DMatrix::zeros(direct.nrows(), states);
        c.columns_mut(0, n).copy_from(&plant.output);
        c.columns_mut(held(delays), LEGS)
            .copy_from(&direct.columns(LEGS, LEGS));
        let mut d = DMatrix::zeros(direct.nrows(), INPUTS);
        d.columns_mut(0, LEGS)
            .copy_from(&(plant.output * end + direct.columns(0, LEGS)));
        DiscreteStateSpace { a, b, c, d }
    }

    /// The sampled plant as real matrices, for simulation and for eigenvalues.
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
            // y = output·ξ, plus its conjugate for a pair.
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
