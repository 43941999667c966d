//! The emulated board. UART 0 stands for the converters: each request carries the
//! ADC codes of one sample and is answered with the DAC codes; the plant is at the
//! other end of the line. UART 1 is the link.
//!
//! As on a board for the lab, the loop runs in an interrupt above all else, the
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
use firmware::loop_task::Board;
use firmware::ram_flash::RamFlash;
use firmware::store::Store;
use firmware::tables::Entry;
use heapless::Deque;
use shared::recorder::Record;
use shared::table::Limits;
use uart::{Line, Receive};

/// Records that the recorder has room for.
const ROOM: usize = 16_384;

static BOARD: Board = Board::new();

/// The request on the converters' line, as far as it has come.
static CONVERTERS: Mutex<RefCell<(Option<Line>, [u8; REQUEST], usize)>> =
    Mutex::new(RefCell::new((None, [0; REQUEST], 0)));

/// Bytes from the host that the link task has not seen yet.
static INCOMING: Mutex<RefCell<(Option<Receive>, Deque<u8, 1024>)>> =
    Mutex::new(RefCell::new((None, Deque::new())));

/// Runs the controller of a machine for ever.
pub fn run(entry: &'static Entry) -> ! {
    let (Some(room), Some(mut core)) = (
        cortex_m::singleton!(: [Record; ROOM] = [Record::NONE; ROOM]),
        Peripherals::take(),
    ) else {
        panic!("run is called once");
    };
    let store = Store::new(RamFlash::new(), 0..RamFlash::SIZE as u32);
    let mut link = LinkTask::begin(&BOARD, entry, Limits::NONE, store, room);
    let converters = uart::CONVERTERS.open();
    let (mut send, receive) = uart::LINK.open().split();
    critical_section::with(|cs| {
        CONVERTERS.borrow_ref_mut(cs).0 = Some(converters);
        INCOMING.borrow_ref_mut(cs).0 = Some(receive);
    });
    // SAFETY: no critical section depends on the priorities, they all mask every
    // interrupt; and all that the handlers use is in place.
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
        // Asleep, not polling: the emulator then has the host's core for the
        // lines. In a critical section, so that what comes between the look and the
        // sleep stays pending and ends it.
        critical_section::with(|cs| {
            if INCOMING.borrow_ref(cs).1.is_empty() {
                asm::wfi();
            }
        });
    }
}

#[exception]
// SAFETY: cortex-m-rt wants the default handler marked so; it touches nothing
// that a critical section does not guard.
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
                // A host that sends faster than it is answered loses bytes, and
                // with them a frame's checksum.
                let _ = incoming.push_back(byte);
            }
        });
    }
}
