//! A table that came over the link, kept through power failure.
//!
//! One item of a sequential-storage map: a new one is written beside the old one and
//! counts only when it is whole, so that a board that loses its power at any moment
//! finds the old or the new one, never half of one. The table compiled in is not
//! touched.

use core::ops::Range;

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::NorFlash;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};
use shared::table::{TABLE_ROOM, ValidTable};

/// The item's key.
const KEY: u8 = 0;

/// Of a checksum and a table; flash writes whole words, of 32 bytes at the most.
const ROOM: usize = TABLE_ROOM + 64;

/// What is kept when there is no table.
const NOTHING: &[u8] = &[];

/// The memory could not be read or written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failed;

/// A board's memory for a table.
pub struct Store<F: NorFlash> {
    map: MapStorage<u8, F, Cache<Uncached, Uncached, Uncached, u8>>,
    buffer: [u8; ROOM],
    item: [u8; ROOM],
}

impl<F: NorFlash> Store<F> {
    /// In `pages` of `flash`, at least two that can be erased by themselves. None if
    /// they cannot be used.
    pub fn new(flash: F, pages: Range<u32>) -> Option<Self> {
        let config = MapConfig::try_new(pages).ok()?;
        Some(Self {
            map: MapStorage::new(flash, config, Cache::new_uncached()),
            buffer: [0; ROOM],
            item: [0; ROOM],
        })
    }

    /// The table that was kept last, with its checksum; none if there is none, or none
    /// that this firmware reads: its layout is another, or it is not valid.
    pub fn table(&mut self) -> Option<(ValidTable, u32)> {
        let item = block_on(self.map.fetch_item::<&[u8]>(&mut self.buffer, &KEY));
        let (checksum, bytes) = item.ok()??.split_first_chunk()?;
        let checksum = u32::from_le_bytes(*checksum);
        let table = ValidTable::decode(bytes, checksum).ok()?;
        Some((table, checksum))
    }

    /// Keeps a table in place of the one before.
    ///
    /// # Errors
    /// Where the flash does; the one before is still there.
    pub fn keep(&mut self, table: &ValidTable) -> Result<(), Failed> {
        let (checksum, rest) = self.item.split_first_chunk_mut().ok_or(Failed)?;
        *checksum = table.checksum().to_le_bytes();
        let room = rest.first_chunk_mut().ok_or(Failed)?;
        let length = table.encode(room).ok_or(Failed)?.len() + size_of::<u32>();
        let item = self.item.get(..length).ok_or(Failed)?;
        block_on(self.map.store_item(&mut self.buffer, &KEY, &item)).map_err(|_| Failed)
    }

    /// Forgets it.
    ///
    /// # Errors
    /// Where the flash does not.
    pub fn forget(&mut self) -> Result<(), Failed> {
        block_on(self.map.store_item(&mut self.buffer, &KEY, &NOTHING)).map_err(|_| Failed)
    }

    /// The flash it is in.
    pub fn into_flash(self) -> F {
        self.map.destroy().0
    }
}
