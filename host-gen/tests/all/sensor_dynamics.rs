//! Lower corners and resonances of sensors: in the plant against closed forms and a second
//! method, in the loop, and in the simulation.

use core::f64::consts::{FRAC_1_SQRT_2, TAU};

use host_gen::closed_loop::{SampledLoop, stable};
use host_gen::control::LinearLaw;
use host_gen::design::Study;
use host_gen::machine::{FeedbackKind, Simulation};
use host_gen::plant::StateSpace;
use host_gen::simulate::Rig;
use nalgebra::{Complex, DMatrix};
use shared::LEGS;
use shared::codes::DacCode;

use crate::common::{edited, encirclements, parse, search, study};
use crate::sampled_loop::hold;

/// A sensor's corners: lower, its order, resonance with damping, bandwidth; and the amplifier's.
#[derive(Clone, Copy, Debug, Default)]
struct Corners {
    lower: Option<(f64, u32)>,
    resonance: Option<(f64, f64)>,
    bandwidth: Option<f64>,
    amplifier: Option<f64>,
}

impl Corners {
    /// The keys of the sensors of this kind.
    fn keys(&self, kind: &str) -> Vec<(String, String)> {
        let mut keys = Vec::new();
        let mut put = |key: &str, value: String| keys.push((format!("board.{key}"), value));
        if let Some((hz, order)) = self.lower {
            put(&format!("{kind}.lower_corner"), format!("{hz:?}"));
            put(&format!("{kind}.lower_order"), order.to_string());
        }
        if let Some((hz, damping)) = self.resonance {
            let value = format!("{{ hz = {hz:?}, damping = {damping:?} }}");
            put(&format!("{kind}.resonance"), value);
        }
        if let Some(hz) = self.bandwidth {
            put(&format!("{kind}.bandwidth"), format!("{hz:?}"));
        }
        if let Some(hz) = self.amplifier {
            put("actuator.bandwidth", format!("{hz:?}"));
        }
        keys
    }

    /// Coefficients of the sensor's numerator and denominator, s⁰ first.
    fn polynomials(&self) -> (Vec<f64>, Vec<f64>) {
        let times = |a: &[f64], b: &[f64]| {
            let mut product = vec![0.0; a.len() + b.len() - 1];
            for (i, x) in a.iter().enumerate() {
                for (j, y) in b.iter().enumerate() {
                    product[i + j] += x * y;
                }
            }
            product
        };
        let (mut above, mut below) = (vec![1.0], vec![1.0]);
        match self.lower {
            Some((hz, 1)) => {
                above = times(&above, &[0.0, 1.0]);
                below = times(&below, &[TAU * hz, 1.0]);
            }
            Some((hz, _)) => {
                let w = TAU * hz;
                above = times(&above, &[0.0, 0.0, 1.0]);
                below = times(&below, &[w * w, 2f64.sqrt() * w, 1.0]);
            }
            None => {}
        }
        if let Some((hz, damping)) = self.resonance {
            let w = TAU * hz;
            above = times(&above, &[w * w]);
            below = times(&below, &[w * w, 2.0 * damping * w, 1.0]);
        }
        if let Some(hz) = self.bandwidth {
            above = times(&above, &[TAU * hz]);
            below = times(&below, &[TAU * hz, 1.0]);
        }
        (above, below)
    }

    fn at(&self, hz: f64) -> Complex<f64> {
        let s = Complex::new(0.0, TAU * hz);
        let value = |c: &[f64]| {
            let terms = c.iter().rev();
            terms.fold(Complex::new(0.0, 0.0), |sum, c| sum * s + c)
        };
        let (above, below) = self.polynomials();
        value(&above) / value(&below)
    }
}

fn with(feedback: &str, kinds: &[(&str, Corners)], edits: &[(&str, &str)]) -> Study {
    let feedback = format!("\"{feedback}\"");
    let keys: Vec<_> = kinds
        .iter()
        .flat_map(|(kind, corners)| corners.keys(kind))
        .collect();
    let mut all = vec![("control.feedback", &*feedback)];
    if feedback == "\"both\"" {
        all.push(("control.law", "\"modal\""));
    }
    all.extend(keys.iter().map(|(key, value)| (&**key, &**value)));
    all.extend(edits);
    study(&edited(&all))
}

