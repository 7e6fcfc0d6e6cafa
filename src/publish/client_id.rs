//! The name that a broker knows this doorcam by. A broker ends a connection when another client comes with the same
//! name, so no two may share one, not even on one machine or on machines of one name.

use std::fs::File;
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::sync::Arc;

/// Digits of the number that makes the name unique.
const DIGITS: usize = 16;

/// A number that no other doorcam has, as text.
#[derive(Debug, Clone)]
pub(super) struct Unique {
    pub(super) text: String,
    /// Locked as long as this doorcam runs, so that another one with the same storage notices.
    _file: Option<Arc<File>>,
}

impl Unique {
    /// The number that is kept in the file `client-id` of a storage directory, which is made if there is none. Without a
    /// directory, or if its file cannot be used, it is of this run only.
    pub(super) fn load(directory: Option<&Path>) -> Self {
        let Some(directory) = directory else { return Self::of_this_run() };
        let name = directory.join("client-id");
        match kept(&name) {
            Ok((text, file)) => Self { text, _file: Some(Arc::new(file)) },
            Err(e) => {
                tracing::warn!("{}: {e}: this run has an MQTT client id of its own", name.display());
                Self::of_this_run()
            }
        }
    }

    fn of_this_run() -> Self {
        Self { text: random(), _file: None }
    }
}

fn kept(name: &Path) -> io::Result<(String, File)> {
    if let Some(directory) = name.parent() {
        std::fs::create_dir_all(directory)?;
    }
    let options = File::options().read(true).write(true).create(true).truncate(false).mode(0o600).to_owned();
    let mut file = options.open(name)?;
    if !file.metadata()?.is_file() {
        return Err(io::Error::other("it is no regular file"));
    }
    match file.try_lock() {
        Ok(()) => {}
        Err(std::fs::TryLockError::WouldBlock) => {
            return Err(io::Error::other("another doorcam uses this storage directory, expected one per doorway"));
        }
        // On a file system without locks nobody can tell.
        Err(std::fs::TryLockError::Error(_)) => {}
    }
    let mut text = Vec::new();
    (&file).take(DIGITS as u64 + 2).read_to_end(&mut text)?;
    let digits = text.trim_ascii();
    if digits.len() == DIGITS && digits.iter().all(|c| c.is_ascii_digit() || (b'a'..=b'f').contains(c)) {
        return Ok((String::from_utf8_lossy(digits).into_owned(), file));
    }
    let text = random();
    file.set_len(0)?;
    file.rewind()?;
    file.write_all(format!("{text}\n").as_bytes())?;
    file.sync_all()?;
    Ok((text, file))
}

fn random() -> String {
    let mut bytes = [0; DIGITS / 2];
    if getrandom::fill(&mut bytes).is_err() {
        // Without random numbers, the time and the process tell this run from most others.
        let now = jiff::Timestamp::now().as_nanosecond() as u64;
        bytes = (now ^ u64::from(std::process::id()).rotate_left(40)).to_le_bytes();
    }
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_storage_directory_has_one_and_every_other_run_another() {
        let directory = tempfile::tempdir().unwrap();
        let place = directory.path().join("not/yet");
        let first = Unique::load(Some(&place));
        assert_eq!(first.text.len(), DIGITS);
        let beside = Unique::load(Some(&place));
        assert_ne!(beside.text, first.text, "two at the same time");
        let text = first.text.clone();
        drop(first);
        assert_eq!(Unique::load(Some(&place)).text, text, "after a restart");
        assert_ne!(Unique::load(None).text, Unique::load(None).text);
        assert_ne!(Unique::load(Some(directory.path())).text, text);
    }

    #[test]
    fn what_is_no_id_is_replaced_and_what_is_no_file_is_left_alone() {
        for odd in [&b""[..], b"hello", b"0123456789ABCDEF", b"\xff\xff", &[b'a'; 1000]] {
            let directory = tempfile::tempdir().unwrap();
            let file = directory.path().join("client-id");
            std::fs::write(&file, odd).unwrap();
            let text = Unique::load(Some(directory.path())).text;
            assert_eq!(std::fs::read_to_string(&file).unwrap(), format!("{text}\n"));
        }
        let directory = tempfile::tempdir().unwrap();
        std::fs::create_dir(directory.path().join("client-id")).unwrap();
        assert_eq!(Unique::load(Some(directory.path())).text.len(), DIGITS);
    }
}
