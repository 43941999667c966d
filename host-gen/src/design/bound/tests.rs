use core::f64::consts::TAU;
use std::path::Path;

use super::*;
use crate::closed_loop::SampledLoop;
use crate::control::gains::ModalTransform;
use crate::design::{Design, Search};
use crate::machine::Machine;
use crate::numeric::six::ComplexMatrix6;

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
