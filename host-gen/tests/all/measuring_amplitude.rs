//! The default amplitude of a measurement: no machine is shaken into a fault, and none is
//! hardly shaken at all.

use host_gen::board::measure::{Pass, Response};
use host_gen::control::LinearLaw;
use host_gen::design::Study;
use host_gen::simulate::SoftwareBoard;
use shared::LEGS;
use shared::controller::Memory;
use shared::link::Request;
use shared::multisine::{LINES, Slot};
use shared::supervisor::{Event, Mode};
use shared::table::ValidTable;

use crate::common::{edited, searched};

/// The metrology frame with all masses and stiffnesses divided by `by`: the same frequencies,
/// and as many times the acceleration per newton. The self-test pushes as much less.
fn lighter(by: f64) -> String {
    let numbers = |values: &[f64]| {
        let values: Vec<_> = values.iter().map(|x| format!("{:e}", x / by)).collect();
        match &values[..] {
            [one] => one.clone(),
            many => format!("[{}]", many.join(", ")),
        }
    };
    let entries: [(&str, &[f64]); 11] = [
        ("bodies.frame.mass", &[742.0]),
        ("bodies.frame.inertia", &[52.25, 52.25, 104.5]),
        ("bodies.lens.mass", &[851.6]),
        ("bodies.lens.inertia", &[72.95, 72.95, 49.15]),
        ("profiles.leg.axial", &[8.389e6]),
        ("profiles.leg.bending", &[371.0, 371.0]),
        ("profiles.leg.torsion", &[5.84]),
        ("profiles.block.axial", &[4.5e7]),
        ("profiles.block.bending", &[3.0e4, 3.0e4]),
        ("profiles.block.torsion", &[1.0e4]),
        ("supervision.test_force", &[0.05]),
    ];
    let entries = entries.map(|(entry, values)| (entry, numbers(values)));
    let entries: Vec<_> = entries
        .iter()
        .map(|(entry, value)| (*entry, &**value))
        .collect();
    edited(&entries)
}

/// A board after its self-test.
fn tested<'a>(study: &Study, table: &ValidTable, lines: &'a mut [Slot]) -> SoftwareBoard<'a> {
    let memory = Memory {
        lines,
        ..Memory::none()
    };
    let mut board = SoftwareBoard::new(study, table, memory);
    board.controller.ask(Event::SelfTest).unwrap();
    run(&mut board, 5.0);
    let report = board.controller.report();
    assert_eq!(report.mode, Mode::Idle, "{report:?}");
    board
}

fn run(board: &mut SoftwareBoard<'_>, seconds: f64) {
    for _ in 0..(seconds * 20e3) as u32 {
        board.sample();
    }
}

/// The first pass of a measurement from `low`, Hz.
fn pass(study: &Study, table: &ValidTable, law: Option<&LinearLaw>, low: f64) -> Pass {
    let mut pass = Pass::first(20e3, [low, 500.0]).unwrap();
    let responses = Response::of_model(study, table, law, &pass.hertz());
    pass.set_amplitudes(study, table, &responses, None);
    pass
}

/// Injects into `leg` for two seconds, after which every monitor has had its say; then waits
/// for the machine to come to rest. The forces are `by` times those of the pass.
fn shake(board: &mut SoftwareBoard<'_>, pass: &Pass, leg: usize, by: f32) {
    let mut injection = pass.injection(leg, 40_000);
    injection.legs[leg] *= by;
    board.controller.start_injection(injection).unwrap();
    while board.controller.report().injecting > 0 {
        board.sample();
    }
    run(board, 1.0);
}

/// Sets the lines of a pass, as a host does over the link.
fn set(board: &mut SoftwareBoard<'_>, pass: &Pass) {
    let Request::Multisine(window, lines) = pass.lines() else {
        panic!("lines are set by another request");
    };
    board.controller.set_multisine(window, &lines).unwrap();
}

/// Ends signals as a host does that has all windows: at any sample of them.
fn end_anywhere(board: &mut SoftwareBoard<'_>, pass: &Pass) {
    for k in 0..1500 {
        let samples = 1000 + (k as u32 * 4861) % 7000;
        let mut injection = pass.injection(k % LEGS, samples);
        // Half of it: a cut sine is a pulse, and those of many signals in a row add up.
        injection.legs[k % LEGS] *= 0.5;
        board.controller.start_injection(injection).unwrap();
        while board.controller.report().injecting > 0 {
            board.sample();
        }
        for _ in 0..405 + k * 37 % 45 {
            board.sample();
        }
        let fault = board.controller.report().fault;
        assert_eq!(fault, None, "leg {}, {samples} samples", k % LEGS + 1);
    }
}

#[test]
fn no_machine_is_shaken_into_a_fault() {
    for by in [1.0, 30.0] {
        let (study, found) = searched(&lighter(by));
        let table = &found.as_ref().unwrap().table;
        let mut lines = [Slot::EMPTY; LINES];
        let mut board = tested(study, table, &mut lines);
        let open = pass(study, table, None, 0.5);
        set(&mut board, &open);
        for leg in 0..LEGS {
            shake(&mut board, &open, leg, 1.0);
            let fault = board.controller.report().fault;
            assert_eq!(fault, None, "{by}: {} N, leg {leg}", open.force());
        }

        let law = LinearLaw::new(table);
        let closed = pass(study, table, Some(&law), 0.5);
        println!("{by}: {} N open, {} N closed", open.force(), closed.force());
        board.controller.ask(Event::Start).unwrap();
        run(&mut board, 20.0);
        assert_eq!(board.controller.report().mode, Mode::Closed, "{by}");
        set(&mut board, &closed);
        for leg in 0..LEGS {
            shake(&mut board, &closed, leg, 1.0);
            let fault = board.controller.report().fault;
            assert_eq!(fault, None, "{by}: {} N, leg {leg}", closed.force());
        }
        if by == 1.0 {
            // Slower sines would be longer pulses.
            let faster = pass(study, table, Some(&law), 40.0);
            set(&mut board, &faster);
            end_anywhere(&mut board, &faster);
        }
        // Not far below it either.
        let [open_force, closed_force] = [&open, &closed].map(Pass::force);
        assert!(
            closed_force > 0.1 * open_force,
            "{by}: {open_force} N, {closed_force} N"
        );
        if by > 1.0 {
            let mut lines = [Slot::EMPTY; LINES];
            let mut board = tested(study, table, &mut lines);
            set(&mut board, &open);
            // As much as the limit allows.
            let more = 0.99 * table.get().actuators[0].limit / open_force as f32;
            assert!(more < 16.0, "{more}");
            shake(&mut board, &open, 0, more);
            assert!(board.controller.report().fault.is_some(), "{by}");
        }
    }
}
