//! Files that are written completely or not at all.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

/// Replaces a file atomically and durably, creating its directory if needed: after a crash at any moment it has either
/// its old or its new contents.
///
/// # Errors
/// If the directory or the file cannot be written.
pub fn replace(file: &Path, bytes: &[u8]) -> io::Result<()> {
    let directory = file.parent().filter(|d| !d.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::create_dir_all(directory)?;
    let mut temporary = tempfile::NamedTempFile::new_in(directory)?;
    temporary.write_all(bytes)?;
    temporary.as_file().sync_all()?;
    temporary.persist(file).map_err(|e| e.error)?;
    fs::File::open(directory)?.sync_all()
}
