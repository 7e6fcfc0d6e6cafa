//! Freed memory goes back to the system.

/// Of glibc's malloc, as a process finds them in its environment when it begins.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const SETTINGS: [(&str, &str); 2] = [
    // Blocks from so many bytes on are the system's own, and go back to it one by one. Less than a patch in three colours:
    // a learned background keeps dozens of these, and leaves holes where it was.
    ("MALLOC_MMAP_THRESHOLD_", "32768"),
    // So many heaps, however many threads there are: what one of them has freed is of use to the others.
    ("MALLOC_ARENA_MAX", "2"),
];

/// Begins the program anew with those of the settings that it does not have.
///
/// glibc raises the threshold whenever a larger block is freed. Setting up a background frees matrices of megabytes, again and
/// again, and what lies between them then keeps them from going back: a program that needs 60 MB holds twice that after some
/// minutes. And it gives nearly every thread a heap, each of which keeps what it once needed at most.
/// Both are fixed by the environment when a process begins, or by a function that only unsafe code can call.
pub(super) fn hand_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        use std::os::unix::process::CommandExt;

        let missing: Vec<_> = SETTINGS.into_iter().filter(|(name, _)| std::env::var_os(name).is_none()).collect();
        if missing.is_empty() {
            return;
        }
        let mut arguments = std::env::args_os();
        if let (Ok(program), Some(own_name)) = (std::env::current_exe(), arguments.next()) {
            let error = std::process::Command::new(program).arg0(own_name).args(arguments).envs(missing).exec();
            // It takes more memory then, and that is all.
            tracing::debug!("cannot fix malloc's settings: {error}");
        }
    }
}
