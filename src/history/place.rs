//! Whether an open file is still the one that its path leads to.

use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A file that was opened, and what it was then.
///
/// Only the file system is asked. Opening the file and closing it again would release SQLite's locks on it, as POSIX
/// wants it.
#[derive(Debug, Clone)]
pub(super) struct Place {
    path: PathBuf,
    device: u64,
    inode: u64,
}

/// A file's length, and when it was last written to, in seconds and nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Look {
    length: u64,
    written: (i64, i64),
}

impl Place {
    /// The file that a path leads to now.
    pub(super) fn of(path: PathBuf) -> io::Result<Self> {
        let found = path.metadata()?;
        Ok(Self { device: found.dev(), inode: found.ino(), path })
    }

    /// Its path.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// What it looks like now; `None` if it cannot be seen.
    pub(super) fn look(&self) -> Option<Look> {
        let found = self.path.metadata().ok()?;
        Some(Look { length: found.len(), written: (found.mtime(), found.mtime_nsec()) })
    }

    /// What happened to it, in words, if the path does not lead to it any more.
    pub(super) fn lost(&self) -> Option<String> {
        match self.path.metadata() {
            Ok(found) if (found.dev(), found.ino()) == (self.device, self.inode) => None,
            Ok(_) => Some("it was replaced by another file while it was in use".into()),
            Err(e) if matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
                Some("it was deleted or moved away while it was in use".into())
            }
            Err(e) => Some(format!("it cannot be found any more: {e}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_file_that_was_deleted_moved_or_replaced_is_not_the_one_that_was_opened() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("deep/file");
        fs::create_dir(directory.path().join("deep")).unwrap();
        fs::write(&path, "one").unwrap();
        let place = Place::of(path.clone()).unwrap();
        fs::write(&path, "the same file, written again").unwrap();
        assert_eq!(place.lost(), None);
        fs::write(directory.path().join("other"), "two").unwrap();
        fs::rename(directory.path().join("other"), &path).unwrap();
        assert!(place.lost().unwrap().contains("replaced"));
        fs::remove_file(&path).unwrap();
        assert!(place.lost().unwrap().contains("deleted or moved"));
        fs::remove_dir(directory.path().join("deep")).unwrap();
        fs::write(directory.path().join("deep"), "a file, where the directory was").unwrap();
        assert!(place.lost().unwrap().contains("deleted or moved"));
    }
}
