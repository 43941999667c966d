//! A table as bytes, and its checksum.

use super::{Table, TableError, ValidTable};
use crate::CRC_32;

/// Largest size of a table encoded by postcard, bytes.
pub const TABLE_ROOM: usize = 4096;

impl ValidTable {
    /// Decodes and validates a table that postcard encoded in `bytes`.
    ///
    /// # Errors
    /// [`TableError::Encoding`] if the bytes are not exactly one table,
    /// [`TableError::Checksum`] if its checksum is not `checksum`, else what
    /// [`Table::validate`] finds.
    pub fn decode(bytes: &[u8], checksum: u32) -> Result<Self, TableError> {
        let Ok((table, [])) = postcard::take_from_bytes::<Table>(bytes) else {
            return Err(TableError::Encoding);
        };
        let table = table.validate()?;
        if table.checksum() == checksum {
            Ok(table)
        } else {
            Err(TableError::Checksum)
        }
    }

    /// Encodes the table with postcard at the start of `room` and returns the bytes used.
    /// None if `room` is too small.
    pub fn encode<'a>(&self, room: &'a mut [u8; TABLE_ROOM]) -> Option<&'a [u8]> {
        postcard::to_slice(self.get(), room)
            .ok()
            .map(|bytes| &*bytes)
    }

    /// CRC-32 (ISO-HDLC) of the encoded table. It identifies the table and reveals a
    /// changed bit.
    pub fn checksum(&self) -> u32 {
        // A table has only numbers, options and arrays of fixed length, which postcard
        // always encodes, and the sum accepts every byte.
        postcard::serialize_with_flavor(self.get(), Sum(CRC_32.digest())).unwrap_or(0)
    }
}

/// Adds the bytes to a checksum instead of storing them.
struct Sum(crc::Digest<'static, u32>);

impl postcard::ser_flavors::Flavor for Sum {
    type Output = u32;

    fn try_push(&mut self, data: u8) -> postcard::Result<()> {
        self.0.update(&[data]);
        Ok(())
    }

    fn try_extend(&mut self, data: &[u8]) -> postcard::Result<()> {
        self.0.update(data);
        Ok(())
    }

    fn finalize(self) -> postcard::Result<u32> {
        Ok(self.0.finalize())
    }
}
