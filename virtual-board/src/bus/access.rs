//! Accesses by the core: which peripheral answers, and what a write changes outside it.

use super::Bus;
use super::map::Block;
use crate::counts::Chip;
use crate::peripherals::dma::Dma;
use crate::peripherals::gpio::Gpio;
use crate::peripherals::rcc::{Domain, Reset};
use crate::peripherals::syscfg::Syscfg;
use crate::peripherals::tim1::Tim1;
use crate::peripherals::{Refusal, dwt, unknown};
use crate::time::Ticks;
use crate::wires::{Pin, pins};

impl Bus {
    /// Accounts for an access, and lets happen what is due before it.
    fn begin(&mut self, block: Block) {
        self.accesses += 1;
        if block.is_behind_bridge() {
            self.now += self.ticks.1;
        }
        self.events(self.now);
    }

    /// A read by the core.
    pub fn read(&mut self, address: u32, size: usize) -> u32 {
        let Some((block, offset)) = Block::at(address) else {
            self.refuse(format!(
                "read of {size} bytes at {address:#010x}: no peripheral"
            ));
            return 0;
        };
        self.begin(block);
        self.unsteady += u64::from(!block.is_steady(offset));
        let chip = served(block);
        self.counts.access(block, offset, false, chip);
        let answer = self
            .check(block, offset, size)
            .and_then(|()| self.read_register(block, offset, size));
        self.lines(self.now);
        let value = answer.unwrap_or_else(|why| {
            let register = block.register(offset);
            self.refuse(format!("read of {register} at {address:#010x}: {why}"));
            0
        });
        self.answers.push(address, value);
        value
    }

    /// A write by the core.
    pub fn write(&mut self, address: u32, size: usize, value: u32) {
        let Some((block, offset)) = Block::at(address) else {
            self.refuse(format!(
                "write of {value:#x}, {size} bytes, to {address:#010x}: no peripheral"
            ));
            return;
        };
        self.begin(block);
        self.unsteady += 1;
        let chip = served(block);
        self.counts.access(block, offset, true, chip);
        let done = self
            .check(block, offset, size)
            .and_then(|()| self.write_register(block, offset, size, value));
        self.lines(self.now);
        self.requests(self.now);
        self.schedule();
        if let Err(why) = done {
            let register = block.register(offset);
            self.refuse(format!(
                "write of {value:#x} to {register} at {address:#010x}: {why}"
            ));
        }
    }

    fn check(&self, block: Block, offset: u32, size: usize) -> Result<(), Refusal> {
        if let Some(domain) = block.domain()
            && !self.rcc.is_on(domain)
        {
            return Err("its clock is off or its reset is on".to_owned());
        }
        if block.takes(offset, size) {
            Ok(())
        } else {
            Err(format!("an access of {size} bytes"))
        }
    }

    fn read_register(&mut self, block: Block, offset: u32, size: usize) -> Result<u32, Refusal> {
        let now = self.now;
        let sampling = self.gate.sampling(now);
        match block {
            Block::Spi3 => self.spi3.read(offset, size),
            Block::Spi4 => self.spi4.read(offset, size),
            Block::Spi5 => self.spi5.read(offset, size),
            Block::Dma1 => self.dma.read(offset),
            Block::Dmamux1 => self.dma.read_mux(offset),
            Block::Usart3 => self.usart3.read(offset),
            Block::Tim1 => self.tim1.read(offset, sampling),
            Block::Flash => self.flash.read(offset),
            Block::Syscfg => self.syscfg.read(offset),
            Block::Iwdg1 => self.iwdg.read(offset, now),
            Block::Gpio(port) => {
                self.gpio[usize::from(port)].read(offset, |number| self.level(Pin(port, number)))
            }
            Block::Rcc => self.rcc.read(offset, now),
            Block::Pwr => self.pwr.read(offset, now),
            Block::Dbgmcu => self.dbgmcu.read(offset),
            Block::Dwt => self.dwt.read(offset, sampling, self.core),
            Block::Scs => match offset {
                0x100..0xD00 => self.nvic.read(offset, size),
                0xD90..0xDBC => self.mpu.read(offset),
                offset if offset == dwt::DEMCR.0 => Ok(self.dwt.demcr()),
                0xD00..0xF80 => self.scb.read(offset, size, &self.nvic),
                _ => unknown(),
            },
        }
    }

