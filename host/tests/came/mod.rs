//! `kband` run as a user runs it, and what came of it.

use std::fs::File;
use std::path::Path;
use std::process::{Command, Stdio};

/// What a command came to.
pub struct Came {
    pub status: Option<i32>,
    pub out: String,
    pub said: String,
    words: String,
}

/// Runs `kband` in `folder`; killed after a limit of wall-clock time in s.
pub fn run(folder: &Path, limit: &str, words: &[&str]) -> Came {
    let file = |name: &str| File::create(folder.join(name)).unwrap();
    let status = Command::new("timeout")
        .args(["--kill-after=5", limit])
        .arg(env!("CARGO_BIN_EXE_kband"))
        .args(words)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(file(".out"))
        .stderr(file(".said"))
        .status()
        .unwrap();
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    Came {
        status: status.code(),
        out: read(".out"),
        said: read(".said"),
        words: words.join(" "),
    }
}

impl Came {
    /// Its output, after exit status 0.
    #[track_caller]
    pub fn done(self) -> String {
        assert_eq!(self.status, Some(0), "kband {}: {}", self.words, self.said);
        self.out
    }

    /// Refused with one message that has these words, and nothing printed.
    #[track_caller]
    pub fn refused(&self, expected: &[&str]) {
        let came = format!("kband {}: {}{}", self.words, self.out, self.said);
        assert_eq!(self.status, Some(2), "{came}");
        assert_eq!(self.said.matches("error:").count(), 1, "{came}");
        for part in expected {
            assert!(self.said.contains(part), "no '{part}' in {came}");
        }
    }
}
