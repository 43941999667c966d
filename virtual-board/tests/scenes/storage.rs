//! The table in flash.

use shared::link::{Reply, Request};
use shared::table::{TABLE_ROOM, Table, ValidTable};
use virtual_board::chips::ad5676r::MIDDLE;
use virtual_board::peripherals::flash::{SECTOR, Turned, WORD};
use virtual_board::peripherals::rcc::Reset;
use virtual_board::time::{MICROSECOND, MILLISECOND, SECOND};

use crate::lab::{Lab, Outcome, long};

/// The image's table, changed in how long it settles.
fn table(settle: u32) -> Outcome<ValidTable> {
    let mut table: Table = *firmware::tables::NUCLEO_H743.table.get();
    table.supervision.settle = settle;
    table.validate().map_err(|why| format!("{why:?}").into())
}

/// Sends a table in pieces.
fn pieces(lab: &mut Lab, table: &ValidTable) -> Outcome<u32> {
    let mut room = [0; TABLE_ROOM];
    let bytes = table.encode(&mut room).ok_or("too long")?;
    for (at, piece) in (0..).step_by(256).zip(bytes.chunks(256)) {
        lab.done(Request::Piece(at, piece.iter().copied().collect()))?;
    }
    Ok(bytes.len() as u32)
}

/// Sends a table, and has it kept.
pub fn keep(lab: &mut Lab, table: &ValidTable) -> Outcome {
    let length = pieces(lab, table)?;
    lab.done(Request::Keep(length, table.checksum()))
}

/// Whether a table that was sent runs, and its checksum.
fn runs(lab: &mut Lab) -> Outcome<(bool, u32)> {
    match lab.ask(Request::Identity)? {
        Reply::Identity(identity) => Ok((identity.sent, identity.checksum)),
        reply => Err(format!("{reply:?} in place of an identity").into()),
    }
}

fn power_cycle(lab: &mut Lab) -> Outcome {
    lab.board.reset(Reset::Power);
    lab.board.run(30 * MILLISECOND)?;
    lab.hello()
}

/// Words of the two sectors that hold something.
fn written(lab: &Lab) -> Vec<usize> {
    let flash = &lab.board.bus().flash;
    let first = 6 * SECTOR / WORD;
    let words = flash.memory[6 * SECTOR..].chunks(WORD).enumerate();
    words
        .filter(|(_, bytes)| bytes.iter().any(|byte| *byte != 0xFF))
        .map(|(i, _)| first + i)
        .collect()
}

#[test]
fn a_table_survives_power() -> Outcome {
    let mut lab = Lab::new()?;
    let kept = table(12_345)?;
    keep(&mut lab, &kept)?;
    assert_eq!(runs(&mut lab)?, (true, kept.checksum()));
    power_cycle(&mut lab)?;
    assert_eq!(runs(&mut lab)?, (true, kept.checksum()));
    lab.done(Request::Forget)?;
    power_cycle(&mut lab)?;
    assert!(!runs(&mut lab)?.0);
    Ok(())
}

/// One turned bit is corrected: the table runs, and another can be kept.
#[test]
fn one_turned_bit_changes_nothing() -> Outcome {
    let mut lab = Lab::new()?;
    let kept = table(12_345)?;
    keep(&mut lab, &kept)?;
    let word = written(&lab)[10];
    lab.board.bus_mut().flash.turned.insert(word, Turned::One);
    power_cycle(&mut lab)?;
    assert_eq!(runs(&mut lab)?, (true, kept.checksum()));
    let next = table(23_456)?;
    keep(&mut lab, &next)?;
    assert_eq!(runs(&mut lab)?, (true, next.checksum()));
    Ok(())
}

