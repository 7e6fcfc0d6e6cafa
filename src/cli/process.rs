//! What a command that watches or records asks of its process.

use std::fs::File;

use anyhow::{Context, bail};
use rustix::fs::Mode;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit, umask};

/// Files that a watch needs besides connections: the program's own, the history with its readers, a recording, the
/// broker, webhooks, and a few connections, so that somebody can see what is wrong.
const FILES: usize = 48;
/// Fewest connections that are served, however few files may be open: they are among [`FILES`].
const CONNECTIONS: usize = 8;
/// More files than this are never asked for.
const PLENTY: u64 = 1 << 16;

/// Makes files and directories that are created from now on readable by their owner only: they tell who was where.
pub(super) fn keep_private() {
    let before = umask(Mode::RWXG | Mode::RWXO);
    // What the user forbids stays forbidden.
    umask(before | Mode::RWXG | Mode::RWXO);
}

/// Checks that enough files can be open at once, and raises the limit if it is low and may be raised.
pub(super) fn need_files() -> anyhow::Result<()> {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if let Some(limit) = current.filter(|&limit| limit < PLENTY) {
        let raised = maximum.map_or(PLENTY, |maximum| maximum.min(PLENTY));
        if raised > limit {
            // Where that is forbidden, the limit may still be enough.
            let _ = setrlimit(Resource::Nofile, Rlimit { current: Some(raised), maximum });
        }
    }
    let limit = getrlimit(Resource::Nofile).current;
    // Those that were open at the start count as well.
    let mut files = Vec::with_capacity(FILES);
    while files.len() < FILES {
        match File::open("/dev/null") {
            Ok(file) => files.push(file),
            Err(e) if e.raw_os_error() == Some(rustix::io::Errno::MFILE.raw_os_error()) => {
                let limit = limit.map_or_else(String::new, |limit| format!(" of {limit}"));
                bail!(
                    "the limit{limit} open files leaves {} for doorcam, expected at least {FILES} (ulimit -n, or \
                     LimitNOFILE of the service)",
                    files.len()
                );
            }
            Err(e) => return Err(e).context("/dev/null cannot be opened"),
        }
    }
    Ok(())
}

/// How many of the `wanted` connections there are files for.
pub(super) fn connections(wanted: usize) -> usize {
    let limit = getrlimit(Resource::Nofile).current.and_then(|limit| usize::try_from(limit).ok());
    let most = limit.map_or(wanted, |limit| limit.saturating_sub(FILES).max(CONNECTIONS));
    if most < wanted {
        tracing::warn!(
            "server.max_connections is {wanted}, the limit of open files leaves {most} (ulimit -n, or LimitNOFILE of the \
             service)"
        );
    }
    wanted.min(most)
}
