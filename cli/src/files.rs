//! Files that commands write.

use std::io::Write as _;
use std::path::Path;

use crate::failure::Failure;

/// Writes a temporary file in the same folder and renames it, so that there is never an
/// incomplete file.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let failed = |error| Failure::Io {
        path: path.display().to_string(),
        what: "written",
        error,
    };
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let mut file = tempfile::Builder::new();
    // The permissions of an ordinary new file, not of a temporary one.
    #[cfg(unix)]
    file.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o644));
    let mut file = file.tempfile_in(folder).map_err(failed)?;
    file.write_all(bytes).map_err(failed)?;
    file.persist(path).map_err(|error| failed(error.error))?;
    Ok(())
}
