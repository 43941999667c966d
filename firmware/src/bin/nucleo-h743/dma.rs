//! The two streams of DMA1 that move a sample without the processor (RM0433, chapters 16 and
//! 18): one begins the ADC's frame when TIM1 says so, the other feeds the DAC's bus.
//!
//! The DMA cannot reach DTCM, so what it reads is in AXI SRAM. Without a data cache nothing has
//! to be written back.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::pac::dma::{regs, vals};
use embassy_stm32::pac::{DMA1, DMAMUX1};
use shared::LEGS;

/// Stream that begins the ADC's frame.
const BEGIN: usize = 0;

/// Stream that feeds the DAC's bus.
const FEED: usize = 1;

/// DMAMUX1's number of TIM1's first channel.
const TIM1_CH1: u8 = 11;

/// DMAMUX1's number of SPI3's transmitter.
const SPI3_TX: u8 = 62;

/// What begins the ADC's frame.
#[unsafe(link_section = ".axi.dma")]
static COMMAND: AtomicU32 = AtomicU32::new(0);

/// The frames of the DAC.
#[unsafe(link_section = ".axi.dma")]
static FRAMES: [AtomicU32; LEGS] = [const { AtomicU32::new(0) }; LEGS];

/// From memory to a register, a word at a time, each read just before it is wanted.
fn outwards() -> regs::Cr {
    let mut w = regs::Cr::default();
    w.set_dir(vals::Dir::MEMORY_TO_PERIPHERAL);
    w.set_psize(vals::Size::BITS32);
    w.set_msize(vals::Size::BITS32);
    w.set_pl(vals::Pl::VERY_HIGH);
    w
}

/// At every compare event of TIM1's first channel, `command` is written to `register`. To be
/// called once.
pub fn begin_with(command: u32, register: *mut u32) {
    COMMAND.store(command, Ordering::Relaxed);
    cortex_m::asm::dmb();
    DMAMUX1.ccr(BEGIN).write(|w| w.set_dmareq_id(TIM1_CH1));
    let stream = DMA1.st(BEGIN);
    stream.par().write_value(register as u32);
    stream.m0ar().write_value((&raw const COMMAND) as u32);
    stream.ndtr().write(|w| w.set_ndt(1));
    let mut w = outwards();
    w.set_circ(true);
    w.set_en(true);
    stream.cr().write_value(w);
}

/// Frames go to `register`, the DAC's bus, from now on. To be called once.
pub fn feed_to(register: *mut u32) {
    DMAMUX1.ccr(FEED).write(|w| w.set_dmareq_id(SPI3_TX));
    let stream = DMA1.st(FEED);
    stream.par().write_value(register as u32);
    stream.m0ar().write_value((&raw const FRAMES) as u32);
    rearm();
}

/// Makes the stream ready for the next frames. The last must have been taken.
pub fn rearm() {
    DMA1.ifcr(FEED / 4).write(|w| {
        w.set_feif(FEED % 4, true);
        w.set_dmeif(FEED % 4, true);
        w.set_teif(FEED % 4, true);
        w.set_htif(FEED % 4, true);
        w.set_tcif(FEED % 4, true);
    });
    DMA1.st(FEED).ndtr().write(|w| w.set_ndt(LEGS as u16));
}

/// Gives up frames that were not taken.
pub fn abort() {
    let stream = DMA1.st(FEED);
    stream.cr().write_value(outwards());
    // A word that is under way ends first.
    for _ in 0..100 {
        if !stream.cr().read().en() {
            break;
        }
    }
}

/// Offers `frames` to the DAC's bus.
pub fn feed(frames: [u32; LEGS]) {
    for (place, frame) in FRAMES.iter().zip(frames) {
        place.store(frame, Ordering::Relaxed);
    }
    // The stream reads the first as soon as it is enabled.
    cortex_m::asm::dmb();
    let mut w = outwards();
    w.set_minc(true);
    w.set_en(true);
    DMA1.st(FEED).cr().write_value(w);
}
