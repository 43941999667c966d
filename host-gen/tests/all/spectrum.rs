//! Floors, spectra and the budget against formulas and against the simulation.

use core::f64::consts::TAU;

use crate::common::{edited, frame, looped};
use host_gen::analysis::criterion::Criterion;
use host_gen::analysis::vibration::{Floor, budget};
use host_gen::design::Study;
use host_gen::machine::Simulation;
use host_gen::simulate::run::run;

/// The table of the IEST, µm/s, and the density from a band velocity.
#[test]
fn criteria_are_the_published_ones() {
    let velocity = |criterion: Criterion, hz: f64| 1e6 * criterion.velocity(hz);
    for (criterion, flat) in Criterion::VC
        .into_iter()
        .zip([50.0, 25.0, 12.5, 6.25, 3.125, 1.5625, 0.78125])
    {
        for hz in [8.0, 20.0, 80.0] {
            assert!((velocity(criterion, hz) / flat - 1.0).abs() < 1e-12);
        }
    }
    assert!((velocity(Criterion::VcA, 4.0) / 100.0 - 1.0).abs() < 1e-12);
    assert!((velocity(Criterion::VcC, 1.0) / 12.5 - 1.0).abs() < 1e-12);
    assert!((velocity(Criterion::NistA, 20.0) - 3.1).abs() < 1e-12);
    // Both halves of NIST-A meet at 20 Hz, within the rounding of 3.1.
    let below = velocity(Criterion::NistA, 19.999);
    assert!((below - 3.1).abs() < 0.05, "{below}");
    // v/√(0.2316·f) as an amplitude density, times ω for the acceleration.
    let density = Floor::Criterion(Criterion::VcC).density(10.0);
    let expected = TAU * 10.0 * 12.5e-6 / (0.2316f64 * 10.0).sqrt();
    assert!((density / expected - 1.0).abs() < 1e-3);
}

#[test]
fn a_table_is_straight_on_logarithmic_axes() {
    let floor = Floor::Table(vec![(1.0, 1e-4), (10.0, 1e-2), (100.0, 1e-2)]);
    for (hz, expected) in [
        (1.0, 1e-4),
        (10f64.sqrt(), 1e-3),
        (10.0, 1e-2),
        (50.0, 1e-2),
    ] {
        assert!((floor.density(hz) / expected - 1.0).abs() < 1e-12);
    }
    assert_eq!(floor.density(0.9), 0.0);
    assert_eq!(floor.density(101.0), 0.0);
    assert_eq!(Floor::White(3.0).density(7.0), 3.0);
}

/// White noise on the undamped-but-for-ζ machine: the frame's motion as a mass
/// on springs. Open loop, the integral of a resonance's square is (π/2)·f·Q
/// half-bandwidths, so the trapezoids have to catch the peaks.
#[test]
fn resonances_are_integrated() {
    let study = frame();
    let board = &study.machine().board;
    let floor = Floor::White(1e-4);
    let open = budget(study.plant(), board, None, &floor, [0.5, 300.0]).unwrap();
    // A second method: Simpson on a grid two hundred times as fine.
    let row = 2;
    let fine: f64 = {
        let plant = &study.plant().plant;
        let power = |hz: f64| {
            let gain = plant.response(hz).from_floor(plant.performance());
            gain.row(row).norm_squared() * 1e-8
        };
        let step = 0.001;
        let count = 299_500;
        let odd: f64 = (0..count)
            .step_by(2)
            .map(|i| power(0.5 + step * f64::from(i + 1)))
            .sum();
        let even: f64 = (2..count)
            .step_by(2)
            .map(|i| power(0.5 + step * f64::from(i)))
            .sum();
        (power(0.5) + power(300.0) + 4.0 * odd + 2.0 * even) * step / 3.0
    };
    let found: f64 = open.power(&open.performance[row], 0.5, 300.0)[0];
    assert!((found / fine - 1.0).abs() < 0.02, "{found:e} {fine:e}");
}

/// The budget against the simulation, source by source: only the floor, only
/// the sensors, only the ADC, only the DAC.
#[test]
fn the_budget_is_what_the_simulation_shows() {
    for source in 0..4 {
        let (study, table, _) = looped(&edited(&[("damping.modal", "0.1")]));
        let settings = Simulation {
            duration: 40.0,
            settling: 20.0,
            floor_rms: if source == 0 { 2e-3 } else { 0.0 },
            floor_band: [5.0, 60.0],
            seed: 2,
        };
        let mut machine = study.machine().clone();
        let board = &mut machine.board;
        // Loud enough that rounding to codes does not count.
        board.sensor.noise_density = if source == 1 { 2e-6 } else { 0.0 };
        board.adc_noise = if source == 2 { 4e-3 } else { 0.0 };
        board.dac_noise = if source == 3 { 2e-3 } else { 0.0 };
        let study = &Study::new(machine).unwrap();
        let board = &study.machine().board;
        let [low, high] = settings.floor_band;
        let shape =
            |hz: f64| (1.0 / (1.0 + (low / hz).powi(4)) / (1.0 + (hz / high).powi(4))).sqrt();
        let points = (1..4000).map(|i| 0.25 * f64::from(i));
        let total: f64 = points.clone().map(|hz| shape(hz).powi(2) * 0.25).sum();
        let floor = Floor::Table(
            points
                .map(|hz| (hz, settings.floor_rms * shape(hz) / total.sqrt()))
                .collect(),
        );
        let budget = budget(study.plant(), board, Some(table), &floor, [0.3, 9000.0]).unwrap();
        let run = run(study.plant(), board, &settings, table, true);
        assert_eq!(
            run.clamped_steps, 0,
            "source {source}, {} N",
            run.force_peak
        );
        for row in [0, 2, 4] {
            let powers = budget.power(&budget.performance[row], 0.3, 9000.0);
            let share = powers[source] / powers.iter().sum::<f64>();
            assert!(share > 0.95, "source {source}, output {row}: {share}");
            let ratio = run.rms[row] / powers.iter().sum::<f64>().sqrt();
            // Held noise has a quarter of its power above half the sample rate.
            // The means over a period keep it, the budget up to 9 kHz does not.
            let above = if source == 3 { 1.13 } else { 1.0 };
            // Forty seconds of a process a hertz wide and more: some per cent.
            assert!(
                (0.9..1.1 * above).contains(&ratio),
                "source {source}, output {row}: {ratio}"
            );
        }
    }
}

/// A frame that rides on its floor meets the floor's own criterion: far below
/// the modes it moves as the floor, so a band at 1 Hz has the floor's velocity
/// times the number of inputs that move it.
#[test]
fn slow_bands_ride_with_the_floor() {
    let study = frame();
    let board = &study.machine().board;
    let floor = Floor::Criterion(Criterion::VcD);
    let open = budget(study.plant(), board, None, &floor, [0.5, 300.0]).unwrap();
    // Base motion along x from the six inputs, R⁻¹, at the mounts' height.
    let inverse = study.model().floor_inverse();
    let expected = (0..3)
        .map(|axis| inverse.row(axis).norm())
        .fold(0.0, f64::max)
        * Criterion::VcD.velocity(1.0);
    let (hz, velocity, _) = open.thirds()[0];
    assert!((hz - 1.0).abs() < 1e-9);
    // (1 Hz / 14 Hz)² of amplification, and band edges.
    assert!(
        (velocity / expected - 1.0).abs() < 0.02,
        "{velocity:e} {expected:e}"
    );
    assert!(open.criterion().is_none_or(|met| met != Criterion::VcG));
}
