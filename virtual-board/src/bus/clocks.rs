//! Clocks: what the peripherals and the core run with, and what an instruction costs then.

use super::Bus;
use crate::peripherals::nvic::NMI;
use crate::time::{Cost, Ticks};

impl Bus {
    /// Frequencies have changed.
    pub(super) fn clock(&mut self) {
        let clocks = self.rcc.clocks();
        if clocks.core != self.core {
            let sampling = self.gate.sampling(self.now);
            self.dwt.settle(sampling, self.core);
            self.core = clocks.core;
            self.price();
        }
        self.tim1.clock = clocks.timer2;
        self.usart3.kernel = clocks.pclk1;
        let [dead_3, dead_4, dead_5] = self.dead_spi;
        self.spi3.kernel = clocks.spi123.filter(|_| !dead_3);
        self.spi4.kernel = clocks.spi45.filter(|_| !dead_4);
        self.spi5.kernel = clocks.spi45.filter(|_| !dead_5);
    }

    /// SPI3, SPI4 or SPI5 never ends a transfer from now on, as if its kernel had no clock.
    pub fn kill_spi(&mut self, dead: [bool; 3]) {
        self.dead_spi = dead;
        self.clock();
    }

    /// Changes what instructions and accesses cost.
    pub fn set_cost(&mut self, cost: Cost) {
        self.cost = cost;
        self.price();
    }

    fn price(&mut self) {
        let cycle = crate::time::SECOND as f64 / self.core.max(1) as f64;
        let ticks = |cycles: f64| (cycles * cycle).round() as Ticks;
        self.ticks = (
            ticks(self.cost.instruction),
            ticks(self.cost.access),
            ticks(1.0),
        );
    }

    /// Whether the core has a clock.
    pub fn runs(&self) -> bool {
        self.core != 0
    }

    /// The clock at HSE stops, or comes back.
    pub fn set_hse(&mut self, present: bool) {
        if present {
            self.rcc.hse_present = true;
        } else if self.rcc.lose_hse() {
            self.nvic.set_pending(NMI, true);
        }
        self.clock();
    }

    /// The core's clock, Hz.
    pub fn core(&self) -> u64 {
        self.core
    }
}
