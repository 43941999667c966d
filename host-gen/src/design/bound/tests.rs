use core::f64::consts::TAU;
use std::path::Path;

use super::*;
use crate::closed_loop::SampledLoop;
use crate::closed_loop::budget::budget;
use crate::control::gains::ModalTransform;
use crate::design::{Design, Search};
use crate::machine::Machine;
use crate::numeric::six::ComplexMatrix6;
use crate::plant::Gain;

/// |S| ≤ ε up to the angle a and |S| ≤ M above: Bode's integral allows ε = M^(1 − π/a), and no
/// less.
#[test]
fn bodes_integral_is_found() {
    let period = 1e-3;
    let highest = 0.5 / period;
    for (edge, most) in [(0.2, 2.0_f64), (0.05, 1.3), (0.4, 4.0)] {
        let edge = edge * highest;
        let samples = |per_decade: f64| -> Vec<Sample> {
            let breaks = divided(&[1e-3, edge, highest], per_decade);
            let mut at = nodes(&breaks, &[Complex::new(edge, 0.01 * edge)], |_| 0.0);
            at.push((0.5e-3, 1e-3));
            let sample = |(hz, weight): (f64, f64)| {
                let low = hz < edge;
                Sample {
                    z: Complex::cis(TAU * hz * period),
                    weight: weight / highest,
                    limits: vec![Limit {
                        centre: Complex::ONE,
                        kept: if low { 0.0 } else { most },
                        scaled: if low { 1.0 } else { 0.0 },
                    }],
                }
            };
            at.into_iter().map(sample).collect()
        };
        let lags = (0..25).map(|k| Resonance {
            hz: 0.45 * highest * 0.8_f64.powi(k),
            damping: 1.0,
        });
        let sharp = (1..5).map(|k| Resonance {
            hz: edge,
            damping: 4.0_f64.powi(-k),
        });
        let poles: Vec<_> = lags.chain(sharp).collect();
        let function = TestFunction::with_poles(0, &poles, period);
        let found = certificate(function, &samples(20.0), &[samples(200.0), samples(400.0)]);
        let found = found.expect("a bound is found");
        let exact = 20.0 * (1.0 - highest / edge) * most.log10();
        // Of what a finite sum cannot follow at the edge, where the best Φ jumps, a few per cent.
        let short = exact - found.db;
        assert!(
            short > -1e-3 && short < 0.04 * exact.abs(),
            "{} of {exact}",
            found.db
        );
        assert!(found.grid_db < 1e-2, "{}", found.grid_db);
    }
}

/// The paper's machine with this line in `[control]`.
fn paper(roll_off: &str) -> Study {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
    let text = std::fs::read_to_string(folder.join("metrology-frame.toml"));
    let text = text.expect("the model is there");
    let text = text.replace("[control]", &format!("[control]\n{roll_off}"));
    let machine = Machine::parse(Path::new("metrology-frame.toml"), &text);
    Study::new(machine.expect("the file is valid")).expect("the model is valid")
}

/// T of the modes in modal coordinates at `hz`, by the matrices of plant and law.
fn complementary(study: &Study, design: &Design, hz: f64) -> ComplexMatrix6 {
    let sampled = SampledLoop::new(study.plant(), &design.table);
    let output = ModalTransform::new(study.design_model()).output;
    let output = output.map(Complex::from);
    let c = sampled.law.response(study.plant().z(hz));
    let l = -(c * study.plant().response(hz).g22());
    let inverse = output.try_inverse().expect("modes are independent");
    let l = inverse * l * output;
    let one = ComplexMatrix6::identity();
    one - (one + l).try_inverse().expect("the loop has no pole here")
}

