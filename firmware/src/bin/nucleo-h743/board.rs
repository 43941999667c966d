//! The reference board: its pins, and what runs when. Everything else is the same on every
//! board.

use core::cell::RefCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::{DWT, NVIC};
use critical_section::Mutex;
// The log is sent through the debugger, if one is connected.
use defmt_rtt as _;
use embassy_stm32::flash::Flash;
use embassy_stm32::gpio::{AfType, Flex, Input, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::pac::spi::vals::Mbr;
use embassy_stm32::pac::{self, RCC};
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{Peri, bind_interrupts, interrupt, peripherals};
use embedded_hal_nb::serial::Read as _;
use embedded_io::Write as _;
use firmware::converters::ad5676r::Ad5676r;
use firmware::converters::ad7606::Ad7606;
use firmware::link_task::LinkTask;
use firmware::loop_task::BoardController;
use firmware::store::Store;
use firmware::{budget, tables};
use shared::controller::{Health, Reading, Restart};
use shared::recorder::Record;

use crate::clocks::{self, CORE, TIMER};
use crate::flash::{self, Sectors};
use crate::guard::{self, Watchdog};
use crate::{period, spi::Spi};

/// Number of records that fit into the recorder: 288 KiB of the 512 KiB of AXI SRAM.
const ROOM: usize = 8192;

/// Memory of the recorder, which only [`room`] initialises.
#[unsafe(link_section = ".axi.room")]
static mut RECORDS: MaybeUninit<[Record; ROOM]> = MaybeUninit::uninit();

static BOARD: BoardController = BoardController::new();

/// The converters, used by the interrupt.
struct Converters {
    adc: Ad7606<Spi, Input<'static>>,
    dac: Ad5676r<Spi>,
    /// Whether the DAC works: it answered at start, and its writes have not failed since.
    sound: bool,
    /// Consecutive writes that failed.
    failed: u32,
    /// Whether the last sample missed its deadline.
    late: bool,
}

static CONVERTERS: Mutex<RefCell<Option<Converters>>> = Mutex::new(RefCell::new(None));

/// Largest number of core cycles from the interrupt until the codes were written.
static LONGEST: AtomicU32 = AtomicU32::new(0);

/// Sum of these cycles over the samples since the last [`report`].
static SUM: AtomicU32 = AtomicU32::new(0);

/// Smallest count of TIM1 at the interrupt.
static EARLIEST: AtomicU32 = AtomicU32::new(u32::MAX);

/// Largest count of TIM1 at the interrupt.
static LATEST: AtomicU32 = AtomicU32::new(0);

/// Samples since the start.
static SAMPLES: AtomicU32 = AtomicU32::new(0);

/// Deadline for writing the codes, core cycles after the sample.
static DEADLINE: AtomicU32 = AtomicU32::new(0);

/// Sample period, core cycles.
static PERIOD: AtomicU32 = AtomicU32::new(0);

/// Cycle count at the last interrupt; 0 before the first.
static LAST: AtomicU32 = AtomicU32::new(0);

/// Number of consecutive failed writes after which the DAC is held in reset.
const HOPELESS: u32 = 3;

bind_interrupts!(struct Interrupts {
    USART3 => usart::BufferedInterruptHandler<peripherals::USART3>;
});

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
            converters.sample();
            let spent = DWT::cycle_count().wrapping_sub(start);
            let end = since * (CORE / TIMER) + spent;
            converters.late = end > DEADLINE.load(Ordering::Relaxed);
            LONGEST.fetch_max(spent, Ordering::Relaxed);
            SUM.fetch_add(spent, Ordering::Relaxed);
        }
    });
    EARLIEST.fetch_min(since, Ordering::Relaxed);
    LATEST.fetch_max(since, Ordering::Relaxed);
    SAMPLES.fetch_add(1, Ordering::Relaxed);
}

impl Converters {
    fn sample(&mut self) {
        let samples = self.adc.read().ok().map(Into::into);
        let reading = Reading {
            // Without a working DAC the samples count as lost, and the loop stays open.
            samples: samples.filter(|_| self.sound),
            late: self.late,
        };
        let Some(codes) = BOARD.on_sample(reading) else {
            return;
        };
        if self.dac.write(codes).is_ok() {
            self.failed = 0;
            return;
        }
        self.failed += 1;
        if self.failed >= HOPELESS {
            guard::hold_safe();
            self.sound = false;
        }
    }
}

fn alternate(pin: Peri<'static, embassy_stm32::gpio::AnyPin>, number: u8) {
    let mut pin = Flex::new(pin);
    pin.set_as_af_unchecked(
        number,
        AfType::output(OutputType::PushPull, Speed::VeryHigh),
    );
    // The pin keeps this function for ever.
    core::mem::forget(pin);
}