const CORNERS: [Corners; 6] = {
    const NONE: Corners = Corners {
        lower: None,
        resonance: None,
        bandwidth: None,
        amplifier: None,
    };
    [
        Corners {
            lower: Some((0.3, 1)),
            ..NONE
        },
        Corners {
            lower: Some((0.003, 2)),
            ..NONE
        },
        Corners {
            resonance: Some((370.0, 0.02)),
            ..NONE
        },
        Corners {
            lower: Some((2.0, 2)),
            resonance: Some((900.0, 0.5)),
            ..NONE
        },
        Corners {
            lower: Some((0.05, 1)),
            resonance: Some((3e3, 0.1)),
            bandwidth: Some(200.0),
            amplifier: Some(5e3),
        },
        // Equal corners of amplifier and sensor.
        Corners {
            lower: Some((0.05, 1)),
            resonance: Some((3e3, 0.1)),
            bandwidth: Some(5e3),
            amplifier: Some(5e3),
        },
    ]
};

/// What sensors read of the floor is what they read without dynamics, times the filter: far below
/// the lower corner, at it, and above the resonance. The legs' forces move the machine as before.
#[test]
fn sensors_read_the_floor_through_their_filter() {
    for (feedback, kind) in [("acceleration", "accelerometer"), ("force", "force_sensor")] {
        for corners in CORNERS {
            let plain = with(feedback, &[], &[]);
            let filtered = with(feedback, &[(kind, corners)], &[]);
            let plain = &plain.plant().plant;
            let filtered = filtered.plant();
            let rows = plain.sensors();
            let still = plain.response(1e-3).from_floor(rows.clone()).camax();
            for hz in [1e-4, 3e-3, 0.05, 0.3, 2.0, 11.0, 83.0, 370.0, 3e3, 9e3] {
                let expected = plain.response(hz).from_floor(rows.clone()) * corners.at(hz);
                let found = filtered.response(hz).from_floor(rows.clone());
                let error = (&found - &expected).camax();
                let part = if corners.bandwidth == corners.amplifier {
                    2e-5
                } else {
                    1e-7
                };
                // Counted from s = 0, a slow filter's terms are f/corner times what they leave.
                let slowest = corners.lower.map_or(hz, |(hz, _)| hz);
                let rounding = 1e-15 * (hz / slowest).max(1.0) * still;
                let allowed = part * expected.camax() + rounding;
                assert!(
                    error < allowed,
                    "{feedback} {corners:?} {hz} Hz: {error:.1e} of {:.1e}",
                    expected.camax()
                );
            }
            let outputs = plain.performance();
            let [expected, found] = [
                plain.response(30.0).from_floor(outputs.clone()),
                filtered.response(30.0).from_floor(outputs),
            ];
            assert!((&found - &expected).camax() < 1e-9 * expected.camax());
        }
    }
}

/// The corner is that of −3 dB, and below it the response falls with its order.
#[test]
fn the_lower_corner_is_that_of_a_data_sheet() {
    for order in [1, 2] {
        let corners = Corners {
            lower: Some((0.3, order)),
            ..Corners::default()
        };
        let study = with("acceleration", &[("accelerometer", corners)], &[]);
        let plain = with("acceleration", &[], &[]);
        let gain = |hz: f64| {
            let of = |study: &Study| {
                let plant = study.plant();
                plant.response(hz).from_floor(plant.plant.sensors())[(0, 0)].norm()
            };
            of(&study) / of(&plain)
        };
        assert!((gain(0.3) - FRAC_1_SQRT_2).abs() < 1e-9, "{}", gain(0.3));
        let slope = (gain(2e-3) / gain(1e-3)).log2();
        assert!((slope - f64::from(order)).abs() < 1e-3, "{slope}");
        assert!((gain(100.0) - 1.0).abs() < 1e-4);
    }
}

