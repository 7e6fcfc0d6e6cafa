use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// The path of a file while it is written. Its extension is not that of an image, so that no reader takes it for one.
fn unfinished(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.part"))
}

/// Writes a file completely or not at all. It need not survive a power cut: waiting for the disk after each frame would
/// take too long.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let part = unfinished(path);
    let written = (|| {
        let mut file = File::create(&part)?;
        file.write_all(bytes)?;
        fs::rename(&part, path)
    })();
    if written.is_err() {
        // The remains only take up space, and a full disk may be why it failed.
        let _ = fs::remove_file(&part);
    }
    written
}

/// Waits until a directory's entries, or a file's bytes, are on the disk.
pub(super) fn sync(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_all()
}

/// Waits until everything in a recording's directory is on the disk.
///
/// A recording has thousands of files, and syncing each takes some milliseconds: syncing the whole file system is
/// faster.
#[cfg(target_os = "linux")]
pub(super) fn sync_below(directory: &Path) -> io::Result<()> {
    rustix::fs::syncfs(File::open(directory)?)?;
    Ok(())
}

/// Waits until everything in a recording's directory is on the disk.
#[cfg(not(target_os = "linux"))]
pub(super) fn sync_below(directory: &Path) -> io::Result<()> {
    for entry in fs::read_dir(directory)? {
        let path = entry?.path();
        if path.is_dir() { sync_below(&path)? } else { sync(&path)? }
    }
    sync(directory)
}

/// A text file to which lines are appended, each completely or not at all.
#[derive(Debug)]
pub(super) struct Lines {
    file: File,
    length: u64,
}

impl Lines {
    pub(super) fn create(path: &Path, first: &str) -> io::Result<Self> {
        let mut lines = Self { file: File::create_new(path)?, length: 0 };
        lines.add(first)?;
        Ok(lines)
    }

    pub(super) fn add(&mut self, line: &str) -> io::Result<()> {
        let added = self.file.write_all(format!("{line}\n").as_bytes());
        match added {
            Ok(()) => self.length += line.len() as u64 + 1,
            Err(_) => self.cut(self.length),
        }
        added
    }

    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// Truncates the file to `length` bytes.
    pub(super) fn cut(&mut self, length: u64) {
        use std::io::{Seek, SeekFrom};

        // If this fails too, the reader still tolerates half a line at the end.
        let _ = self.file.set_len(length);
        let _ = self.file.seek(SeekFrom::Start(length));
        self.length = length;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_there_whole_and_nothing_is_beside_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        write_whole(&path, b"first").unwrap();
        write_whole(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        // A directory is in the way: the unfinished file is removed.
        fs::create_dir(dir.path().join("b.png")).unwrap();
        write_whole(&dir.path().join("b.png"), b"x").unwrap_err();
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2);
    }

    #[test]
    fn lines_can_be_taken_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("times");
        let mut lines = Lines::create(&path, "head").unwrap();
        let before = lines.length();
        lines.add("one").unwrap();
        lines.cut(before);
        lines.add("two").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "head\ntwo\n");
        Lines::create(&path, "head").unwrap_err();
    }
}
