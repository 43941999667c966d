//! The controller step: what holds for every table and every input, and its
//! signs and closed forms.

mod common;

use common::{DIRECT, pushed, table};
use nalgebra::Matrix6;
use proptest::prelude::*;
use shared::LEGS;
use shared::codes::{Adc, AdcCode, Dac, DacCode, LegForces, Samples};
use shared::recorder::Record;
use shared::step::{
    Ahead, Clamp, Demand, Latched, LawState, State, follow, force as law_force, step,
};
use shared::table::{
    Channel, Complement, Direct, Feedback, Law, Modal, Paths, SECTIONS, Section, Table, TableError,
    ValidTable,
};

/// One mode after the other straight through, with no gain yet.
fn modal() -> Modal {
    Modal {
        input: Matrix6::identity(),
        complement: None,
        channels: [Channel {
            sections: [Section::PASS; SECTIONS],
            proportional: 0.0,
            integral: 0.0,
        }; LEGS],
        sections: 0,
        output: Matrix6::identity(),
    }
}

/// A table with this direct law.
fn direct(direct: Direct) -> Table {
    let mut t = table();
    t.law.paths = Paths::Direct(direct);
    t
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
    let mut state = State::settled_on(table, [AdcCode(0); LEGS].into());
    step(
        table,
        &mut state,
        adc.map(AdcCode).into(),
        pushed(injection),
    )
    .dac
    .map(force)
}

/// Leg 2 alone answers sensor 1 alone, and against it: Eq. (14).
#[test]
fn the_controller_opposes() {
    let mut law = DIRECT;
    law.proportional[(2, 1)] = 1000.0;
    let out = first(&valid(direct(law)), [0, 3000, 0, 0, 0, 0], [0.0; LEGS]);
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
    let mut law = DIRECT;
    law.integral[(0, 0)] = 2.0;
    let t = direct(law);
    let mut state = LawState::REST;
    let y = [0.5, 0.0, 0.0, 0.0, 0.0, 0.0];
    for n in 1..=50 {
        let (force, clamp) = law_force(
            &t.law,
            &[1e6; LEGS],
            &mut state,
            &y,
            &[0.0; LEGS],
            &Demand::LAW,
        );
        assert_eq!(clamp, Clamp::Idle);
        // Whole numbers: exact in single precision.
        assert_eq!(force[0], -(2.0 * n as f32 - 1.0));
    }
}

/// The leak empties the integral by 1/e in 1/leak steps.
#[test]
fn the_integral_leaks() {
    let mut law = DIRECT;
    law.integral[(0, 0)] = 1.0;
    let mut t = direct(law);
    t.law.leak = 1e-3;
    let mut state = LawState::REST;
    let mut last = [0.0; LEGS];
    for n in 0..1002 {
        let y = if n == 0 { 10.0 } else { 0.0 };
        let y = [y, 0.0, 0.0, 0.0, 0.0, 0.0];
        last = law_force(
            &t.law,
            &[1e6; LEGS],
            &mut state,
            &y,
            &[0.0; LEGS],
            &Demand::LAW,
        )
        .0;
    }
    // Two trapezoid halves of 10, the first a step older.
    let expected = -20.0 * (-1.0f32).exp();
    assert!((last[0] / expected - 1.0).abs() < 2e-3, "{}", last[0]);
}

#[test]
fn a_constant_offset_gives_no_kick_and_dies_out() {
    let mut t = direct(Direct {
        proportional: Matrix6::identity() * 50e3,
        ..DIRECT
    });
    t.ac_coupling = 1e-3;
    let t = valid(t);
    let offset = [AdcCode(500); LEGS].into();
    let mut state = State::settled_on(&t, offset);
    for _ in 0..10_000 {
        let out = step(&t, &mut state, offset, Demand::LAW);
        assert!(out.dac.iter().all(|code| force(*code).abs() <= CODE));
    }
    // Another offset: away after some time constants, though not at once.
    let moved = [AdcCode(700); LEGS];
    let kick = force(step(&t, &mut state, moved.into(), Demand::LAW).dac[0]);
    assert!(kick < -100.0, "{kick} N");
    let mut last = kick;
    for _ in 0..30_000 {
        last = force(step(&t, &mut state, moved.into(), Demand::LAW).dac[0]);
    }
    assert!(last.abs() <= CODE, "{last} N");
}

/// 1000 N/(m/s²) behind an AC coupling whose averages follow at most 1e-3 m/s².
fn limited_coupling() -> ValidTable {
    let mut t = direct(Direct {
        proportional: Matrix6::identity() * 1e3,
        ..DIRECT
    });
    t.ac_coupling = 1e-3;
    t.ac_limit = 1e-3;
    valid(t)
}

