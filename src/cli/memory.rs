//! Large blocks of memory go back to the system when they are freed.

/// Of glibc's malloc: blocks from so many bytes on are the system's own, and go back to it one by one. Less than a patch in
/// three colours: a learned background keeps dozens of these, and leaves holes where it was.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const THRESHOLD: (&str, &str) = ("MALLOC_MMAP_THRESHOLD_", "32768");

/// Begins the program anew with a fixed threshold, if it has none.
///
/// glibc raises the threshold whenever a larger block is freed. Setting up a background frees matrices of megabytes, again and
/// again, and what lies between them then keeps them from going back: a program that needs 60 MB holds
/// twice that after some minutes.
/// The threshold is fixed by the environment when a process begins, or by a function that only unsafe code can call.
pub(super) fn hand_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        use std::os::unix::process::CommandExt;

        let (name, bytes) = THRESHOLD;
        if std::env::var_os(name).is_some() {
            return;
        }
        let mut arguments = std::env::args_os();
        if let (Ok(program), Some(own_name)) = (std::env::current_exe(), arguments.next()) {
            let error = std::process::Command::new(program).arg0(own_name).args(arguments).env(name, bytes).exec();
            // It takes more memory then, and that is all.
            tracing::debug!("cannot fix malloc's threshold: {error}");
        }
    }
}
