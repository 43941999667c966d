//! The supervisor's part of the table: times as samples, and the answers that the self-test
//! expects.

use nalgebra::Complex;
use shared::LEGS;
use shared::supervisor::GENTLE;
use shared::table::{Phasor, SelfTest, Supervision};

use crate::machine::{Board, Machine, Sensor};
use crate::plant::SampledPlant;

/// Frequency of the self-test's sine over the highest natural frequency. Well above all modes the
/// frame answers as a free mass, so the answers depend little on payload, legs and damping.
const ABOVE: f64 = 6.0;

/// Settling time of the self-test over its measuring time.
const SETTLE: f64 = 0.4;

/// Noise of sensor and ADC, codes rms, below which a healthy sensor may repeat the same code for a
/// long time.
const QUIET: f64 = 0.3;

/// Smallest spike over the rms noise of sensor and ADC.
const SPIKE: f64 = 20.0;

/// Lower limit for the smallest spike, codes. In a shock the machine moves less than this from
/// sample to sample.
const LEAST_SPIKE: f64 = 48.0;

/// Answer to the pilot with the loop open, over the noise of the sensors in the measurement. The
/// margin is needed because the closed loop attenuates the answer, and DAC and floor add noise.
const AUDIBLE: f64 = 150.0;

/// The thresholds and times of the supervisor for `machine`. Times are rounded to samples.
pub fn supervision(machine: &Machine) -> Supervision {
    let s = &machine.supervision;
    let board = &machine.board;
    // Validation of the machine has checked that the times fit.
    let samples = |seconds: f64| (seconds * board.sample_rate).round() as u32;
    let quiet = board.fed_back().any(|sensor| noise(board, sensor) < QUIET);
    Supervision {
        ramp: f64::from(GENTLE).powf(-1.0 / (s.soft_start * board.sample_rate)) as f32,
        settle: samples(s.settle),
        safe_ramp: samples(s.safe_ramp),
        rail: samples(s.rail),
        stuck: samples(s.stuck.unwrap_or(if quiet { 0.0 } else { 0.1 })),
        spike: [Some(&board.sensor), board.beside.as_ref()].map(|kind| {
            let noise = kind.map_or(0.0, |sensor| noise(board, sensor));
            // The conversion saturates at the ends of the range.
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

/// Rounds to four digits: enough for the test, and the same on every processor.
fn rounded(x: f64) -> f32 {
    format!("{x:.3e}").parse().unwrap_or(0.0)
}

/// Noise of sensor and ADC, codes rms, as samples differ from each other: drift makes neither
/// spikes nor other codes in a moment, and the supervisor takes the mean out of its windows.
fn noise(board: &Board, sensor: &Sensor) -> f64 {
    codes(
        board,
        sensor,
        sensor.noise_density.between_samples(board.sample_rate),
    )
}

/// The noise of the ADC and that of the sensor with a white `density`, codes rms.
fn codes(board: &Board, sensor: &Sensor, density: f64) -> f64 {
    let own = density * (0.5 * board.sample_rate).sqrt() * sensor.sensitivity;
    own.hypot(board.adc_noise) / board.adc.lsb()
}

/// Noise of sensor and ADC, rms, in the unit of the sensor, as samples differ from each other.
pub(crate) fn sensor_noise(board: &Board, sensor: &Sensor) -> f64 {
    in_units(board, sensor, noise(board, sensor))
}

/// Codes in the unit of the sensor.
fn in_units(board: &Board, sensor: &Sensor, codes: f64) -> f64 {
    codes * (board.adc.lsb() / sensor.sensitivity.abs())
}

/// The self-test and the pilot for `machine`, with the answers of its sampled `plant`.
pub fn self_test(machine: &Machine, plant: &SampledPlant) -> SelfTest {
    let board = &machine.board;
    let s = &machine.supervision;
    let highest = plant.plant.poles.iter().map(|pole| pole.lambda.norm());
    let highest = highest.fold(0.0, f64::max) / core::f64::consts::TAU;
    let measure = (s.test_time * board.sample_rate).round();
    // A whole number of periods in the measurement, well below half the sample rate.
    let hz = (ABOVE * highest).min(0.2 * board.sample_rate);
    let periods = (hz * measure / board.sample_rate).round().max(1.0);
    let step = (periods / measure * 4_294_967_296.0).round();
    let hz = step / 4_294_967_296.0 * board.sample_rate;
    let gain = plant.response(hz).g22();
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
        let needed = board.fed_back().enumerate().map(|(kind, sensor)| {
            // Noise of n²/Hz at its frequency gives a phasor measured with a Hann window over T the variance
            // 3·n²/T.
            let codes = codes(board, sensor, sensor.noise_density.at(hz));
            let square = in_units(board, sensor, codes).powi(2) / (0.5 * board.sample_rate);
            let noise = (LEGS as f64 * 3.0 * square / s.pilot_time).sqrt();
            let rows = gain.rows(kind * LEGS, LEGS);
            let weakest = rows.column_iter().map(|leg| leg.norm());
            AUDIBLE * noise / weakest.fold(f64::INFINITY, f64::min)
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
