//! The monitors: faults of sensors, outputs and the board, found in every sample.

mod jumps;
mod windows;

use crate::LEGS;
use crate::codes::{DacCode, Samples};
use crate::step::Status;
use crate::supervisor::{Cause, Mode};
use crate::table::{Table, ValidTable};

use jumps::Jumps;
use windows::Windows;

/// Number of sensors of both kinds.
const SENSORS: usize = 2 * LEGS;

/// A mask with bit i set where `is(i)`, of the sensors that the table uses. None if no bit
/// is set.
fn mask(table: &Table, is: impl Fn(usize) -> bool) -> Option<u16> {
    let count = if table.complement().is_some() {
        SENSORS
    } else {
        LEGS
    };
    let mut bits = 0;
    for i in 0..count {
        if is(i) {
            bits |= 1 << i;
        }
    }
    (bits != 0).then_some(bits)
}

/// The state of the monitors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Monitors {
    jumps: Jumps,
    windows: Windows,
    /// Consecutive samples at a rail.
    rail: [u32; SENSORS],
    /// Whether any of `rail` is not zero.
    railed: bool,
    /// Consecutive samples that could not be read.
    lost: u32,
    /// Four times the clamped samples, less one for each sample that was not.
    saturated: u32,
    /// Samples since the last valid frame, while the legs are driven.
    silence: u32,
}

/// One sample as the monitors see it.
#[derive(Clone, Copy, Debug)]
pub struct Sight<'a> {
    /// The codes that were read.
    pub samples: &'a Samples,
    /// The codes put out in answer.
    pub dac: &'a [DacCode; LEGS],
    /// What the step observed.
    pub status: Status,
    /// Whether the previous deadline was missed.
    pub late: bool,
    /// Whether a signal is injected: forces that jump, as injected and clamped ones may, cause
    /// jumps in the sensors that are no spikes.
    pub injecting: bool,
}

impl Monitors {
    /// Before the first sample.
    pub const NEW: Self = Self {
        jumps: Jumps::NEW,
        windows: Windows::NEW,
        rail: [0; SENSORS],
        railed: false,
        lost: 0,
        saturated: 0,
        silence: 0,
    };

    /// To be called when a valid frame arrived on the link.
    pub fn heard(&mut self) {
        self.silence = 0;
    }

    /// Samples since the last valid frame on the link; 0 while nothing drives the legs.
    pub fn silence(&self) -> u32 {
        self.silence
    }

    /// To be called instead of [`Monitors::see`] when a sample could not be read.
    pub fn lost(&mut self, table: &ValidTable) -> Option<Cause> {
        self.lost = self.lost.saturating_add(1);
        (self.lost >= table.get().supervision.lost).then_some(Cause::Lost)
    }

    /// Checks one sample, and returns the first fault found.
    #[inline]
    pub fn see(&mut self, table: &ValidTable, mode: Mode, sight: &Sight<'_>) -> Option<Cause> {
        let Sight {
            status, injecting, ..
        } = *sight;
        let table = table.get();
        let limits = &table.supervision;
        self.lost = 0;
        self.count_rails(status);
        let stuck = self.jumps.see(table, sight);
        if mode.is_loop() && status.clamped {
            // Four up and one down, so that a limit cycle that is clamped in only some of
            // its samples counts too.
            self.saturated = self.saturated.saturating_add(4);
        } else {
            self.saturated = self.saturated.saturating_sub(1);
        }
        let driven = mode.is_loop() || mode == Mode::Testing;
        self.silence = if driven || injecting {
            self.silence.saturating_add(1)
        } else {
            0
        };
        let by_window = self.windows.see(table, mode, sight);

        if status.not_finite {
            return Some(Cause::NotFinite);
        }
        if self.railed
            && let Some(bits) = mask(table, |i| self.rail[i] >= limits.rail)
        {
            return Some(Cause::Rail(bits));
        }
        if stuck && let Some(bits) = self.jumps.stuck(table) {
            return Some(Cause::Stuck(bits));
        }
        if let Some(bits) = self.jumps.spiky(table) {
            return Some(Cause::Erratic(bits));
        }
        if self.saturated / 4 >= limits.saturated {
            return Some(Cause::Saturated);
        }
        // An injection alone ends without a fault: see `Controller`.
        if driven && limits.silence > 0 && self.silence >= limits.silence {
            return Some(Cause::Silent);
        }
        by_window
    }

    /// Counts the samples at a rail. Nothing to do as long as there are none.
    #[inline]
    fn count_rails(&mut self, status: Status) {
        if !status.at_rail() && !self.railed {
            return;
        }
        let bits = u16::from(status.sensors_at_rail) | u16::from(status.forces_at_rail) << LEGS;
        self.railed = bits != 0;
        for (i, rail) in self.rail.iter_mut().enumerate() {
            *rail = if bits >> i & 1 != 0 {
                rail.saturating_add(1)
            } else {
                0
            };
        }
    }
}
