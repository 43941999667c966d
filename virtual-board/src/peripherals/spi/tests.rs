//! Transfers by hand.

use super::*;

fn ready(mbr: u32) -> Result<Spi, Refusal> {
    let mut spi = Spi::new(FULL);
    spi.kernel = Some(112_000_000);
    spi.write(0x00, 4, 1 << 12, 0)?;
    spi.write(0x08, 4, 7 | mbr << 28, 0)?;
    spi.write(0x0C, 4, 1 << 22 | 1 << 25 | 1 << 26 | 1 << 31, 0)?;
    Ok(spi)
}

/// Three bytes at 28 MHz: 24 bits of 35.71 ns; the first byte first.
#[test]
fn a_transfer_takes_its_bits() -> Result<(), Refusal> {
    let mut spi = ready(1)?;
    spi.write(0x04, 4, 3, 0)?;
    spi.write(0x00, 4, 1 | 1 << 12, 0)?;
    for byte in [0x12, 0x34, 0x56] {
        spi.write(0x20, 1, byte, 0)?;
    }
    assert_eq!(spi.next(), None);
    spi.write(0x00, 4, 1 | 1 << 9 | 1 << 12, 1000)?;
    let mut sent = Vec::new();
    let mut ended = 0;
    while let Some(at) = spi.next() {
        assert_eq!(spi.read(0x14, 4)? & EOT, 0);
        let frame = spi.due(at).ok_or("due")?;
        sent.push(frame.data);
        spi.finish(frame.data ^ 0xFF);
        ended = at;
    }
    assert_eq!(sent, [0x12, 0x34, 0x56]);
    assert_eq!(ended - 1000, 24 * cycles(4, 112_000_000));
    assert_eq!(spi.read(0x14, 4)? & (EOT | TXTF | OVR), EOT | TXTF);
    let read: Result<Vec<_>, _> = (0..3).map(|_| spi.read(0x30, 1)).collect();
    assert_eq!(read?, [0xED, 0xCB, 0xA9]);
    spi.write(0x18, 4, EOT | TXTF, 0)?;
    assert_eq!(spi.read(0x14, 4)? & EOT, 0);
    assert!(spi.read(0x30, 1).is_err());
    Ok(())
}

/// A frame of 32 bits: the last byte written goes first (50.4.11).
#[test]
fn words_go_out_from_the_highest_bit() -> Result<(), Refusal> {
    let mut spi = ready(0)?;
    spi.write(0x08, 4, 31, 0)?;
    spi.write(0x04, 4, 1, 0)?;
    spi.write(0x00, 4, 1 | 1 << 12, 0)?;
    spi.write(0x20, 4, 0x1234_5678, 0)?;
    spi.write(0x00, 4, 1 | 1 << 9 | 1 << 12, 0)?;
    let frame = spi.due(Ticks::MAX).ok_or("due")?;
    assert_eq!((frame.bits, frame.data), (32, 0x1234_5678));
    spi.finish(0xCAFE_F00D);
    assert_eq!(spi.read(0x30, 4)?, 0xCAFE_F00D);
    Ok(())
}

/// Without end, in one direction: a word goes out when it is written, and TXC (50.11.6)
/// tells its end.
#[test]
fn words_are_sent_as_they_come() -> Result<(), Refusal> {
    let mut spi = ready(1)?;
    spi.write(0x08, 4, 23 | 1 << 28, 0)?;
    spi.write(0x0C, 4, 1 << 17 | 1 << 22 | 1 << 25 | 1 << 26 | 1 << 31, 0)?;
    spi.write(0x00, 4, 1 | 1 << 12, 0)?;
    spi.write(0x00, 4, 1 | 1 << 9 | 1 << 12, 0)?;
    for word in [0x12_3456, 0xAB_CDEF] {
        assert_ne!(spi.read(0x14, 4)? & 1 << 12, 0);
        spi.write(0x20, 4, word, 1000)?;
        assert_eq!(spi.read(0x14, 4)? & 1 << 12, 0);
        let ends = spi.next().ok_or("begun")?;
        assert_eq!(ends - 1000, 24 * cycles(4, 112_000_000));
        assert_eq!(spi.due(ends).ok_or("due")?.data, word);
        spi.finish(0xFF_FFFF);
    }
    assert_eq!(spi.read(0x14, 4)? & (EOT | OVR | 1), 0);
    Ok(())
}

/// A receiver's clock runs by itself for TSIZE frames.
#[test]
fn a_receiver_needs_no_data_to_send() -> Result<(), Refusal> {
    let mut spi = ready(2)?;
    spi.write(0x08, 4, 31 | 2 << 28, 0)?;
    spi.write(0x0C, 4, 2 << 17 | 1 << 22 | 1 << 25 | 1 << 26 | 1 << 31, 0)?;
    spi.write(0x04, 4, 3, 0)?;
    spi.write(0x00, 4, 1 | 1 << 12, 0)?;
    assert_eq!(spi.next(), None);
    spi.write(0x00, 4, 1 | 1 << 9 | 1 << 12, 0)?;
    for word in 1..=3 {
        assert!(spi.next().is_some());
        spi.finish(word);
    }
    assert_eq!(spi.next(), None);
    assert_ne!(spi.read(0x14, 4)? & EOT, 0);
    for word in 1..=3 {
        assert_eq!(spi.read(0x30, 4)?, word);
    }
    Ok(())
}

