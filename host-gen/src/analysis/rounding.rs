//! The error from single precision: the law of the step compared with the same law in
//! double precision, on the same sensor values.

use core::f64::consts::TAU;

use nalgebra::{Complex, DMatrix, DVector, Matrix6, Vector6};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::Serialize;
use shared::LEGS;
use shared::step::{Demand, LawState, force};
use shared::table::{Paths, ValidTable};

use crate::control::LinearLaw;
use crate::machine::{Machine, Sensor};
use crate::plant::DiscreteStateSpace;

/// Rounding error relative to noise at one frequency.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Rounding {
    /// Frequency, Hz.
    pub hz: f64,
    /// Power of the rounding error of the leg forces, relative to the power of the forces
    /// caused by sensor and ADC noise, dB; the worst leg.
    pub over_noise_db: f64,
    /// Power of the rounding to DAC codes, taken as white noise, relative to the power of
    /// the forces caused by sensor and ADC noise, dB; the worst leg.
    pub codes_over_noise_db: f64,
}

/// Frequencies at which the error is evaluated, Hz.
const AT: [f64; 8] = [1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 4000.0];

/// Number of windows that are evaluated.
const WINDOWS: usize = 6;
/// Runs that share them, each with noise of its own.
const STREAMS: usize = 2;
/// Length of a window, s.
const WINDOW: f64 = 2.0;

/// The entries of a law's matrices that are not zero: one in ten.
struct SparseLaw {
    /// For each next state and then each force, its entries on the states and then on the inputs.
    rows: Vec<Vec<(usize, f64)>>,
    states: usize,
}

impl SparseLaw {
    fn new(law: &DiscreteStateSpace) -> Self {
        let states = law.a.nrows();
        let row = |of_states: &DMatrix<f64>, of_inputs: &DMatrix<f64>, i: usize| {
            let (states, inputs) = (of_states.row(i), of_inputs.row(i));
            let entries = states.iter().chain(inputs.iter()).copied();
            let entries = entries.enumerate().filter(|(_, x)| *x != 0.0);
            entries.collect::<Vec<_>>()
        };
        let next = (0..states).map(|i| row(&law.a, &law.b, i));
        let forces = (0..LEGS).map(|i| row(&law.c, &law.d, i));
        Self {
            rows: next.chain(forces).collect(),
            states,
        }
    }

    /// The forces for the inputs `y`, N; moves the states one sample on.
    fn step(&self, states: &mut DVector<f64>, y: &DVector<f64>) -> [f64; LEGS] {
        let value = |&(at, x): &(usize, f64)| {
            x * if at < self.states {
                states[at]
            } else {
                y[at - self.states]
            }
        };
        let all: Vec<f64> = self
            .rows
            .iter()
            .map(|row| row.iter().map(value).sum())
            .collect();
        states.copy_from_slice(&all[..self.states]);
        core::array::from_fn(|leg| all[self.states + leg])
    }
}