/// A loop that a search found, of a machine with a roll-off: its t is orthogonal to each
/// certificate's Φ, lies within all limits at the levels that it reaches, and so these are above
/// the bound.
#[test]
fn a_loop_is_orthogonal_and_within_its_limits() {
    let study = paper("roll_off = { hz = 1000, order = 2 }");
    let design = Search::FULL.design(&study).expect("it is reached");
    let roll_off = study.machine().target.roll_off;
    let bounds = Bounds::new(&study, roll_off).expect("the zeros converge");
    let db: Vec<_> = design.bands.iter().map(|band| band.sampled_db).collect();
    let levels: Vec<_> = db.iter().copied().map(Some).collect();
    let found = bounds.of(Asked::Bands(&levels));
    let linear: Vec<_> = db.iter().map(|db| Some(factor(*db))).collect();
    let mut certified = 0;
    for (mode, prepared) in found.iter().zip(&bounds.modes) {
        let k = mode.mode - 1;
        let t: Vec<_> = prepared.fine[1]
            .iter()
            .map(|(z, ..)| complementary(&study, &design, z.arg() / TAU / study.plant().period))
            .map(|t| t[(k, k)])
            .collect();
        for ((z, _, seen), t) in prepared.fine[1].iter().zip(&t) {
            for controllers in [Controllers::Modal, Controllers::Any] {
                let question = Question::Bands(&linear);
                for limit in bounds.limits.limits(seen, controllers, question) {
                    let disc = limit.at(1.0);
                    // Rounding of the table, and peaks between the points of the design's grid.
                    let room = 1.001 * disc.radius + 1e-6 * disc.centre.norm();
                    let apart = (t - disc.centre).norm();
                    let hz = z.arg() / TAU / study.plant().period;
                    assert!(
                        apart < room,
                        "mode {k} {controllers:?} at {hz} Hz: {apart} > {room} {limit:?}"
                    );
                }
            }
        }
        let ByControllers { modal, any } = &mode.found;
        for certificate in [modal, any].into_iter().flatten() {
            certified += 1;
            assert!(certificate.db < 0.0);
            let phi = |z: &Complex<f64>| certificate.function.at(*z);
            let grid = prepared.fine[1].iter().zip(&t);
            let (mut sum, mut size) = (0.0, 0.0);
            for ((z, weight, _), t) in grid {
                let part = phi(z) * t * *weight;
                sum += part.re;
                size += part.norm();
            }
            assert!(sum.abs() < 1e-4 * size, "{sum} of {size}");
        }
    }
    // The vertical and the yaw mode couple to no other: both kinds of controllers are bounded.
    assert!(certified >= 4, "{certified}");
    for number in [3, 6] {
        let mode = found.iter().find(|mode| mode.mode == number);
        let found = &mode.expect("the mode is bounded").found;
        let [modal, any] = [&found.modal, &found.any].map(|found| {
            let found = found.as_ref().expect("a certificate is found");
            assert!(found.grid_db < 0.1);
            found.db
        });
        // More controllers can do more.
        assert!(any <= modal);
    }
}

/// The requirements of a loop that exists are not said to be impossible; those that ask for
/// T below 1 where S below 1/√2 needs it above are.
#[test]
fn only_what_is_impossible_is_certified() {
    let study = paper("roll_off = { hz = 1000, order = 2 }");
    let found = widening(&study).expect("the zeros converge");
    assert!(found.modal.is_none() && found.any.is_none());
    let study = paper("roll_off = { hz = 30, order = 2 }");
    let found = widening(&study).expect("the zeros converge");
    assert!(found.any.is_some_and(|factor| factor > 1.5));
    // No bound without one of the limits, and none with both kinds of sensors.
    let study = paper("");
    assert!(widening(&study).expect("the zeros converge").any.is_none());
}

/// A motion x₊ = a·x + w with white w of power 1, measured with white noise of power `noise`: what a
/// force of `delay` samples leaves of it at least. The lower bounds on two grids.
fn predicted(a: f64, noise: f64, delay: usize, sensitivity: f64) -> [f64; 2] {
    let pattern = Pattern::new(&[vec![0]]);
    let points = |count: u32| -> Vec<Point> {
        let point = |k: u32| {
            let z = Complex::cis(0.5 * TAU * (f64::from(k) + 0.5) / f64::from(count));
            let moved = (1.0 - a / z).inv();
            let row = |entries: &[Complex<f64>], rows: usize| {
                let mut gain = Gain::zeros(rows);
                for (j, entry) in entries.iter().enumerate() {
                    gain[(0, j)] = *entry;
                }
                gain
            };
            let measured = row(&[moved, noise.sqrt().into()], LEGS);
            let (direct, force) = (row(&[moved], 1), row(&[Complex::ONE], 1));
            Point {
                z,
                weight: f64::from(count).recip(),
                ball: Ball::new(sensitivity, f64::INFINITY),
                motion: Some(Quadratic::new(
                    &pattern,
                    1.0,
                    &[direct],
                    &force,
                    &[measured],
                )),
            }
        };
        (0..count).map(point).collect()
    };
    let lag = |hz: f64| Resonance { hz, damping: 1.0 };
    let poles = [-a.ln() / TAU, 0.05, 0.15].map(lag);
    let function = TestFunction::with_poles(delay - 1, &poles, 1.0);
    let found = certified(
        &pattern,
        function,
        &points(300),
        &[points(400), points(800)],
    );
    found.expect("a bound is found").squares
}

/// Without other limits, the bound is what Kalman's predictor leaves: the variance of its error one
/// sample ahead by Riccati's equation, and from sample to sample that of w more.
#[test]
fn kalmans_predictor_is_found() {
    for (a, noise, delay) in [
        (0.9, 0.3_f64, 1),
        (0.9, 1e-3, 2),
        (0.95, 2.0, 3),
        (0.5, 0.1, 2),
    ] {
        let mut exact = 1.0;
        for _ in 0..10_000 {
            exact = a * a * exact * noise / (exact + noise) + 1.0;
        }
        for _ in 1..delay {
            exact = a * a * exact + 1.0;
        }
        for found in predicted(a, noise, delay, 1e3) {
            let part = found / exact;
            // What the barrier and the verification leave.
            assert!(
                part < 1.0 + 1e-6 && part > 0.995,
                "{a} {noise} {delay}: {part}"
            );
        }
    }
}

