//! The link's serial port: USART3, which the ST-LINK passes on to the host (RM0433, chapter 48).
//! Bytes go through queues between the interrupt and the link task; neither waits for the other.

use embassy_stm32::interrupt;
use embassy_stm32::pac::{RCC, USART3};
use heapless::spsc::{Consumer, Producer, Queue};
use shared::link::FRAME;

use crate::clocks::APB;

/// Speed of the link, bits/s.
const BAUD: u32 = 921_600;

/// Bytes from the host: a burst of many requests. Bytes that find the queue full are lost, and
/// the checksum of their frame fails.
static mut RECEIVED: Queue<u8, 4096> = Queue::new();

/// Bytes to the host.
static mut SENT: Queue<u8, 2048> = Queue::new();

/// The interrupt's ends of the queues.
struct Ends {
    received: Producer<'static, u8>,
    sent: Consumer<'static, u8>,
}

static mut ENDS: Option<Ends> = None;

/// The link task's end of the port.
pub struct Port {
    received: Consumer<'static, u8>,
    sent: Producer<'static, u8>,
}

impl Port {
    /// Switches the port on. Its pins must be set. To be called once, before the interrupt is
    /// unmasked.
    pub fn open() -> Self {
        // SAFETY: called once, so these are the only references to the queues.
        let (receive, send) = unsafe { (&mut *(&raw mut RECEIVED), &mut *(&raw mut SENT)) };
        let (receive, send) = (receive.split(), send.split());
        // SAFETY: the interrupt, the only other user, is still masked.
        unsafe {
            (&raw mut ENDS).write(Some(Ends {
                received: receive.0,
                sent: send.1,
            }));
        }
        RCC.apb1lenr().modify(|w| w.set_usart3en(true));
        USART3
            .brr()
            .write(|w| w.set_brr(((APB + BAUD / 2) / BAUD) as u16));
        USART3.cr1().write(|w| {
            w.set_fifoen(true);
            w.set_rxneie(true);
            w.set_te(true);
            w.set_re(true);
            w.set_ue(true);
        });
        Self {
            received: receive.1,
            sent: send.0,
        }
    }

    /// The next byte from the host.
    pub fn read(&mut self) -> Option<u8> {
        self.received.dequeue()
    }

    /// Whether a frame can be written without waiting.
    pub fn is_ready(&self) -> bool {
        self.sent.capacity() - self.sent.len() >= FRAME
    }

    /// Queues a frame. The port must be ready.
    pub fn write(&mut self, frame: &[u8]) {
        for byte in frame {
            // A ready port has room.
            let _ = self.sent.enqueue(*byte);
        }
        // The interrupt changes only this bit, so the last change is this one.
        USART3.cr1().modify(|w| w.set_txeie(true));
    }
}

#[interrupt]
fn USART3() {
    // SAFETY: written before the interrupt was unmasked; from then on only used here, in an
    // interrupt that cannot interrupt itself.
    let Some(ends) = (unsafe { &mut *(&raw mut ENDS) }) else {
        return;
    };
    // Overrun, noise, framing: the bytes are wrong, and their frame fails its checksum.
    USART3.icr().write(|w| {
        w.set_ore(true);
        w.set_ne(true);
        w.set_fe(true);
    });
    while USART3.isr().read().rxne() {
        let byte = USART3.rdr().read().dr() as u8;
        let _ = ends.received.enqueue(byte);
    }
    while USART3.cr1().read().txeie() && USART3.isr().read().txe() {
        match ends.sent.dequeue() {
            Some(byte) => USART3.tdr().write(|w| w.set_dr(byte.into())),
            None => USART3.cr1().modify(|w| w.set_txeie(false)),
        }
    }
}
