//! Files: read only if they are what they should be, written completely or not at all.
//!
//! A path from a command line, a configuration or a recording may lead anywhere: to a FIFO, which would make the reader
//! wait for ever, to a device that never ends, or to a file larger than the memory. So every file is opened by
//! [`open`], which takes regular files only, and read up to a limit that its [`FileKind`] states.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

use rustix::fs::OFlags;

/// A kind of file that is read: what is expected in it, and how large it may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileKind {
    /// What is expected, with its article, for messages.
    what: &'static str,
    /// Most bytes.
    most: u64,
}

const KB: u64 = 1 << 10;
const MB: u64 = 1 << 20;

impl FileKind {
    /// An image of a frame: 8K at 16 bits a colour, uncompressed, has 200 MB.
    pub const IMAGE: Self = Self::new("an image", 256 * MB);
    /// A recording's manifest. A thousand floor points have 100 kB.
    pub const MANIFEST: Self = Self::new("a recording's manifest", 16 * MB);
    /// A recording's times: 32 bytes for each of the most frames that a recording may have.
    pub const TIMES: Self = Self::new("a recording's times", 128 * MB);
    /// A recording's truth: a day with three people at ten frames a second has 250 MB.
    pub const TRUTH: Self = Self::new("a recording's truth", 256 * MB);
    /// Updates, one a line. They are read line by line, so the limit is only against files without an end.
    pub const UPDATES: Self = Self::new("updates, one a line", 64 * 1024 * MB);
    /// A calibration: as large as a request may bring, with room for a recording's manifest, which is taken as well.
    pub const CALIBRATION: Self = Self::new("a calibration", 16 * MB);
    /// Saved zones: as large as a request may bring.
    pub const ZONES: Self = Self::new("zones", 16 * MB);
    /// A camera's locked controls.
    pub const CONTROLS: Self = Self::new("a camera's controls", MB);
    /// A configuration.
    pub const CONFIG: Self = Self::new("a configuration", 4 * MB);
    /// A scenario of the simulator.
    pub const SCENARIO: Self = Self::new("a scenario", 4 * MB);
    /// A token, password, secret or private key.
    pub const SECRET: Self = Self::new("a token or a key", 64 * KB);
    /// Certificates: all that systems trust, in one file, have 250 kB.
    pub const CERTIFICATES: Self = Self::new("certificates", 4 * MB);

    /// A kind of file: `what` is expected, such as "an image", with `most` bytes.
    pub const fn new(what: &'static str, most: u64) -> Self {
        Self { what, most }
    }

    /// The same kind, with `most` bytes if that is less.
    #[must_use]
    pub fn at_most(self, most: u64) -> Self {
        Self { most: self.most.min(most), ..self }
    }
}

/// Why a file is not read. The message does not name the file.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// It cannot be opened or read.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// It is something else than a regular file.
    #[error("is {found}, expected a file with {expected}")]
    NotAFile {
        /// What it is, such as "a directory".
        found: &'static str,
        /// What the file should have.
        expected: &'static str,
    },
    /// It is too large to be what is expected.
    #[error("is larger than {}, expected {expected}", size(.most))]
    TooLarge {
        /// The most bytes that were expected.
        most: u64,
        /// What the file should be.
        expected: &'static str,
    },
    /// It has something else than text.
    #[error(transparent)]
    Text(#[from] TextError),
}

/// Why bytes are not text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum TextError {
    /// It is text in another encoding.
    #[error("is text in UTF-16 or UTF-32, expected UTF-8")]
    Wide,
    /// It is no text.
    #[error("is not text: byte {0} is not UTF-8")]
    NotUtf8(usize),
}

impl ReadError {
    /// Whether there is no such file.
    pub fn is_missing(&self) -> bool {
        matches!(self, Self::Io(e) if e.kind() == io::ErrorKind::NotFound)
    }

    /// The reason in words, without the operating system's number for the usual ones.
    pub fn words(&self) -> String {
        match self {
            Self::Io(e) => words(e),
            other => other.to_string(),
        }
    }
}

/// An I/O error in words, without the operating system's number for the usual ones.
pub(crate) fn words(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "no such file or directory".into(),
        io::ErrorKind::PermissionDenied => "permission denied".into(),
        _ => error.to_string(),
    }
}

