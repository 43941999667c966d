//! A soft start on a floor that shakes.

use crate::common::looped_frame;
use host_gen::simulate::Rig;
use shared::LEGS;
use shared::codes::{AdcCode, DacCode, Samples};
use shared::controller::{Controller, Memory, Reading};
use shared::supervisor::{Event, Mode, QUIET};

/// Begins a soft start: a second at rest, the self-test, and a second again.
fn begin(
    controller: &mut Controller<'_>,
    second: usize,
    mut sample: impl FnMut(&mut Controller<'_>),
) {
    for event in [Event::SelfTest, Event::Start] {
        for _ in 0..second {
            sample(controller);
        }
        controller.ask(event).unwrap();
        while controller.report().mode == Mode::Testing {
            sample(controller);
        }
    }
}

/// While a leg pushes with more than half its limit, the gain of a soft start falls; afterwards
/// it grows again, and the loop closes.
#[test]
fn large_forces_lower_the_gain() {
    let (study, table, _) = looped_frame();
    let machine = study.machine();
    let board = &machine.board;
    let mut rig = Rig::new(study.plant().clone(), board, &machine.simulation);
    let mut controller = Controller::new(*table, table.checksum(), Memory::none());
    let second = board.sample_rate as usize;
    let push = |dac: [DacCode; LEGS]| {
        let forces = dac.map(|code| board.dac.force(code, board.actuator_gain).abs());
        forces.into_iter().fold(0.0, f64::max) / board.force_limit
    };
    let mut sample = |controller: &mut Controller<'_>, floor: f64| {
        rig.floor_gain = floor;
        let dac = controller.on_sample(Reading::from(rig.sample()));
        rig.advance(dac);
        push(dac)
    };
    begin(&mut controller, second, |controller| {
        sample(controller, 1.0);
    });
    while controller.report().gain < 0.2 {
        sample(&mut controller, 1.0);
    }
    assert_eq!(controller.report().mode, Mode::Starting);
    let mut pushed = 0.0;
    let mut lowered = 0;
    for _ in 0..second / 10 {
        let before = controller.report().gain;
        let now = sample(&mut controller, 100.0);
        let after = controller.report().gain;
        // What the leg did in the sample before decides.
        if pushed > 0.51 {
            assert!(after < before, "{before} to {after} at {pushed}");
            lowered += 1;
        } else if pushed < 0.49 {
            assert!(after > before, "{before} to {after} at {pushed}");
        }
        pushed = now;
    }
    assert!(lowered > 20, "{lowered}");
    for _ in 0..60 * second {
        if controller.report().mode != Mode::Starting {
            break;
        }
        sample(&mut controller, 1.0);
    }
    let report = controller.report();
    assert_eq!((report.mode, report.fault), (Mode::Closed, None));
}

/// When the wait of a soft start ends, the AC coupling and the law are set anew, at a gain at which
/// the offsets of the sensors have filled the integrals: nothing jumps, on a floor that does not
/// move. Before the forces were handed over, the lens moved more than ten times as much.
#[test]
fn the_end_of_the_wait_is_not_felt() {
    let (study, table, _) = looped_frame();
    let machine = study.machine();
    let board = &machine.board;
    let mut rig = Rig::new(study.plant().clone(), board, &machine.simulation);
    rig.floor_gain = 0.0;
    let mut controller = Controller::new(*table, table.checksum(), Memory::none());
    let second = board.sample_rate as usize;
    let mut sample = |controller: &mut Controller<'_>| {
        let codes = rig.sample();
        let sensors = core::array::from_fn(|i| {
            // Offsets of some of the ADC's range.
            AdcCode(codes.sensors[i].0.saturating_add(400 - 130 * i as i16))
        });
        let codes = Samples { sensors, ..codes };
        let dac = controller.on_sample(Reading::from(codes));
        rig.advance(dac).amax()
    };
    begin(&mut controller, second, |controller| {
        sample(controller);
    });
    while controller.report().gain < QUIET {
        sample(&mut controller);
    }
    let wait = 2 * table.get().supervision.settle as usize;
    let mut run = |count: usize| {
        let motions = (0..count).map(|_| sample(&mut controller));
        motions.fold(0.0, f64::max)
    };
    run(wait - second);
    let before = run(second - 10);
    // The gain is still below twice that of the wait.
    let after = run(second / 10);
    println!("{before:e} then {after:e} m/s²");
    assert!(after < 1.5 * before, "{before:e} then {after:e} m/s²");
}
