//! The sampled plant and loop against second methods.

use core::f64::consts::TAU;

use crate::common::{
    edited, encirclements, frame, looped, looped_frame, parse, search, searched, study,
};
use host_gen::closed_loop::{LoopGrid, SampledLoop, stable};
use host_gen::control::LinearLaw;
use host_gen::control::table::direct;
use host_gen::design::outcome::{Advice, Refusal};
use host_gen::design::{Design, DesignError, Shaping, Study};
use host_gen::machine::{Board, NoiseDensity, Simulation};
use host_gen::numeric::singular::largest_singular_value;
use host_gen::plant::{Gain, StateSpace};
use host_gen::simulate::run::run;
use nalgebra::{Complex, DMatrix, Matrix6};

/// e^(At) and the integral of e^(As)·B over t, by one exponential of an
/// augmented matrix.
pub fn hold(a: &DMatrix<f64>, b: &DMatrix<f64>, t: f64) -> (DMatrix<f64>, DMatrix<f64>) {
    let (n, m) = b.shape();
    let mut augmented = DMatrix::zeros(n + m, n + m);
    augmented.view_mut((0, 0), (n, n)).copy_from(&(a * t));
    augmented.view_mut((0, n), (n, m)).copy_from(&(b * t));
    let e = augmented.exp();
    (
        e.view((0, 0), (n, n)).into_owned(),
        e.view((0, n), (n, m)).into_owned(),
    )
}

/// The machine with a first-order lag in front of every leg and one behind
/// every sensor, their states after those of the modes; sensors and performance.
fn with_lags(plant: &StateSpace, outputs: usize, actuator: f64, sensor: f64) -> StateSpace {
    let StateSpace { a, b, c, d } = plant;
    let (c, d) = (c.rows(0, outputs), d.rows(0, outputs));
    let n = a.nrows();
    let mut out = StateSpace {
        a: DMatrix::zeros(n + 12, n + 12),
        b: DMatrix::zeros(n + 12, 12),
        c: DMatrix::zeros(outputs, n + 12),
        d: DMatrix::zeros(outputs, 12),
    };
    out.a.view_mut((0, 0), (n, n)).copy_from(a);
    out.a.view_mut((0, n), (n, 6)).copy_from(&b.columns(6, 6));
    out.b.view_mut((0, 0), (n, 6)).copy_from(&b.columns(0, 6));
    out.c.view_mut((0, 0), (outputs, n)).copy_from(&c);
    out.c
        .view_mut((0, n), (outputs, 6))
        .copy_from(&d.columns(6, 6));
    out.d
        .view_mut((0, 0), (outputs, 6))
        .copy_from(&d.columns(0, 6));
    for i in 0..6 {
        out.a[(n + i, n + i)] = -actuator;
        out.b[(n + i, 6 + i)] = actuator;
        // What the sensor gave at once now drives its lag.
        let (row, direct) = (out.c.row(i).into_owned(), out.d.row(i).into_owned());
        out.a.row_mut(n + 6 + i).copy_from(&(row * sensor));
        out.a[(n + 6 + i, n + 6 + i)] -= sensor;
        out.b.row_mut(n + 6 + i).copy_from(&(direct * sensor));
        out.c.row_mut(i).fill(0.0);
        out.d.row_mut(i).fill(0.0);
        out.c[(i, n + 6 + i)] = 1.0;
    }
    out
}

