//! A table on its way to the board, piece by piece.

use heapless::Vec;

use crate::controller::Refusal;
use crate::table::{Limits, TABLE_ROOM, ValidTable};

/// Bytes of a table in one request.
pub const PIECE: usize = 256;

/// What has come of a table so far.
#[derive(Debug)]
pub struct Upload {
    bytes: [u8; TABLE_ROOM],
}

impl Upload {
    /// Nothing.
    pub const fn new() -> Self {
        Self {
            bytes: [0; TABLE_ROOM],
        }
    }

    /// Puts a piece at its place.
    ///
    /// # Errors
    /// Where a table is not that long.
    pub fn put(&mut self, at: u32, piece: &Vec<u8, PIECE>) -> Result<(), Refusal> {
        let at = at as usize;
        let place = at
            .checked_add(piece.len())
            .and_then(|end| self.bytes.get_mut(at..end))
            .ok_or(Refusal::Range)?;
        place.copy_from_slice(piece);
        Ok(())
    }

    /// The table of the first `length` bytes.
    ///
    /// # Errors
    /// Where they are none, or not the one whose checksum was given, or none that the
    /// board can run.
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
