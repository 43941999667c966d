//! Sensor noise over frequency: in the noise budget, in the simulation, and in the thresholds.

use core::f64::consts::TAU;

use host_gen::closed_loop::budget::budget;
use host_gen::control::LinearLaw;
use host_gen::control::supervision::{self_test, supervision};
use host_gen::design::Study;
use host_gen::floor::Floor;
use host_gen::machine::{NoiseDensity, Simulation};
use host_gen::simulate::Rig;
use nalgebra::{Complex, Matrix6};
use shared::LEGS;

use crate::common::{edited, looped, parse};

/// Twenty times the noise of a Meggitt 86, 37, 7 and 3 ng/√Hz at 1, 10 and 100 Hz, and a rise.
const POINTS: [(f64, f64); 4] = [
    (1.0, 7.26e-6),
    (10.0, 1.37e-6),
    (100.0, 5.9e-7),
    (3e3, 2e-6),
];

/// The line through the points, from the logarithms to base 10.
fn density(hz: f64) -> f64 {
    let hz = hz.clamp(POINTS[0].0, POINTS[3].0);
    let above = POINTS.iter().position(|(f, _)| *f >= hz).unwrap().max(1);
    let [(f0, d0), (f1, d1)] = [POINTS[above - 1], POINTS[above]];
    let part = (hz / f0).log10() / (f1 / f0).log10();
    10f64.powf(d0.log10() * (1.0 - part) + d1.log10() * part)
}

fn table() -> String {
    let points = POINTS.map(|(hz, density)| format!("[{hz:?}, {density:?}]"));
    format!("[{}]", points.join(", "))
}

fn noisy(edits: &[(&str, &str)]) -> String {
    let table = table();
    let noise = ("board.accelerometer.noise_density", &*table);
    edited(&[&[noise], edits].concat())
}

/// Welch's estimate at frequencies that lie `rate`/`length` apart: segments of that length under
/// Hann's window, each half over the next.
fn welch(signal: &[f64], rate: f64, length: usize, bins: &[usize]) -> Vec<f64> {
    let hann = |k: usize| {
        (core::f64::consts::PI * k as f64 / length as f64)
            .sin()
            .powi(2)
    };
    let energy: f64 = (0..length).map(|k| hann(k).powi(2)).sum();
    let starts: Vec<_> = (0..=signal.len() - length).step_by(length / 2).collect();
    let power = |bin: usize| {
        let turn = Complex::cis(-TAU * bin as f64 / length as f64);
        let of_segment = |&start: &usize| {
            let mut phase = Complex::new(1.0, 0.0);
            let mut sum = Complex::new(0.0, 0.0);
            for k in 0..length {
                sum += phase * (hann(k) * signal[start + k]);
                phase *= turn;
            }
            sum.norm_sqr()
        };
        let mean = starts.iter().map(of_segment).sum::<f64>() / starts.len() as f64;
        2.0 * mean / (rate * energy)
    };
    bins.iter().map(|&bin| power(bin)).collect()
}

/// The codes of a machine at rest have the spectrum of the table, in every channel, and the
/// channels are independent.
#[test]
fn the_simulation_has_the_spectrum_of_the_table() {
    let machine = parse(&noisy(&[
        ("board.accelerometer.sensitivity", "2e3"),
        ("board.adc.noise", "0.0"),
        ("board.dac.noise", "0.0"),
    ]));
    let study = Study::new(machine.unwrap()).unwrap();
    let board = &study.machine().board;
    let settings = Simulation {
        floor_rms: 0.0,
        ..study.machine().simulation
    };
    let mut rig = Rig::new(study.plant().clone(), board, &settings);
    let rate = board.sample_rate;
    let count = 1 << 21;
    let mut signals = [const { Vec::new() }; LEGS];
    for _ in 0..count {
        let codes = rig.sample().sensors;
        for (signal, code) in signals.iter_mut().zip(codes) {
            let volts = f64::from(code.0) * board.adc.lsb() - board.sensor.offset;
            signal.push(volts / board.sensor.sensitivity);
        }
    }
    // Segments long enough for the lowest frequencies, and more of them for the others.
    for (length, bins, tolerance) in [
        (1 << 17, vec![7, 10, 13, 20, 30], 0.12),
        (1 << 12, vec![10, 20, 41, 205, 614, 1200], 0.035),
    ] {
        let expected: Vec<_> = bins
            .iter()
            .map(|bin| density(*bin as f64 * rate / length as f64))
            .collect();
        let mut mean = vec![0.0; bins.len()];
        for signal in &signals {
            let powers = welch(signal, rate, length, &bins);
            for (mean, power) in mean.iter_mut().zip(powers) {
                *mean += power / LEGS as f64;
            }
        }
        for ((bin, expected), power) in bins.iter().zip(expected).zip(mean) {
            let ratio = power.sqrt() / expected;
            assert!((ratio - 1.0).abs() < tolerance, "{length} {bin}: {ratio}");
        }
    }
    // The whole power, of each channel, and none in common.
    let power = |a: &[f64], b: &[f64]| {
        let products = a.iter().zip(b).map(|(a, b)| a * b);
        products.sum::<f64>() / count as f64
    };
    let expected: f64 = (0..100_000)
        .map(|i| density((f64::from(i) + 0.5) * 0.1).powi(2) * 0.1)
        .sum();
    for (i, a) in signals.iter().enumerate() {
        let ratio = power(a, a) / expected;
        assert!((ratio - 1.0).abs() < 0.01, "{i}: {ratio}");
        let next = &signals[(i + 1) % LEGS];
        let common = power(a, next) / expected;
        assert!(common.abs() < 0.02, "{i}: {common}");
    }
}

