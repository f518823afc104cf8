//! Processes that must not outlive this one, however it ends.

use std::process::Command;

/// Has the process that `command` starts killed when the thread that starts it is gone, even where
/// that is killed and cannot clean up.
#[cfg(target_os = "linux")]
pub(crate) fn tether(command: &mut Command) {
    use rustix::process::{Signal, set_parent_process_death_signal};
    use std::os::unix::process::CommandExt;

    let tie = || set_parent_process_death_signal(Some(Signal::KILL)).map_err(Into::into);
    // SAFETY: between fork and exec the closure makes one system call, with no lock and no memory.
    unsafe { command.pre_exec(tie) };
}

/// Elsewhere the process ends with its line alone.
#[cfg(not(target_os = "linux"))]
pub(crate) fn tether(_command: &mut Command) {}
