//! The gate: in the loop with a simulated plant, the board's sampling time stands still
//! until the plant has answered.
//!
//! While the gate is closed, TIM1 is held at the end of the LDAC pulse (or at its first count,
//! if it has just been started, or at the end of a period without that pulse), and with it
//! what measures samples against time: the cycle counter and the watchdog's count. So a
//! debugger's freeze bits would hold them. The core, the link's port and the flash go on. This
//! is the only way in which that mode differs from free running.

use crate::time::Ticks;

/// The gate. By default there is none, and sampling runs freely.
#[derive(Default)]
pub struct Gate {
    used: bool,
    /// A sample may begin.
    open: bool,
    /// Since when it has been closed.
    since: Option<Ticks>,
    /// How long it has been closed in all.
    held: Ticks,
}

impl Gate {
    /// From now on every sample waits for [`Gate::open`].
    pub fn install(&mut self) {
        self.used = true;
    }

    /// Whether sampling is held now.
    pub fn is_closed(&self) -> bool {
        self.since.is_some()
    }

    /// Whether the next sample has to wait.
    pub fn holds(&self) -> bool {
        self.used && !self.open
    }

    /// Sampling stops at a moment.
    pub fn close(&mut self, now: Ticks) {
        if self.since.is_none() {
            self.since = Some(now);
        }
    }

    /// Sampling goes on. `begins`: the sample has begun already, with the timer; otherwise
    /// the next one may.
    pub fn open(&mut self, now: Ticks, begins: bool) {
        if let Some(since) = self.since.take() {
            self.held += now - since;
        }
        self.open = !begins;
    }

    /// A sample begins.
    pub fn pass(&mut self) {
        self.open = false;
    }

    /// A reset of the board: nothing is held until the timer runs again.
    pub fn reset(&mut self, now: Ticks) {
        self.open(now, true);
    }

    /// Sampling time at a moment.
    pub fn sampling(&self, now: Ticks) -> Ticks {
        self.since.unwrap_or(now) - self.held
    }

    /// The moment of a sampling time, None while it stands still.
    pub fn moment(&self, sampling: Ticks) -> Option<Ticks> {
        self.since.is_none().then_some(sampling + self.held)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampling_time_stands_still() {
        let mut gate = Gate::default();
        assert!(!gate.holds());
        gate.install();
        assert!(gate.holds());
        gate.close(100);
        assert_eq!(gate.sampling(500), 100);
        assert_eq!(gate.moment(120), None);
        gate.open(500, false);
        assert!(!gate.holds());
        assert_eq!(gate.sampling(510), 110);
        assert_eq!(gate.moment(120), Some(520));
        gate.pass();
        assert!(gate.holds());
    }
}