/// Whole, part and several periods of delay; both kinds of sensor; with and
/// without lags of amplifiers and sensors.
#[test]
fn sampling_is_exact() {
    for (feedback, latch, lags) in [
        ("acceleration", 50e-6, None),
        ("acceleration", 20e-6, None),
        ("force", 20e-6, None),
        ("acceleration", 130e-6, None),
        ("acceleration", 0.0, None),
        ("acceleration", 50e-6, Some((2e3, 5e3))),
        ("force", 20e-6, Some((700.0, 9e3))),
        // A double pole, and one that is nearly double.
        ("acceleration", 20e-6, Some((3e3, 3e3))),
        ("force", 50e-6, Some((3e3, 3e3 * (1.0 + 1e-12)))),
    ] {
        let mut text = vec![
            ("control.feedback", format!("\"{feedback}\"")),
            ("board.conversion_delay", "0.0".to_owned()),
            ("board.output_delay", format!("{latch:?}")),
        ];
        if let Some((actuator, sensor)) = lags {
            text.push(("board.actuator.bandwidth", format!("{actuator:?}")));
            text.push(("board.accelerometer.bandwidth", format!("{sensor:?}")));
            text.push(("board.force_sensor.bandwidth", format!("{sensor:?}")));
        }
        let edits: Vec<_> = text.iter().map(|(key, value)| (*key, &**value)).collect();
        let study = study(&edited(&edits));
        let period = 50e-6;
        let outputs = study.plant().plant.performance().end;
        let whole = &study.plant().plant.state_space;
        let StateSpace { a, b, c, d } = match lags {
            Some((actuator, sensor)) => with_lags(whole, outputs, TAU * actuator, TAU * sensor),
            None => StateSpace {
                a: whole.a.clone(),
                b: whole.b.clone(),
                c: whole.c.rows(0, outputs).into_owned(),
                d: whole.d.rows(0, outputs).into_owned(),
            },
        };
        let n = a.nrows();
        let legs = b.columns(6, 6).into_owned();
        let periods = (latch / period + 1e-9_f64).floor();
        let part = (latch - periods * period).max(0.0);
        let (phi, _) = hold(&a, &legs, period);
        let (rest, after) = hold(&a, &legs, period - part);
        let (_, early) = hold(&a, &legs, part);
        let before = rest * early;
        let complex = |m: &DMatrix<f64>| m.map(Complex::from);
        for hz in [0.5, 13.9, 83.0, 1000.0, 9000.0] {
            let response = study.plant().response(hz);
            let near = |what: &str, expected: DMatrix<Complex<f64>>, found: Gain| {
                let error = (&expected - found).camax() / expected.camax();
                // Corners that coincide are moved by 1e-5 of themselves; aliases add up.
                let allowed = match lags {
                    Some((actuator, sensor)) if sensor < 1.01 * actuator => 2e-5,
                    _ => 1e-7,
                };
                assert!(
                    error < allowed,
                    "{what}, {feedback}, {latch} s, {lags:?}, {hz} Hz: {error:.1e}"
                );
            };
            let z = Complex::cis(TAU * hz * period);
            let delay = z.powf(-periods);
            let resolvent = (DMatrix::from_diagonal_element(n, n, z) - complex(&phi))
                .try_inverse()
                .unwrap();
            let x = &resolvent * (complex(&after) * delay + complex(&before) * (delay / z));
            let sampled = complex(&c) * x + complex(&d.columns(6, 6).into_owned()) * (delay / z);
            near(
                "legs to sensors",
                sampled.rows(0, 6).into_owned(),
                response.from_legs(0..6),
            );
            // Continuous, and the force as a latched staircase.
            let s = Complex::new(0.0, TAU * hz);
            let resolvent = (DMatrix::from_diagonal_element(n, n, s) - complex(&a))
                .try_inverse()
                .unwrap();
            let g = complex(&c) * resolvent * complex(&b) + complex(&d);
            near(
                "floor",
                g.columns(0, 6).into_owned(),
                response.from_floor(0..outputs),
            );
            let turn = 0.5 * TAU * hz * period;
            let hold = (-s * (latch + 0.5 * period)).exp() * (turn.sin() / turn);
            near(
                "legs to performance",
                g.view((6, 6), (outputs - 6, 6)) * hold,
                response.from_legs(6..outputs),
            );
        }
    }
}

/// A machine with so much damping that it has real poles, and lags at one of them: the plant is that
/// with lags a thousandth beside it.
#[test]
fn a_lag_may_be_at_a_pole_of_the_machine() {
    let with_lag = |factor: f64, actuator: bool| {
        let damped = ("profiles.leg.damper", "1e6".to_owned());
        let plain = study(&edited(&[(damped.0, &damped.1)]));
        let poles = plain.plant().plant.poles.iter().map(|pole| pole.lambda);
        let pole = poles.filter(|pole| pole.im == 0.0).map(|pole| -pole.re);
        let hz = factor * pole.fold(0.0, f64::max) / TAU;
        let mut text = vec![damped, ("board.accelerometer.bandwidth", format!("{hz:?}"))];
        if actuator {
            text.push(("board.actuator.bandwidth", format!("{hz:?}")));
        }
        let edits: Vec<_> = text.iter().map(|(key, value)| (*key, &**value)).collect();
        study(&edited(&edits))
    };
    for actuator in [false, true] {
        let [at, beside] = [1.0, 1.001].map(|factor| with_lag(factor, actuator));
        for hz in [1.0, 30.0, 400.0, 8000.0] {
            let [at, beside] = [&at, &beside].map(|study| study.plant().response(hz).g22());
            let apart = (at - &beside).camax() / beside.camax();
            // Two lags of which each moves by a thousandth, and their aliases.
            assert!(apart < 3e-3, "{actuator} {hz} Hz: {apart:.1e}");
            assert!(apart > 1e-9, "{actuator} {hz} Hz: nothing changed");
        }
    }
}