/// A shock of any height moves the AC coupling's average by its limit a time
/// constant and no more; a shift that stays is still followed.
#[test]
fn a_shock_is_no_offset() {
    let t = limited_coupling();
    let mut state = State::settled_on(&t, [AdcCode(0); LEGS].into());
    for _ in 0..100 {
        step(&t, &mut state, [AdcCode(30_000); LEGS].into(), Demand::LAW);
    }
    let after = force(step(&t, &mut state, [AdcCode(0); LEGS].into(), Demand::LAW).dac[0]);
    // Both averages rose by 100·1e-3·1e-3 m/s², at 1000 N/(m/s²).
    assert!((after - 0.2).abs() <= CODE, "{after} N");
    // 100 codes are 1.5e-3 m/s², past the limit.
    for _ in 0..20_000 {
        step(&t, &mut state, [AdcCode(100); LEGS].into(), Demand::LAW);
    }
    let settled = force(step(&t, &mut state, [AdcCode(100); LEGS].into(), Demand::LAW).dac[0]);
    assert!(settled.abs() <= CODE, "{settled} N");
}

/// With the loop open there is no such limit: an offset of any height is taken off before the loop
/// is closed.
#[test]
fn an_open_loop_follows_every_offset() {
    let t = limited_coupling();
    let mut state = State::settled_on(&t, [AdcCode(0); LEGS].into());
    let offset = [AdcCode(20_000); LEGS].into();
    let (mut ahead, mut latched) = (Ahead::NOTHING, Latched::NOTHING);
    for _ in 0..30_000 {
        ahead.open(&state, &LegForces::ZERO);
        let mut record = Record {
            adc: offset,
            ..Record::NONE
        };
        latched.latch(&t, &ahead, &mut record);
        follow(&t, &mut state, &ahead, &latched, &offset);
        assert_eq!(record.dac, t.safe_codes());
    }
    let left = force(step(&t, &mut state, offset, Demand::LAW).dac[0]);
    assert!(left.abs() <= CODE, "{left} N");
}

/// A second of overload, then a small pull the other way: with anti-windup the
/// legs follow within some of its time constants, without it they stay at the
/// limit for as long as they were overloaded.
#[test]
fn anti_windup_recovers() {
    let law = Direct {
        integral: Matrix6::identity() * 10.0,
        ..DIRECT
    };
    recovers(&direct(law));
    let mut law = modal();
    for channel in &mut law.channels {
        channel.integral = 10.0;
    }
    let mut t = table();
    t.law.paths = Paths::Modal(law);
    recovers(&t);
}

