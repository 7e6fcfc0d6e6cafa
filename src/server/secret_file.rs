use std::os::unix::fs::MetadataExt;
use std::path::Path;

use doorcam_source::files::{self, FileKind, ReadError};

/// Mode bits that a secret's file must not have: write for the group, and any for others.
const TOO_OPEN: u32 = 0o027;

/// Reads a file that holds a secret. Like ssh, it refuses a file that everybody can read or that others than its owner
/// can write: a secret that leaks unnoticed is worse than a start that fails.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, String> {
    let file = path.display();
    let cannot = |e: ReadError| match e {
        e @ ReadError::Io(_) => format!("{file}: cannot read it: {}", e.words()),
        e => format!("{file}: {e}"),
    };
    let opened = files::open(path, FileKind::SECRET).map_err(cannot)?;
    let mode = opened.metadata().map_err(|e| cannot(e.into()))?.mode() & 0o777;
    if mode & TOO_OPEN != 0 {
        return Err(format!(
            "{file}: its mode {mode:o} lets others at the secret, expected 600 or 640 (chmod 600 {file})"
        ));
    }
    files::read_opened(&opened, FileKind::SECRET).map_err(cannot)
}