/// The plant with a chain of sections behind each sensor, and an amplifier's lag in front of each
/// leg.
fn augmented(plant: &StateSpace, corners: &[Corners]) -> StateSpace {
    const MOST: usize = 5;
    let rows = LEGS * corners.len();
    let n = plant.a.nrows();
    let size = n + LEGS + MOST * rows;
    let mut a = DMatrix::zeros(size, size);
    let mut b = DMatrix::zeros(size, 2 * LEGS);
    // The sensors from states and inputs.
    let mut c = DMatrix::zeros(rows, size);
    let mut d = plant.d.rows(0, rows).into_owned();
    a.view_mut((0, 0), (n, n)).copy_from(&plant.a);
    b.view_mut((0, 0), (n, 2 * LEGS)).copy_from(&plant.b);
    c.view_mut((0, 0), (rows, n))
        .copy_from(&plant.c.rows(0, rows));
    let mut at = n;
    if let Some(hz) = corners[0].amplifier {
        let legs = (LEGS, LEGS);
        a.view_mut((0, n), (n, LEGS))
            .copy_from(&plant.b.columns_range(LEGS..));
        b.view_mut((0, LEGS), (n, LEGS)).fill(0.0);
        c.view_mut((0, n), (rows, LEGS))
            .copy_from(&d.columns_range(LEGS..));
        d.columns_range_mut(LEGS..).fill(0.0);
        a.view_mut((n, n), legs).fill_diagonal(-TAU * hz);
        b.view_mut((n, LEGS), legs).fill_diagonal(TAU * hz);
        at += LEGS;
    }
    for row in 0..rows {
        let corners = corners[row / LEGS];
        // Each with its frequency, 2ζ of a second order, and whether it passes high frequencies.
        let lower = corners.lower.map(|(hz, order)| {
            let second = (order == 2).then_some(2f64.sqrt());
            (hz, second, true)
        });
        let peak = corners.resonance;
        let peak = peak.map(|(hz, damping)| (hz, Some(2.0 * damping), false));
        let lag = corners.bandwidth.map(|hz| (hz, None, false));
        for (hz, second, high) in [lower, peak, lag].into_iter().flatten() {
            let w = TAU * hz;
            let (from_states, from_inputs) = (c.row(row).into_owned(), d.row(row).into_owned());
            let mut driven = at;
            match second {
                // ẋ = w·(u − x)
                None => a[(at, at)] = -w,
                // ẋ₁ = w·x₂, ẋ₂ = w·(u − x₁ − 2ζ·x₂)
                Some(twice) => {
                    a[(at, at + 1)] = w;
                    a[(at + 1, at)] = -w;
                    a[(at + 1, at + 1)] = -twice * w;
                    driven += 1;
                }
            }
            let mut own = a.row_mut(driven);
            own += &from_states * w;
            b.row_mut(driven).copy_from(&(&from_inputs * w));
            if high {
                c[(row, at)] -= 1.0;
                if let Some(twice) = second {
                    c[(row, at + 1)] -= twice;
                }
            } else {
                c.row_mut(row).fill(0.0);
                d.row_mut(row).fill(0.0);
                c[(row, at)] = 1.0;
            }
            at = driven + 1;
        }
    }
    StateSpace {
        a: a.view((0, 0), (at, at)).into_owned(),
        b: b.rows(0, at).into_owned(),
        c: c.columns(0, at).into_owned(),
        d,
    }
}

