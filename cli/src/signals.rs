//! Signals that end the program, for commands that have begun something on a board.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::signal;
use signal_hook::flag;

use crate::failure::Failure;

/// Ctrl-C, the request to end, and a closed terminal.
const SIGNALS: &[i32] = &[
    signal::SIGINT,
    signal::SIGTERM,
    #[cfg(unix)]
    signal::SIGHUP,
];

/// The signals since [`Signals::catch`].
pub struct Signals {
    /// Whether there was one.
    pub came: Arc<AtomicBool>,
    number: Arc<AtomicUsize>,
}

impl Signals {
    /// From now on, a signal is only noted. A second one ends the program at once.
    pub fn catch() -> Result<Self, Failure> {
        Self::registered().map_err(|error| Failure::Io {
            path: "signals".to_owned(),
            what: "caught",
            error,
        })
    }

    fn registered() -> io::Result<Self> {
        let (came, number) = (Arc::default(), Arc::default());
        for &signal in SIGNALS {
            // In this order: the first one is noted after it was looked at.
            flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&came))?;
            flag::register(signal, Arc::clone(&came))?;
            flag::register_usize(signal, Arc::clone(&number), signal as usize)?;
        }
        Ok(Self { came, number })
    }

    /// The exit code of a program that a signal has ended, as shells give it.
    pub fn exit_code(&self) -> u8 {
        128 + self.number.load(Ordering::Relaxed) as u8
    }
}
