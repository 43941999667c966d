//! The controller step: what holds for every table and every input, and its
//! signs and closed forms.

use nalgebra::Matrix6;
use proptest::prelude::*;
use shared::LEGS;
use shared::codes::{Adc, AdcCode, Dac, DacCode, LegForces};
use shared::step::{Clamp, PiState, State, pi, step};
use shared::table::{
    FORMAT_VERSION, Feedback, Law, ModelDigest, Shaping, Table, TableError, ValidTable,
};

fn table() -> Table {
    Table {
        version: FORMAT_VERSION,
        model: ModelDigest([0; 32]),
        sample_rate: 20e3,
        feedback: Feedback::Acceleration,
        sensors: [Adc::new(16, 10.0).unwrap().calibration(20.0); LEGS],
        adc_max: AdcCode(32767),
        shaping: Shaping {
            ac_coupling: 0.0,
            roll_off: 1.0,
        },
        law: Law {
            proportional: Matrix6::zeros(),
            integral: Matrix6::zeros(),
            leak: 0.0,
            anti_windup: 0.0,
        },
        actuators: [Dac::new(16, 0.0, 5.0).unwrap().drive(100.0, 200.0); LEGS],
        dac_max: DacCode(65535),
    }
}

fn force(code: DacCode) -> f64 {
    Dac::new(16, 0.0, 5.0).unwrap().force(code, 100.0)
}

/// Half a DAC step, N, and a little for single precision.
const CODE: f64 = 0.51 * 100.0 * 5.0 / 65536.0;

fn valid(table: Table) -> ValidTable {
    table.validate().unwrap()
}

/// One step from rest, AC coupling at zero.
fn first(table: &ValidTable, adc: [i16; LEGS], injection: [f32; LEGS]) -> [f64; LEGS] {
    let mut state = State::settled_on(table, [AdcCode(0); LEGS]);
    step(table, &mut state, adc.map(AdcCode), LegForces(injection))
        .dac
        .map(force)
}

/// Leg 2 alone answers sensor 1 alone, and against it: Eq. (14).
#[test]
fn the_controller_opposes() {
    let mut t = table();
    t.law.proportional[(2, 1)] = 1000.0;
    let out = first(&valid(t), [0, 3000, 0, 0, 0, 0], [0.0; LEGS]);
    // 3000 codes of 10/32768 V at 20 V/(m/s²).
    let expected = -1000.0 * 3000.0 * 10.0 / 32768.0 / 20.0;
    for (i, force) in out.iter().enumerate() {
        let expected = if i == 2 { expected } else { 0.0 };
        assert!((force - expected).abs() <= CODE, "leg {i}: {force} N");
    }
}

#[test]
fn injection_pushes() {
    let out = first(
        &valid(table()),
        [0; LEGS],
        [0.0, 50.0, 0.0, -70.0, 0.0, 0.0],
    );
    for (force, expected) in out.iter().zip([0.0, 50.0, 0.0, -70.0, 0.0, 0.0]) {
        assert!((force - expected).abs() <= CODE);
    }
}

/// Trapezoids: after n equal samples from rest the integral is (2n − 1)·K_i·y.
#[test]
fn the_integral_is_trapezoidal() {
    let mut t = table();
    t.law.integral[(0, 0)] = 2.0;
    let mut state = PiState::REST;
    let y = [0.5, 0.0, 0.0, 0.0, 0.0, 0.0];
    for n in 1..=50 {
        let (force, clamp) = pi(&t.law, &[1e6; LEGS], &mut state, &y, &[0.0; LEGS]);
        assert_eq!(clamp, Clamp::Idle);
        // Whole numbers: exact in single precision.
        assert_eq!(force[0], -(2.0 * n as f32 - 1.0));
    }
}

/// The leak empties the integral by 1/e in 1/leak steps.
#[test]
fn the_integral_leaks() {
    let mut t = table();
    t.law.integral[(0, 0)] = 1.0;
    t.law.leak = 1e-3;
    let mut state = PiState::REST;
    let mut last = [0.0; LEGS];
    for n in 0..1002 {
        let y = if n == 0 { 10.0 } else { 0.0 };
        let y = [y, 0.0, 0.0, 0.0, 0.0, 0.0];
        last = pi(&t.law, &[1e6; LEGS], &mut state, &y, &[0.0; LEGS]).0;
    }
    // Two trapezoid halves of 10, the first a step older.
    let expected = -20.0 * (-1.0f32).exp();
    assert!((last[0] / expected - 1.0).abs() < 2e-3, "{}", last[0]);
}