/// A file's name for messages: whatever it is called, it takes one line.
pub(crate) fn shown(path: &Path) -> String {
    let mut text = String::new();
    for c in path.to_string_lossy().chars() {
        if c.is_control() { text.extend(c.escape_default()) } else { text.push(c) }
    }
    text
}

/// A limit in words.
fn size(bytes: &u64) -> String {
    if *bytes < MB { format!("{} kB", bytes / KB) } else { format!("{} MB", bytes / MB) }
}

/// Opens a regular file that is not larger than its kind may be. Never waits for another process, as opening a FIFO
/// would; links are followed. A path that stands for one of this process's own open files, such as `/dev/stdin`, may
/// also lead to a pipe or terminal: whoever starts the program has opened that on purpose.
///
/// # Errors
/// If it cannot be opened, is something else than a regular file, or is too large.
pub fn open(path: &Path, kind: FileKind) -> Result<File, ReadError> {
    if is_handed_over(path) {
        return Ok(File::open(path)?);
    }
    // Before it is opened, which is not harmless for every device.
    check(&fs::metadata(path)?, kind)?;
    let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits();
    let file = OpenOptions::new().read(true).custom_flags(flags as i32).open(path)?;
    // It may be another one by now.
    check(&file.metadata()?, kind)?;
    Ok(file)
}

fn check(data: &fs::Metadata, kind: FileKind) -> Result<(), ReadError> {
    let of = data.file_type();
    let found = if of.is_file() {
        return too_large(data.len() > kind.most, kind);
    } else if of.is_dir() {
        "a directory"
    } else if of.is_fifo() {
        "a FIFO"
    } else if of.is_socket() {
        "a socket"
    } else {
        "a device"
    };
    Err(ReadError::NotAFile { found, expected: kind.what })
}

fn too_large(is: bool, kind: FileKind) -> Result<(), ReadError> {
    if is { Err(ReadError::TooLarge { most: kind.most, expected: kind.what }) } else { Ok(()) }
}

/// Whether a path stands for one of this process's own open files.
fn is_handed_over(path: &Path) -> bool {
    let number = ["/dev/fd", "/proc/self/fd"].iter().find_map(|folder| path.strip_prefix(folder).ok());
    let number = number.and_then(Path::to_str).is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
    number || path == Path::new("/dev/stdin")
}

/// Reads a whole file.
///
/// # Errors
/// As for [`open`], or if reading fails.
pub fn read(path: &Path, kind: FileKind) -> Result<Vec<u8>, ReadError> {
    read_opened(&open(path, kind)?, kind)
}

/// Reads the rest of a file that [`open`] has opened.
///
/// # Errors
/// If reading fails, or there is more in it than its kind may have, as it may have grown.
pub fn read_opened(file: &File, kind: FileKind) -> Result<Vec<u8>, ReadError> {
    let expected = file.metadata().map_or(0, |data| data.len()).min(kind.most);
    let mut bytes = Vec::with_capacity(usize::try_from(expected).unwrap_or(0));
    file.take(kind.most + 1).read_to_end(&mut bytes)?;
    too_large(bytes.len() as u64 > kind.most, kind)?;
    Ok(bytes)
}

/// Reads a whole file of text, without its byte order mark.
///
/// # Errors
/// As for [`read`], or if it is not text in UTF-8.
pub fn read_text(path: &Path, kind: FileKind) -> Result<String, ReadError> {
    let mut bytes = read(path, kind)?;
    let length = text(&bytes)?.len();
    bytes.drain(..bytes.len() - length);
    String::from_utf8(bytes).map_err(|e| TextError::NotUtf8(e.utf8_error().valid_up_to()).into())
}

