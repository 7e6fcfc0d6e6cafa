//! Settings that make glibc's malloc return freed memory to the system.

/// Environment variables that glibc's malloc reads when a process starts.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const SETTINGS: [(&str, &str); 2] = [
    // Blocks of at least this many bytes are mapped one by one and return to the system when freed. It is less than a
    // patch in three colours: a learned background keeps dozens of those, which would leave holes in the heap.
    ("MALLOC_MMAP_THRESHOLD_", "32768"),
    // Most heaps, however many threads there are, so that threads can reuse what others have freed.
    ("MALLOC_ARENA_MAX", "2"),
];

/// Executes the program again with those of the settings that its environment lacks.
///
/// By default, glibc raises the threshold whenever a larger block is freed. Setting up a background frees matrices of
/// megabytes again and again, and the small blocks between them then keep them from returning to the system: a program
/// that needs 60 MB holds twice that after some minutes. Also, nearly every thread gets a heap of its own, which keeps
/// the most that it ever needed. Both can be set only by the environment at the start of the process, or by a function
/// that only unsafe code can call.
///
/// Freed memory is not asked back after a burst of requests (`malloc_trim`, unsafe as well): bodies are read into one
/// block each, so that long ones are mapped by themselves, and the little that is left is reused by the next burst.
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
            // Not fatal: the program only uses more memory.
            tracing::debug!("cannot restart with malloc's settings: {error}");
        }
    }
}