/// From samples of the forces to samples of the sensors, against matrix exponentials of the plant
/// with all filters.
#[test]
fn sampling_with_filters_is_exact() {
    let [first, .., slow, third, fourth, _] = CORNERS;
    for (feedback, kinds) in [
        ("acceleration", vec![("accelerometer", first)]),
        ("acceleration", vec![("accelerometer", third)]),
        ("force", vec![("force_sensor", fourth)]),
        (
            "both",
            vec![("accelerometer", third), ("force_sensor", slow)],
        ),
        (
            "both",
            vec![("accelerometer", fourth), ("force_sensor", first)],
        ),
    ] {
        let study = with(
            feedback,
            &kinds,
            &[
                ("board.conversion_delay", "0.0"),
                ("board.output_delay", "20e-6"),
            ],
        );
        let mut corners: Vec<_> = kinds.iter().map(|(_, corners)| *corners).collect();
        if let Some(amplifier) = corners.iter().find_map(|c| c.amplifier) {
            corners[0].amplifier = Some(amplifier);
        }
        let StateSpace { a, b, c, d } = augmented(&study.plant().plant.state_space, &corners);
        let (period, latch) = (50e-6, 20e-6);
        let legs = b.columns(LEGS, LEGS).into_owned();
        let n = a.nrows();
        let (phi, _) = hold(&a, &legs, period);
        let (rest, after) = hold(&a, &legs, period - latch);
        let (_, early) = hold(&a, &legs, latch);
        let before = rest * early;
        let complex = |m: &DMatrix<f64>| m.map(Complex::from);
        for hz in [0.05, 0.5, 13.9, 83.0, 1000.0, 9000.0] {
            let z = Complex::cis(TAU * hz * period);
            let shifted = DMatrix::from_diagonal_element(n, n, z) - complex(&phi);
            let forced = complex(&after) + complex(&before) / z;
            let x = shifted.lu().solve(&forced).unwrap();
            let direct = d.columns(LEGS, LEGS).into_owned();
            let expected = complex(&c) * x + complex(&direct) / z;
            let found = study.plant().response(hz).g22();
            for first in (0..found.nrows()).step_by(LEGS) {
                let expected = expected.rows(first, LEGS);
                let found = found.rows(first, LEGS);
                // Far below the corner little is left of D and the poles, which cancel.
                let rounding = 1e-13 * study.plant().plant.state_space.d.amax();
                let error = (expected - found).camax() / (expected.camax() + 1e6 * rounding);
                assert!(
                    error < 1e-6,
                    "{feedback} {kinds:?} {first} {hz} Hz: {error:.1e}"
                );
            }
        }
    }
}

/// The loop has the sensors' poles, and its poles and its Nyquist curve agree on stability.
#[test]
fn the_loop_sees_the_sensors() {
    let corners = Corners {
        lower: Some((0.3, 1)),
        resonance: Some((2e3, 0.3)),
        ..Corners::default()
    };
    let study = with("acceleration", &[("accelerometer", corners)], &[]);
    let plain = with("acceleration", &[], &[]);
    let table = search().design(&plain).unwrap().table;
    let poles = |gain: f64| {
        let law = LinearLaw::new(&table).with_gain(gain);
        let plant = study.plant();
        (SampledLoop { plant, law }.poles().unwrap(), law)
    };
    let (open, _) = poles(0.0);
    let near = |at: Complex<f64>| {
        let close = |pole: &&Complex<f64>| (*pole - at).norm() < 1e-6 * at.norm();
        open.iter().filter(close).count()
    };
    assert_eq!(near(Complex::new(-TAU * 0.3, 0.0)), LEGS);
    let pair = Complex::new(-0.3, (1.0 - 0.09f64).sqrt()) * (TAU * 2e3);
    assert_eq!(near(pair), LEGS);
    for gain in [0.03, 0.3, 1.0] {
        let (closed, law) = poles(gain);
        let unstable = closed.iter().filter(|s| s.re >= 0.0).count();
        assert_eq!(stable(&closed), unstable == 0);
        let turns = encirclements(&study, &law).unsigned_abs() as usize;
        assert_eq!(turns, unstable, "{gain}");
    }
}

/// A search for these sensors finds a controller. With sensors that see nothing below 3 Hz, a
/// suspension of 1 Hz is out of reach, and a warning says so.
#[test]
fn a_design_takes_them_into_account() {
    let seismic = Corners {
        lower: Some((0.003, 1)),
        bandwidth: Some(5e3),
        ..Corners::default()
    };
    let study = with("acceleration", &[("accelerometer", seismic)], &[]);
    let design = search().design(&study).unwrap();
    let law = LinearLaw::new(&design.table);
    let closed = SampledLoop {
        plant: study.plant(),
        law,
    };
    assert!(stable(&closed.poles().unwrap()));
    assert!(host_gen::analysis::warnings::warnings(&study).is_empty());

    let blind = Corners {
        lower: Some((3.0, 2)),
        ..Corners::default()
    };
    let study = with("acceleration", &[("accelerometer", blind)], &[]);
    let warnings = host_gen::analysis::warnings::warnings(&study);
    assert!(
        warnings.iter().any(|w| w.contains("lower_corner")),
        "{warnings:?}"
    );
    assert!(search().design(&study).is_err());
}

