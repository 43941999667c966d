//! Modes, faults, injection, recorder and link of the whole controller.

mod common;

use common::{DIRECT, SELF_TEST, SUPERVISION, table};
use nalgebra::Matrix6;
use proptest::prelude::*;
use shared::LEGS;
use shared::codes::{AdcCode, DacCode, Samples};
use shared::controller::{Controller, Memory, Reading, Refusal};
use shared::injection::{FADE, Injection, Signal};
use shared::link::{Answer, Cutter, FRAME, Packet, Reply, Request, Server, VERSION, encode};
use shared::multisine::{LINES, Line, Multisine, Slot};
use shared::recorder::{Record, Recorded, Recording, Trigger};
use shared::supervisor::{Cause, Event, Mode};
use shared::table::{
    Direct, Limits, Paths, Phasor, SelfTest, Supervision, TABLE_ROOM, TableError, ValidTable,
};

/// The documented table of modes is the one that runs, all of it: every mode with
/// every event.
#[test]
fn the_documented_modes_are_the_real_ones() {
    let text = include_str!("../../docs/supervisor.md");
    let mut lines = text
        .lines()
        .skip_while(|line| !line.starts_with("| mode |"));
    let cells = |line: &str| -> Vec<String> {
        let cells = line.trim_matches('|').split('|');
        cells.map(|cell| cell.trim().to_owned()).collect()
    };
    let events = cells(lines.next().unwrap());
    let names: Vec<_> = Event::ALL
        .iter()
        .map(|event| format!("{event:?}"))
        .collect();
    assert_eq!(events[1..], names);
    let rows: Vec<_> = lines
        .skip(1)
        .take_while(|line| line.starts_with('|'))
        .collect();
    assert_eq!(rows.len(), Mode::ALL.len());
    for (mode, row) in Mode::ALL.into_iter().zip(rows) {
        let row = cells(row);
        assert_eq!(row[0], format!("{mode:?}"));
        for (event, cell) in Event::ALL.into_iter().zip(&row[1..]) {
            let next = mode.after(event);
            let expected = next.map_or_else(|| "–".to_owned(), |next| format!("{next:?}"));
            assert_eq!(*cell, expected, "{mode:?}, {event:?}");
        }
    }
}

/// Sensor i answers leg i alone, at once and by one unit a newton; proportional law.
fn plain() -> ValidTable {
    let mut t = table();
    t.law.paths = Paths::Direct(Direct {
        proportional: Matrix6::identity() * 10.0,
        ..DIRECT
    });
    t.sensors = [shared::codes::Calibration {
        zero: 0.0,
        gain: 0.01,
    }; LEGS];
    t.supervision = Supervision {
        safe_ramp: 50,
        rail: 5,
        stuck: 30,
        lost: 3,
        late: 2,
        saturated: 20,
        silence: 0,
        window: 20,
        wild: 1e3,
        dull: 1e3,
        strange: 3,
        growth: 1e3,
        ..SUPERVISION
    };
    let mut sensors = SELF_TEST.sensors;
    for (i, leg) in sensors.iter_mut().enumerate() {
        leg[i] = Phasor { re: 1.0, im: 0.0 };
    }
    t.self_test = SelfTest {
        amplitude: 10.0,
        sensors,
        ..SELF_TEST
    };
    t.validate().unwrap()
}

/// A board whose sensors read what its legs pushed the sample before.
struct Bench<'a> {
    controller: Controller<'a>,
    dac: [DacCode; LEGS],
    count: i16,
    /// Sensor 2 reads the opposite.
    inverted: bool,
    /// A leg that pushes with this part of what it is asked.
    weak: Option<(usize, f64)>,
}

impl<'a> Bench<'a> {
    fn new(room: &'a mut [Record]) -> Self {
        Self::with(plain(), room)
    }

    fn with(table: ValidTable, records: &'a mut [Record]) -> Self {
        let memory = Memory {
            records,
            ..Memory::none()
        };
        Self {
            controller: Controller::new(table, table.checksum(), memory),
            dac: table.safe_codes(),
            count: 0,
            inverted: false,
            weak: None,
        }
    }

