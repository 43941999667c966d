//! The link's line: bursts, noise, zeros, and nobody who reads the log.

use shared::link::{Reply, Request};
use shared::supervisor::Mode;
use virtual_board::time::{MILLISECOND, SECOND};

use crate::lab::{Lab, Outcome, long};

/// Requests sent back to back are all answered, and the loop does not notice.
#[test]
fn sixty_requests_in_a_burst() -> Outcome {
    for request in [Request::Report, Request::Recording(0), Request::Health] {
        let mut lab = Lab::pushing()?;
        let before = lab.report()?;
        let mut burst = Vec::new();
        for _ in 0..60 {
            burst.extend(lab.frame(request.clone())?);
        }
        lab.board.send(&burst);
        let replies = lab.replies(60)?;
        assert!(
            lab.board.resets.is_empty(),
            "{request:?}: {:?}",
            lab.board.resets
        );
        assert!(
            replies
                .iter()
                .all(|reply| !matches!(reply, Reply::Refused(_))),
            "{request:?}"
        );
        let after = lab.report()?;
        assert_eq!(
            (after.mode, after.late),
            (Mode::Testing, before.late),
            "{request:?}"
        );
    }
    Ok(())
}

/// Bytes at the line's full rate for a minute, or for a second without time.
fn flood(mut byte: impl FnMut() -> u8) -> Outcome {
    let mut lab = Lab::pushing()?;
    let slices = if long() { 6_000 } else { 100 };
    for _ in 0..slices {
        // Ten milliseconds.
        let bytes: Vec<u8> = (0..922).map(|_| byte()).collect();
        lab.board.send(&bytes);
        lab.board.run(SECOND / 100)?;
        lab.board.received();
        if !lab.board.resets.is_empty() {
            return Err(format!("reset: {:?}", lab.board.resets).into());
        }
    }
    lab.board.run(100 * MILLISECOND)?;
    lab.board.send(&[0]);
    lab.board.run(10 * MILLISECOND)?;
    lab.board.received();
    lab.hello()?;
    assert!(lab.report()?.at > 20_000);
    Ok(())
}

#[test]
fn noise_on_the_line() -> Outcome {
    let mut state = 1u32;
    flood(|| {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state >> 8) as u8
    })
}

#[test]
fn zeros_on_the_line() -> Outcome {
    flood(|| 0)
}

/// Many short frames that are malformed: each would be answered.
#[test]
fn malformed_frames_on_the_line() -> Outcome {
    let mut i = 0;
    flood(|| {
        i += 1;
        if i % 4 == 0 { 0 } else { 0x55 }
    })
}

/// Nobody reads the log: its buffer is full long since, and nothing waits for it.
#[test]
fn nobody_reads_the_log() -> Outcome {
    let mut lab = Lab::new()?;
    for _ in 0..if long() { 300 } else { 3 } {
        // A fault and its clearing are a message each.
        lab.board.bus_mut().adc.defect = Some(virtual_board::chips::ad7606::Defect::BusyHigh);
        lab.board.run(250 * MILLISECOND)?;
        lab.board.bus_mut().adc.defect = None;
        lab.done(Request::Clear)?;
        lab.board.run(250 * MILLISECOND)?;
    }
    assert!(lab.board.resets.is_empty(), "{:?}", lab.board.resets);
    Ok(())
}
