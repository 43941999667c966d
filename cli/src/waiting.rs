//! What a command waits for, on standard error.

use std::io::{self, Write as _};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread;
use std::time::Duration;

/// Time after which a command says what it waits for.
const LONG: Duration = Duration::from_secs(1);

/// The end of a wait, when dropped.
pub struct Waiting(#[expect(dead_code, reason = "its end is what is told")] Sender<()>);

/// Prints `line` once, if the wait is long.
pub fn waiting(line: String) -> Waiting {
    let (sender, end) = mpsc::channel();
    thread::spawn(move || {
        if end.recv_timeout(LONG) == Err(RecvTimeoutError::Timeout) {
            // Without standard error there is nobody to tell.
            let _ = writeln!(io::stderr(), "{line}");
        }
    });
    Waiting(sender)
}
