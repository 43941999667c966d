//! Machines that are not their file: what is fitted to their responses is them.

use core::f64::consts::FRAC_1_SQRT_2;

use host_gen::board::measure::{MeasuredLine, Measurement, Pass, Resonance};
use host_gen::design::Study;
use host_gen::identify::{
    FitError, Identification, Parameter, Quantity, Scale, changed, fit, fitted_file, parameters,
};
use host_gen::machine::Machine;
use nalgebra::Complex;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use rand_distr::{Distribution as _, StandardNormal};
use shared::LEGS;

use crate::common::{edited, parse};

/// The flexible machine has so many modes, and all are measured.
const MODES: usize = 12;

/// Changes with these standard deviations, evenly distributed; none of the delay, which is not the
/// machine's.
fn drawn(parameters: &[Parameter], random: &mut ChaCha8Rng) -> Vec<f64> {
    let mut uniform = || (random.next_u64() >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
    let change = |p: &Parameter| match p.quantity {
        Quantity::Delay => 0.0,
        _ => 3f64.sqrt() * p.deviation * uniform(),
    };
    parameters.iter().map(change).collect()
}

/// What would be measured on `truth`, with relative errors of 20 % below 10 Hz and 3 % above it: at the
/// lines of a first pass, and at those around its modes.
fn measured(truth: &Study, random: &mut ChaCha8Rng) -> Measurement {
    let band = [0.5, 500.0];
    let resonance = |hz: &f64| Resonance {
        hz: *hz,
        damping: 0.005,
    };
    let resonances: Vec<_> = truth
        .model()
        .modes()
        .hertz()
        .iter()
        .map(resonance)
        .collect();
    let mut hertz = Pass::first(20e3, band).unwrap().hertz();
    hertz.extend(Pass::second(20e3, band, &resonances).unwrap().hertz());
    hertz.sort_by(f64::total_cmp);
    let line = |hz: f64| {
        let plant = truth.plant().response(hz).g22();
        let relative = if hz < 10.0 { 0.2 } else { 0.03 };
        // Of each kind of sensors by itself.
        let deviation = |i: usize| {
            let kind = plant.rows(i / LEGS * LEGS, LEGS);
            relative * kind.norm() / (kind.len() as f64).sqrt()
        };
        let mut noise = || -> f64 { StandardNormal.sample(random) };
        let mut part = |i: usize, x: f64| x + deviation(i) * FRAC_1_SQRT_2 * noise();
        let mut entry = |i, j| [part(i, plant[(i, j)].re), part(i, plant[(i, j)].im)];
        MeasuredLine {
            hz,
            amplitude: 1.0,
            plant: (0..plant.nrows())
                .map(|i| core::array::from_fn(|j| entry(i, j)))
                .collect(),
            deviation: (0..plant.nrows()).map(|i| [deviation(i); LEGS]).collect(),
            covariance: (0..plant.nrows())
                .map(|i| {
                    let own = |j| if i == j { deviation(i).powi(2) } else { 0.0 };
                    (0..plant.nrows()).map(|j| [own(j), 0.0]).collect()
                })
                .collect(),
            model: Vec::new(),
            error: 0.0,
            expected_error: 0.0,
            sensitivity: None,
        }
    };
    Measurement {
        resonances: Vec::new(),
        lines: hertz.into_iter().map(line).collect(),
    }
}

fn modes(machine: &Machine) -> Vec<f64> {
    let study = Study::new(machine.clone()).unwrap();
    study.model().modes().hertz()
}

#[test]
fn a_machine_that_is_not_its_file_is_found() {
    let [mut held, mut all] = [0, 0];
    for feedback in ["\"acceleration\"", "\"force\"", "\"both\""] {
        let text = edited(&[("control.feedback", feedback), ("control.law", "\"modal\"")]);
        let machine = parse(&text).unwrap();
        let parameters = parameters(&machine, MODES);
        for seed in 0..2 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let changes = drawn(&parameters, &mut random);
            let truth = Study::new(changed(&machine, &parameters, &changes)).unwrap();
            let found = fit(&machine, &measured(&truth, &mut random), &()).unwrap();
            // 64 lines with 36 complex entries, and eighty quantities: 1 % of scatter.
            assert!(
                (found.relative_misfit - 1.0).abs() < 0.05,
                "{}",
                found.relative_misfit
            );
            assert!(found.unexplained.is_empty() && found.strange.is_empty());
            let modes = [&found.machine, truth.machine()].map(modes);
            for (found, truth) in modes[0].iter().zip(&modes[1]) {
                assert!((found / truth - 1.0).abs() < 1e-3, "{found} {truth}");
            }
            for (estimate, change) in found.estimates.iter().zip(&changes) {
                let change = match estimate.scale {
                    Scale::Relative => change.exp_m1(),
                    _ => *change,
                };
                let inside = (estimate.change - change).abs() <= estimate.interval;
                (held, all) = (held + usize::from(inside), all + 1);
            }
            fitted_file_is_the_fitted_machine(&text, &machine, &found);
        }
    }
    // 95 %. Scale of masses, stiffnesses and gains together is one quantity for a quarter of them, so
    // the scatter is that of about twenty independent ones for each machine.
    let part = f64::from(held as u32) / f64::from(all as u32);
    assert!((0.89..1.0).contains(&part), "{held} of {all}");
}

