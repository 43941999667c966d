//! Files that commands write.

use std::path::Path;

use crate::failure::Failure;

/// Writes a file as [`host_gen::files::write_whole`] does.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    host_gen::files::write_whole(path, bytes).map_err(|error| Failure::Io {
        path: path.display().to_string(),
        what: "written",
        error,
    })
}
