//! A sample: the loop's interrupt, its converters and its timing.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::DWT;
use critical_section::Mutex;
use embassy_stm32::interrupt;
use firmware::budget;
use firmware::converters::ad5676r::Ad5676r;
use firmware::converters::ad7606;
use firmware::loop_task::BoardController;
use shared::controller::Reading;
use shared::table::Table;

use crate::clocks::{CORE, TIMER};
use crate::guard;
use crate::period;
use crate::spi::{Receiver, Transmitter};

/// The controller.
pub static BOARD: BoardController = BoardController::new();

/// Number of consecutive failures of the DAC after which it is held in reset.
const HOPELESS: u32 = 3;

/// The amplifiers are switched on after this many samples with a sound DAC.
const RUNNING: u32 = 100;

/// The converters.
pub struct Converters {
    adc: Receiver,
    dac: Ad5676r<Transmitter>,
    /// Whether the DAC works: it answered at start, and has not failed since.
    sound: bool,
    /// Consecutive writes that failed.
    failed: u32,
    /// Consecutive codes that did not read back.
    wrong: u32,
    /// Samples until the amplifiers are switched on.
    waiting: u32,
    /// Whether the last sample missed its deadline.
    late: bool,
}

static CONVERTERS: Mutex<RefCell<Option<Converters>>> = Mutex::new(RefCell::new(None));

/// Largest number of core cycles from the interrupt until the codes were handed over.
static WRITTEN: AtomicU32 = AtomicU32::new(0);

/// Largest number of core cycles of a sample, from the interrupt to its end.
static LONGEST: AtomicU32 = AtomicU32::new(0);

/// Sum of the cycles of the samples since the last [`timing`].
static SUM: AtomicU32 = AtomicU32::new(0);

/// Smallest count of TIM1 at the interrupt.
static EARLIEST: AtomicU32 = AtomicU32::new(u32::MAX);

/// Largest count of TIM1 at the interrupt.
static LATEST: AtomicU32 = AtomicU32::new(0);

/// Samples since the start.
static SAMPLES: AtomicU32 = AtomicU32::new(0);

/// Deadline for handing the codes over, core cycles after the sample.
static DEADLINE: AtomicU32 = AtomicU32::new(0);

/// Sample period, core cycles.
static PERIOD: AtomicU32 = AtomicU32::new(0);

/// Cycle count at the last interrupt; 0 before the first.
static LAST: AtomicU32 = AtomicU32::new(0);

/// The loop, at the highest priority.
#[interrupt]
fn TIM1_CC() {
    let since = period::acknowledge();
    let start = DWT::cycle_count();
    let last = LAST.swap(start | 1, Ordering::Relaxed);
    // More than 1.5 periods since the last interrupt: one was missed.
    let missed = last != 0 && start.wrapping_sub(last) / 3 > PERIOD.load(Ordering::Relaxed) / 2;
    critical_section::with(|cs| {
        if let Some(converters) = &mut *CONVERTERS.borrow_ref_mut(cs) {
            converters.late |= missed;
            converters.latch();
            let written = DWT::cycle_count().wrapping_sub(start);
            let end = since * (CORE / TIMER) + written;
            converters.late = end > DEADLINE.load(Ordering::Relaxed);
            converters.adc.arm();
            BOARD.follow();
            converters.judge();
            let spent = DWT::cycle_count().wrapping_sub(start);
            WRITTEN.fetch_max(written, Ordering::Relaxed);
            LONGEST.fetch_max(spent, Ordering::Relaxed);
            SUM.fetch_add(spent, Ordering::Relaxed);
        }
    });
    EARLIEST.fetch_min(since, Ordering::Relaxed);
    LATEST.fetch_max(since, Ordering::Relaxed);
    SAMPLES.fetch_add(1, Ordering::Relaxed);
}

