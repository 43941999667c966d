//! Any bytes into the board's end of the link: no panic, and every answer fits a
//! frame.
#![no_main]

use libfuzzer_sys::fuzz_target;
use shared::link::{Cutter, Packet, Request, decode, encode};

fuzz_target!(|bytes: &[u8]| {
    let mut cutter = Cutter::new();
    for byte in bytes {
        if let Some(Ok(packet)) = cutter.push::<Request>(*byte) {
            // What is understood is written as it was read, but for NaNs.
            let frame = encode(&packet).expect("what fitted a frame fits one again");
            let mut again = frame.clone();
            let length = again.len() - 1;
            let back: Packet<Request> = decode(&mut again[..length]).expect("it is one");
            assert_eq!(encode(&back), Some(frame));
        }
    }
});