#[test]
fn a_constant_offset_gives_no_kick_and_dies_out() {
    let mut t = table();
    t.shaping.ac_coupling = 1e-3;
    t.law.proportional = Matrix6::identity() * 50e3;
    let t = valid(t);
    let offset = [AdcCode(500); LEGS];
    let mut state = State::settled_on(&t, offset);
    for _ in 0..10_000 {
        let out = step(&t, &mut state, offset, LegForces::ZERO);
        assert!(out.dac.iter().all(|code| force(*code).abs() <= CODE));
    }
    // Another offset: away after some time constants, though not at once.
    let moved = [AdcCode(700); LEGS];
    let kick = force(step(&t, &mut state, moved, LegForces::ZERO).dac[0]);
    assert!(kick < -100.0, "{kick} N");
    let mut last = kick;
    for _ in 0..30_000 {
        last = force(step(&t, &mut state, moved, LegForces::ZERO).dac[0]);
    }
    assert!(last.abs() <= CODE, "{last} N");
}

/// A second of overload, then a small pull the other way: with anti-windup the
/// legs follow within some of its time constants, without it they stay at the
/// limit for as long as they were overloaded.
#[test]
fn anti_windup_recovers() {
    let steps_to_recover = |anti_windup: f32| {
        let mut t = table();
        t.law.integral = Matrix6::identity() * 10.0;
        t.law.anti_windup = anti_windup;
        let t = valid(t);
        let mut state = State::settled_on(&t, [AdcCode(0); LEGS]);
        for _ in 0..20_000 {
            let out = step(&t, &mut state, [AdcCode(3000); LEGS], LegForces::ZERO);
            assert!(state.is_finite());
            assert!(out.dac.iter().all(|code| force(*code) >= -200.0 - CODE));
        }
        (0..)
            .find(|_| {
                let out = step(&t, &mut state, [AdcCode(-3000); LEGS], LegForces::ZERO);
                !out.status.clamped
            })
            .unwrap()
    };
    let time_constant = 100;
    let with = steps_to_recover(1.0 / time_constant as f32);
    let without = steps_to_recover(0.0);
    assert!(with < 5 * time_constant, "{with} steps");
    assert!(without > 10_000, "{without} steps");
}

#[test]
fn a_force_that_is_no_number_gives_the_safe_codes() {
    let mut t = table();
    t.law.proportional = Matrix6::repeat(f32::MAX);
    let t = valid(t);
    let mut state = State::settled_on(&t, [AdcCode(0); LEGS]);
    let out = step(
        &t,
        &mut state,
        [32767, -32768, 32767, -32768, 32767, 32767].map(AdcCode),
        LegForces([f32::NAN; LEGS]),
    );
    assert!(out.status.not_finite);
    assert_eq!(out.dac, t.safe_codes());
    assert_eq!(out.dac, [DacCode(32768); LEGS]);
}

#[test]
fn sensors_at_a_rail_are_reported() {
    let t = valid(table());
    let mut state = State::settled_on(&t, [AdcCode(0); LEGS]);
    let adc = [32767, 32766, -32768, -32767, 0, 32767].map(AdcCode);
    let out = step(&t, &mut state, adc, LegForces::ZERO);
    assert_eq!(out.status.sensors_at_rail, 0b10_0101);
}

