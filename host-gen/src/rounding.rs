//! What single precision costs: the step's law against the same law in double
//! precision, on the same sensor values.

use core::f64::consts::TAU;

use nalgebra::{Complex, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;
use shared::LEGS;
use shared::step::{LawState, force};
use shared::table::ValidTable;

use crate::law::LinearLaw;
use crate::machine::Machine;

/// Rounding at one frequency.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Rounding {
    /// Hz.
    pub hz: f64,
    /// Power of the forces' rounding over that of the forces that sensor and
    /// ADC noise cause, worst leg, dB.
    pub over_noise_db: f64,
}

/// Where it is looked at, Hz.
const AT: [f64; 8] = [1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 4000.0];

/// Seconds looked at, in windows of two.
const WINDOWS: usize = 12;
const WINDOW: f64 = 2.0;

/// Runs both laws on sensor noise and on a slow motion that takes up to half of
/// the actuators' limit: the state then is large while its noise must stay
/// small.
///
/// AC coupling is left out: its averages hold the offset, whose rounding is
/// beneath that of the ADC's code.
pub fn rounding(machine: &Machine, table: &ValidTable) -> Vec<Rounding> {
    let mut plain = *table.get();
    plain.ac_coupling = 0.0;
    let Ok(plain) = plain.validate() else {
        return Vec::new();
    };
    let linear = LinearLaw::new(&plain);
    let exact = linear.state_space();
    let law = plain.get().law;
    let board = &machine.board;
    let sensor = &board.sensor;
    let nyquist = (0.5 * board.sample_rate).sqrt();
    let noise = (sensor.noise_density * nyquist)
        .hypot(board.adc_noise.hypot(board.adc.lsb() / 12f64.sqrt()) / sensor.sensitivity);
    let slow_hz = 0.7 * machine.target.frequency;
    let gain = linear.response(Complex::cis(TAU * slow_hz / board.sample_rate));
    let largest = gain
        .row_iter()
        .map(|row| row.iter().sum::<Complex<f64>>().norm())
        .fold(0.0, f64::max);
    let slow = 0.5 * board.force_limit / largest;
    let mut random = ChaCha8Rng::seed_from_u64(machine.simulation.seed);

    let mut single = LawState::REST;
    let states = exact.a.nrows();
    let [mut whole, mut of_noise] = [(); 2].map(|()| DVector::<f64>::zeros(states));
    let length = (WINDOW * board.sample_rate) as usize;
    let blank = || vec![[Complex::<f64>::ZERO; LEGS]; AT.len()];
    let mut powers = [[[0.0_f64; LEGS]; AT.len()]; 2];
    // The first window settles.
    for window in 0..=WINDOWS {
        let mut sums = [blank(), blank()];
        for k in 0..length {
            let time = (window * length + k) as f64 / board.sample_rate;
            let slow = slow * (TAU * slow_hz * time).sin();
            let noises: [f64; LEGS] = core::array::from_fn(|_| {
                let normal: f64 = StandardNormal.sample(&mut random);
                normal * noise
            });
            // The same numbers to both: what the step reads is single.
            let w: [f32; LEGS] = noises.map(|x| (x + slow) as f32);
            let y = DVector::from_iterator(LEGS, w.iter().map(|x| f64::from(*x)));
            let (found, _) = force(&law, &[f32::MAX; LEGS], &mut single, &w, &[0.0; LEGS]);
            let expected = &exact.c * &whole + &exact.d * &y;
            whole = &exact.a * whole + &exact.b * y;
            let n = DVector::from_column_slice(&noises);
            let by_noise = &exact.c * &of_noise + &exact.d * &n;
            of_noise = &exact.a * of_noise + &exact.b * n;
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
                    sums[0][i][leg] += turn * (f64::from(found[leg]) - expected[leg]);
                    sums[1][i][leg] += turn * by_noise[leg];
                }
            }
        }
        for (powers, sums) in powers.iter_mut().zip(sums) {
            for (powers, sums) in powers.iter_mut().zip(sums) {
                for (power, sum) in powers.iter_mut().zip(sums) {
                    *power += sum.norm_sqr();
                }
            }
        }
    }
    AT.iter()
        .enumerate()
        .filter(|(_, hz)| **hz < 0.5 * board.sample_rate)
        .map(|(i, &hz)| Rounding {
            hz,
            over_noise_db: (0..LEGS)
                .map(|leg| 10.0 * (powers[0][i][leg] / powers[1][i][leg]).log10())
                .fold(f64::MIN, f64::max),
        })
        .collect()
}
