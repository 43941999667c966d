//! A soft start on a floor that shakes.

use crate::common::looped_frame;
use host_gen::simulate::Rig;
use shared::LEGS;
use shared::codes::DacCode;
use shared::controller::{Controller, Memory, Reading};
use shared::supervisor::{Event, Mode};

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
    for event in [Event::SelfTest, Event::Start] {
        for _ in 0..second {
            sample(&mut controller, 1.0);
        }
        controller.ask(event).unwrap();
        while controller.report().mode == Mode::Testing {
            sample(&mut controller, 1.0);
        }
    }
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