/// The lower the peak sensitivity may be, the less is possible; with S = 1, nothing is.
#[test]
fn the_mean_square_falls_with_the_peak_sensitivity() {
    let of = |sensitivity: f64| predicted(0.95, 1e-2, 2, sensitivity)[1];
    let found = [1.0001, 1.1, 1.3, 1.6, 100.0].map(of);
    assert!(found.is_sorted_by(|a, b| *a > 1.003 * b), "{found:?}");
    let open = (1.0 - 0.95_f64.powi(2)).recip();
    assert!(
        found[0] < open && found[0] > 0.95 * open,
        "{found:?} {open}"
    );
}

/// A ball has what keeps both limits, and it is one of the two if that lies within the other.
#[test]
fn a_ball_has_what_keeps_both_limits() {
    for (s, t) in [
        (2.0, 1.0),
        (1.5, 1.3),
        (1.2, 1.0),
        (1.2, 0.9),
        (1.3, 2.0),
        (2.0, 0.1),
    ] {
        let inside = |ball: Ball, x: Complex<f64>| {
            let pattern = Pattern::new(&[vec![0], vec![1]]);
            let point = Point {
                z: Complex::ONE,
                weight: 1.0,
                ball,
                motion: None,
            };
            // −Re(phi·t) at the point of the ball that is farthest in the direction of `x` − 0.5.
            let phi = -(x - 0.5).conj() / (x - 0.5).norm();
            let phi = DVector::from_element(2, phi);
            let least = point.least(&pattern, &phi, 0.0);
            2.0 * (phi[0] * x).re >= least - 1e-9
        };
        for k in 0..2000 {
            let turn = Complex::cis(TAU * 0.618_034 * f64::from(k));
            let x = turn * (t * f64::from(k) / 2000.0);
            if (x - 1.0).norm() <= s {
                assert!(inside(Ball::new(s, t), x), "{s} {t} {x}");
            }
        }
    }
    assert_eq!(Ball::new(2.0, 0.5), Ball::new(3.0, 0.5));
    assert_eq!(Ball::new(1.2, 4.0), Ball::new(1.2, f64::INFINITY));
}

/// A loop that a search found for the least rms: its mean square by A, M, T and R is that of the
/// noise budget, which has none of these; its T is orthogonal to Φ; and no bound is above it.
#[test]
fn a_loop_is_above_the_bound_of_its_mean_square() {
    let study = paper("minimise = \"rms\"\nroll_off = { hz = 6000, order = 2 }");
    let machine = study.machine();
    let design = Search::FULL.design(&study).expect("it is reached");
    let bounds = Bounds::new(&study, machine.target.roll_off).expect("the zeros converge");
    let found = bounds.mean_square().expect("the zeros converge");
    let ByControllers { modal, any } = found.expect("the file asks for the least rms");
    let [modal, any] = [modal, any].map(|found| found.expect("a bound is found"));
    assert_eq!(modal.blocks, [vec![1, 2, 4, 5], vec![3], vec![6]]);
    assert_eq!(any.blocks, [vec![1, 2, 3, 4, 5, 6]]);
    assert!(any.rms < modal.rms && modal.grid_db < 0.01 && any.grid_db < 0.01);

    let measure = machine.measure().expect("it minimises an rms");
    let sources = Sources::new(&study, measure);
    let grid = MeanSquares::new(&bounds, &sources).expect("the zeros converge");
    let [low, high] = sources.band;
    let mut square = 0.0;
    let nodes = grid.grid(&divided(&grid.edges, 100.0));
    let all = nodes.iter();
    let all = all.map(|(hz, _)| complementary(&study, &design, *hz));
    let all: Vec<_> = all.collect();
    for (&(hz, weight), t) in nodes.iter().zip(&all) {
        if low < hz && hz < high {
            let (a, m, r) = bounds.limits.moved(hz, &sources).expect("P has an inverse");
            let left = a.iter().zip(&r).map(|(a, r)| {
                let seen: Gain = &m * t * r.fixed_rows::<LEGS>(0);
                (a - seen).norm_squared()
            });
            square += weight * left.sum::<f64>();
        }
    }
    let floor = machine.floor_motion();
    let budget = budget(
        study.plant(),
        &machine.board,
        Some(&design.table),
        &floor,
        sources.band,
        None,
    );
    let budget = budget.expect("the poles converge");
    let outputs = budget.performance.iter();
    let expected: f64 = outputs.flat_map(|of| budget.measured(of, measure)).sum();
    assert!(
        (square / expected - 1.0).abs() < 1e-3,
        "{square} {expected}"
    );
    assert!(modal.rms < expected.sqrt());

    for bound in [modal, any] {
        let (mut sum, mut size) = (0.0, 0.0);
        for ((hz, weight), t) in nodes.iter().zip(&all) {
            let z = study.plant().z(*hz);
            for EntryFunction { to, from, function } in &bound.certificate {
                let part = function.at(z) * t[(to - 1, from - 1)] * *weight;
                sum += part.re;
                size += part.norm();
            }
        }
        assert!(sum.abs() < 1e-4 * size, "{sum} of {size}");
    }
}
