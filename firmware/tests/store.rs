//! The memory for a table: through power cut at every single write.

use std::convert::Infallible;

use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use firmware::ram_flash::RamFlash;
use firmware::store::Store;
use firmware::tables;
use sequential_storage::mock_flash::{MockFlashBase, WriteCountCheck};
use shared::table::ValidTable;

/// Two pages of 8 KiB in words of 32 bytes, as the STM32H743 writes its flash.
type Flash = MockFlashBase<2, 32, 256>;

fn store(mut flash: Flash) -> Store<Flash> {
    flash.bytes_until_shutoff = None;
    Store::new(flash, Flash::FULL_FLASH_RANGE).unwrap()
}

/// Tables that differ in their number.
fn table(number: u8) -> ValidTable {
    let mut table = *tables::ALL[0].table.get();
    table.model.0[0] = number;
    table.validate().unwrap()
}

/// Power is cut after every possible number of writes while a table is kept, with the
/// memory in every state from empty to turned over: the board then finds the table
/// before or the new one, whole; and the memory still takes a third.
#[test]
fn no_power_cut_costs_the_table() {
    let mut cuts = 0;
    for before in 0..9 {
        let mut flash = Flash::new(WriteCountCheck::OnceOnly, None, true);
        for number in 0..before {
            let mut store = store(flash);
            store.keep(&table(number)).unwrap();
            flash = store.into_flash();
        }
        let old = before.checked_sub(1).map(table);
        for writes in 0.. {
            let mut cut = flash.clone();
            cut.bytes_until_shutoff = Some(writes);
            let mut interrupted = Store::new(cut, Flash::FULL_FLASH_RANGE).unwrap();
            let kept = interrupted.keep(&table(100)).is_ok();
            let mut after = store(interrupted.into_flash());
            let found = after.table().map(|(table, _)| table);
            if kept {
                assert_eq!(found, Some(table(100)), "{before}, {writes}");
                break;
            }
            assert!(
                found == old || found == Some(table(100)),
                "{before}, {writes}"
            );
            after.keep(&table(101)).unwrap();
            let third = after.table().unwrap();
            assert_eq!(third, (table(101), table(101).checksum()));
            cuts += 1;
        }
    }
    // Some 2 kB in words of 32 bytes, nine times, and the erased pages.
    assert!(cuts > 500, "{cuts}");
}

/// What is kept comes back, until it is forgotten; a bit that is lost makes it none.
#[test]
fn what_is_kept_comes_back() {
    let mut store = Store::new(RamFlash::new(), 0..RamFlash::SIZE as u32).unwrap();
    assert_eq!(store.table(), None);
    for number in 0..20 {
        store.keep(&table(number)).unwrap();
        assert_eq!(store.table().unwrap().0, table(number));
    }
    store.forget().unwrap();
    assert_eq!(store.table(), None);
    store.keep(&table(3)).unwrap();
    assert_eq!(store.table().unwrap().0, table(3));

    let mut flash = Flash::new(WriteCountCheck::OnceOnly, None, true);
    flash = {
        let mut store = self::store(flash);
        store.keep(&table(3)).unwrap();
        store.into_flash()
    };
    for at in 0..flash.as_bytes().len() {
        let mut flash = flash.clone();
        if flash.as_bytes()[at] == 0xFF {
            continue;
        }
        flash.as_bytes_mut()[at] ^= 1;
        let found = self::store(flash).table();
        assert!(found.is_none_or(|(found, _)| found == table(3)), "{at}");
    }
}

/// Counts what is read. Two pages of 128 KiB in words of 32 bytes, as the reference board's.
struct Counted {
    bytes: Vec<u8>,
    read: usize,
}

impl ErrorType for Counted {
    type Error = Infallible;
}

impl ReadNorFlash for Counted {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        let at = offset as usize;
        bytes.copy_from_slice(&self.bytes[at..at + bytes.len()]);
        self.read += bytes.len();
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for Counted {
    const WRITE_SIZE: usize = 32;
    const ERASE_SIZE: usize = 128 * 1024;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
        self.bytes[from as usize..to as usize].fill(0xFF);
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Infallible> {
        let at = offset as usize;
        let place = &mut self.bytes[at..at + bytes.len()];
        assert!(
            place.iter().all(|byte| *byte == 0xFF),
            "written twice: {at}"
        );
        place.copy_from_slice(bytes);
        Ok(())
    }
}

/// However many tables were kept before, a start that then keeps one reads each page a few
/// times, not once for every old table in it.
#[test]
fn keeping_does_not_read_a_page_for_every_old_table() {
    let size = 2 * Counted::ERASE_SIZE;
    let mut flash = Counted {
        bytes: vec![0xFF; size],
        read: 0,
    };
    let mut most = 0;
    for number in 0..300_u32 {
        let mut store = Store::new(flash, 0..size as u32).unwrap();
        // A board reads the table when it starts.
        let found = store.table().map(|(table, _)| table);
        assert_eq!(found, number.checked_sub(1).map(|last| table(last as u8)));
        store.keep(&table(number as u8)).unwrap();
        flash = store.into_flash();
        most = most.max(flash.read);
        flash.read = 0;
    }
    assert!(most <= 2 * size, "{most} bytes read");
    println!("{most} bytes read at the most");
}
