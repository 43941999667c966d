//! What happens by itself, in the order of its moments.

use super::{Block, Bus};
use crate::memory::AXI;
use crate::peripherals::dma::{self, Transfer};
use crate::peripherals::iwdg::Iwdg;
use crate::peripherals::rcc::Reset;
use crate::peripherals::{tim1, unknown, usart};
use crate::time::Ticks;
use crate::wires::pins;

impl Bus {
    /// When something happens next.
    pub fn next(&self) -> Option<Ticks> {
        (self.due != Ticks::MAX).then_some(self.due)
    }

    /// Finds out when something happens next; to be called when that may have changed.
    pub fn schedule(&mut self) {
        self.due = self.earliest().unwrap_or(Ticks::MAX);
    }

    fn earliest(&self) -> Option<Ticks> {
        let sampling = [self.tim1.next().map(|(at, _)| at), self.iwdg.next()];
        let sampling = sampling.into_iter().flatten().min();
        [
            sampling.and_then(|at| self.gate.moment(at)),
            self.dma.next(),
            self.spi3.next(),
            self.spi4.next(),
            self.usart3.next(),
            self.flash.next(),
            self.adc.next(),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// Whether the core may have to do something else than its next instruction.
    pub fn is_urgent(&self) -> bool {
        self.error.is_some() || self.reset.is_some() || self.fault.is_some() || self.nvic.waits()
    }

    /// Lets everything happen that is due by `now`, in the order of its moments.
    pub fn events(&mut self, now: Ticks) {
        while let Some(at) = self.next().filter(|at| *at <= now) {
            self.happened += 1;
            let sampling = self.gate.sampling(at);
            if self.iwdg.next().is_some_and(|bites| bites <= sampling) && !self.gate.is_closed() {
                self.reset = self.reset.or(Some(Reset::Watchdog));
                self.iwdg = Iwdg::default();
            }
            if let Some((_, update)) = self.tim1.next().filter(|(due, _)| *due <= sampling)
                && !self.gate.is_closed()
            {
                if update && self.gate.holds() {
                    self.gate.close(at);
                } else {
                    self.timer_event(sampling, at);
                }
            }
            if self.adc.advance(at) {
                self.note(pins::BUSY, at);
            }
            self.spi_event(at);
            self.dma_event(at);
            self.usart3.advance(at);
            self.flash.advance(at);
            self.lines(at);
            self.requests(at);
            self.schedule();
        }
    }

    fn timer_event(&mut self, sampling: Ticks, at: Ticks) {
        let Some(event) = self.tim1.advance(sampling) else {
            return;
        };
        if event.update {
            self.counts.sampled(at);
            self.gate.pass();
        }
        // The end of LDAC.
        if event.matches >> 3 & 1 != 0 && self.gate.holds() {
            self.gate.close(at);
        }
        if event.matches >> 1 & 1 != 0 {
            self.counts.timer_event(at);
        }
        self.drive(pins::CONVST, at);
        self.drive(pins::LDAC, at);
    }

    fn spi_event(&mut self, at: Ticks) {
        if let Some(frame) = self.spi4.due(at) {
            let received = self.exchange_adc(frame);
            self.spi4.finish(received);
        }
        if let Some(frame) = self.spi3.due(at) {
            let received = self.exchange_dac(frame);
            if self.spi3.ends_several() {
                self.counts.wrote(at);
            }
            self.spi3.finish(received);
        }
        self.drive(pins::CS, at);
        self.drive(pins::SYNC, at);
    }

    fn dma_event(&mut self, at: Ticks) {
        while let Some(Transfer { address, word }) = self.dma.due(at) {
            let done = match Block::at(address) {
                Some((block, offset)) => self.write_spi(block, offset, 4, word, at),
                None => unknown(),
            };
            if let Err(why) = done {
                self.refuse(format!("DMA1 writes {word:#x} to {address:#010x}: {why}"));
            }
        }
    }

    /// Takes the requests to the DMA. A transfer takes as long as an access by the core.
    pub(super) fn requests(&mut self, at: Ticks) {
        // It reaches AXI SRAM, and none of the core's own memories (2.1.6).
        let memory = &self.memory;
        let reachable = AXI.0..AXI.0 + AXI.1 as u32;
        let loaded = self.dma.load(|address| {
            memory
                .word(address)
                .filter(|_| reachable.contains(&address))
        });
        if let Err(why) = loaded {
            self.refuse(why);
        }
        let moves = at + self.ticks.1;
        if self.spi3.requests()
            && let Some(stream) = self.dma.waiting(dma::SPI3_TX)
        {
            self.dma.request(stream, moves);
        }
        if self.tim1.requests_dma()
            && let Some(stream) = self.dma.waiting(dma::TIM1_CH1)
        {
            self.tim1.grant_dma();
            self.dma.request(stream, moves);
        }
    }

    /// Sets the interrupt lines as the peripherals request.
    pub(super) fn lines(&mut self, at: Ticks) {
        let timer = self.tim1.requests();
        if timer {
            self.counts.requested(at);
        }
        self.nvic.line(tim1::CC_IRQ, timer);
        self.nvic.line(usart::IRQ, self.usart3.requests());
    }
}