    fn samples(&mut self) -> Samples {
        self.count = self.count.wrapping_add(1);
        let mut forces = self.dac.map(|code| (f64::from(code.0) - 32768.0) / 131.072);
        if let Some((leg, part)) = self.weak {
            forces[leg] *= part;
        }
        // A little of something, so that nothing is stuck.
        let mut codes = forces.map(|force| AdcCode((100.0 * force) as i16 + self.count % 3));
        if self.inverted {
            codes[1].0 = -codes[1].0;
        }
        codes.into()
    }

    fn run(&mut self, count: usize) {
        for _ in 0..count {
            let samples = self.samples();
            self.dac = self.controller.on_sample(samples.into());
        }
    }

    fn mode(&self) -> Mode {
        self.controller.report().mode
    }

    fn reach_idle(&mut self) {
        self.controller.ask(Event::SelfTest).unwrap();
        self.run(6 * 128 + 20);
        assert_eq!(self.mode(), Mode::Idle, "{:?}", self.controller.report());
    }

    /// With a small gain: the bench's own answer is large.
    fn reach_closed(&mut self) {
        self.reach_idle();
        self.controller.set_gain(0.002).unwrap();
        self.controller.ask(Event::Start).unwrap();
        self.run(300);
        assert_eq!(self.mode(), Mode::Closed);
    }

    fn cause(&self) -> Option<Cause> {
        self.controller.report().fault.map(|fault| fault.cause)
    }
}

const SAFE: [DacCode; LEGS] = [DacCode(32768); LEGS];

/// The self-test passes a machine that is as it should be and names a sensor that
/// is not.
#[test]
fn the_self_test_names_the_sensor() {
    let mut bench = Bench::new(&mut []);
    bench.reach_idle();
    assert_eq!(bench.dac, SAFE);
    bench.inverted = true;
    bench.controller.ask(Event::SelfTest).unwrap();
    bench.run(6 * 128 + 20);
    assert_eq!(bench.cause(), Some(Cause::TestSensors(1 << 1)));
}

/// The pilot, with the loop closed: passes what is as it should be however long,
/// tells of a leg that pushes with half of what it is asked, not at the first sight of
/// it, and waits while something else is injected. On the bench a leg and its sensor
/// are one.
#[test]
fn the_pilot_names_the_place() {
    let mut t = *plain().get();
    t.self_test.pilot = 5.0;
    t.self_test.watch = 1280;
    let t = t.validate().unwrap();
    let cycle = 7 * 1280 + 20;
    let mut bench = Bench::with(t, &mut []);
    bench.reach_closed();
    bench.run(5 * cycle);
    assert_eq!(bench.cause(), None);
    bench.weak = Some((4, 0.5));
    bench.run(cycle);
    assert_eq!(bench.cause(), None);
    bench.run(3 * cycle);
    assert_eq!(bench.cause(), Some(Cause::TestSensors(1 << 4)));

    let mut bench = Bench::with(t, &mut []);
    bench.reach_closed();
    let injection = Injection {
        signal: Signal::Noise { seed: 1 },
        legs: [20.0; LEGS],
        samples: 5 * cycle as u32,
    };
    bench.controller.start_injection(injection).unwrap();
    bench.weak = Some((4, 0.5));
    bench.run(5 * cycle);
    assert_eq!(bench.cause(), None);
    bench.run(3 * cycle);
    assert_eq!(bench.cause(), Some(Cause::TestSensors(1 << 4)));
}

/// A bit turned now and then in one sensor is told; the same in a signal that moves
/// as much from sample to sample is not seen, nor is a single one.
#[test]
fn turned_bits_are_told() {
    let mut t = *plain().get();
    t.supervision.spike = [48; 2];
    let t = t.validate().unwrap();
    let run = |every: i16, moves: i16| {
        let mut bench = Bench::with(t, &mut []);
        bench.reach_idle();
        for k in 0..19_000i16 {
            let mut samples = bench.samples();
            // From nothing, as a vibration comes.
            let moves = moves / 1000 * k.min(1000);
            for code in &mut samples.sensors {
                code.0 += if k % 2 == 0 { moves } else { -moves };
            }
            if k % every == every - 1 {
                samples.sensors[3].0 ^= 1 << 9;
            }
            bench.dac = bench.controller.on_sample(samples.into());
        }
        bench.cause()
    };
    assert_eq!(run(1000, 0), Some(Cause::Erratic(1 << 3)));
    assert_eq!(run(15_000, 0), None);
    assert_eq!(run(1000, 2000), None);
}

