//! Non-volatile memory for a table that came over the link.
//!
//! The table is one item of a sequential-storage map. A new item is written to free flash and
//! becomes valid when it is complete. So after a loss of power at any moment the board finds
//! either the old or the new table, never a part of one. The table compiled into the firmware
//! is not affected.

use core::ops::Range;

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::NorFlash;
use sequential_storage::cache::key_pointers::ArrayKeyPointers;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};
use shared::table::{TABLE_ROOM, ValidTable};

/// Key of the item.
const KEY: u8 = 0;

/// Size of a buffer for a checksum and a table. Flash is written in whole words of up to 32
/// bytes.
const ROOM: usize = TABLE_ROOM + 64;

/// The item that says that no table is stored.
const NOTHING: &[u8] = &[];

/// Knows where the item is. Without it, moving to another page searches the whole page once
/// for each of the old items in it.
type Place = ArrayKeyPointers<u8, 1>;

/// The memory could not be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreError;

/// A board's memory for a table.
pub struct Store<F: NorFlash> {
    map: MapStorage<u8, F, Cache<Uncached, Uncached, Place, u8>>,
    buffer: [u8; ROOM],
    item: [u8; ROOM],
}

impl<F: NorFlash> Store<F> {
    /// A store in the byte range `pages` of `flash`, which must cover at least two pages that
    /// can be erased separately. None if it does not.
    pub fn new(flash: F, pages: Range<u32>) -> Option<Self> {
        let config = MapConfig::try_new(pages).ok()?;
        Some(Self {
            map: MapStorage::new(flash, config, Cache::new(Uncached, Uncached, Place::new())),
            buffer: [0; ROOM],
            item: [0; ROOM],
        })
    }

    /// The stored table with its checksum. None if there is none, or if this firmware cannot
    /// use it: it has another layout or is not valid.
    pub fn table(&mut self) -> Option<(ValidTable, u32)> {
        let item = block_on(self.map.fetch_item::<&[u8]>(&mut self.buffer, &KEY));
        let (checksum, bytes) = item.ok()??.split_first_chunk()?;
        let checksum = u32::from_le_bytes(*checksum);
        let table = ValidTable::decode(bytes, checksum).ok()?;
        Some((table, checksum))
    }

    /// Stores a table in place of the previous one.
    ///
    /// # Errors
    /// If the flash cannot be written. The previous table is still stored.
    pub fn keep(&mut self, table: &ValidTable) -> Result<(), StoreError> {
        let (checksum, rest) = self.item.split_first_chunk_mut().ok_or(StoreError)?;
        *checksum = table.checksum().to_le_bytes();
        let room = rest.first_chunk_mut().ok_or(StoreError)?;
        let length = table.encode(room).ok_or(StoreError)?.len() + size_of::<u32>();
        let item = self.item.get(..length).ok_or(StoreError)?;
        block_on(self.map.store_item(&mut self.buffer, &KEY, &item)).map_err(|_| StoreError)
    }

    /// Deletes the stored table.
    ///
    /// # Errors
    /// If the flash cannot be written.
    pub fn forget(&mut self) -> Result<(), StoreError> {
        block_on(self.map.store_item(&mut self.buffer, &KEY, &NOTHING)).map_err(|_| StoreError)
    }

    /// Returns the flash.
    pub fn into_flash(self) -> F {
        self.map.destroy().0
    }
}
