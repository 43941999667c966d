//! The board's wires: what drives them, and what was on them over time.

use std::collections::BTreeMap;

use crate::time::Ticks;

/// What is on a wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Driven or pulled low.
    Low,
    /// Driven or pulled high.
    High,
    /// Nothing drives or pulls it.
    Floating,
}

impl Level {
    /// High or low.
    pub const fn of(high: bool) -> Self {
        if high { Self::High } else { Self::Low }
    }

    /// High; a floating wire counts as `floating`.
    pub fn is_high(self, floating: bool) -> bool {
        match self {
            Self::Low => false,
            Self::High => true,
            Self::Floating => floating,
        }
    }
}

/// A pin of the processor: port (0 is A) and number.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pin(pub u8, pub u8);

impl std::fmt::Debug for Pin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "P{}{}", char::from(b'A' + self.0), self.1)
    }
}

/// Outputs with a leg, and inputs with a sensor.
pub const LEGS: usize = 6;

/// The AD7606's inputs with a sensor, in the table's order: V1 is 0.
pub const INPUTS: [usize; LEGS] = [0, 1, 2, 4, 5, 6];

/// The pins with wires on the board (`docs/board.md`, Wiring).
pub mod pins {
    use super::Pin;

    /// AD7606 CONVST A and B; TIM1 channel 1.
    pub const CONVST: Pin = Pin(4, 9);
    /// AD7606 BUSY.
    pub const BUSY: Pin = Pin(6, 12);
    /// AD7606 RESET.
    pub const ADC_RESET: Pin = Pin(4, 14);
    /// AD7606 CS; SPI4 NSS.
    pub const CS: Pin = Pin(4, 4);
    /// AD7606 SCLK; SPI4 SCK.
    pub const ADC_SCLK: Pin = Pin(4, 2);
    /// AD7606 DOUTA; SPI4 MISO.
    pub const DOUTA: Pin = Pin(4, 5);
    /// AD7606 SCLK too; SPI5 SCK.
    pub const DOUTB_SCLK: Pin = Pin(5, 7);
    /// AD7606 DOUTB; SPI5 MOSI.
    pub const DOUTB: Pin = Pin(5, 9);
    /// AD5676R LDAC; TIM1 channel 3.
    pub const LDAC: Pin = Pin(4, 13);
    /// AD5676R SYNC; SPI3 NSS.
    pub const SYNC: Pin = Pin(0, 4);
    /// AD5676R SCLK; SPI3 SCK.
    pub const DAC_SCLK: Pin = Pin(2, 10);
    /// AD5676R SDI; SPI3 MOSI.
    pub const SDI: Pin = Pin(2, 12);
    /// AD5676R SDO; SPI3 MISO.
    pub const SDO: Pin = Pin(2, 11);
    /// AD5676R RESET, with a resistor to ground.
    pub const DAC_RESET: Pin = Pin(6, 14);
    /// The link from the board; USART3 TX.
    pub const LINK_TX: Pin = Pin(3, 8);
    /// The link to the board; USART3 RX.
    pub const LINK_RX: Pin = Pin(3, 9);
}

/// What something was over time: each change with its moment.
#[derive(Clone, Debug)]
pub struct History<T>(Vec<(Ticks, T)>);

impl<T> Default for History<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Copy + PartialEq> History<T> {
    /// Notes `value` if it is another than before.
    pub fn note(&mut self, at: Ticks, value: T) {
        if self.0.last().is_none_or(|(_, last)| *last != value) {
            self.0.push((at, value));
        }
    }

    /// All changes, the oldest first.
    pub fn changes(&self) -> &[(Ticks, T)] {
        &self.0
    }

    /// The value at a moment, or None before the first.
    pub fn at(&self, moment: Ticks) -> Option<T> {
        let after = self.0.partition_point(|(at, _)| *at <= moment);
        after.checked_sub(1).map(|i| self.0[i].1)
    }

    /// Forgets all but the last value.
    pub fn forget(&mut self) {
        let keep = self.0.len().saturating_sub(1);
        self.0.drain(..keep);
    }
}

/// Histories of the pins that somebody wants to see.
#[derive(Default)]
pub struct Recorder(BTreeMap<Pin, History<Level>>);

impl Recorder {
    /// Records a pin from now on.
    pub fn watch(&mut self, pin: Pin, at: Ticks, level: Level) {
        self.0.entry(pin).or_default().note(at, level);
    }

    /// The recorded pins.
    pub fn pins(&self) -> impl Iterator<Item = Pin> {
        self.0.keys().copied()
    }

    /// Whether a pin is recorded.
    pub fn watches(&self, pin: Pin) -> bool {
        self.0.contains_key(&pin)
    }

    /// Notes the level of a pin, if it is recorded.
    pub fn note(&mut self, pin: Pin, at: Ticks, level: Level) {
        if let Some(history) = self.0.get_mut(&pin) {
            history.note(at, level);
        }
    }

    /// The history of a pin, if it is recorded.
    pub fn history(&self, pin: Pin) -> Option<&History<Level>> {
        self.0.get(&pin)
    }
}