fn recovers(table: &Table) {
    let steps_to_recover = |anti_windup: f32| {
        let mut t = *table;
        t.law.anti_windup = anti_windup;
        let t = valid(t);
        let mut state = State::settled_on(&t, [AdcCode(0); LEGS].into());
        for _ in 0..20_000 {
            let out = step(&t, &mut state, [AdcCode(3000); LEGS].into(), Demand::LAW);
            assert!(state.is_finite());
            assert!(out.dac.iter().all(|code| force(*code) >= -200.0 - CODE));
        }
        (0..)
            .find(|_| {
                let out = step(&t, &mut state, [AdcCode(-3000); LEGS].into(), Demand::LAW);
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
    let t = valid(direct(Direct {
        proportional: Matrix6::repeat(f32::MAX),
        ..DIRECT
    }));
    let mut state = State::settled_on(&t, [AdcCode(0); LEGS].into());
    let out = step(
        &t,
        &mut state,
        [32767, -32768, 32767, -32768, 32767, 32767]
            .map(AdcCode)
            .into(),
        pushed([f32::NAN; LEGS]),
    );
    assert!(out.status.not_finite);
    assert_eq!(out.dac, t.safe_codes());
    assert_eq!(out.dac, [DacCode(32768); LEGS]);
}

#[test]
fn sensors_at_a_rail_are_reported() {
    let t = valid(table());
    let mut state = State::settled_on(&t, [AdcCode(0); LEGS].into());
    let adc = [32767, 32766, -32768, -32767, 0, 32767].map(AdcCode);
    let out = step(&t, &mut state, adc.into(), Demand::LAW);
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
    refused(&|t| t.version = 1, TableError::Version);
    refused(&|t| t.sample_rate = 0.0, TableError::SampleRate);
    refused(&|t| t.sample_rate = f32::NAN, TableError::SampleRate);
    refused(&|t| t.sensors[3].gain = 0.0, TableError::Sensor(3));
    refused(
        &|t| t.sensors[5].zero = f32::INFINITY,
        TableError::Sensor(5),
    );
    refused(&|t| t.adc_max = AdcCode(0), TableError::AdcRange);
    refused(&|t| t.ac_coupling = -0.1, TableError::Shaping);
    refused(&|t| t.ac_limit = 0.0, TableError::Shaping);
    refused(&|t| t.ac_limit = f32::NAN, TableError::Shaping);
    refused(&|t| t.law.leak = 1.5, TableError::Integral);
    refused(&|t| t.law.anti_windup = f32::NAN, TableError::Integral);
    let refused_direct = |change: &dyn Fn(&mut Direct), expected| {
        let mut law = DIRECT;
        change(&mut law);
        refused(&|t| t.law.paths = Paths::Direct(law), expected);
    };
    refused_direct(&|law| law.roll_off = 0.0, TableError::Shaping);
    refused_direct(&|law| law.roll_off = f32::NAN, TableError::Shaping);
    refused_direct(
        &|law| law.proportional[(4, 1)] = f32::NAN,
        TableError::Gain(4),
    );
    refused_direct(
        &|law| law.integral[(1, 4)] = f32::INFINITY,
        TableError::Gain(1),
    );
    let refused_modal = |change: &dyn Fn(&mut Modal), expected| {
        let mut law = modal();
        change(&mut law);
        refused(&|t| t.law.paths = Paths::Modal(law), expected);
    };
    refused_modal(&|law| law.sections = SECTIONS + 1, TableError::Sections);
    refused_modal(&|law| law.input[(3, 0)] = f32::NAN, TableError::Gain(3));
    refused_modal(&|law| law.output[(0, 5)] = f32::NAN, TableError::Gain(0));
    refused_modal(
        &|law| law.channels[5].integral = f32::NAN,
        TableError::Gain(5),
    );
    refused_modal(
        &|law| law.channels[2].sections[1].low = f32::NAN,
        TableError::Section(2),
    );
    // A double pole at z = −1, then an undamped pair.
    refused_modal(
        &|law| {
            law.channels[1].sections[0].rate = 2.0;
            law.channels[1].sections[0].damping = 2.0;
        },
        TableError::Section(1),
    );
    refused_modal(
        &|law| law.channels[4].sections[2].damping = 0.5,
        TableError::Section(4),
    );
    refused(&|t| t.actuators[2].limit = -1.0, TableError::Actuator(2));
    refused(&|t| t.actuators[2].limit = 300.0, TableError::Actuator(2));
    refused(&|t| t.actuators[0].gain = 0.0, TableError::Actuator(0));
    refused(&|t| t.actuators[1].zero = f32::NAN, TableError::Actuator(1));
    // 200 N are 26,214 codes: past one end of the range each.
    refused(&|t| t.actuators[3].zero = 20e3, TableError::Actuator(3));
    refused(&|t| t.actuators[3].zero = 45e3, TableError::Actuator(3));
    refused(&|t| t.dac_max = DacCode(4095), TableError::Actuator(0));
}

/// A section is stable exactly if both its poles lie inside the unit circle:
/// Jury's criterion in the table against the roots themselves.
#[test]
fn stable_sections_are_those_with_poles_inside() {
    let mut stable = 0;
    let mut count = 0;
    for i in 1..80 {
        for j in 1..80 {
            let (rate, damping) = (0.05 * i as f32, 0.05 * j as f32);
            let (c, d) = (f64::from(rate), f64::from(damping));
            // z² + (c·d − 2)·z + 1 − c·d + c².
            let (sum, product) = (2.0 - c * d, 1.0 - c * d + c * c);
            let root = sum * sum - 4.0 * product;
            let radius = if root < 0.0 {
                product.sqrt()
            } else {
                0.5 * (sum.abs() + root.sqrt())
            };
            if (radius - 1.0).abs() < 1e-6 {
                continue;
            }
            let mut law = modal();
            law.channels[0].sections[0].rate = rate;
            law.channels[0].sections[0].damping = damping;
            let mut t = table();
            t.law.paths = Paths::Modal(law);
            assert_eq!(t.validate().is_ok(), radius < 1.0, "{rate} {damping}");
            stable += usize::from(radius < 1.0);
            count += 1;
        }
    }
    assert!(stable > 500 && count - stable > 500, "{stable} of {count}");
}

/// What both kinds of sensors show alike passes as it is, whatever the split; of
/// a force alone only what is fast, of an acceleration alone what is slow.
#[test]
fn the_kinds_complement_each_other() {
    const SPLITS: [f32; LEGS] = [1e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0];
    let mut law = modal();
    for channel in &mut law.channels {
        channel.proportional = 1.0;
    }
    law.complement = Some(Complement {
        sensors: [Adc::new(16, 10.0).unwrap().calibration(0.02); LEGS],
        input: Matrix6::identity(),
        split: SPLITS,
    });
    let mut t = table();
    t.law.paths = Paths::Modal(law);
    let run = |a: f32, f: f32, steps: usize| {
        let mut state = LawState::REST;
        let mut last = [0.0; LEGS];
        for _ in 0..steps {
            last = law_force(
                &t.law,
                &[1e6; LEGS],
                &mut state,
                &[a; LEGS],
                &[f; LEGS],
                &Demand::LAW,
            )
            .0;
        }
        last
    };
    // The sum f + (a − f) rounds once.
    for out in run(3.0, 3.0, 500) {
        assert!((out + 3.0).abs() < 1e-6);
    }
    let [first, last] = [1, 200_000].map(|steps| run(0.0, 3.0, steps));
    // An average stands still where its step rounds to nothing.
    let still = |split: f32| 3.0 * f32::EPSILON / split + 1e-6;
    for (i, split) in SPLITS.into_iter().enumerate() {
        assert!((first[i] + 3.0 * (1.0 - split)).abs() < 1e-5, "{i}");
        assert!(last[i].abs() < still(split), "{i}: {}", last[i]);
    }
    let last = run(3.0, 0.0, 200_000);
    for (out, split) in last.into_iter().zip(SPLITS) {
        assert!((out + 3.0).abs() < still(split));
    }
}

/// A force sensor's offset, large as a leg's share of the weight may be, gives no
/// kick, and one at a rail is told.
#[test]
fn force_sensors_settle_too() {
    let mut law = modal();
    for channel in &mut law.channels {
        channel.proportional = 0.01;
    }
    law.complement = Some(Complement {
        sensors: [Adc::new(16, 10.0).unwrap().calibration(0.02); LEGS],
        input: Matrix6::identity(),
        split: [1e-3; LEGS],
    });
    let mut t = table();
    t.law.paths = Paths::Modal(law);
    let t = valid(t);
    let adc = Samples {
        sensors: [AdcCode(0); LEGS],
        forces: [20_000, -20_000, 32_767, 1, -32_768, 5].map(AdcCode),
    };
    let mut state = State::settled_on(&t, adc);
    let out = step(&t, &mut state, adc, Demand::LAW);
    assert_eq!(out.dac, t.safe_codes());
    assert_eq!(out.status.forces_at_rail, 0b01_0100);
    assert!(out.status.at_rail() && out.status.sensors_at_rail == 0);
    // A start resets the law, but not what the force sensors always read.
    state.start(&t);
    let out = step(&t, &mut state, adc, Demand::LAW);
    assert_eq!(out.dac, t.safe_codes());
}

#[test]
fn force_sensors_stand_beside_accelerometers_only() {
    let complement = Complement {
        sensors: [Adc::new(16, 10.0).unwrap().calibration(0.02); LEGS],
        input: Matrix6::identity(),
        split: [0.5; LEGS],
    };
    let with = |feedback, complement| {
        let mut t = table();
        t.feedback = feedback;
        t.law.paths = Paths::Modal(Modal {
            complement: Some(complement),
            ..modal()
        });
        t.validate().err()
    };
    assert_eq!(with(Feedback::Acceleration, complement), None);
    assert_eq!(
        with(Feedback::Force, complement),
        Some(TableError::Complement)
    );
    let mut dead = complement;
    dead.sensors[4].gain = 0.0;
    assert_eq!(
        with(Feedback::Acceleration, dead),
        Some(TableError::ForceSensor(4))
    );
    let mut shut = complement;
    shut.split[2] = 0.0;
    assert_eq!(
        with(Feedback::Acceleration, shut),
        Some(TableError::Shaping)
    );
}

/// With all channels and sections alike, sensors → modes → legs is one matrix.
#[test]
fn alike_channels_are_one_matrix() {
    let input = Matrix6::from_fn(|i, j| ((3 * i + 5 * j) % 7) as f32 - 2.5);
    let output = Matrix6::from_fn(|i, j| ((2 * i + 3 * j) % 5) as f32 - 1.5);
    let mut law = modal();
    law.input = input;
    law.output = output;
    for channel in &mut law.channels {
        channel.proportional = 0.5;
        channel.integral = 0.25;
    }
    let mut one = table();
    one.law.paths = Paths::Modal(law);
    let two = direct(Direct {
        roll_off: 1.0,
        proportional: output * input * 0.5,
        integral: output * input * 0.25,
    });
    let mut states = [LawState::REST; 2];
    for k in 0..200u32 {
        let y = core::array::from_fn(|i| ((k * 7 + 3 * i as u32) % 11) as f32 - 5.0);
        let [a, b] = [&one, &two].map(|t| t.law);
        let modal = law_force(
            &a,
            &[1e9; LEGS],
            &mut states[0],
            &y,
            &[0.0; LEGS],
            &Demand::LAW,
        )
        .0;
        let direct = law_force(
            &b,
            &[1e9; LEGS],
            &mut states[1],
            &y,
            &[0.0; LEGS],
            &Demand::LAW,
        )
        .0;
        // All numbers are small multiples of 1/16: exact.
        assert_eq!(modal, direct);
    }
}

fn matrix(size: f32) -> impl Strategy<Value = Matrix6<f32>> {
    prop::collection::vec(-size..size, 36).prop_map(|all| Matrix6::from_row_slice(&all))
}

fn any_section() -> impl Strategy<Value = Section> {
    (
        0.001..1.0f32,
        0.01..1.0f32,
        prop::array::uniform3(-30.0..30.0f32),
    )
        .prop_map(|(rate, part, [direct, band, low])| Section {
            rate,
            // Between the bounds of stability.
            damping: rate * 1.01 + part * (1.9 / rate + 0.45 * rate - rate * 1.01),
            direct,
            band,
            low,
        })
}

fn any_paths() -> impl Strategy<Value = Paths> {
    let direct =
        (matrix(1e6), matrix(1e3), 1e-4..1.0f32).prop_map(|(proportional, integral, roll_off)| {
            Paths::Direct(Direct {
                roll_off,
                proportional,
                integral,
            })
        });
    let channel = (
        prop::array::uniform3(any_section()),
        -1e4..1e4f32,
        -10.0..10.0f32,
    )
        .prop_map(|(sections, proportional, integral)| Channel {
            sections,
            proportional,
            integral,
        });
    let complement =
        (matrix(50.0), prop::array::uniform6(1e-4..1.0f32)).prop_map(|(input, split)| Complement {
            sensors: [Adc::new(16, 10.0).unwrap().calibration(0.02); LEGS],
            input,
            split,
        });
    let modal = (
        matrix(50.0),
        prop::option::of(complement),
        prop::array::uniform6(channel),
        0..=SECTIONS,
        matrix(50.0),
    )
        .prop_map(|(input, complement, channels, sections, output)| {
            Paths::Modal(Modal {
                input,
                complement,
                channels,
                sections,
                output,
            })
        });
    prop_oneof![direct, modal]
}

fn any_table() -> impl Strategy<Value = ValidTable> {
    (
        any_paths(),
        prop::array::uniform6(10.0..240.0f32),
        prop::array::uniform3(0.0..1.0f32),
        -1e-3..1e-3f32,
    )
        .prop_map(|(paths, limits, c, gain)| {
            let mut t = table();
            t.ac_coupling = c[0] * c[0];
            t.law = Law {
                paths,
                leak: c[1] * c[1] * c[1],
                anti_windup: c[2],
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
        let mut state = State::settled_on(&t, samples[0].0.map(AdcCode).into());
        for (adc, injection) in samples {
            let out = step(&t, &mut state, adc.map(AdcCode).into(), pushed(injection));
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
        let mut state = LawState::REST;
        let (free, clamp) = law_force(law, &[f32::MAX; LEGS], &mut state, &y, &[0.0; LEGS], &pushed(injection));
        prop_assert_eq!(clamp, Clamp::Idle);
        let mut state = LawState::REST;
        let (held, clamp) = law_force(law, &limits, &mut state, &y, &[0.0; LEGS], &pushed(injection));
        let worst = (0..LEGS).map(|i| free[i].abs() / limits[i]).fold(0.0, f32::max);
        if worst <= 1.0 {
            prop_assert_eq!(clamp, Clamp::Idle);
            prop_assert_eq!(held, free);
        } else {
            prop_assert!(matches!(clamp, Clamp::Active(_)));
            for i in 0..LEGS {
                // Three roundings.
                prop_assert!((held[i] * worst - free[i]).abs() <= 4.0 * f32::EPSILON * free[i].abs());
                prop_assert!(held[i].abs() <= limits[i]);
            }
        }
    }
}