#[test]
fn a_kernel_without_a_clock_never_ends() -> Result<(), Refusal> {
    let mut spi = ready(1)?;
    spi.kernel = None;
    spi.write(0x04, 4, 1, 0)?;
    spi.write(0x00, 4, 1 | 1 << 12, 0)?;
    spi.write(0x20, 1, 0, 0)?;
    spi.write(0x00, 4, 1 | 1 << 9 | 1 << 12, 0)?;
    assert_eq!(spi.next(), None);
    assert!(spi.write(0x08, 4, 7, 0).is_err());
    Ok(())
}

/// What a select line does: the moments of its edges, first low, in bits after `from`.
fn edges(spi: &mut Spi, from: Ticks, bit: Ticks) -> Vec<(u64, bool)> {
    let mut edges = Vec::new();
    let mut last = None;
    let mut at = from;
    loop {
        let level = spi.select();
        if level != last {
            edges.push(((at - from) / bit, level == Some(true)));
            last = level;
        }
        let Some(next) = spi.next() else {
            return edges;
        };
        at = next;
        if spi.due(at).is_some() {
            spi.finish(0);
        }
    }
}

/// 50.4.7: the select line leads by MSSI; with SSOM and MIDI it is high between frames, and low
/// through the transfer without. By hand, in bits: 1 + 24, 3, 1 + 24.
#[test]
fn a_select_line_pulses() -> Result<(), Refusal> {
    for (ssom, expected) in [
        (SSOM, &[(0, true), (25, false), (28, true), (53, false)][..]),
        (0, &[(0, true), (52, false)]),
    ] {
        let mut spi = ready(0)?;
        spi.write(0x00, 4, 0, 0)?;
        spi.write(0x08, 4, 23, 0)?;
        let cfg2 = 1 | 3 << 4 | 1 << 17 | MASTER | 1 << 25 | SSOE | ssom | AFCNTR;
        spi.write(0x0C, 4, cfg2, 0)?;
        spi.write(0x04, 4, 2, 0)?;
        spi.write(0x00, 4, SPE, 0)?;
        spi.write(0x20, 4, 1, 0)?;
        spi.write(0x20, 4, 2, 0)?;
        // No third: TXTF (50.11.6).
        assert_eq!(spi.read(0x14, 4)? & 2, 0);
        assert!(spi.write(0x20, 4, 3, 0).is_err());
        spi.write(0x00, 4, SPE | CSTART, 500)?;
        let bit = spi.bit();
        assert_eq!(edges(&mut spi, 500, bit), expected);
        assert_ne!(spi.read(0x14, 4)? & EOT, 0);
    }
    Ok(())
}

/// CSTART counts only while SPE is set already.
#[test]
fn cstart_needs_spe() -> Result<(), Refusal> {
    let mut spi = ready(2)?;
    spi.write(0x0C, 4, 2 << 17 | MASTER | 1 << 25 | SSM | AFCNTR, 0)?;
    spi.write(0x04, 4, 3, 0)?;
    spi.write(0x00, 4, SPE | CSTART | SSI, 0)?;
    assert_eq!(spi.next(), None);
    spi.write(0x00, 4, SPE | CSTART | SSI, 0)?;
    assert!(spi.next().is_some());
    Ok(())
}

/// A slave shifts with another's clock, in frames of its own, and counts them.
#[test]
fn a_slave_receives() -> Result<(), Refusal> {
    let mut spi = Spi::new(LIMITED);
    spi.kernel = Some(57_000_000);
    // 24 bits are more than the instance has.
    assert!(spi.write(0x08, 4, 23, 0).is_err());
    spi.write(0x08, 4, 15, 0)?;
    spi.write(0x0C, 4, 2 << 17 | 1 << 25 | SSM | AFCNTR, 0)?;
    spi.write(0x04, 4, 2, 0)?;
    spi.write(0x00, 4, SPE, 0)?;
    let bits = |word: u32| (0..16).rev().map(move |bit| word >> bit & 1 != 0);
    for bit in bits(0x1234).chain(bits(0xABCD)) {
        assert_eq!(spi.read(0x14, 4)? & EOT, 0);
        spi.clock((true, false), bit)?;
    }
    assert_ne!(spi.read(0x14, 4)? & EOT, 0);
    assert!(spi.read(0x30, 4).is_err());
    assert_eq!((spi.read(0x30, 2)?, spi.read(0x30, 2)?), (0x1234, 0xABCD));
    assert!(spi.clock((false, false), true).is_err());
    // Another edge, and SPE off and on again: a frame begins anew.
    spi.clock((true, false), true)?;
    spi.write(0x00, 4, 0, 0)?;
    spi.write(0x18, 4, EOT | TXTF, 0)?;
    spi.write(0x00, 4, SPE, 0)?;
    for bit in bits(0x5678) {
        spi.clock((true, false), bit)?;
    }
    assert_eq!(spi.read(0x30, 2)?, 0x5678);
    Ok(())
}