/// The sensors' part of the noise budget is the integral of |from sensors to output|² times the
/// table's square, here by the trapezium rule on a fine grid.
#[test]
fn the_noise_budget_takes_the_table() {
    let (_, table, _) = looped(&edited(&[("damping.modal", "0.1")]));
    let study = Study::new(parse(&noisy(&[("damping.modal", "0.1")])).unwrap()).unwrap();
    let plant = study.plant();
    let board = &study.machine().board;
    let band = [0.3, 300.0];
    let found = budget(plant, board, Some(table), &Floor::White(0.0), band, None).unwrap();
    let law = LinearLaw::new(table);
    let count = 40_000;
    let at = |i: i32| band[0] * (band[1] / band[0]).powf(f64::from(i) / f64::from(count));
    let mut sums = [0.0; LEGS];
    let mut before: Option<(f64, [f64; LEGS])> = None;
    for hz in (0..=count).map(at) {
        let response = plant.response(hz);
        let controller = law.response(plant.z(hz));
        let one = Matrix6::<Complex<f64>>::identity();
        let loops = one - &controller * response.g22();
        let from_sensors = response.from_legs(plant.plant.performance())
            * loops.try_inverse().unwrap()
            * controller;
        let powers: [f64; LEGS] =
            core::array::from_fn(|row| from_sensors.row(row).norm_squared() * density(hz).powi(2));
        if let Some((last, last_powers)) = before {
            for ((sum, a), b) in sums.iter_mut().zip(last_powers).zip(powers) {
                *sum += 0.5 * (a + b) * (hz - last);
            }
        }
        before = Some((hz, powers));
    }
    for (row, sum) in sums.into_iter().enumerate() {
        let sensors = found.power(&found.performance[row])[1];
        assert!((sensors / sum - 1.0).abs() < 1e-4, "{row}: {sensors} {sum}");
    }
    // The table's points are nodes' ends: no interval has one inside.
    let of_white = {
        let mut board = board.clone();
        board.sensor.noise_density = NoiseDensity::white(1e-6);
        budget(plant, &board, Some(table), &Floor::White(0.0), band, None).unwrap()
    };
    assert!(found.hz.len() > of_white.hz.len());
}

/// A table of one density is white noise; drift makes neither spikes nor a louder pilot.
#[test]
fn the_supervisor_takes_a_figure_for_each_use() {
    let limits = |noise: &str| {
        let text = edited(&[("board.accelerometer.noise_density", noise)]);
        let study = Study::new(parse(&text).unwrap()).unwrap();
        let machine = study.machine();
        (supervision(machine), self_test(machine, study.plant()))
    };
    let white = limits("2e-5");
    assert_eq!(limits("[[1.0, 2e-5], [100.0, 2e-5]]"), white);
    // Louder below 1 Hz only.
    assert_eq!(limits("[[0.1, 2e-3], [1.0, 2e-5]]"), white);
    // At the pilot's frequency: twice the noise above it takes twice the force.
    let rising = limits("[[200.0, 2e-5], [300.0, 4e-5]]");
    let ratio = rising.1.pilot / white.1.pilot;
    assert!((ratio - 2.0).abs() < 0.05, "{ratio}");
    assert!((f64::from(rising.0.spike[0]) / f64::from(white.0.spike[0]) - 2.0).abs() < 0.05);
}

#[test]
fn wrong_tables_are_refused() {
    for (noise, entry, says) in [
        ("[[1.0, 1e-7]]", "", "at least two points"),
        ("[]", "", "at least two points"),
        ("[[0.0, 1e-7], [1.0, 1e-7]]", "[0][0]", "above 0 Hz, not 0"),
        (
            "[[10.0, 1e-7], [1.0, 1e-7]]",
            "[1][0]",
            "1 Hz comes after 10 Hz",
        ),
        (
            "[[1.0, 1e-7], [1.0, 2e-7]]",
            "[1][0]",
            "1 Hz comes after 1 Hz",
        ),
        (
            "[[1.0, 0.0], [10.0, 1e-7]]",
            "[0][1]",
            "above 0 on logarithmic axes",
        ),
        (
            "[[1.0, 1e-7], [10.0, -1e-7]]",
            "[1][1]",
            "above 0 on logarithmic axes",
        ),
        (
            "[[1.0, 1e-7], [10.0, 1e9]]",
            "[1][1]",
            "at most 1e3 m/s²/√Hz",
        ),
        ("[[1.0, 1e-7], [1e12, 1e-7]]", "[1][0]", "1e-6 to 1e8 Hz"),
        ("[1.0, 1e-7]", "", "a table [[hz, density], …]"),
        ("\"loud\"", "", "a table [[hz, density], …]"),
        ("-1e-7", "", "at least 0"),
    ] {
        let text = edited(&[("board.accelerometer.noise_density", noise)]);
        let error = parse(&text).unwrap_err();
        let entry = format!("board.accelerometer.noise_density{entry}");
        assert_eq!(error.entry(), entry, "{noise}: {error}");
        assert!(error.to_string().contains(says), "{noise}: {error}");
        assert!(error.place().is_some(), "{noise}: {error}");
    }
}

/// The description of a machine keeps what its file says.
#[test]
fn the_digest_covers_the_table() {
    let digest = |noise: &str| {
        let text = edited(&[("board.accelerometer.noise_density", noise)]);
        parse(&text).unwrap().digest
    };
    assert_eq!(digest("1e-7"), parse(&edited(&[])).unwrap().digest);
    assert_ne!(digest("[[1.0, 1e-7], [2.0, 1e-7]]"), digest("1e-7"));
    assert_ne!(
        digest("[[1.0, 1e-7], [2.0, 1e-7]]"),
        digest("[[1.0, 1e-7], [2.0, 2e-7]]")
    );
}