    fn write_register(
        &mut self,
        block: Block,
        offset: u32,
        size: usize,
        value: u32,
    ) -> Result<(), Refusal> {
        let now = self.now;
        let sampling = self.gate.sampling(now);
        match block {
            Block::Spi3 | Block::Spi4 | Block::Spi5 => {
                self.write_spi(block, offset, size, value, now)
            }
            Block::Dma1 => self.dma.write(offset, value),
            Block::Dmamux1 => self.dma.write_mux(offset, value),
            Block::Usart3 => self.usart3.write(offset, value, now),
            Block::Tim1 => {
                self.tim1.write(offset, value, sampling)?;
                if self.tim1.is_fresh() && self.gate.holds() {
                    self.gate.close(now);
                }
                self.drive(pins::CONVST, now);
                self.drive(pins::LDAC, now);
                Ok(())
            }
            Block::Flash => self.flash.write(offset, value, now),
            Block::Syscfg => {
                self.syscfg.write(offset, value)?;
                self.pwr.settle(now);
                Ok(())
            }
            Block::Iwdg1 => self.iwdg.write(offset, value, now, sampling),
            Block::Gpio(port) => self.write_gpio(port, offset, value),
            Block::Rcc => {
                self.rcc.write(offset, value, now)?;
                self.clock();
                self.reset_domains();
                Ok(())
            }
            Block::Pwr => self.pwr.write(offset, value, now),
            Block::Dbgmcu => self.dbgmcu.write(offset, value),
            Block::Dwt => self.dwt.write(offset, value, sampling, self.core),
            Block::Scs => self.write_core(offset, size, value),
        }
    }

    /// A write to a register of an SPI, by the core or the DMA, at a moment.
    pub(super) fn write_spi(
        &mut self,
        block: Block,
        offset: u32,
        size: usize,
        value: u32,
        at: Ticks,
    ) -> Result<(), Refusal> {
        match block {
            Block::Spi3 => self.spi3.write(offset, size, value, at)?,
            Block::Spi4 => self.spi4.write(offset, size, value, at)?,
            Block::Spi5 => self.spi5.write(offset, size, value, at)?,
            _ => return unknown(),
        }
        self.drive(pins::CS, at);
        self.drive(pins::SYNC, at);
        Ok(())
    }

    fn write_gpio(&mut self, port: u8, offset: u32, value: u32) -> Result<(), Refusal> {
        self.gpio[usize::from(port)].write(offset, value)?;
        // ODR and BSRR change levels alone.
        if !matches!(offset, 0x14 | 0x18) {
            self.check_alternates(port)?;
        }
        self.wires();
        Ok(())
    }

    fn write_core(&mut self, offset: u32, size: usize, value: u32) -> Result<(), Refusal> {
        match offset {
            0x100..0xD00 => self.nvic.write(offset, size, value),
            0xD90..0xDBC => {
                self.mpu_changed = true;
                self.mpu.write(offset, value)
            }
            offset if offset == dwt::DEMCR.0 => {
                let sampling = self.gate.sampling(self.now);
                self.dwt.set_demcr(value, sampling, self.core)
            }
            0xD00..0xF80 => {
                self.scb.write(offset, size, value, &mut self.nvic)?;
                if self.scb.reset_requested {
                    self.reset = self.reset.or(Some(Reset::Software));
                }
                Ok(())
            }
            _ => unknown(),
        }
    }

    /// Peripherals whose reset bit is set.
    fn reset_domains(&mut self) {
        for domain in Domain::all() {
            if !self.rcc.is_reset(domain) {
                continue;
            }
            match domain {
                Domain::Gpio(port) => {
                    self.gpio[usize::from(port)] = Gpio::new(usize::from(port));
                }
                Domain::Dma1 => self.dma = Dma::default(),
                Domain::Spi3 => self.spi3.reset(),
                Domain::Spi4 => self.spi4.reset(),
                Domain::Spi5 => self.spi5.reset(),
                Domain::Syscfg => self.syscfg = Syscfg::default(),
                Domain::Tim1 => self.tim1 = Tim1::default(),
                Domain::Usart3 => self.usart3.reset(),
            }
            self.clock();
            self.wires();
        }
    }
}

/// The chip whose bus an access serves.
fn served(block: Block) -> Chip {
    match block {
        Block::Spi4 | Block::Spi5 => Chip::Adc,
        Block::Spi3 | Block::Dma1 => Chip::Dac,
        Block::Gpio(port) if port == pins::BUSY.0 => Chip::Adc,
        _ => Chip::Other,
    }
}