/// Runs the board. Never returns.
pub fn run() -> ! {
    let restart = guard::restart();
    guard::paint_stack();
    let p = clocks::start();
    // Low: the DAC's outputs stay in the middle of their range.
    let mut dac_reset = Output::new(p.PG14, Level::Low, Speed::Low);
    let watchdog = Watchdog::start();
    let Some(mut core) = cortex_m::Peripherals::take() else {
        panic!("taken once");
    };
    core.SCB.enable_icache();
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    defmt::info!("started by {=str}", name(restart));

    let store = Store::new(Sectors(Flash::new_blocking(p.FLASH)), 0..flash::SIZE);
    let entry = &tables::NUCLEO_H743;
    let mut link = LinkTask::begin(&BOARD, entry, budget::LIMITS, store, room());

    RCC.apb2enr().modify(|w| w.set_spi1en(true));
    RCC.apb1lenr().modify(|w| w.set_spi3en(true));
    alternate(p.PA5.into(), 5);
    alternate(p.PA6.into(), 5);
    alternate(p.PC10.into(), 6);
    alternate(p.PC11.into(), 6);
    alternate(p.PC12.into(), 6);
    alternate(p.PE9.into(), 1);
    alternate(p.PE13.into(), 1);
    let select = |pin: Peri<'static, embassy_stm32::gpio::AnyPin>| {
        Output::new(pin, Level::High, Speed::VeryHigh)
    };
    // The ADC requires a reset after power-up.
    let mut adc_reset = Output::new(p.PE14, Level::High, Speed::Low);
    cortex_m::asm::delay(CORE / 1_000_000);
    adc_reset.set_low();
    let adc = Spi::new(pac::SPI1, select(p.PD14.into()), Mbr::DIV8);
    let adc = Ad7606::new(adc, Input::new(p.PG12, Pull::Up));
    dac_reset.set_high();
    cortex_m::asm::delay(CORE / 1_000);
    // A slow clock for reading back, the loop's clock afterwards.
    let mut dac = Ad5676r::new(Spi::new(pac::SPI3, select(p.PD2.into()), Mbr::DIV64));
    let safe = BOARD.with(|controller| controller.table().safe_codes());
    let sound = safe.is_some_and(|safe| dac.start(safe).is_ok());
    if !sound {
        guard::hold_safe();
        defmt::error!("the DAC does not answer; the loop stays open");
    }
    let mut device = dac.into_device();
    device.set_divider(Mbr::DIV4);
    critical_section::with(|cs| {
        CONVERTERS.borrow_ref_mut(cs).replace(Converters {
            adc,
            dac: Ad5676r::new(device),
            sound,
            failed: 0,
            late: false,
        });
    });

    let (mut transmit, mut receive) = ([0; 2048], [0; 1024]);
    let mut config = usart::Config::default();
    config.baudrate = 921_600;
    let Ok(uart) = BufferedUart::new(
        p.USART3,
        p.PD9,
        p.PD8,
        &mut transmit,
        &mut receive,
        Interrupts,
        config,
    ) else {
        panic!("the link's speed is one that the port has");
    };
    let (mut send, mut receive) = uart.split();
    // SAFETY: critical sections mask every interrupt, whatever its priority, and everything
    // that the handlers use is initialised.
    unsafe {
        core.NVIC.set_priority(interrupt::TIM1_CC, 0x00);
        core.NVIC.set_priority(interrupt::USART3, 0x80);
        NVIC::unmask(interrupt::TIM1_CC);
    }

    let mut runs = None;
    let (mut seen, mut reported) = (0, 0);
    let mut fault = None;
    loop {
        // A table that came over the link may have another sample rate.
        let table = BOARD.with(|controller| {
            let table = controller.table().get();
            (table.sample_rate, table.latch)
        });
        if table != runs
            && let Some((rate, latch)) = table
        {
            let deadline = (latch - budget::SETUP) * CORE as f32;
            DEADLINE.store(deadline as u32, Ordering::Relaxed);
            PERIOD.store((CORE as f32 / rate) as u32, Ordering::Relaxed);
            LAST.store(0, Ordering::Relaxed);
            period::start(rate, latch);
            runs = table;
        }
        while let Ok(byte) = receive.read() {
            if let Some(frame) = link.on_byte(byte, &BOARD) {
                // Writing to the port's buffer cannot fail.
                let _ = send.write_all(&frame);
            }
        }
        if let Some(frame) = link.idle(&BOARD) {
            let _ = send.write_all(&frame);
        }
        let samples = SAMPLES.load(Ordering::Relaxed);
        // The loop has run since the last time, and this is the link.
        if samples != seen {
            seen = samples;
            watchdog.feed();
        }
        // About ten times a second.
        let count = samples.wrapping_sub(reported);
        if let Some((rate, _)) = runs
            && count as f32 > 0.1 * rate
        {
            reported = samples;
            report(restart, rate, count);
            let found = BOARD.with(|controller| controller.report().fault).flatten();
            if found != fault {
                fault = found;
                match fault {
                    Some(fault) => defmt::warn!("fault at sample {=u64}", fault.at),
                    None => defmt::info!("fault cleared"),
                }
            }
        }
    }
}

/// Passes the timing of the last `count` samples and the stack use to the controller.
fn report(restart: Restart, rate: f32, count: u32) {
    let sum = SUM.swap(0, Ordering::Relaxed);
    let ns = |units: u32, clock: u32| (u64::from(units) * 1_000_000_000 / u64::from(clock)) as u32;
    let jitter = LATEST
        .load(Ordering::Relaxed)
        .saturating_sub(EARLIEST.load(Ordering::Relaxed));
    let health = Health {
        restart,
        period: (1e9 / rate) as u32,
        longest: ns(LONGEST.load(Ordering::Relaxed), CORE),
        usual: ns(sum / count.max(1), CORE),
        jitter: ns(jitter, TIMER),
        stack: guard::unused_stack(),
    };
    BOARD.with(|controller| controller.set_health(health));
}

/// The memory of the recorder. To be called once.
fn room() -> &'static mut [Record] {
    let start = (&raw mut RECORDS).cast::<Record>();
    for i in 0..ROOM {
        // SAFETY: within the array, and there is no other reference to it.
        unsafe { start.add(i).write(Record::NONE) };
    }
    // SAFETY: every record was written above, and `run` calls this once and never returns.
    unsafe { core::slice::from_raw_parts_mut(start, ROOM) }
}

fn name(restart: Restart) -> &'static str {
    match restart {
        Restart::Power => "power",
        Restart::Pin => "the reset pin",
        Restart::Watchdog => "the watchdog",
        Restart::Panic => "a panic",
        Restart::HardFault => "a hard fault",
    }
}