/// The file that is written, read again, has the responses of the fitted machine: in its units, as the
/// table corrects known gains.
fn fitted_file_is_the_fitted_machine(text: &str, machine: &Machine, found: &Identification) {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("base.toml");
    std::fs::write(&base, text).unwrap();
    let fitted = fitted_file(machine, found, "base.toml", "fitted", "a test");
    let path = folder.path().join("fitted.toml");
    std::fs::write(&path, fitted).unwrap();
    let read = Study::new(Machine::load(&path).unwrap()).unwrap();
    let fitted = Study::new(found.machine.clone()).unwrap();
    let gains = &read.machine().board.gains;
    for hz in [1.0, 8.0, 14.0, 25.0, 60.0, 90.0, 300.0] {
        let [mut read, fitted] = [&read, &fitted].map(|study| study.plant().response(hz).g22());
        for i in 0..read.nrows() {
            for j in 0..LEGS {
                read[(i, j)] *= gains.sensors[i / LEGS][i % LEGS] * gains.actuators[j];
            }
        }
        // Seven digits are written; resonances amplify what is lost a hundredfold.
        assert!((read - &fitted).norm() < 1e-4 * fitted.norm(), "{hz} Hz");
    }
}

/// All parts that are uncertain get into the file: springs, point masses, beams by material and
/// section, dampers and loss factors.
#[test]
fn a_fitted_file_has_all_parts() {
    let text = edited(&[
        (
            "springs.stop",
            "{ nodes = [\"n9\", \"n3\"], stiffness = [1e5, 2e5, -1e4], rotational_stiffness = [1e3, 0.0, 0.0], damper = [10.0, 20.0, 30.0], loss_factor = 0.01 }",
        ),
        (
            "point_masses.weight",
            "{ node = \"lens15\", mass = 5.0, inertia = [0.1, 0.1, 0.1] }",
        ),
        (
            "profiles.leg",
            "{ youngs_modulus = 2.1e11, shear_modulus = 8e10, area = 1.13e-5, second_moments = [5e-10, 5e-10], torsion_constant = 2e-11, density = 7800.0, loss_factor = 0.01 }",
        ),
        ("damping.rayleigh", "[0.1, 1e-6]"),
    ]);
    let machine = parse(&text).unwrap();
    let parameters = parameters(&machine, MODES);
    for quantity in [
        Quantity::Spring(0),
        Quantity::PointMass(0),
        Quantity::Damping,
    ] {
        assert!(parameters.iter().any(|p| p.quantity == quantity));
    }
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let changes = drawn(&parameters, &mut random);
    let truth = Study::new(changed(&machine, &parameters, &changes)).unwrap();
    let found = fit(&machine, &measured(&truth, &mut random), &()).unwrap();
    assert_eq!(found.unexplained, [0.0; 0]);
    fitted_file_is_the_fitted_machine(&text, &machine, &found);
}

/// Swapped and reversed sensors and legs are named, and nothing is fitted.
#[test]
fn other_wiring_is_named() {
    let machine = parse(&edited(&[])).unwrap();
    let parameters = parameters(&machine, MODES);
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let changes = drawn(&parameters, &mut random);
    let truth = Study::new(changed(&machine, &parameters, &changes)).unwrap();
    let mut measurement = measured(&truth, &mut random);
    for line in &mut measurement.lines {
        // Sensors x3, z3, y5, z5, z7, y7 and legs 4 to 9.
        line.plant.swap(1, 3);
        for row in &mut line.plant {
            row[5] = row[5].map(|x| -x);
        }
    }
    let error = fit(&machine, &measurement, &()).unwrap_err();
    let FitError::Wiring(mistakes) = error else {
        panic!("{error}");
    };
    assert_eq!(
        mistakes,
        [
            "accelerometer z3 and accelerometer z5 are swapped",
            "the drive of leg9 is reversed"
        ]
    );
}

/// A resonance that the file has not is named, and the model does not explain it.
#[test]
fn what_the_model_has_not_is_named() {
    let machine = parse(&edited(&[])).unwrap();
    let truth = Study::new(machine.clone()).unwrap();
    let mut measurement = measured(&truth, &mut ChaCha8Rng::seed_from_u64(1));
    for line in &mut measurement.lines {
        let x = line.hz / 50.0;
        let resonance = Complex::from(2e-4 * x * x) / Complex::new(1.0 - x * x, 0.02 * x);
        for row in &mut line.plant {
            row[2][0] += resonance.re;
            row[2][1] += resonance.im;
        }
    }
    let found = fit(&machine, &measurement, &()).unwrap();
    assert!(found.unexplained.iter().any(|hz| (hz - 50.0).abs() < 5.0));
    let [strange] = found.strange[..] else {
        panic!("{:?}", found.strange);
    };
    assert!((strange.hz - 50.0).abs() < 0.5, "{strange:?}");
    let text = found.to_string();
    assert!(text.contains("a resonance at"), "{text}");
    assert!(text.contains("does not explain the measurement"), "{text}");
}

#[test]
fn what_cannot_be_fitted_says_why() {
    let machine = parse(&edited(&[])).unwrap();
    let study = Study::new(machine.clone()).unwrap();
    let good = measured(&study, &mut ChaCha8Rng::seed_from_u64(1));
    let mut noisy = good.clone();
    for line in &mut noisy.lines {
        for x in line.deviation.as_flattened_mut() {
            *x *= 20.0;
        }
    }
    let mut short = good.clone();
    for line in &mut short.lines {
        line.plant.truncate(5);
    }
    let none = Measurement {
        lines: Vec::new(),
        ..good
    };
    let error = |measurement: &Measurement| fit(&machine, measurement, &()).unwrap_err();
    assert_eq!(error(&noisy), FitError::Few(0));
    let sensors = |measured| FitError::Sensors { measured, model: 6 };
    assert_eq!(error(&short), sensors(5));
    assert_eq!(error(&none), sensors(0));
}
