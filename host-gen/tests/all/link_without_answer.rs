//! A line on which no board answers: the client gives up after its five seconds, whatever else
//! arrives. A test that hangs has failed.

use std::io::{Read as _, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::thread;
use std::time::Duration;

use host_gen::board::link::{Address, Client, LinkError};
use shared::LEGS;
use shared::codes::{DacCode, Samples};
use shared::controller::Telemetry;
use shared::link::{Packet, Reply, VERSION, encode};
use shared::recorder::Record;
use shared::step::Status;
use shared::supervisor::Mode;

/// The error of a connection to a host that writes what `next` gives, without end.
fn error_of(mut next: impl FnMut() -> Vec<u8> + Send + 'static) -> LinkError {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap().to_string();
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        while stream.write_all(&next()).is_ok() {}
    });
    connect(&at)
}

fn connect(at: &str) -> LinkError {
    let at: Address = at.parse().unwrap();
    match Client::connect(&at) {
        Ok(_) => panic!("no board is there"),
        Err(error) => error,
    }
}

fn is_noise(error: &LinkError) -> bool {
    matches!(error, LinkError::Noise { bytes, .. } if *bytes > 0)
}

/// As of a line stuck low: frames without content.
#[test]
fn zeros() {
    let error = error_of(|| vec![0; 4096]);
    assert!(is_noise(&error), "{error}");
    // One at a time, each in time before the next read gives up.
    let error = error_of(|| {
        thread::sleep(Duration::from_millis(5));
        vec![0]
    });
    assert!(is_noise(&error), "{error}");
}

#[test]
fn noise() {
    let mut state = 1_u64;
    let error = error_of(move || {
        let mut byte = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 56) as u8
        };
        (0..92).map(|_| byte()).collect()
    });
    assert!(is_noise(&error), "{error}");
}

/// Never a zero, so never the end of a frame.
#[test]
fn a_frame_without_end() {
    let error = error_of(|| vec![0x55; 1024]);
    assert!(is_noise(&error), "{error}");
}

/// Valid packets, but none is the reply.
#[test]
fn telemetry_of_another_session() {
    let telemetry = Packet {
        version: VERSION,
        session: 7,
        sequence: 0,
        body: Reply::Telemetry(Telemetry {
            at: 1,
            mode: Mode::Idle,
            gain: 0.0,
            record: Record {
                adc: Samples::NONE,
                dac: [DacCode(0); LEGS],
            },
            status: Status::NOTHING,
        }),
    };
    let frame = encode(&telemetry).unwrap().to_vec();
    let error = error_of(move || frame.clone());
    assert!(is_noise(&error), "{error}");
}

/// A program that takes the connection and says nothing.
#[test]
fn silence() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let error = connect(&listener.local_addr().unwrap().to_string());
    assert!(matches!(error, LinkError::Silent(_)), "{error}");
}

/// A line that ends is told as such, not as silence.
#[test]
fn the_end_of_the_line() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap().to_string();
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let _ = stream.read(&mut [0; 64]);
    });
    let error = connect(&at);
    assert!(matches!(error, LinkError::Line { .. }), "{error}");
}

/// A host that does not take the connection: the queue of its listener is full, so that
/// nothing answers the first packet of TCP.
#[test]
#[cfg(target_os = "linux")]
fn a_host_that_does_not_answer() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap();
    let dial = |at: &SocketAddr| TcpStream::connect_timeout(at, Duration::from_millis(200));
    let queue: Vec<_> = (0..10_000).map_while(|_| dial(&at).ok()).collect();
    assert!(queue.len() < 10_000, "the queue is never full");
    let error = connect(&at.to_string());
    assert!(matches!(error, LinkError::Silent(_)), "{error}");
}

/// The same on a serial line: zeros, and nothing at all.
#[test]
#[cfg(unix)]
fn a_serial_line() {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    use serialport::{SerialPort as _, TTYPort};

    for zeros in [true, false] {
        let (mut far, near) = TTYPort::pair().unwrap();
        let at = near.name().unwrap();
        drop(near);
        let done = Arc::new(AtomicBool::new(false));
        let over = done.clone();
        let flood = thread::spawn(move || {
            while !over.load(Ordering::Relaxed) {
                if zeros {
                    // What nobody reads is lost.
                    let _ = far.write(&[0; 92]);
                }
                thread::yield_now();
            }
        });
        let error = connect(&at);
        done.store(true, Ordering::Relaxed);
        flood.join().unwrap();
        match zeros {
            true => assert!(is_noise(&error), "{error}"),
            false => assert!(matches!(error, LinkError::Silent(_)), "{error}"),
        }
    }
}