fn corner_of(shaped: &Design) -> f64 {
    match shaped.shaping {
        Shaping::Common { corner_hz } => corner_hz,
        Shaping::Modes { .. } => panic!("not the direct law"),
    }
}

/// Stability by the argument principle, where eigenvalues say the same and
/// where they say the opposite.
#[test]
fn stability_by_nyquist() {
    let (study, _, shaped) = looped_frame();
    for (corner, expected) in [
        (corner_of(shaped), true),
        (2.0, true),
        (2.6, false),
        (5.0, false),
    ] {
        let table = direct(
            study.machine(),
            study.plant(),
            &study.machine().target,
            study.gains(),
            corner,
        )
        .unwrap();
        let law = LinearLaw::new(&table);
        let closed = SampledLoop {
            plant: study.plant(),
            law,
        };
        let poles = closed.poles().unwrap();
        let unstable = poles.iter().filter(|s| s.re >= 0.0).count();
        assert_eq!(stable(&poles), expected, "{corner} Hz");
        assert_eq!(
            encirclements(study, &law).unsigned_abs() as usize,
            unstable,
            "{corner} Hz"
        );
    }
}

/// The chosen corner keeps the bound on a sweep twenty times as dense as the
/// search's, and a corner 3 % higher breaks it.
#[test]
fn the_corner_is_the_highest_within_the_bound() {
    let (study, table, shaped) = looped_frame();
    let worst = |law: &LinearLaw| {
        let to = study.design_model().modal.transpose().map(Complex::from);
        let from = to.try_inverse().unwrap();
        let mut worst: f64 = 0.0;
        for i in 0..12_000 {
            let hz = 0.02 * (0.5e4 * 2.0 / 0.02_f64).powf(f64::from(i) / 11_999.0);
            let c = law.response(study.plant().z(hz));
            let g = study.plant().response(hz).g22();
            for (l, part) in [
                (-(to * (&c * &g) * from), 1.0),
                // Legs and sensors may have half as much again.
                (-(&c * &g), 1.5),
                ((-(&g * &c)).fixed_view::<6, 6>(0, 0).into_owned(), 1.5),
            ] {
                let sensitivity = (Matrix6::identity() + l).try_inverse().unwrap();
                worst = worst.max(sensitivity.singular_values().max() / part);
            }
        }
        worst
    };
    let chosen = worst(&LinearLaw::new(table));
    assert!(chosen <= 2.0 && chosen > 1.99, "{chosen}");
    let found = shaped.peak_sensitivity;
    let elsewhere = found.at_legs.max(found.at_sensors) / 1.5;
    assert!((chosen - found.value.max(elsewhere)).abs() < 2e-3);
    let higher = direct(
        study.machine(),
        study.plant(),
        &study.machine().target,
        study.gains(),
        1.03 * corner_of(shaped),
    )
    .unwrap();
    assert!(worst(&LinearLaw::new(&higher)) > 2.0);
}

/// The fast test by pivots says what singular values say.
#[test]
fn bound_by_pivots_is_bound_by_singular_values() {
    let study = frame();
    let grid = LoopGrid::new(study.plant(), &study.design_model().modal, 0.001, &[]);
    // Not nearer to instability, where the peak is narrower than the grid.
    for corner in [0.2, 0.84, 1.2] {
        let table = direct(
            study.machine(),
            study.plant(),
            &study.machine().target,
            study.gains(),
            corner,
        )
        .unwrap();
        let law = LinearLaw::new(&table);
        let peak = grid.peak(study.plant(), &law).value;
        assert!(grid.within(&law, 1.001 * peak));
        assert!(!grid.within(&law, 0.99 * peak));
    }
}