/// Runs both laws on sensor noise and on a slow motion that needs up to half of the
/// actuators' limit: then the states are large while their rounding error must stay
/// small. Empty if `table` without AC coupling is not valid.
///
/// AC coupling is left out: its states hold the sensor's offset, and their rounding error
/// is smaller than an ADC code.
pub fn rounding(machine: &Machine, table: &ValidTable) -> Vec<Rounding> {
    let mut plain = *table.get();
    plain.ac_coupling = 0.0;
    let Ok(plain) = plain.validate() else {
        return Vec::new();
    };
    let linear = LinearLaw::new(&plain);
    let exact = SparseLaw::new(&linear.state_space());
    let states = exact.states;
    let law = plain.get().law;
    let board = &machine.board;
    let nyquist = (0.5 * board.sample_rate).sqrt();
    // By sensor: rms of white noise and the ADC's together, with densities as at a frequency, or
    // between samples; and a motion, equal accelerations in all modes with the forces that
    // belong to them.
    let with = |density: &dyn Fn(&Sensor) -> f64| {
        let adc = board.adc_noise.hypot(board.adc.lsb() / 12f64.sqrt());
        let of_kind = |sensor: &Sensor| {
            let rms = (density(sensor) * nyquist).hypot(adc / sensor.sensitivity);
            [rms; LEGS]
        };
        DVector::from_vec(board.fed_back().flat_map(of_kind).collect())
    };
    let noise = with(&|sensor| sensor.noise_density.between_samples(board.sample_rate));
    let mut motion = vec![1.0; LEGS];
    if let (Paths::Modal(modal), Some(complement)) = (&law.paths, plain.get().complement()) {
        let double = |m: &Matrix6<f32>| m.map(f64::from);
        let modes = double(&modal.input) * Vector6::repeat(1.0);
        let forces = double(&complement.input).lu().solve(&modes);
        motion.extend(forces.iter().flat_map(|forces| forces.iter()));
    }
    let motion = DVector::from_vec(motion);
    let slow_hz = 0.7 * machine.target.frequency;
    let gain = linear.response(Complex::cis(TAU * slow_hz / board.sample_rate));
    let largest = (gain * motion.map(Complex::from))
        .iter()
        .map(|force| force.norm())
        .fold(0.0, f64::max);
    let slow = 0.5 * board.force_limit / largest;
    let length = (WINDOW * board.sample_rate) as usize;
    let run = |stream: u64| {
        let mut random = ChaCha8Rng::seed_from_u64(machine.simulation.seed);
        random.set_stream(stream);
        let mut single = LawState::REST;
        let mut whole = DVector::<f64>::zeros(states);
        let mut powers = [[0.0_f64; LEGS]; AT.len()];
        // The first window is for settling.
        for window in 0..=WINDOWS / STREAMS {
            let mut sums = [[Complex::<f64>::ZERO; LEGS]; AT.len()];
            for k in 0..length {
                let time = (window * length + k) as f64 / board.sample_rate;
                let slow = slow * (TAU * slow_hz * time).sin();
                let n = DVector::from_fn(noise.len(), |i, _| {
                    let normal: f64 = StandardNormal.sample(&mut random);
                    normal * noise[i]
                });
                // The same numbers to both: what the step reads is single.
                let read = (&n + slow * &motion).map(|x| x as f32);
                let y = read.map(f64::from);
                let kind = |first: usize| {
                    core::array::from_fn(|i| read.get(first + i).map_or(0.0, |x| *x))
                };
                let (w, forces) = (kind(0), kind(LEGS));
                let (found, _) = force(
                    &law,
                    &[f32::MAX; LEGS],
                    &mut single,
                    &w,
                    &forces,
                    &Demand::LAW,
                );
                let expected = exact.step(&mut whole, &y);
                if window == 0 {
                    continue;
                }
                // Hann's window.
                let part = (core::f64::consts::PI * k as f64 / length as f64)
                    .sin()
                    .powi(2);
                for (i, hz) in AT.iter().enumerate() {
                    let turn = Complex::cis(-TAU * hz * k as f64 / board.sample_rate) * part;
                    for leg in 0..LEGS {
                        sums[i][leg] += turn * (f64::from(found[leg]) - expected[leg]);
                    }
                }
            }
            for (powers, sums) in powers.iter_mut().zip(sums) {
                for (power, sum) in powers.iter_mut().zip(sums) {
                    *power += sum.norm_sqr();
                }
            }
        }
        powers
    };
    let streams: Vec<_> = (0..STREAMS as u64).into_par_iter().map(run).collect();
    let power = |i: usize, leg: usize| streams.iter().map(|powers| powers[i][leg]).sum::<f64>();
    let code = (board.dac.lsb() * board.actuator_gain).powi(2) / 12.0;
    let by_noise = |hz: f64| {
        let gain = linear.response(Complex::cis(TAU * hz / board.sample_rate));
        let noise = with(&|sensor| sensor.noise_density.at(hz));
        gain.map(|z| z.norm_sqr()) * noise.map(|rms| rms * rms)
    };
    // White noise of power 1 in the same windows: the squares of Hann's window have the mean 3/8.
    let white = WINDOWS as f64 * length as f64 * 0.375;
    AT.iter()
        .enumerate()
        .filter(|(_, hz)| **hz < 0.5 * board.sample_rate)
        .map(|(i, &hz)| Rounding {
            hz,
            codes_over_noise_db: 10.0 * (code / by_noise(hz).min()).log10(),
            over_noise_db: (0..LEGS)
                .map(|leg| 10.0 * (power(i, leg) / (white * by_noise(hz)[leg])).log10())
                .fold(f64::MIN, f64::max),
        })
        .collect()
}
