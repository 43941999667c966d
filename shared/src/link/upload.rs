//! Upload of a table to the board, in pieces.

use heapless::Vec;

use crate::controller::Refusal;
use crate::table::{Limits, TABLE_ROOM, ValidTable};

/// Largest number of bytes of a table in one request.
pub const PIECE: usize = 256;

/// The pieces received so far.
#[derive(Debug)]
pub struct Upload {
    bytes: [u8; TABLE_ROOM],
}

impl Upload {
    /// Before the first piece.
    pub const fn new() -> Self {
        Self {
            bytes: [0; TABLE_ROOM],
        }
    }

    /// Stores a piece at byte offset `at`.
    ///
    /// # Errors
    /// [`Refusal::Range`] if it ends past [`TABLE_ROOM`].
    pub fn put(&mut self, at: u32, piece: &Vec<u8, PIECE>) -> Result<(), Refusal> {
        let at = at as usize;
        let place = at
            .checked_add(piece.len())
            .and_then(|end| self.bytes.get_mut(at..end))
            .ok_or(Refusal::Range)?;
        place.copy_from_slice(piece);
        Ok(())
    }

    /// The table encoded in the first `length` bytes.
    ///
    /// # Errors
    /// [`Refusal::Range`] if `length` is above [`TABLE_ROOM`], [`Refusal::Table`] if the bytes
    /// are not a valid table, do not match `checksum`, or exceed the board's `limits`.
    pub fn table(
        &self,
        length: u32,
        checksum: u32,
        limits: &Limits,
    ) -> Result<ValidTable, Refusal> {
        let bytes = self.bytes.get(..length as usize).ok_or(Refusal::Range)?;
        let table = ValidTable::decode(bytes, checksum).map_err(Refusal::Table)?;
        limits.admit(&table).map_err(Refusal::Table)?;
        Ok(table)
    }
}

impl Default for Upload {
    fn default() -> Self {
        Self::new()
    }
}