/// rms in time against rms from the spectra, open and closed. Modal damping of
/// 10 % so that a minute holds hundreds of independent swings.
#[test]
fn rms_in_time_is_rms_from_spectra() {
    // A quiet board, so that only the floor speaks.
    let mut machine = parse(&edited(&[("damping.modal", "0.1")])).unwrap();
    quiet(&mut machine.board);
    let study = Study::new(machine).unwrap();
    let settings = Simulation {
        duration: 60.0,
        settling: 10.0,
        floor_rms: 1e-2,
        floor_band: [5.0, 60.0],
        seed: 3,
    };
    let table = search().design(&study).unwrap().table;
    let closed_loop = SampledLoop {
        plant: study.plant(),
        law: LinearLaw::new(&table),
    };
    // Second-order Butterworth magnitudes; the bilinear warp is nil here.
    let [low, high] = settings.floor_band;
    let shape = |hz: f64| 1.0 / (1.0 + (low / hz).powi(4)) / (1.0 + (hz / high).powi(4));
    let step = 0.05;
    let grid: Vec<f64> = (1..20_000).map(|i| step * f64::from(i)).collect();
    let total: f64 = grid.iter().map(|&hz| shape(hz) * step).sum();
    let rows = study.plant().plant.performance();
    let rms = |row: usize, closed: bool| {
        let power: f64 = grid
            .iter()
            .map(|&hz| {
                let gain = if closed {
                    closed_loop.close(hz, rows.clone())
                } else {
                    study.plant().response(hz).from_floor(rows.clone())
                };
                let base = study.plant().plant.base.map(Complex::from);
                (gain.row(row) * base).norm_squared() * shape(hz) * step
            })
            .sum();
        settings.floor_rms * (power / total).sqrt()
    };
    for closed in [false, true] {
        let measured = run(
            study.plant(),
            &study.machine().board,
            &settings,
            &table,
            closed,
        );
        assert_eq!(measured.clamped_steps, 0);
        for row in [0, 2, 4] {
            let expected = rms(row, closed);
            let ratio = measured.rms[row] / expected;
            assert!(
                (ratio - 1.0).abs() < 0.1,
                "closed {closed}, output {row}: {ratio}"
            );
        }
    }
}

#[test]
fn unreachable_targets_name_the_nearest() {
    for (frequency, damping) in [(0.5, 0.7), (0.1, 0.7), (0.3, 0.2)] {
        let edits = |f: f64| {
            let text = edited(&[
                ("control.frequency", &format!("{f:?}")),
                ("control.damping", &format!("{damping:?}")),
            ]);
            &searched(&text).1
        };
        let error = edits(frequency).as_ref().unwrap_err();
        let DesignError::Unreachable {
            refusal:
                Refusal {
                    advice: Advice::Nearest(nearest),
                    ..
                },
            ..
        } = *error
        else {
            panic!("{error}");
        };
        assert!(nearest > frequency);
        // It can be reached, and a little less cannot.
        assert!(edits(nearest).is_ok());
        assert!(edits(0.95 * nearest).is_err());
    }
    let hopeless = study(&edited(&[("control.damping", "30.0")]));
    let hopeless = search().design(&hopeless).unwrap_err();
    assert!(matches!(
        hopeless,
        DesignError::Unreachable {
            refusal: Refusal {
                advice: Advice::NoFrequency,
                ..
            },
            ..
        }
    ));
}

/// Force feedback and other boards: whatever the tool accepts is stable within
/// the bound.
#[test]
fn other_boards() {
    for edits in [
        vec![
            ("control.feedback", "\"force\""),
            ("control.frequency", "5.0"),
        ],
        vec![
            ("board.sample_rate", "50e3"),
            ("board.conversion_delay", "0.0"),
            ("board.output_delay", "20e-6"),
        ],
        vec![("board.sample_rate", "5e3"), ("control.frequency", "3.0")],
        vec![
            ("control.max_sensitivity", "1.5"),
            ("board.output_delay", "5e-6"),
        ],
    ] {
        let (study, table, shaped) = looped(&edited(&edits));
        let law = LinearLaw::new(table);
        assert!(shaped.peak_sensitivity.value <= study.machine().target.max_sensitivity);
        assert_eq!(encirclements(study, &law), 0, "{edits:?}");
        let closed = SampledLoop {
            plant: study.plant(),
            law,
        };
        let rows = study.plant().plant.performance();
        let open = largest_singular_value(&study.plant().response(13.91).from_floor(rows.clone()));
        assert!(
            largest_singular_value(&closed.close(13.91, rows)) < 0.05 * open,
            "{edits:?}"
        );
    }
}