/// What a loop makes of the jump at the end of a test signal is no fault; the same later is one.
#[test]
fn the_end_of_an_injection_is_no_spike() {
    let mut t = *plain().get();
    t.supervision.spike = [48; 2];
    t.supervision.spikes = 5;
    let t = t.validate().unwrap();
    let run = |after: usize| {
        let mut bench = Bench::with(t, &mut []);
        bench.reach_idle();
        let injection = Injection {
            signal: Signal::Noise { seed: 1 },
            legs: [0.0; LEGS],
            samples: 100,
        };
        bench.controller.start_injection(injection).unwrap();
        while bench.controller.report().injecting > 0 {
            bench.run(1);
        }
        bench.run(after);
        let mut samples = bench.samples();
        for code in &mut samples.sensors {
            code.0 += 500;
        }
        bench.dac = bench.controller.on_sample(samples.into());
        bench.run(10);
        bench.cause()
    };
    for after in [0, 1, 2, 3, 4, 10, 40] {
        assert_eq!(run(after), None, "{after} samples after the end");
    }
    assert_eq!(run(200), Some(Cause::Erratic(0x3F)));
}

/// Each fault from the closed loop: its cause, a straight way to the safe codes
/// within the bound, latched until it is cleared, and nothing starts by itself.
#[test]
fn every_fault_ends_safe() {
    type Break = fn(&mut Bench<'_>) -> Reading;
    let cases: [(Break, Cause); 7] = [
        (
            |b| {
                let mut samples = b.samples();
                samples.sensors[3] = AdcCode(32767);
                samples.into()
            },
            Cause::Rail(1 << 3),
        ),
        (
            |b| {
                let mut samples = b.samples();
                samples.sensors[5] = AdcCode(77);
                samples.into()
            },
            Cause::Stuck(1 << 5),
        ),
        (
            |_| Reading {
                samples: None,
                late: false,
            },
            Cause::Lost,
        ),
        (
            |b| Reading {
                late: true,
                ..b.samples().into()
            },
            Cause::Late,
        ),
        (
            |b| {
                let sign = if b.count % 2 == 0 { 1 } else { -1 };
                let mut samples = b.samples();
                samples.sensors = [AdcCode(32000 * sign); LEGS];
                b.controller.set_gain(1.0).unwrap();
                samples.into()
            },
            Cause::Saturated,
        ),
        (
            |b| {
                let sign = if b.count % 2 == 0 { 1 } else { -1 };
                let mut samples = b.samples();
                samples.sensors[2] = AdcCode(20000 * sign);
                samples.into()
            },
            Cause::Implausible(1 << 2),
        ),
        (
            |b| {
                b.controller.table_changed();
                b.samples().into()
            },
            Cause::Table,
        ),
    ];
    for (wrong, cause) in cases {
        let mut bench = Bench::new(&mut []);
        bench.reach_closed();
        let mut since = None;
        let clamped = bench.controller.report().clamped;
        for _ in 0..800 {
            let before = bench.dac;
            let reading = wrong(&mut bench);
            bench.dac = bench.controller.on_sample(reading);
            if bench.mode().is_fault() {
                if since.is_none() && cause == Cause::Saturated {
                    // Clamped without a pause for just as long as the table allows.
                    let limit = plain().get().supervision.saturated;
                    assert_eq!(bench.controller.report().clamped - clamped, limit);
                }
                let since = since.get_or_insert(0);
                *since += 1;
                // Never away from safe again, once the sample is out in which it was found.
                for (before, now) in before.iter().zip(&bench.dac) {
                    let far = |code: &DacCode| (i32::from(code.0) - 32768).abs();
                    assert!(*since == 1 || far(now) <= far(before));
                }
                if *since > 50 {
                    assert_eq!(bench.dac, SAFE, "{cause:?}");
                    assert_eq!(bench.mode(), Mode::Failed);
                }
            }
        }
        assert_eq!(bench.cause(), Some(cause));
        assert!(since.is_some_and(|since| since > 51));
        for event in [Event::Start, Event::SelfTest, Event::Stop] {
            assert_eq!(bench.controller.ask(event), Err(Refusal::Mode));
        }
        bench.controller.ask(Event::Clear).unwrap();
        assert_eq!(bench.mode(), Mode::Untested);
        bench.run(100);
        assert_eq!((bench.mode(), bench.dac), (Mode::Untested, SAFE));
    }
}

/// Nobody on the link: a fault while the legs are driven, and not before.
#[test]
fn silence_is_a_fault_only_while_driven() {
    let mut t = *plain().get();
    t.supervision.silence = 1000;
    let t = t.validate().unwrap();
    let mut bench = Bench::new(&mut []);
    bench.controller = Controller::new(t, t.checksum(), Memory::none());
    bench.run(2000);
    assert_eq!(bench.cause(), None);
    bench.reach_closed();
    bench.controller.heard();
    bench.run(999);
    assert_eq!(bench.cause(), None);
    bench.run(1);
    assert_eq!(bench.cause(), Some(Cause::Silent));
}

/// An injection ends when nobody has asked for five seconds, whatever its duration; a request
/// in time keeps it. The loop stays closed, or the legs at rest.
#[test]
fn an_injection_ends_when_nobody_asks() {
    let five = 100_000;
    let injection = Injection {
        signal: Signal::Sine { hz: 50.0 },
        legs: [1.0; LEGS],
        samples: shared::injection::LONGEST,
    };
    for mode in [Mode::Closed, Mode::Idle] {
        let mut bench = Bench::new(&mut []);
        match mode {
            Mode::Closed => bench.reach_closed(),
            _ => bench.reach_idle(),
        }
        bench.run(2 * five);
        bench.controller.start_injection(injection).unwrap();
        for _ in 0..3 {
            bench.run(five - 1);
            assert!(bench.controller.report().injecting > 0);
            bench.controller.heard();
        }
        bench.run(five);
        let report = bench.controller.report();
        assert_eq!((report.injecting, report.fault), (0, None));
        assert_eq!(report.mode, mode);
        // The next one is as long as it likes again.
        bench.controller.start_injection(injection).unwrap();
        bench.run(five - 1);
        assert!(bench.controller.report().injecting > 0);
    }
}

/// A table with another checksum never leaves safe.
#[test]
fn another_table_does_not_run() {
    let table = plain();
    let mut controller = Controller::new(table, table.checksum() ^ 1, Memory::none());
    assert_eq!(
        controller.report().fault.map(|fault| fault.cause),
        Some(Cause::Table)
    );
    for _ in 0..100 {
        let dac = controller.on_sample(Samples::from([AdcCode(100); LEGS]).into());
        assert_eq!(dac, SAFE);
    }
    // Every bit of the table is in the sum.
    let mut other = *table.get();
    other.self_test.forces[5][5].im = f32::from_bits(1);
    assert_ne!(other.validate().unwrap().checksum(), table.checksum());
}

/// A soft start waits at the documented gain of 0.03 for twice the time `settle`, and then goes on.
#[test]
fn a_soft_start_waits_at_a_small_gain() {
    let mut table = *plain().get();
    table.supervision.settle = 100;
    // Forces too small to lower the gain.
    table.law.paths = Paths::Direct(Direct {
        proportional: Matrix6::identity() * 1e-3,
        ..DIRECT
    });
    let mut bench = Bench::with(table.validate().unwrap(), &mut []);
    bench.reach_idle();
    bench.controller.ask(Event::Start).unwrap();
    let mut waited = 0;
    for _ in 0..2000 {
        bench.run(1);
        // Up to the factor from sample to sample.
        if (0.03..0.03 * 1.01).contains(&bench.controller.report().gain) {
            waited += 1;
        }
    }
    assert!((200..=202).contains(&waited), "{waited}");
    assert_eq!(bench.mode(), Mode::Closed);
}

/// A soft stop ends at the safe codes without a step: the last code before them is
/// within GENTLE of the whole force.
#[test]
fn a_soft_stop_is_soft() {
    let mut bench = Bench::new(&mut []);
    bench.reach_closed();
    bench.controller.ask(Event::Stop).unwrap();
    bench.run(2000);
    assert_eq!((bench.mode(), bench.dac), (Mode::Idle, SAFE));
}

/// What is recorded about an injection is what was injected, from the sample that
/// the report names.
#[test]
fn the_recorder_holds_the_injection() {
    let mut room = [Record::NONE; 64];
    let mut bench = Bench::new(&mut room);
    bench.reach_idle();
    let too_long = Recording {
        trigger: Trigger::Now,
        before: 40,
        after: 25,
    };
    assert_eq!(bench.controller.arm(too_long), Err(Refusal::Range));
    let recording = Recording {
        trigger: Trigger::Injection,
        before: 10,
        after: 30,
    };
    bench.controller.arm(recording).unwrap();
    bench.run(100);
    let injection = Injection {
        signal: Signal::Sine { hz: 1000.0 },
        legs: [100.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        samples: 20,
    };
    bench.controller.start_injection(injection).unwrap();
    bench.run(60);
    let report = bench.controller.report();
    assert_eq!(
        report.recorded,
        Recorded::Done {
            length: 40,
            before: 10,
            at: report.injected
        }
    );
    for k in 0..40 {
        let record = bench.controller.recording(k).unwrap();
        let phase = k as f64 - 10.0;
        let force = if (0.0..20.0).contains(&phase) {
            100.0 * (core::f64::consts::TAU * phase / 20.0).sin()
        } else {
            0.0
        };
        let found = (f64::from(record.dac[0].0) - 32768.0) / 131.072;
        assert!((found - force).abs() < 0.01, "{k}: {found} {force}");
        assert_eq!(record.dac[1], DacCode(32768));
    }
    assert_eq!(bench.controller.recording(40), None);
}

/// What is out of range.
#[test]
fn injections_have_limits() {
    let table = plain();
    let no_lines = Multisine::new(&mut []);
    let sine = |hz, size: f32| Injection {
        signal: Signal::Sine { hz },
        legs: [size; LEGS],
        samples: 10,
    };
    for bad in [
        sine(10_001.0, 1.0),
        sine(f32::NAN, 1.0),
        sine(50.0, 200.1),
        sine(50.0, f32::NAN),
        sine(50.0, f32::INFINITY),
        Injection {
            samples: 0,
            ..sine(50.0, 1.0)
        },
        Injection {
            signal: Signal::Multisine,
            ..sine(50.0, 1.0)
        },
    ] {
        assert!(!bad.is_within(&table, &no_lines), "{bad:?}");
    }
}

fn frame(session: u32, sequence: u32, body: Request) -> Vec<u8> {
    let packet = Packet {
        version: VERSION,
        session,
        sequence,
        body,
    };
    encode(&packet).unwrap().to_vec()
}

fn answer(
    bytes: &[u8],
    cutter: &mut Cutter,
    server: &mut Server,
    controller: &mut Controller<'_>,
) -> Vec<Packet<Reply>> {
    let packets = bytes.iter().filter_map(|byte| cutter.push(*byte));
    packets
        .map(|incoming| match server.answer(incoming, controller) {
            Answer::Reply(reply) => reply,
            Answer::Table(job) => {
                let compiled = (plain(), plain().checksum());
                let outcome = server.table(job, &Limits::NONE, compiled);
                server.run(outcome, controller)
            }
        })
        .collect()
}

/// A signal in one leg makes its sensor unlike the others. With the loop open that is no fault, nor
/// soon after it; with the loop closed it is one.
#[test]
fn a_test_signal_does_not_make_sensors_implausible() {
    let injection = Injection {
        signal: Signal::Noise { seed: 1 },
        legs: [100.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        samples: 400,
    };
    let mut bench = Bench::new(&mut []);
    bench.reach_idle();
    bench.controller.start_injection(injection).unwrap();
    bench.run(500);
    assert_eq!(
        (bench.mode(), bench.controller.report().injecting),
        (Mode::Idle, 0)
    );
    bench.reach_closed();
    bench.controller.start_injection(injection).unwrap();
    bench.run(500);
    let fault = bench.controller.report().fault.map(|fault| fault.cause);
    assert!(matches!(fault, Some(Cause::Implausible(_))), "{fault:?}");
}

/// Begins a session with a board, which then answers one request after the other.
fn session(bench: &mut Bench<'_>) -> impl FnMut(&mut Bench<'_>, Request) -> Reply + use<> {
    let (mut cutter, mut server) = (Cutter::new(), Server::new());
    let hello = frame(0, 1, Request::Hello(5));
    let session = answer(&hello, &mut cutter, &mut server, &mut bench.controller)[0].session;
    let mut sequence = 1;
    move |bench, body| {
        sequence += 1;
        let bytes = frame(session, sequence, body);
        answer(&bytes, &mut cutter, &mut server, &mut bench.controller)
            .remove(0)
            .body
    }
}

/// None is quiet beside the others.
const LEG_SIZES: [f32; LEGS] = [1.0, -1.0, 0.5, 1.0, -1.5, -2.0];

/// What the legs did at each line comes over the link: what was injected, in codes.
#[test]
fn a_multisine_is_measured_over_the_link() {
    let mut slots = [Slot::EMPTY; LINES];
    let mut bench = Bench::new(&mut []);
    let memory = Memory {
        lines: &mut slots,
        ..Memory::none()
    };
    bench.controller = Controller::new(plain(), plain().checksum(), memory);
    bench.reach_idle();
    let mut say = session(&mut bench);
    let lines: heapless::Vec<Line, LINES> = (0..LINES as u32)
        .map(|k| Line {
            turns: 2 + 3 * k,
            amplitude: 0.1 * k as f32,
        })
        .collect();
    let injection = Injection {
        signal: Signal::Multisine,
        legs: LEG_SIZES,
        samples: 3 * 2048 + 16 + FADE,
    };
    let refused = |why| Reply::Refused(why);
    let set = || Request::Multisine(11, lines.clone());
    assert_eq!(
        say(&mut bench, Request::Inject(injection)),
        refused(Refusal::Range)
    );
    assert_eq!(say(&mut bench, Request::Line(0)), refused(Refusal::Range));
    assert_eq!(say(&mut bench, set()), Reply::Done);
    assert_eq!(say(&mut bench, Request::Inject(injection)), Reply::Done);
    assert_eq!(say(&mut bench, set()), refused(Refusal::Mode));
    bench.run(3 * 2048 + 15 + FADE as usize);
    assert_eq!(bench.controller.report().injecting, 1);
    bench.run(1);
    assert_eq!(bench.controller.report().injecting, 0);
    for k in 0..LINES {
        let Reply::Line(line) = say(&mut bench, Request::Line(k as u8)) else {
            panic!("line {k}");
        };
        assert_eq!(line.windows, 3);
        // Re(X·e^(jωt)) = a·sin(ωt − πk²/32), and 131.072 codes per newton.
        let phase = core::f64::consts::PI * ((k * k) as f64 / 32.0 + 0.5);
        for (leg, size) in LEG_SIZES.iter().enumerate() {
            let size = f64::from(*size) * 131.072 * 0.1 * k as f64;
            let [re, im] = line.parts[2 * LEGS + leg].map(f64::from);
            let error = (re - size * phase.cos()).hypot(im + size * phase.sin());
            // Rounded codes over 2048 samples.
            assert!(error < 0.05, "line {k}, leg {leg}: {re} {im}");
        }
    }
    assert_eq!(say(&mut bench, Request::Line(32)), refused(Refusal::Range));
    // Another one begins at its first window.
    assert_eq!(say(&mut bench, set()), Reply::Done);
    assert_eq!(say(&mut bench, Request::Inject(injection)), Reply::Done);
    bench.run(100);
    let Reply::Line(line) = say(&mut bench, Request::Line(3)) else {
        panic!("there is one");
    };
    assert_eq!((line.windows, line.parts), (0, [[0.0; 2]; 3 * LEGS]));
}

/// Sessions, old frames and frames of others; the longest answer fits.
#[test]
fn the_link_refuses_what_is_not_its_own() {
    let mut bench = Bench::new(&mut []);
    let (mut cutter, mut server) = (Cutter::new(), Server::new());
    let c = &mut bench.controller;
    let mut ask = |bytes: Vec<u8>| answer(&bytes, &mut cutter, &mut server, c).remove(0);
    let before = ask(frame(0, 1, Request::Report));
    assert_eq!(before.body, Reply::Refused(Refusal::Session));
    let session = ask(frame(0, 1, Request::Hello(5))).session;
    assert_ne!(session, 0);
    let mut say = |session, sequence, body| ask(frame(session, sequence, body)).body;
    assert!(matches!(say(session, 2, Request::Report), Reply::Report(_)));
    let replayed = Reply::Refused(Refusal::Replayed);
    assert_eq!(say(session, 2, Request::SelfTest), replayed);
    assert_eq!(say(session, 1, Request::SelfTest), replayed);
    // The hello itself, played again, does not end the session.
    assert_eq!(say(0, 1, Request::Hello(5)), replayed);
    let other = say(session ^ 4, 9, Request::SelfTest);
    assert_eq!(other, Reply::Refused(Refusal::Session));
    assert_eq!(say(session, 3, Request::SelfTest), Reply::Done);
    assert_eq!(bench.mode(), Mode::Testing);
    let record = Record {
        adc: Samples {
            sensors: [AdcCode(-32768); LEGS],
            forces: [AdcCode(-32768); LEGS],
        },
        dac: [DacCode(65535); LEGS],
    };
    let longest = Packet {
        version: VERSION,
        session: u32::MAX,
        sequence: u32::MAX,
        body: Reply::Records([record; 8].into_iter().collect()),
    };
    assert!(encode(&longest).unwrap().len() <= FRAME);
    let line = Line {
        turns: u32::MAX,
        amplitude: 1.0,
    };
    let longest = Packet {
        version: VERSION,
        session: u32::MAX,
        sequence: u32::MAX,
        body: Request::Multisine(20, [line; LINES].into_iter().collect()),
    };
    assert!(encode(&longest).unwrap().len() <= FRAME);
}

/// A new session does not get the telemetry that another one asked for.
#[test]
fn telemetry_ends_with_its_session() {
    let mut bench = Bench::new(&mut []);
    let (mut cutter, mut server) = (Cutter::new(), Server::new());
    let c = &mut bench.controller;
    let session = answer(&frame(0, 1, Request::Hello(5)), &mut cutter, &mut server, c)[0].session;
    let telemetry = frame(session, 2, Request::Telemetry(1));
    answer(&telemetry, &mut cutter, &mut server, c);
    bench.run(3);
    assert!(server.telemetry(&mut bench.controller).is_some());
    let hello = frame(0, 1, Request::Hello(6));
    answer(&hello, &mut cutter, &mut server, &mut bench.controller);
    bench.run(3);
    assert!(server.telemetry(&mut bench.controller).is_none());
}

/// A table over the link: piece by piece, refused while the loop is closed, if a bit
/// of it is turned, if it is not the one that was said or none that the board can run;
/// then it runs, untested, until it is forgotten.
#[test]
fn a_table_comes_over_the_link() {
    let mut other = *plain().get();
    other.latch = 60e-6;
    let other = other.validate().unwrap();
    let mut room = [0; TABLE_ROOM];
    let bytes = other.encode(&mut room).unwrap().to_vec();
    let (length, sum) = (bytes.len() as u32, other.checksum());

    let mut bench = Bench::new(&mut []);
    bench.reach_closed();
    let mut say = session(&mut bench);
    let refused = |why| Reply::Refused(Refusal::Table(why));
    for (at, piece) in (0..).step_by(256).zip(bytes.chunks(256)) {
        let piece = Request::Piece(at, piece.iter().copied().collect());
        assert_eq!(say(&mut bench, piece), Reply::Done);
    }
    let keep = || Request::Keep(length, sum);
    let mode = Reply::Refused(Refusal::Mode);
    assert_eq!(say(&mut bench, keep()), mode);
    assert_eq!(say(&mut bench, Request::Forget), mode);
    bench.controller.ask(Event::Stop).unwrap();
    bench.run(2000);
    assert_eq!(bench.mode(), Mode::Idle);
    let wrong = Request::Keep(length, sum ^ 1);
    assert_eq!(say(&mut bench, wrong), refused(TableError::Checksum));
    for length in [length - 1, length + 1] {
        let other = Request::Keep(length, sum);
        assert_eq!(say(&mut bench, other), refused(TableError::Encoding));
    }
    let turn = |at: u32| {
        let byte = bytes[at as usize] ^ 4;
        Request::Piece(at, [byte].into_iter().collect())
    };
    // The layout's version, and somewhere in the middle.
    for (at, why) in [(0, TableError::Version), (900, TableError::Checksum)] {
        assert_eq!(say(&mut bench, turn(at)), Reply::Done);
        assert_eq!(say(&mut bench, keep()), refused(why));
        let back = Request::Piece(at, [bytes[at as usize]].into_iter().collect());
        assert_eq!(say(&mut bench, back), Reply::Done);
    }
    let past = Request::Piece(TABLE_ROOM as u32 - 1, [1, 2].into_iter().collect());
    assert_eq!(say(&mut bench, past), Reply::Refused(Refusal::Range));
    assert_eq!(bench.controller.identity().checksum, plain().checksum());
    assert_eq!(bench.mode(), Mode::Idle);

    assert_eq!(say(&mut bench, keep()), Reply::Done);
    assert_eq!(*bench.controller.table(), other);
    assert!(bench.controller.identity().sent);
    assert_eq!(bench.mode(), Mode::Untested);
    bench.run(10);
    assert_eq!((bench.mode(), bench.dac), (Mode::Untested, SAFE));
    assert_eq!(say(&mut bench, Request::Forget), Reply::Done);
    assert_eq!(*bench.controller.table(), plain());
    assert!(!bench.controller.identity().sent);
}

/// What a board cannot run: too fast, outputs that are not ready at their latch or
/// would be overwritten before it, sensors it has no inputs for.
#[test]
fn a_board_has_limits() {
    let board = Limits {
        rate: 25e3,
        written: (10e-6, 20e-6),
        beside: false,
        codes: (AdcCode(32767), DacCode(65535)),
    };
    let with = |change: fn(&mut shared::table::Table)| {
        let mut t = *plain().get();
        change(&mut t);
        board.admit(&t.validate().unwrap())
    };
    assert_eq!(with(|_| {}), Ok(()));
    assert_eq!(with(|t| t.sample_rate = 50e3), Err(TableError::BoardRate));
    assert_eq!(with(|t| t.latch = 19e-6), Err(TableError::BoardLatch));
    assert_eq!(with(|t| t.latch = 59e-6), Ok(()));
    assert_eq!(with(|t| t.latch = 61e-6), Err(TableError::BoardLatch));
    assert_eq!(
        with(|t| t.adc_max = AdcCode(8191)),
        Err(TableError::BoardCodes)
    );
}

proptest! {
    /// Whatever bytes come, and whatever is asked, the outputs stay within limits
    /// and the state in one of its modes; noise is never taken for a request.
    #[test]
    fn noise_changes_nothing(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        let mut bench = Bench::new(&mut []);
        let (mut cutter, mut server) = (Cutter::new(), Server::new());
        let session = answer(
            &frame(0, 1, Request::Hello(5)),
            &mut cutter,
            &mut server,
            &mut bench.controller,
        )
        .remove(0)
        .session;
        let before = bench.controller.report();
        for reply in answer(&bytes, &mut cutter, &mut server, &mut bench.controller) {
            prop_assert!(matches!(reply.body, Reply::Refused(_)));
        }
        prop_assert_eq!(bench.controller.report(), before);
        // A zero ends what was left of it, and the link goes on.
        let mut next = vec![0];
        next.extend(frame(session, 2, Request::Report));
        let replies = answer(&next, &mut cutter, &mut server, &mut bench.controller);
        prop_assert!(matches!(replies.last().unwrap().body, Reply::Report(_)));
    }

    /// Any events in any order with any sensors: outputs within limits, no panic.
    #[test]
    fn outputs_stay_inside(
        steps in prop::collection::vec((any::<[i16; LEGS]>(), 0..20u8), 1..400),
    ) {
        let table = plain();
        let mut controller = Controller::new(table, table.checksum(), Memory::none());
        for (codes, act) in steps {
            let event = match act {
                0 => Some(Event::SelfTest),
                1..=3 => Some(Event::Start),
                4 => Some(Event::Stop),
                5 => Some(Event::Clear),
                _ => None,
            };
            if let Some(event) = event {
                let _ = controller.ask(event);
            }
            let mut reading = Reading::from(Samples::from(codes.map(AdcCode)));
            if act == 19 {
                reading.samples = None;
            }
            for code in controller.on_sample(reading) {
                let force = (f64::from(code.0) - 32768.0) / 131.072;
                prop_assert!(force.abs() <= 200.01);
            }
        }
    }
}
