//! The emulated board. UART 0 replaces the converters: each request carries the ADC codes of
//! one sample, and the reply carries the DAC codes. The plant is simulated at the other end
//! of the line. UART 1 is the link.
//!
//! As on the reference board, the loop runs in an interrupt of the highest priority, and the
//! link below it.

mod stop;
mod uart;

use core::cell::RefCell;

use cortex_m::peripheral::NVIC;
use cortex_m::{Peripherals, asm};
use cortex_m_rt::exception;
use critical_section::Mutex;
use firmware::exchange::{REQUEST, parse_request, refusal, reply};
use firmware::link_task::LinkTask;
use firmware::loop_task::BoardController;
use firmware::ram_flash::RamFlash;
use firmware::store::Store;
use firmware::tables::Entry;
use heapless::Deque;
use shared::controller::Memory;
use shared::multisine::{LINES, Slot};
use shared::recorder::Record;
use shared::table::Limits;
use uart::{Receiver, SerialPort};

/// Number of records that fit into the recorder.
const ROOM: usize = 16_384;

static BOARD: BoardController = BoardController::new();

/// The converters' line, and the part of a request received so far with its length.
static CONVERTERS: Mutex<RefCell<(Option<SerialPort>, [u8; REQUEST], usize)>> =
    Mutex::new(RefCell::new((None, [0; REQUEST], 0)));

/// The link's receiver, and bytes from the host that the link task has not read yet.
static INCOMING: Mutex<RefCell<(Option<Receiver>, Deque<u8, 1024>)>> =
    Mutex::new(RefCell::new((None, Deque::new())));

/// Runs the controller of a machine. Never returns.
pub fn run(entry: &'static Entry) -> ! {
    let (Some(records), Some(lines), Some(mut core)) = (
        cortex_m::singleton!(: [Record; ROOM] = [Record::NONE; ROOM]),
        cortex_m::singleton!(: [Slot; LINES] = [Slot::EMPTY; LINES]),
        Peripherals::take(),
    ) else {
        panic!("run is called once");
    };
    let store = Store::new(RamFlash::new(), 0..RamFlash::SIZE as u32);
    let memory = Memory { records, lines };
    let mut link = LinkTask::begin(&BOARD, entry, Limits::NONE, store, memory);
    let converters = uart::CONVERTERS.open();
    let (mut send, receive) = uart::LINK.open().split();
    critical_section::with(|cs| {
        CONVERTERS.borrow_ref_mut(cs).0 = Some(converters);
        INCOMING.borrow_ref_mut(cs).0 = Some(receive);
    });
    // SAFETY: critical sections mask every interrupt, whatever its priority, and everything
    // that the handlers use is initialised.
    unsafe {
        core.NVIC.set_priority(uart::CONVERTERS.interrupt, 0x00);
        core.NVIC.set_priority(uart::LINK.interrupt, 0x80);
        NVIC::unmask(uart::CONVERTERS.interrupt);
        NVIC::unmask(uart::LINK.interrupt);
    }
    loop {
        let byte = critical_section::with(|cs| INCOMING.borrow_ref_mut(cs).1.pop_front());
        if let Some(frame) = byte.and_then(|byte| link.on_byte(byte, &BOARD)) {
            send.write(&frame);
        }
        if let Some(frame) = link.idle(&BOARD) {
            send.write(&frame);
        }
        // Sleeping instead of polling leaves the host's processor to the serial lines. In a
        // critical section, so that an interrupt between the check and the sleep stays
        // pending and ends the sleep.
        critical_section::with(|cs| {
            if INCOMING.borrow_ref(cs).1.is_empty() {
                asm::wfi();
            }
        });
    }
}

#[exception]
// SAFETY: cortex-m-rt requires `unsafe` here. The handler uses only data guarded by critical
// sections.
unsafe fn DefaultHandler(number: i16) {
    if number == uart::CONVERTERS.interrupt.0 {
        critical_section::with(|cs| {
            let (line, frame, at) = &mut *CONVERTERS.borrow_ref_mut(cs);
            let Some(line) = line else { return };
            while let Some(byte) = line.receive.read() {
                frame[*at] = byte;
                *at += 1;
                if *at == REQUEST {
                    *at = 0;
                    let answer = parse_request(frame)
                        .ok()
                        .and_then(|samples| BOARD.on_sample(samples.into()));
                    line.send.write(&answer.map_or_else(refusal, reply));
                }
            }
        });
    } else if number == uart::LINK.interrupt.0 {
        critical_section::with(|cs| {
            let (receive, incoming) = &mut *INCOMING.borrow_ref_mut(cs);
            let Some(receive) = receive else { return };
            while let Some(byte) = receive.read() {
                // If the host sends faster than it is answered, bytes are lost, and the
                // checksum of the frame fails.
                let _ = incoming.push_back(byte);
            }
        });
    }
}