/// Two turned bits: the table is lost, the compiled-in one runs, and another can be kept.
#[test]
fn two_turned_bits_lose_the_table_only() -> Outcome {
    let mut lab = Lab::new()?;
    keep(&mut lab, &table(12_345)?)?;
    let word = written(&lab)[10];
    lab.board.bus_mut().flash.turned.insert(word, Turned::Two);
    power_cycle(&mut lab)?;
    assert!(lab.board.resets.len() == 1, "{:?}", lab.board.resets);
    let compiled = firmware::tables::NUCLEO_H743.checksum;
    assert_eq!(runs(&mut lab)?, (false, compiled));
    let next = table(23_456)?;
    keep(&mut lab, &next)?;
    power_cycle(&mut lab)?;
    assert_eq!(runs(&mut lab)?, (true, next.checksum()));
    Ok(())
}

/// The flash after so many keeps of the same table.
fn filled(keeps: u32) -> Outcome<Vec<u8>> {
    let mut lab = Lab::new()?;
    for _ in 0..keeps {
        keep(&mut lab, &table(11_111)?)?;
    }
    Ok(lab.board.bus().flash.memory.clone())
}

/// Cuts power in the middle of the `operation`-th write or erase of a keep into this flash.
/// False if the keep had fewer.
fn cut(flash: &[u8], operation: u64) -> Outcome<bool> {
    let mut lab = Lab::off()?;
    lab.board.bus_mut().flash.memory.copy_from_slice(flash);
    lab.board.run(30 * MILLISECOND)?;
    let old = table(11_111)?;
    assert_eq!(runs(&mut lab)?, (true, old.checksum()));
    let new = table(22_222)?;
    let length = pieces(&mut lab, &new)?;
    let before = lab.board.bus().flash.operations;
    let frame = lab.frame(Request::Keep(length, new.checksum()))?;
    lab.board.send(&frame);
    let end = lab.board.now() + 10 * SECOND;
    loop {
        lab.board.run(50 * MICROSECOND)?;
        let flash = &lab.board.bus().flash;
        if flash.operations == before + operation && flash.next().is_some() {
            break;
        }
        if flash.operations > before + operation || lab.board.now() > end {
            return Ok(false);
        }
        if !lab.board.received().is_empty() {
            return Ok(false);
        }
    }
    power_cycle(&mut lab)?;
    let (sent, checksum) = runs(&mut lab)?;
    assert!(
        sent && [old.checksum(), new.checksum()].contains(&checksum),
        "cut at {operation}: {sent}, {checksum:#x}"
    );
    keep(&mut lab, &new)?;
    power_cycle(&mut lab)?;
    assert_eq!(
        runs(&mut lab)?,
        (true, new.checksum()),
        "cut at {operation}"
    );
    Ok(true)
}

/// Power is cut at every write of a keep (of every eighth, unless there is time), and
/// afterwards the board has the old or the new table.
#[test]
fn power_cut_at_every_write() -> Outcome {
    let step = if long() { 1 } else { 16 };
    let flash = filled(1)?;
    let mut operation = 0;
    while cut(&flash, operation)? {
        operation += step;
    }
    assert!(operation > 30, "only {operation} operations");
    Ok(())
}

/// As above, for a keep that changes pages and erases one.
#[test]
fn power_cut_at_every_write_and_erase_of_a_migration() -> Outcome {
    if !long() {
        println!("left out without VIRTUAL_LONG=1");
        return Ok(());
    }
    let flash = filled(83)?;
    let mut operation = 0;
    while cut(&flash, operation)? {
        operation += 1;
    }
    assert!(operation > 30, "only {operation} operations");
    Ok(())
}

/// Tables are kept one after the other: 300, or 90 without time, which is more than a page
/// holds.
#[test]
fn many_tables_in_a_row() -> Outcome {
    let mut lab = Lab::new()?;
    let count = if long() { 300 } else { 90 };
    for i in 0..count {
        let next = table(10_000 + i)?;
        keep(&mut lab, &next).map_err(|why| format!("table {i}: {why}"))?;
        assert_eq!(runs(&mut lab)?, (true, next.checksum()), "table {i}");
        assert!(
            lab.board.resets.is_empty(),
            "table {i}: {:?}",
            lab.board.resets
        );
    }
    assert_eq!(lab.board.bus().dac.outputs(), [MIDDLE; 8]);
    Ok(())
}
