//! Files: replaced whole or not at all, read without what editors add, and written for other
//! programs.

pub mod columns;
pub mod identifier;
pub mod mat;

use std::fs::{self, Metadata, OpenOptions, Permissions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// `text` without the byte order mark that some editors put before it.
pub fn without_byte_order_mark(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// Writes `bytes` to `path`, so that a reader never finds half of them: a temporary file in the
/// same folder is renamed.
///
/// A symbolic link is followed: the file it points to is replaced. A file that is replaced keeps
/// its mode and, as far as the system allows, its owner. A device, a FIFO or standard output is
/// written to directly.
///
/// # Errors
/// If the file is read-only, even if the user may replace it, or the system refuses.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    match fs::metadata(path) {
        Ok(there) if is_standard_output(&there) => {
            let mut output = io::stdout().lock();
            output.write_all(bytes)?;
            output.flush()
        }
        Ok(there) if !there.is_file() => {
            OpenOptions::new().write(true).open(path)?.write_all(bytes)
        }
        Ok(there) if there.permissions().readonly() => Err(io::Error::new(
            io::ErrorKind::PermissionDenied,
            "it is read-only; make it writable, or choose another file",
        )),
        Ok(there) => replace(&fs::canonicalize(path)?, bytes, Some(&there)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            replace(&end_of_links(path), bytes, None)
        }
        Err(error) => Err(error),
    }
}

/// Where a chain of symbolic links leads whose last one points to nothing yet.
fn end_of_links(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    // Links in a circle are an error of the system's before this is called.
    while let Ok(target) = fs::read_link(&path) {
        path = folder(&path).join(target);
    }
    path
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

fn replace(path: &Path, bytes: &[u8], old: Option<&Metadata>) -> io::Result<()> {
    let mut file = tempfile::Builder::new();
    // The permissions of an ordinary new file, not of a temporary one.
    #[cfg(unix)]
    file.permissions(<Permissions as std::os::unix::fs::PermissionsExt>::from_mode(0o666));
    let mut file = file.tempfile_in(folder(path))?;
    file.write_all(bytes)?;
    if let Some(old) = old {
        keep_owner(file.path(), old);
        file.as_file().set_permissions(old.permissions())?;
    }
    file.persist(path)?;
    Ok(())
}

/// Only some users may give files to others.
#[cfg(unix)]
fn keep_owner(path: &Path, old: &Metadata) {
    use std::os::unix::fs::{MetadataExt as _, chown};
    let _ = chown(path, Some(old.uid()), Some(old.gid()));
}

#[cfg(not(unix))]
fn keep_owner(_: &Path, _: &Metadata) {}

/// Standard output may be a file that others append to.
#[cfg(unix)]
fn is_standard_output(there: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    fs::metadata("/dev/stdout")
        .is_ok_and(|output| (output.dev(), output.ino()) == (there.dev(), there.ino()))
}

#[cfg(not(unix))]
fn is_standard_output(_: &Metadata) -> bool {
    false
}

#[cfg(all(test, unix))]
mod tests {
    use std::io::Read as _;
    use std::os::unix::fs::{FileTypeExt as _, PermissionsExt as _, symlink};

    use super::*;

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).unwrap().permissions().mode() & 0o7777
    }

    #[test]
    fn links_are_followed_also_into_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("below")).unwrap();
        symlink("below/second", at("first")).unwrap();
        symlink("file", at("below/second")).unwrap();
        for text in ["new", "replaced"] {
            write_whole(&at("first"), text.as_bytes()).unwrap();
            assert_eq!(fs::read_to_string(at("below/file")).unwrap(), text);
            assert!(fs::symlink_metadata(at("first")).unwrap().is_symlink());
            assert!(
                fs::symlink_metadata(at("below/second"))
                    .unwrap()
                    .is_symlink()
            );
        }
        symlink("circle", at("circle")).unwrap();
        assert!(write_whole(&at("circle"), b"").is_err());
    }

    #[test]
    fn modes_are_kept_and_read_only_files_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, "old").unwrap();
        for kept in [0o600, 0o755, 0o664] {
            fs::set_permissions(&path, Permissions::from_mode(kept)).unwrap();
            write_whole(&path, b"new").unwrap();
            assert_eq!(mode(&path), kept);
        }
        fs::set_permissions(&path, Permissions::from_mode(0o444)).unwrap();
        let error = write_whole(&path, b"newer").unwrap_err();
        assert!(error.to_string().contains("read-only"), "{error}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
    }

    #[test]
    fn special_files_are_written_through() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fifo");
        let made = std::process::Command::new("mkfifo").arg(&path).status();
        assert!(made.unwrap().success());
        let reader = std::thread::spawn({
            let path = path.clone();
            move || {
                let mut text = String::new();
                fs::File::open(path)
                    .unwrap()
                    .read_to_string(&mut text)
                    .unwrap();
                text
            }
        });
        write_whole(&path, b"through").unwrap();
        assert_eq!(reader.join().unwrap(), "through");
        assert!(fs::metadata(&path).unwrap().file_type().is_fifo());
        write_whole(Path::new("/dev/null"), b"nowhere").unwrap();
        assert!(
            fs::metadata("/dev/null")
                .unwrap()
                .file_type()
                .is_char_device()
        );
        assert!(write_whole(folder.path(), b"").is_err());
    }
}
