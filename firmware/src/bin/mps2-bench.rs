//! Instructions per sample, counted on the emulated MPS2 board.
//!
//! The emulator is started with `-icount shift=N`: every instruction takes 2^N ns. The board's
//! SysTick counts at 25 MHz with 24 bits. Each sample is counted by itself, so that the counter
//! cannot wrap unnoticed: its flag says whether it did. How many counts an instruction takes is
//! measured with a loop of known length. `cargo xtask bench` runs this at two N, which must agree.
#![no_std]
#![no_main]

#[path = "mps2/stop.rs"]
mod stop;

use core::arch::asm;
use core::hint::black_box;

use cortex_m::Peripherals;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::entry;
use cortex_m_semihosting::hprintln;
use firmware::tables::{both_sensors, metrology_frame};
use nalgebra::Matrix6;
use shared::LEGS;
use shared::codes::{AdcCode, Samples};
use shared::controller::{Controller, Memory, Reading};
use shared::injection::{Injection, Signal};
use shared::multisine::{LINES, Line, Slot};
use shared::recorder::{Record, Recording, Trigger};
use shared::supervisor::{Event, Mode};
use shared::table::{Direct, Paths, Table, ValidTable};

/// Instructions of the loop that calibrates the counter.
const KNOWN: u32 = 20_000;

/// Samples that include everything the controller does only now and then: the end of a leg's
/// measurement by the pilot, the end of a window of the monitors.
const LONG: u32 = 30_000;

/// Samples of a mode that does the same in each of them.
const SHORT: u32 = 2_000;

/// Samples of a soft start, the end of its wait among them.
const START: u32 = 12;

/// Records of the recorder.
const ROOM: usize = 64;

/// Counts instructions.
struct Counter {
    timer: SYST,
    /// Counts of a call of nothing.
    empty: u32,
    /// Counts of [`KNOWN`] instructions.
    known: u32,
}

impl Counter {
    fn new(mut timer: SYST) -> Self {
        timer.set_clock_source(SystClkSource::Core);
        timer.set_reload(0x00FF_FFFF);
        timer.clear_current();
        timer.enable_counter();
        let mut counter = Self {
            timer,
            empty: 0,
            known: 0,
        };
        counter.empty = counter.counts(|| {});
        counter.known = counter.counts(|| {
            // SAFETY: counts a register down, two instructions at a time.
            unsafe {
                asm!("2: subs {n}, #1", "bne 2b", n = inout(reg) KNOWN / 2 => _);
            }
        });
        counter.known -= counter.empty;
        counter
    }

    /// Counts of a call.
    fn counts(&mut self, call: impl FnOnce()) -> u32 {
        self.timer.clear_current();
        // Reading the flag clears it. After a clear the counter reloads, which sets no flag.
        self.timer.has_wrapped();
        let start = SYST::get_current();
        call();
        let end = SYST::get_current();
        if self.timer.has_wrapped() || end > start && start != 0 {
            panic!("the counter wrapped");
        }
        // It counts down from the reload value, and is 0 until the first count.
        let start = if start == 0 { 0x0100_0000 } else { start };
        start - end
    }

    /// Instructions of a call.
    fn instructions(&mut self, call: impl FnOnce()) -> u32 {
        let counts = self.counts(call).saturating_sub(self.empty);
        let (counts, known) = (u64::from(counts), u64::from(self.known));
        // A call takes far fewer than 2³².
        ((counts * u64::from(KNOWN) + known / 2) / known) as u32
    }
}

/// Average and largest number of instructions of many samples.
#[derive(Default)]
struct Count {
    sum: u64,
    samples: u32,
    longest: u32,
}

impl Count {
    fn add(&mut self, instructions: u32) {
        self.sum += u64::from(instructions);
        self.samples += 1;
        self.longest = self.longest.max(instructions);
    }

    fn average(&self) -> u64 {
        self.sum / u64::from(self.samples.max(1))
    }
}

#[entry]
fn main() -> ! {
    let Some(peripherals) = Peripherals::take() else {
        panic!("the peripherals are taken once");
    };
    let mut counter = Counter::new(peripherals.SYST);
    measure(&mut counter, "modal", *metrology_frame::TABLE.get());
    measure(&mut counter, "both", *both_sensors::TABLE.get());
    // The same machine's table with arbitrary matrices.
    let mut direct = *metrology_frame::TABLE.get();
    direct.law.paths = Paths::Direct(Direct {
        roll_off: 0.1,
        proportional: Matrix6::from_element(1.0),
        integral: Matrix6::from_element(0.1),
    });
    measure(&mut counter, "direct", direct);
    stop::done()
}

