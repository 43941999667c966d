//! The supervisor's part of the table: times as samples, and what the self-test
//! must find.

use nalgebra::Complex;
use shared::LEGS;
use shared::supervisor::GENTLE;
use shared::table::{Phasor, SelfTest, Supervision};

use crate::machine::{Board, Machine, Sensor};
use crate::plant::SampledPlant;

/// Of the highest natural frequency: the self-test's sine lies clear above all
/// modes, where a sensor's answer is that of the frame as a free mass and hardly
/// hangs on payload, legs or damping.
const ABOVE: f64 = 6.0;

/// The self-test waits this part of the time it measures before it does.
const SETTLE: f64 = 0.4;

/// Sensor and ADC whose noise is less than this part of a code may give the same
/// code for long.
const QUIET: f64 = 0.3;

/// A spike is this many times what noise does, and at least so many codes: what the
/// machine itself does from sample to sample in a shock is less.
const SPIKE: f64 = 20.0;
const LEAST_SPIKE: f64 = 48.0;

/// The pilot's answer, without the loop, stands this far above the sensors' noise: the
/// loop takes most of it away, and lets DAC and floor add to the noise.
const AUDIBLE: f64 = 150.0;

/// When the supervisor of `machine` acts.
pub fn supervision(machine: &Machine) -> Supervision {
    let s = &machine.supervision;
    let board = &machine.board;
    // Checked with the file to fit.
    let samples = |seconds: f64| (seconds * board.sample_rate).round() as u32;
    let kinds = [Some(board.sensor), board.beside];
    let quiet = kinds
        .into_iter()
        .flatten()
        .any(|sensor| noise(board, sensor) < QUIET);
    Supervision {
        ramp: f64::from(GENTLE).powf(-1.0 / (s.soft_start * board.sample_rate)) as f32,
        settle: samples(s.settle),
        safe_ramp: samples(s.safe_ramp),
        rail: samples(s.rail),
        stuck: samples(s.stuck.unwrap_or(if quiet { 0.0 } else { 0.1 })),
        spike: kinds.map(|kind| {
            let noise = kind.map_or(0.0, |sensor| noise(board, sensor));
            // Held at the ends.
            let least = (SPIKE * noise).max(LEAST_SPIKE) as u16;
            s.spike.unwrap_or(least)
        }),
        spikes: s.spikes,
        lost: s.lost,
        late: s.late,
        saturated: samples(s.saturated.unwrap_or(1.0 / machine.target.frequency)),
        silence: samples(s.silence),
        window: samples(s.window),
        growth: s.growth as f32,
        grown: s.grown,
        level: s.level as f32,
        wild: s.wild as f32,
        dull: s.dull as f32,
        strange: s.strange,
    }
}

/// Four digits: enough for a test, and the same on every processor.
fn rounded(x: f64) -> f32 {
    format!("{x:.3e}").parse().unwrap_or(0.0)
}

/// Of sensor and ADC, rms, codes.
fn noise(board: &Board, sensor: Sensor) -> f64 {
    let own = sensor.noise_density * (0.5 * board.sample_rate).sqrt() * sensor.sensitivity;
    own.hypot(board.adc_noise) / board.adc.lsb()
}

/// The self-test of `machine` with what `plant` answers.
pub fn self_test(machine: &Machine, plant: &SampledPlant) -> SelfTest {
    let board = &machine.board;
    let s = &machine.supervision;
    let highest = plant.plant.poles.iter().map(|pole| pole.lambda.norm());
    let highest = highest.fold(0.0, f64::max) / core::f64::consts::TAU;
    let measure = (s.test_time * board.sample_rate).round();
    // Whole periods, and well below half the sample rate.
    let hz = (ABOVE * highest).min(0.2 * board.sample_rate);
    let periods = (hz * measure / board.sample_rate).round().max(1.0);
    let step = (periods / measure * 4_294_967_296.0).round();
    let gain = plant
        .response(step / 4_294_967_296.0 * board.sample_rate)
        .g22();
    let answers = |first: usize| {
        core::array::from_fn(|leg| {
            core::array::from_fn(|sensor| {
                let answer = gain.get((first + sensor, leg)).copied();
                let Complex { re, im } = answer.unwrap_or(Complex::ZERO);
                Phasor {
                    re: rounded(re),
                    im: rounded(im),
                }
            })
        })
    };
    let watch = (s.pilot_time * board.sample_rate).round();
    let pilot = s.pilot.unwrap_or_else(|| {
        let kinds = [Some(board.sensor), board.beside];
        let needed = kinds.into_iter().enumerate().filter_map(|(kind, sensor)| {
            // A phasor in a Hann window: 3·n²/T of white noise n²/Hz.
            let sensor = sensor?;
            let lsb = board.adc.lsb() / sensor.sensitivity.abs();
            let square = (noise(board, sensor) * lsb).powi(2) / (0.5 * board.sample_rate);
            let noise = (LEGS as f64 * 3.0 * square / s.pilot_time).sqrt();
            let rows = gain.rows(kind * LEGS, LEGS);
            let weakest = rows.column_iter().map(|leg| leg.norm());
            Some(AUDIBLE * noise / weakest.fold(f64::INFINITY, f64::min))
        });
        needed
            .fold(0.0, f64::max)
            .min(s.test_force * board.force_limit)
    });
    SelfTest {
        step: step as u32,
        amplitude: (s.test_force * board.force_limit) as f32,
        settle: (SETTLE * measure) as u32,
        measure: measure as u32,
        pilot: rounded(pilot),
        watch: watch as u32,
        tolerance: s.test_tolerance as f32,
        sensors: answers(0),
        forces: answers(LEGS),
    }
}