/// Sines of force in the simulation, and the sines that its codes have.
#[test]
fn the_simulation_has_the_filter() {
    let corners = Corners {
        lower: Some((20.0, 2)),
        resonance: Some((300.0, 0.1)),
        ..Corners::default()
    };
    let quiet = [
        ("damping.modal", "0.2"),
        ("board.adc.noise", "0.0"),
        ("board.dac.noise", "0.0"),
        ("board.accelerometer.noise_density", "0.0"),
    ];
    let study = with("acceleration", &[("accelerometer", corners)], &quiet);
    let machine = study.machine();
    let board = &machine.board;
    let settings = Simulation {
        floor_rms: 0.0,
        ..machine.simulation
    };
    for hz in [5.0, 20.0, 60.0, 300.0, 500.0] {
        let expected = study.plant().response(hz).g22();
        let largest = expected.column(0).camax();
        // Half of the range for the force of the leg, which is 150 N.
        let mut board = board.clone();
        board.sensor.sensitivity = 5.0 / (150.0 * largest);
        let board = &board;
        let mut rig = Rig::new(study.plant().clone(), board, &settings);
        let mut sums = [Complex::new(0.0, 0.0); LEGS + 1];
        let steps = 40_000;
        for k in 0..2 * steps {
            let phase = TAU * hz * f64::from(k) * board.period();
            let code = (32_767.5 + 20_000.0 * phase.cos()).round();
            let mut codes = [DacCode(32_768); LEGS];
            codes[0] = DacCode(code as u16);
            let read = rig.sample().sensors;
            rig.advance(codes);
            if k >= steps {
                let turn = Complex::cis(-phase) * (2.0 / f64::from(steps));
                for (sum, code) in sums.iter_mut().zip(read) {
                    let volts = f64::from(code.0) * board.adc.lsb() - board.sensor.offset;
                    *sum += turn * (volts / board.sensor.sensitivity);
                }
                sums[LEGS] += turn * board.dac.force(codes[0], board.actuator_gain);
            }
        }
        for i in 0..LEGS {
            let error = (sums[i] / sums[LEGS] - expected[(i, 0)]).norm() / largest;
            assert!(error < 2e-3, "{hz} Hz, sensor {i}: {error:.1e}");
        }
    }
}

#[test]
fn wrong_corners_are_refused() {
    for (keys, entry, says) in [
        (vec![("lower_corner", "0.0")], "lower_corner", "above 0 Hz"),
        (vec![("lower_order", "1")], "lower_order", "no lower_corner"),
        (
            vec![("lower_corner", "0.1"), ("lower_order", "3")],
            "lower_order",
            "1 or 2, not 3",
        ),
        (
            vec![("lower_corner", "90.0"), ("bandwidth", "100.0")],
            "lower_corner",
            "at most half of bandwidth, 100 Hz, not 90",
        ),
        (
            vec![
                ("lower_corner", "90.0"),
                ("resonance", "{ hz = 100.0, damping = 0.1 }"),
            ],
            "lower_corner",
            "at most half of resonance.hz",
        ),
        (
            vec![("resonance", "{ hz = -1.0, damping = 0.1 }")],
            "resonance.hz",
            "above 0 Hz",
        ),
        (
            vec![("resonance", "{ hz = 100.0, damping = 1.0 }")],
            "resonance.damping",
            "0.0001 to 0.99",
        ),
        (
            vec![("resonance", "{ hz = 100.0 }")],
            "resonance",
            "missing key `damping`",
        ),
    ] {
        let keys: Vec<_> = keys
            .into_iter()
            .map(|(key, value)| (format!("board.accelerometer.{key}"), value))
            .collect();
        let edits: Vec<_> = keys.iter().map(|(key, value)| (&**key, *value)).collect();
        let error = parse(&edited(&edits)).unwrap_err();
        assert_eq!(
            error.entry(),
            format!("board.accelerometer.{entry}"),
            "{error}"
        );
        assert!(error.to_string().contains(says), "{error}");
        assert!(error.place().is_some(), "{error}");
    }
}

/// A sensor without the new keys is described as before.
#[test]
fn a_description_without_corners_is_the_old_one() {
    let plain = parse(&edited(&[])).unwrap();
    let text = serde_json::to_string(plain.description()).unwrap();
    assert!(!text.contains("lower") && !text.contains("resonance"));
    assert!(text.contains(r#""noise_density":1e-7"#) || text.contains(r#""noise_density":1e-07"#));
    assert!(plain.with_feedback(FeedbackKind::Force).is_some());
}
