//! `kband` run as a user runs it, and what came of it.
#![allow(dead_code)] // Every test program takes what it needs.

use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;
use std::process::{Command, Stdio};

use kband_host::provenance;

/// Wall-clock seconds for one command, a loaded machine allowed for.
pub const LIMIT: &str = "120";

/// What a command came to.
pub struct Came {
    pub status: Option<i32>,
    pub out: String,
    pub said: String,
    words: String,
}

/// Runs `kband` with these words in `folder`; killed at the limit.
pub fn kband(folder: impl AsRef<Path>, words: &str) -> Came {
    run(folder, LIMIT, &words.split(' ').collect::<Vec<_>>())
}

/// Runs `kband` in `folder`; killed after a limit of wall-clock time in s.
pub fn run(folder: impl AsRef<Path>, limit: &str, words: &[&str]) -> Came {
    // Files, for an emulator that was left running would hold a pipe open.
    let [mut out, mut said] = [(); 2].map(|()| tempfile::tempfile().unwrap());
    let status = Command::new("timeout")
        .args(["--kill-after=5", limit])
        .arg(env!("CARGO_BIN_EXE_kband"))
        .args(words)
        .current_dir(folder.as_ref())
        .stdin(Stdio::null())
        .stdout(out.try_clone().unwrap())
        .stderr(said.try_clone().unwrap())
        .status()
        .unwrap();
    Came {
        status: status.code(),
        out: text(&mut out),
        said: text(&mut said),
        words: words.join(" "),
    }
}

/// A pseudo-terminal that takes and gives bytes as they are: its far end, its near end that stays
/// open, and its name.
#[cfg(unix)]
pub fn port() -> (File, File, String) {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

    let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&far).unwrap();
    unlockpt(&far).unwrap();
    let name = ptsname(&far, Vec::new()).unwrap().into_string().unwrap();
    let near = File::options().read(true).write(true).open(&name).unwrap();
    let mut modes = tcgetattr(&near).unwrap();
    modes.make_raw();
    tcsetattr(&near, OptionalActions::Now, &modes).unwrap();
    (File::from(far), near, name)
}

fn text(file: &mut File) -> String {
    let mut bytes = Vec::new();
    file.rewind().unwrap();
    file.read_to_end(&mut bytes).unwrap();
    String::from_utf8_lossy(&bytes).into_owned()
}

impl Came {
    /// This, after that exit status.
    #[track_caller]
    pub fn ended(self, status: i32) -> Self {
        let Self { words, said, .. } = &self;
        assert_eq!(self.status, Some(status), "kband {words}: {said}");
        self
    }

    /// Its output, after exit status 0.
    #[track_caller]
    pub fn done(self) -> String {
        self.ended(0).out
    }

    /// Its output has these words, after exit status 0.
    #[track_caller]
    pub fn says(self, words: &str) {
        let said = self.done();
        assert!(said.contains(words), "no '{words}' in {said}");
    }

    /// The result in the JSON that it printed, after exit status 0.
    #[track_caller]
    pub fn json(self) -> serde_json::Value {
        provenance::without(serde_json::from_str(&self.done()).expect("kband prints JSON"))
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