impl Converters {
    /// The converters, the DAC started and `sound` or held in reset.
    pub const fn new(adc: Receiver, dac: Ad5676r<Transmitter>, sound: bool) -> Self {
        Self {
            adc,
            dac,
            sound,
            failed: 0,
            wrong: 0,
            waiting: RUNNING,
            late: false,
        }
    }

    /// The first half of a sample: reads, computes and hands over.
    fn latch(&mut self) {
        // While the last bits come in.
        let written = self.dac.device().end();
        if self.sound {
            self.failed = match written {
                Ok(()) => 0,
                Err(_) => self.failed + 1,
            };
        }
        let samples = self.adc.read().map(|lines| ad7606::decode(lines).into());
        let reading = Reading {
            // Without a working DAC the samples count as lost, and the loop stays open.
            samples: samples.filter(|_| self.sound),
            late: self.late,
        };
        let Some(codes) = BOARD.latch(reading) else {
            return;
        };
        if self.sound {
            let frames = self.dac.frames(codes);
            self.dac.device().begin(frames);
        }
    }

    /// Holds the DAC in reset if it is hopeless; switches the amplifiers on if all is well.
    fn judge(&mut self) {
        if self.failed >= HOPELESS || self.wrong >= HOPELESS {
            guard::hold_safe();
            self.sound = false;
        }
        if self.sound && self.waiting > 0 {
            self.waiting -= 1;
            if self.waiting == 0 {
                guard::enable_amplifiers();
            }
        }
    }

    /// Whether the bus was free to read back.
    fn read_back(&mut self) -> bool {
        if !self.sound {
            return true;
        }
        if self.dac.device().is_sending() {
            return false;
        }
        self.wrong = match self.dac.read_back() {
            Ok(()) => 0,
            Err(_) => self.wrong + 1,
        };
        self.judge();
        true
    }
}

/// From the next interrupt on, samples are taken with these converters.
pub fn begin(converters: Converters) {
    converters.adc.arm();
    critical_section::with(|cs| CONVERTERS.borrow_ref_mut(cs).replace(converters));
}

/// Reads the code of one of the DAC's outputs back, of each call's the next one. False if the
/// DAC's bus is still sending.
pub fn read_back() -> bool {
    critical_section::with(|cs| {
        let mut converters = CONVERTERS.borrow_ref_mut(cs);
        converters.as_mut().is_none_or(Converters::read_back)
    })
}

/// Samples at the rate of `table` from now on.
pub fn run(table: &Table) {
    let deadline = (table.latch - (budget::WRITE + budget::SETUP) as f32) * CORE as f32;
    DEADLINE.store(deadline as u32, Ordering::Relaxed);
    PERIOD.store((CORE as f32 / table.sample_rate) as u32, Ordering::Relaxed);
    LAST.store(0, Ordering::Relaxed);
    period::start(table.sample_rate, table.latch);
}

/// Samples since the start.
pub fn count() -> u32 {
    SAMPLES.load(Ordering::Relaxed)
}

/// What samples take, ns.
pub struct Timing {
    /// Largest time from a sample's interrupt until its codes were handed to the DMA.
    pub written: u32,
    /// Largest time that a sample takes.
    pub longest: u32,
    /// The average time that a sample takes, since the last call.
    pub usual: u32,
    /// Difference between the latest and the earliest interrupt relative to the timer.
    pub jitter: u32,
}

/// The timing of the last `count` samples.
pub fn timing(count: u32) -> Timing {
    let ns = |units: u32, clock: u32| (u64::from(units) * 1_000_000_000 / u64::from(clock)) as u32;
    let earliest = EARLIEST.load(Ordering::Relaxed);
    let jitter = LATEST.load(Ordering::Relaxed).saturating_sub(earliest);
    Timing {
        written: ns(WRITTEN.load(Ordering::Relaxed), CORE),
        longest: ns(LONGEST.load(Ordering::Relaxed), CORE),
        usual: ns(SUM.swap(0, Ordering::Relaxed) / count.max(1), CORE),
        jitter: ns(jitter, TIMER),
    }
}