/// A controller of a table with short waits. There is no machine: the self-test passes with any
/// answer, and forces are a thousandth, or much gain at low frequency drives them to their limits.
fn of_table(mut t: Table, memory: Memory<'_>) -> Controller<'_> {
    t.self_test.tolerance = 1e6;
    t.self_test.settle = 1;
    t.self_test.measure = 16;
    t.supervision.settle = 1;
    t.supervision.ramp = 2.0;
    t.supervision.stuck = 0;
    if let Paths::Modal(modal) = &mut t.law.paths {
        modal.output *= 1e-3;
    }
    let Ok(table) = t.validate() else {
        panic!("a table that is one");
    };
    let table: ValidTable = table;
    Controller::new(table, table.checksum(), memory)
}

/// Small enough not to be clamped, and different from sample to sample.
fn reading(k: u32) -> Reading {
    let code = AdcCode([1, -1, 0, 2][(k % 4) as usize]);
    Samples {
        sensors: [code; LEGS],
        forces: [code; LEGS],
    }
    .into()
}

/// Runs samples; counts of both halves and of the first one.
fn run(counter: &mut Counter, controller: &mut Controller<'_>, samples: u32) -> [Count; 2] {
    let mut counts = [Count::default(), Count::default()];
    for k in 0..samples {
        let reading = black_box(reading(k));
        let first = counter.instructions(|| {
            black_box(controller.latch(reading));
        });
        let second = counter.instructions(|| controller.follow());
        let [whole, latch] = &mut counts;
        whole.add(first + second);
        latch.add(first);
    }
    counts
}

/// Prints the instructions of the first half and of whole samples in every mode.
fn measure(counter: &mut Counter, name: &str, table: Table) {
    let memory = Memory {
        records: &mut [Record::NONE; ROOM],
        lines: &mut [Slot::EMPTY; LINES],
    };
    let mut controller = of_table(table, memory);
    let mut print = |controller: &mut Controller<'_>, what: &str, mode: Mode, samples: u32| {
        let [whole, latch] = run(counter, controller, samples);
        // The mode may end with the last sample.
        if controller.report().mode != mode {
            panic!("{} is not {:?}", what, mode);
        }
        hprintln!("{} {} {}", name, what, whole.average());
        hprintln!("{} {} longest {}", name, what, whole.longest);
        hprintln!("{} {} latch {}", name, what, latch.longest);
    };
    print(&mut controller, "untested", Mode::Untested, SHORT);
    let _ = controller.ask(Event::SelfTest);
    // Six legs of seventeen samples.
    print(&mut controller, "self-test", Mode::Testing, 90);
    settle(&mut controller, reading);
    print(&mut controller, "idle", Mode::Idle, SHORT);
    let _ = controller.ask(Event::Start);
    // Six samples until it waits, three in which it does, and some towards the full gain.
    print(&mut controller, "soft start", Mode::Starting, START);
    settle(&mut controller, reading);
    print(&mut controller, "closed", Mode::Closed, LONG);
    controller.set_telemetry(1);
    let _ = controller.arm(Recording {
        trigger: Trigger::Rise {
            sensor: 5,
            level: AdcCode(1000),
        },
        before: 10,
        after: 10,
    });
    print(&mut controller, "recording", Mode::Closed, SHORT);
    let signals = [
        ("sine", Signal::Sine { hz: 10.0 }),
        (
            "sweep",
            Signal::Sweep {
                from: 1.0,
                to: 1000.0,
            },
        ),
        ("multisine", Signal::Multisine),
        ("noise", Signal::Noise { seed: 1 }),
    ];
    let lines = (0..LINES as u32).map(|k| Line {
        turns: 2 + 2 * k,
        amplitude: 1.0,
    });
    if controller.set_multisine(12, &lines.collect()).is_err() {
        panic!("lines that are allowed");
    }
    for (what, signal) in signals {
        let injection = Injection {
            signal,
            legs: [1e-3; LEGS],
            samples: 2 * SHORT,
        };
        if controller.start_injection(injection).is_err() {
            panic!("an injection that is allowed");
        }
        print(&mut controller, what, Mode::Closed, SHORT);
    }
    controller.table_changed();
    print(&mut controller, "failing", Mode::Failing, 10);
    settle(&mut controller, reading);
    print(&mut controller, "failed", Mode::Failed, SHORT);

    // Every reading but one of zeros exceeds the limits.
    let mut tight = table;
    for actuator in &mut tight.actuators {
        actuator.limit = 1e-9;
    }
    tight.supervision.saturated = u32::MAX;
    let mut controller = of_table(tight, Memory::none());
    for event in [Event::SelfTest, Event::Start] {
        let _ = controller.ask(event);
        settle(&mut controller, |_| Samples::NONE.into());
    }
    let before = controller.report().clamped;
    print(&mut controller, "clamped", Mode::Closed, LONG);
    let clamped = controller.report().clamped - before;
    if clamped < LONG / 2 {
        panic!("{} of {} samples are clamped", clamped, LONG);
    }
}

/// Samples until the mode no longer changes.
fn settle(controller: &mut Controller<'_>, reading: fn(u32) -> Reading) {
    for k in 0..5_000 {
        black_box(controller.on_sample(reading(k)));
    }
}