#[test]
fn every_bad_field_is_refused() {
    let refused = |change: &dyn Fn(&mut Table), expected: TableError| {
        let mut t = table();
        change(&mut t);
        assert_eq!(t.validate().err(), Some(expected));
    };
    assert!(table().validate().is_ok());
    refused(&|t| t.version = 2, TableError::Version);
    refused(&|t| t.sample_rate = 0.0, TableError::SampleRate);
    refused(&|t| t.sample_rate = f32::NAN, TableError::SampleRate);
    refused(&|t| t.sensors[3].gain = 0.0, TableError::Sensor(3));
    refused(
        &|t| t.sensors[5].zero = f32::INFINITY,
        TableError::Sensor(5),
    );
    refused(&|t| t.adc_max = AdcCode(0), TableError::AdcRange);
    refused(&|t| t.shaping.ac_coupling = -0.1, TableError::Shaping);
    refused(&|t| t.shaping.roll_off = 0.0, TableError::Shaping);
    refused(&|t| t.shaping.roll_off = f32::NAN, TableError::Shaping);
    refused(&|t| t.law.leak = 1.5, TableError::Integral);
    refused(&|t| t.law.anti_windup = f32::NAN, TableError::Integral);
    refused(
        &|t| t.law.proportional[(4, 1)] = f32::NAN,
        TableError::Gain(4),
    );
    refused(
        &|t| t.law.integral[(1, 4)] = f32::INFINITY,
        TableError::Gain(1),
    );
    refused(&|t| t.actuators[2].limit = -1.0, TableError::Actuator(2));
    refused(&|t| t.actuators[2].limit = 300.0, TableError::Actuator(2));
    refused(&|t| t.actuators[0].gain = 0.0, TableError::Actuator(0));
    refused(&|t| t.actuators[1].zero = f32::NAN, TableError::Actuator(1));
    refused(&|t| t.dac_max = DacCode(4095), TableError::Actuator(0));
}

fn matrix(size: f32) -> impl Strategy<Value = Matrix6<f32>> {
    prop::collection::vec(-size..size, 36).prop_map(|all| Matrix6::from_row_slice(&all))
}

fn any_table() -> impl Strategy<Value = ValidTable> {
    (
        matrix(1e6),
        matrix(1e3),
        prop::array::uniform6(10.0..240.0f32),
        prop::array::uniform4(0.0..1.0f32),
        -1e-3..1e-3f32,
    )
        .prop_map(|(proportional, integral, limits, c, gain)| {
            let mut t = table();
            t.shaping = Shaping {
                ac_coupling: c[0] * c[0],
                roll_off: c[1].max(1e-4),
            };
            t.law = Law {
                proportional,
                integral,
                leak: c[2] * c[2] * c[2],
                anti_windup: c[3],
            };
            for (drive, limit) in t.actuators.iter_mut().zip(limits) {
                drive.limit = limit;
            }
            t.sensors[0].gain = if gain == 0.0 { 1e-3 } else { gain };
            valid(t)
        })
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 300,
        rng_seed: prop::test_runner::RngSeed::Fixed(5),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// Whatever the table, the codes and the injection: every leg within its
    /// limit, the state finite.
    #[test]
    fn outputs_stay_inside_their_limits(
        t in any_table(),
        samples in prop::collection::vec((prop::array::uniform6(any::<i16>()), prop::array::uniform6(-1e4..1e4f32)), 1..60),
    ) {
        let mut state = State::settled_on(&t, samples[0].0.map(AdcCode));
        for (adc, injection) in samples {
            let out = step(&t, &mut state, adc.map(AdcCode), LegForces(injection));
            for (code, drive) in out.dac.iter().zip(&t.get().actuators) {
                prop_assert!(force(*code).abs() <= f64::from(drive.limit) + CODE);
            }
            prop_assert!(state.is_finite());
            prop_assert!(!out.status.not_finite);
        }
    }

    /// The clamp scales the vector of forces and does not bend it: all six
    /// forces are the same part of what they would be without limits, and the
    /// worst leg is at its limit.
    #[test]
    fn the_clamp_keeps_the_direction(
        t in any_table(),
        y in prop::array::uniform6(-1.0..1.0f32),
        injection in prop::array::uniform6(-500.0..500.0f32),
    ) {
        let law = &t.get().law;
        let limits = t.get().actuators.map(|drive| drive.limit);
        let mut state = PiState::REST;
        let (free, clamp) = pi(law, &[f32::MAX; LEGS], &mut state, &y, &injection);
        prop_assert_eq!(clamp, Clamp::Idle);
        let mut state = PiState::REST;
        let (held, clamp) = pi(law, &limits, &mut state, &y, &injection);
        let worst = (0..LEGS).map(|i| free[i].abs() / limits[i]).fold(0.0, f32::max);
        if worst <= 1.0 {
            prop_assert_eq!(clamp, Clamp::Idle);
            prop_assert_eq!(held, free);
        } else {
            prop_assert_eq!(clamp, Clamp::Active);
            for i in 0..LEGS {
                // Three roundings.
                prop_assert!((held[i] * worst - free[i]).abs() <= 4.0 * f32::EPSILON * free[i].abs());
                prop_assert!(held[i].abs() <= limits[i]);
            }
        }
    }
}
