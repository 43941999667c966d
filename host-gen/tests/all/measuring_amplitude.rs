//! The default amplitude of a measurement: no machine is shaken into a fault, and none is
//! hardly shaken at all.

use host_gen::board::measure::{amplitude, multisine};
use host_gen::control::LinearLaw;
use host_gen::design::Study;
use host_gen::simulate::SoftwareBoard;
use shared::LEGS;
use shared::controller::Memory;
use shared::injection::{Injection, PERIOD, Point};
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
fn tested<'a>(study: &Study, table: &ValidTable, period: &'a mut [Point]) -> SoftwareBoard<'a> {
    let memory = Memory {
        period,
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

/// Injects into `leg` for two seconds, after which every monitor has had its say; then waits
/// for the machine to come to rest.
fn shake(board: &mut SoftwareBoard<'_>, leg: usize, amplitude: f64) {
    let mut legs = [0.0; LEGS];
    legs[leg] = amplitude as f32;
    let injection = Injection {
        signal: multisine(PERIOD),
        legs,
        samples: 40_000,
    };
    board.controller.start_injection(injection).unwrap();
    // The first one waits until its period is computed.
    while board.controller.report().injecting > 0 {
        board.sample();
    }
    run(board, 1.0);
}

/// Ends signals as a host does that has all windows: at any sample of them.
fn end_anywhere(board: &mut SoftwareBoard<'_>, amplitude: f64) {
    for k in 0..1500 {
        let mut legs = [0.0; LEGS];
        legs[k % LEGS] = amplitude as f32;
        let samples = 1000 + (k as u32 * 4861) % (PERIOD - 1000);
        let injection = Injection {
            signal: multisine(PERIOD),
            legs,
            samples,
        };
        board.controller.start_injection(injection).unwrap();
        while board.controller.report().injecting > 0 {
            board.sample();
        }
        for _ in 0..5 + k * 37 % 45 {
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
        let mut period = vec![[0.0; 2]; PERIOD as usize];
        let mut board = tested(study, table, &mut period);
        let open = amplitude(study, table, None, PERIOD);
        for leg in 0..LEGS {
            shake(&mut board, leg, open);
            assert_eq!(
                board.controller.report().fault,
                None,
                "{by}: {open} N, leg {leg}"
            );
        }

        let law = LinearLaw::new(table);
        let closed = amplitude(study, table, Some(&law), PERIOD);
        println!("{by}: {open} N open, {closed} N closed");
        board.controller.ask(Event::Start).unwrap();
        run(&mut board, 20.0);
        assert_eq!(board.controller.report().mode, Mode::Closed, "{by}");
        for leg in 0..LEGS {
            shake(&mut board, leg, closed);
            assert_eq!(
                board.controller.report().fault,
                None,
                "{by}: {closed} N, leg {leg}"
            );
        }
        if by == 1.0 {
            end_anywhere(&mut board, closed);
        }
        // Not far below it either.
        assert!(
            closed > 0.1 * open,
            "{by}: {open} N open, {closed} N closed"
        );
        if by > 1.0 {
            let mut period = vec![[0.0; 2]; PERIOD as usize];
            let mut board = tested(study, table, &mut period);
            shake(&mut board, 0, 16.0 * open);
            assert!(board.controller.report().fault.is_some(), "{by}: {open} N");
        }
    }
}
