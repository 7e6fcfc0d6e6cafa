use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Longest file of a token or key, in bytes.
const LONGEST: u64 = 64 * 1024;

/// Mode bits that a secret's file must not have: write for the group, and any for others.
const TOO_OPEN: u32 = 0o027;

/// Reads a file that holds a secret. Like ssh, it refuses a file that everybody can read or that others than its owner
/// can write: a secret that leaks unnoticed is worse than a start that fails.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, String> {
    let file = path.display();
    let cannot = |e: io::Error| format!("{file}: cannot read it: {}", e.kind());
    let opened = std::fs::File::open(path).map_err(cannot)?;
    let mode = opened.metadata().map_err(cannot)?.mode() & 0o777;
    if mode & TOO_OPEN != 0 {
        return Err(format!(
            "{file}: its mode {mode:o} lets others at the secret, expected 600 or 640 (chmod 600 {file})"
        ));
    }
    let mut bytes = Vec::new();
    opened.take(LONGEST + 1).read_to_end(&mut bytes).map_err(cannot)?;
    if bytes.len() as u64 > LONGEST {
        return Err(format!("{file}: longer than {} kB, expected a token or a key", LONGEST / 1024));
    }
    Ok(bytes)
}
