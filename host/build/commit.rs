//! The commit that a folder of sources stands at.

use std::path::Path;
use std::process::Command;

/// The commit of the git tree around `folder`, with `-dirty` where a file of it differs from that commit; `unknown` where
/// there is no such tree, or no git to ask.
pub fn commit(folder: &Path) -> String {
    let git = |words: &[&str]| {
        let output = Command::new("git")
            .args(words)
            .current_dir(folder)
            .output()
            .ok()
            .filter(|output| output.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_string())
    };
    let Some(commit) = git(&["rev-parse", "HEAD"]) else {
        return "unknown".into();
    };
    match git(&["status", "--porcelain", "--untracked-files=no"]) {
        Some(changed) if changed.is_empty() => commit,
        _ => format!("{commit}-dirty"),
    }
}
