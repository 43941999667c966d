//! The reference board: its pins, and what runs when. Everything else is the same on every
//! board.

use core::mem::MaybeUninit;

use cortex_m::peripheral::NVIC;
// The log is sent through the debugger, if one is connected.
use defmt_rtt as _;
use embassy_stm32::gpio::{AfType, AnyPin, Flex, Input, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::pac::RCC;
use embassy_stm32::{Peri, interrupt};
use firmware::converters::ad5676r::Ad5676r;
use firmware::link_task::LinkTask;
use firmware::store::Store;
use firmware::{budget, tables};
use shared::controller::{Health, Memory, Restart};
use shared::link::FRAME;
use shared::multisine::{LINES, Slot};
use shared::recorder::Record;

use crate::clocks::{self, CORE, Source};
use crate::flash::{self, Sectors};
use crate::guard::{self, Watchdog};
use crate::port::Port;
use crate::sample::{self, BOARD, Converters};
use crate::spi::{Receiver, Transmitter};

/// Number of records that fit into the recorder: 288 KiB of the 512 KiB of AXI SRAM.
const ROOM: usize = 8192;

/// Memory of the recorder, which only [`memory`] initialises.
#[unsafe(link_section = ".axi.records")]
static mut RECORDS: MaybeUninit<[Record; ROOM]> = MaybeUninit::uninit();

/// Memory of the multisine, likewise.
#[unsafe(link_section = ".axi.lines")]
static mut SLOTS: MaybeUninit<[Slot; LINES]> = MaybeUninit::uninit();

/// Outputs are read back this many times per second.
const READ_BACK: f32 = 100.0;

/// Timing is reported this many times per second.
const REPORT: f32 = 10.0;

fn alternate(pin: Peri<'static, AnyPin>, number: u8, kind: AfType) {
    let mut pin = Flex::new(pin);
    pin.set_as_af_unchecked(number, kind);
    // The pin keeps this function for ever.
    core::mem::forget(pin);
}

/// Runs the board. Never returns.
pub fn run() -> ! {
    let restart = guard::restart();
    guard::paint_stack();
    let watchdog = Watchdog::start();
    let (p, source) = clocks::start();
    // Low: the amplifiers are off, and the DAC's outputs stay in the middle of their range.
    let amplifiers = Output::new(p.PE11, Level::Low, Speed::Low);
    core::mem::forget(amplifiers);
    let mut dac_reset = Output::new(p.PG14, Level::Low, Speed::Low);
    let Some(mut core) = cortex_m::Peripherals::take() else {
        panic!("taken once");
    };
    flash::forbid_system_memory(&mut core.MPU);
    core.SCB.enable_icache();
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    defmt::info!("started by {=str}", name(restart));
    if source == Source::Internal {
        defmt::error!("no external clock; running on the internal oscillator");
    }

    let store = Store::new(Sectors::new(), 0..flash::SIZE);
    let entry = tables::compiled(&tables::NUCLEO_H743);
    let mut link = LinkTask::begin(&BOARD, entry, budget::LIMITS, store, memory());

    RCC.apb2enr().modify(|w| {
        w.set_spi4en(true);
        w.set_spi5en(true);
    });
    RCC.apb1lenr().modify(|w| w.set_spi3en(true));
    let adc = Receiver::new(Input::new(p.PG12, Pull::Up));
    let bus = Transmitter::new();
    // The buses hold the select lines high from here on.
    let fast = AfType::output(OutputType::PushPull, Speed::VeryHigh);
    for (pin, number) in [
        (p.PE4.into(), 5),
        (p.PE2.into(), 5),
        (p.PE5.into(), 5),
        (p.PF7.into(), 5),
        (p.PF9.into(), 5),
        (p.PA4.into(), 6),
        (p.PC10.into(), 6),
        (p.PC11.into(), 6),
        (p.PC12.into(), 6),
        (p.PE9.into(), 1),
        (p.PE13.into(), 1),
        (p.PD8.into(), 7),
    ] {
        alternate(pin, number, fast);
    }
    // Without a host, the line is at rest.
    alternate(p.PD9.into(), 7, AfType::input(Pull::Up));
    // The ADC requires a reset after power-up.
    let mut adc_reset = Output::new(p.PE14, Level::High, Speed::Low);
    cortex_m::asm::delay(CORE / 1_000_000);
    adc_reset.set_low();
    dac_reset.set_high();
    // Both pins keep their level for ever.
    core::mem::forget((adc_reset, dac_reset));
    cortex_m::asm::delay(CORE / 1_000);
    let mut dac = Ad5676r::new(bus);
    let safe = BOARD.with(|controller| controller.table().safe_codes());
    let sound = safe.is_some_and(|safe| dac.start(safe).is_ok());
    if !sound {
        guard::hold_safe();
        defmt::error!("the DAC does not answer; the loop stays open");
    }
    sample::begin(Converters::new(adc, dac, sound));

    let mut port = Port::open();
    // SAFETY: critical sections mask every interrupt, whatever its priority, and everything
    // that the handlers use is initialised.
    unsafe {
        core.NVIC.set_priority(interrupt::TIM1_CC, 0x00);
        core.NVIC.set_priority(interrupt::USART3, 0x80);
        NVIC::unmask(interrupt::TIM1_CC);
        NVIC::unmask(interrupt::USART3);
    }

    watchdog.watch();
    let mut runs = None;
    let mut rate = 0.0;
    let (mut seen, mut reported, mut read) = (0, 0, 0);
    let mut fault = None;
    loop {
        // A table that came over the link may have another sample rate.
        let changed = BOARD.with(|controller| {
            let checksum = controller.identity().checksum;
            (runs != Some(checksum)).then(|| (checksum, *controller.table().get()))
        });
        if let Some(Some((checksum, table))) = changed {
            sample::run(&table);
            rate = table.sample_rate;
            runs = Some(checksum);
        }
        // One frame a pass, and none that the port would have to wait for.
        if port.is_ready() {
            for _ in 0..FRAME {
                let Some(byte) = port.read() else { break };
                if let Some(frame) = link.on_byte(byte, &BOARD) {
                    port.write(&frame);
                    break;
                }
            }
        }
        if port.is_ready()
            && let Some(frame) = link.idle(&BOARD)
        {
            port.write(&frame);
        }
        let samples = sample::count();
        // The loop has run since the last time, and this is the link.
        if samples != seen {
            seen = samples;
            watchdog.feed();
        }
        if samples.wrapping_sub(read) as f32 > rate / READ_BACK && sample::read_back() {
            read = samples;
        }
        let count = samples.wrapping_sub(reported);
        if count as f32 > rate / REPORT {
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
    let timing = sample::timing(count);
    let health = Health {
        restart,
        period: (1e9 / rate) as u32,
        written: timing.written,
        longest: timing.longest,
        usual: timing.usual,
        jitter: timing.jitter,
        stack: guard::unused_stack(),
    };
    BOARD.with(|controller| controller.set_health(health));
}

/// The memory of the controller. To be called once.
fn memory() -> Memory<'static> {
    // SAFETY: `run` calls this once and never returns: there are no other references.
    unsafe {
        Memory {
            records: filled(&raw mut RECORDS, Record::NONE),
            lines: filled(&raw mut SLOTS, Slot::EMPTY),
        }
    }
}

/// A memory, each place of it with `value`.
///
/// # Safety
/// There must be no other reference to the memory, ever.
unsafe fn filled<T: Copy, const N: usize>(
    memory: *mut MaybeUninit<[T; N]>,
    value: T,
) -> &'static mut [T] {
    let start = memory.cast::<T>();
    for i in 0..N {
        // SAFETY: within the array, and there is no other reference to it.
        unsafe { start.add(i).write(value) };
    }
    // SAFETY: every place was written above, and there is no other reference.
    unsafe { core::slice::from_raw_parts_mut(start, N) }
}

fn name(restart: Restart) -> &'static str {
    match restart {
        Restart::Power => "power",
        Restart::Pin => "the reset pin",
        Restart::Watchdog => "the watchdog",
        Restart::Panic => "a panic",
        Restart::HardFault => "a hard fault",
        Restart::BrownOut => "a low supply voltage",
        Restart::Clock => "a failure of the external clock",
    }
}