/// The rig in time against a march with dense matrix exponentials, for forces
/// that change with every sample: whole, part and several periods of delay. The
/// integral of the performance is a state of the march.
#[test]
fn the_rig_marches_as_the_state_space_does() {
    use host_gen::simulate::Rig;
    use shared::codes::DacCode;
    for latch in [50e-6, 20e-6, 130e-6, 0.0] {
        let text = edited(&[
            ("board.conversion_delay", "0.0"),
            ("board.output_delay", &format!("{latch:?}")),
        ]);
        let mut machine = parse(&text).unwrap();
        quiet(&mut machine.board);
        let study = Study::new(machine).unwrap();
        let board = &study.machine().board;
        // Volts that no code can miss: compare the performance, not the codes.
        let settings = Simulation {
            floor_rms: 0.0,
            ..study.machine().simulation
        };
        let mut rig = Rig::new(study.plant().clone(), board, &settings);
        let plant = &study.plant().plant;
        let StateSpace { a, b, c, d } = &plant.state_space;
        let rows = plant.performance();
        let count = rows.len();
        let mut wide = DMatrix::zeros(24 + count, 24 + count);
        wide.view_mut((0, 0), (24, 24)).copy_from(a);
        wide.view_mut((24, 0), (count, 24))
            .copy_from(&c.rows_range(rows.clone()));
        let mut legs = DMatrix::zeros(24 + count, 6);
        legs.rows_mut(0, 24).copy_from(&b.columns(6, 6));
        legs.rows_mut(24, count)
            .copy_from(&d.rows_range(rows).columns(6, 6));
        let period: f64 = 50e-6;
        let periods = (latch / period + 1e-9).floor();
        let part = (latch - periods * period).max(0.0);
        let (rest, after) = hold(&wide, &legs, period - part);
        let (begin, early) = hold(&wide, &legs, part);
        let late = periods as usize;
        let mut x = nalgebra::DVector::zeros(24 + count);
        let mut past = vec![nalgebra::DVector::zeros(6); late + 2];
        let mut largest: f64 = 0.0;
        for k in 0..400_u32 {
            rig.sample();
            let codes: [DacCode; 6] = core::array::from_fn(|leg| {
                // Some pattern without a period.
                let word = (k + 1)
                    .wrapping_mul(2_654_435_761)
                    .rotate_left(5 * leg as u32);
                DacCode(20_000 + (word % 20_000) as u16)
            });
            past.pop();
            let board = &study.machine().board;
            past.insert(
                0,
                nalgebra::DVector::from_iterator(
                    6,
                    codes
                        .iter()
                        .map(|c| board.dac.force(*c, board.actuator_gain)),
                ),
            );
            x = &begin * x + &early * &past[late + 1];
            x = &rest * x + &after * &past[late];
            let expected = x.rows(24, count) / period;
            x.rows_mut(24, count).fill(0.0);
            let found = rig.advance(codes);
            largest = largest.max(expected.amax());
            assert!(
                (found - &expected).amax() <= 1e-9 * largest.max(1e-9),
                "{latch} s, sample {k}"
            );
        }
    }
}

/// Without damping, floor or control the simulated machine keeps its energy: a
/// pulse of the legs puts some in, a hundred thousand steps later it is there.
#[test]
fn the_undamped_simulation_keeps_its_energy() {
    use host_gen::simulate::Rig;
    use shared::codes::DacCode;
    let mut machine = parse(&edited(&[("damping.modal", "0.0")])).unwrap();
    quiet(&mut machine.board);
    let study = Study::new(machine).unwrap();
    let settings = Simulation {
        floor_rms: 0.0,
        ..study.machine().simulation
    };
    let mut rig = Rig::new(study.plant().clone(), &study.machine().board, &settings);
    let rest = [study.machine().board.dac.middle(); 6];
    let push = [60_000, 20_000, 33_000, 50_000, 10_000, 40_000].map(DacCode);
    // The mean square of the performance over ten seconds: a weighted sum of
    // the energies of all modes.
    let mut window = |steps: usize, dac| {
        let mut sum = 0.0;
        for _ in 0..steps {
            rig.sample();
            sum += rig.advance(dac).norm_squared();
        }
        sum / steps as f64
    };
    window(200, push);
    window(200, rest);
    let first = window(200_000, rest);
    window(600_000, rest);
    let last = window(200_000, rest);
    // Beats of neighbouring modes over ten seconds: below a per mille.
    assert!((last / first - 1.0).abs() < 1e-3, "{first:e} {last:e}");
}

/// A board that adds nothing of its own.
fn quiet(board: &mut Board) {
    (board.adc_noise, board.dac_noise) = (0.0, 0.0);
    board.sensor.noise_density = NoiseDensity::white(0.0);
}