/// Bytes as text, without a byte order mark. Some editors put one before everything, and JSON does not know it.
///
/// # Errors
/// If they are not UTF-8; UTF-16 and UTF-32 are named.
pub fn text(bytes: &[u8]) -> Result<&str, TextError> {
    // No text that is read here begins with a NUL or has one in second place.
    if let [0xff, 0xfe, ..] | [0xfe, 0xff, ..] | [0, ..] | [_, 0, ..] = bytes {
        return Err(TextError::Wide);
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    std::str::from_utf8(bytes).map_err(|e| TextError::NotUtf8(e.valid_up_to()))
}

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
    File::open(directory)?.sync_all()
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;
    use std::os::unix::net::UnixListener;
    use std::path::PathBuf;

    use super::*;

    const KIND: FileKind = FileKind::new("a test", 4 * KB);

    fn fifo(path: &Path) {
        let made = std::process::Command::new("mkfifo").arg(path).status().unwrap();
        assert!(made.success());
    }

    #[test]
    fn only_regular_files_are_read_and_the_error_says_what_else_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::write(at("file"), b"text").unwrap();
        symlink(at("file"), at("link")).unwrap();
        assert_eq!(read(&at("file"), KIND).unwrap(), b"text");
        assert_eq!(read(&at("link"), KIND).unwrap(), b"text");

        fifo(&at("fifo"));
        symlink(at("fifo"), at("link-to-fifo")).unwrap();
        fs::create_dir(at("directory")).unwrap();
        let _socket = UnixListener::bind(at("socket")).unwrap();
        symlink("/dev/zero", at("zero")).unwrap();
        symlink("/dev/stdin", at("stdin")).unwrap();
        let error = |path: PathBuf| read(&path, KIND).expect_err("refused").to_string();
        for (name, found) in [
            ("fifo", "a FIFO"),
            ("link-to-fifo", "a FIFO"),
            ("directory", "a directory"),
            ("socket", "a socket"),
            ("zero", "a device"),
        ] {
            assert_eq!(error(at(name)), format!("is {found}, expected a file with a test"), "{name}");
        }
        assert_eq!(error(PathBuf::from("/dev/zero")), "is a device, expected a file with a test");
        assert!(read(&at("nowhere"), KIND).expect_err("none").is_missing());
    }

    #[test]
    fn the_size_is_looked_at_first_and_no_more_than_the_limit_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("large");
        let sparse = File::create(&path).unwrap();
        sparse.set_len(100 << 30).unwrap();
        let error = read(&path, FileKind::IMAGE).expect_err("refused");
        assert_eq!(error.to_string(), "is larger than 256 MB, expected an image");
        sparse.set_len(4096).unwrap();
        assert_eq!(read(&path, KIND).unwrap().len(), 4096);
        // As if it had grown since it was opened.
        let opened = open(&path, KIND).unwrap();
        sparse.set_len(1 << 40).unwrap();
        assert_eq!(read_opened(&opened, KIND).expect_err("grown").to_string(), "is larger than 4 kB, expected a test");
    }

    #[test]
    fn what_this_process_was_handed_may_be_a_pipe() {
        for path in ["/dev/stdin", "/dev/fd/0", "/proc/self/fd/63"] {
            assert!(is_handed_over(Path::new(path)), "{path}");
        }
        for path in ["/dev/fd/5/frames", "/dev/fd/", "/dev/fd", "/dev/zero", "stdin", "/proc/1/fd/0"] {
            assert!(!is_handed_over(Path::new(path)), "{path}");
        }
        use std::os::fd::AsRawFd;
        let (reader, mut writer) = io::pipe().unwrap();
        writer.write_all(b"{}").unwrap();
        drop(writer);
        let path = PathBuf::from(format!("/dev/fd/{}", reader.as_raw_fd()));
        assert_eq!(read_text(&path, KIND).unwrap(), "{}");
    }

    #[test]
    fn a_byte_order_mark_is_no_text_and_other_encodings_are_named() {
        assert_eq!(text(b"\xef\xbb\xbf{\"a\": 1}"), Ok("{\"a\": 1}"));
        assert_eq!(text("naïve".as_bytes()), Ok("naïve"));
        assert_eq!(text(b""), Ok(""));
        for wide in [&b"\xff\xfe{\0"[..], b"\xfe\xff\0{", b"{\0}\0", b"\0{\0}", b"\xff\xfe\0\0{\0\0\0"] {
            assert_eq!(text(wide), Err(TextError::Wide), "{wide:?}");
        }
        assert_eq!(text(b"{\"a\": \"\xe9\"}"), Err(TextError::NotUtf8(7)));
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("text");
        fs::write(&path, b"\xef\xbb\xbfa").unwrap();
        assert_eq!(read_text(&path, KIND).unwrap(), "a");
    }
}
