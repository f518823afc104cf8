//! Runs `kband` as a user does, and checks its result.
#![allow(dead_code)] // Every test program takes what it needs.

use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use kband_machines::emulator::Machine;
use kband_machines::images;
use serde_json::Value;
use tempfile::TempDir;

/// Time limit of one command, s of wall-clock time; sufficient on a busy machine.
pub const TIMEOUT: &str = "120";

pub struct Outcome {
    pub status: Option<i32>,
    pub out: String,
    pub stderr: String,
    args: String,
}

pub fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// Runs `kband` with these words in `folder`; killed at the limit.
pub fn kband(folder: impl AsRef<Path>, args: &str) -> Outcome {
    run(folder, TIMEOUT, &args.split(' ').collect::<Vec<_>>())
}

/// Runs `kband` in `folder`; killed after a limit in s of wall-clock time.
pub fn run(folder: impl AsRef<Path>, limit: &str, args: &[&str]) -> Outcome {
    // Files instead of pipes: a remaining emulator would keep a pipe open.
    let [mut out, mut stderr] = [(); 2].map(|()| tempfile::tempfile().unwrap());
    let status = Command::new("timeout")
        .args(["--kill-after=5", limit])
        .arg(env!("CARGO_BIN_EXE_kband"))
        .args(args)
        .current_dir(folder.as_ref())
        .stdin(Stdio::null())
        .stdout(out.try_clone().unwrap())
        .stderr(stderr.try_clone().unwrap())
        .status()
        .unwrap();
    Outcome {
        status: status.code(),
        out: text(&mut out),
        stderr: text(&mut stderr),
        args: args.join(" "),
    }
}

pub fn image() -> String {
    let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    image.to_str().unwrap().to_string()
}

/// Runs `kband` in `folder` on the emulated board; `more` are further words.
pub fn on_board(folder: impl AsRef<Path>, limit: &str, args: &str, more: &[&str]) -> Outcome {
    let image = image();
    let args = args.split(' ').chain(["--on", "qemu", "--image", &image]);
    let args: Vec<&str> = args.chain(more.iter().copied()).collect();
    run(folder, limit, &args)
}

/// Starts `kband` in `folder` with its output and its messages on pipes.
pub fn start(folder: impl AsRef<Path>, args: &str) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kband"));
    command.args(args.split(' ')).current_dir(folder);
    command.stdin(Stdio::piped()).stdout(Stdio::piped());
    command.stderr(Stdio::piped()).spawn().unwrap()
}

/// A raw pseudo-terminal: its far end, its near end, which stays open, and its name.
#[cfg(unix)]
pub fn port() -> (File, File, String) {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    let slave = File::options().read(true).write(true).open(&name).unwrap();
    let mut modes = tcgetattr(&slave).unwrap();
    modes.make_raw();
    tcsetattr(&slave, OptionalActions::Now, &modes).unwrap();
    (File::from(master), slave, name)
}

/// A JSON document without its provenance, for comparing several commands.
fn strip(mut document: Value) -> Value {
    if let Value::Object(fields) = &mut document
        && fields.shift_remove("provenance").is_some()
        && fields.len() == 1
        && let Some(rows) = fields.remove("rows")
    {
        return rows;
    }
    document
}

/// A CSV, JSON or SVG without its provenance.
pub fn stripped(text: &str) -> String {
    if let Ok(document) = serde_json::from_str(text) {
        return format!("{:#}\n", strip(document));
    }
    let aside = |line: &&str| !line.starts_with('#') && !line.starts_with("<metadata>");
    let lines = text.split_inclusive('\n');
    lines.filter(aside).collect()
}

fn text(file: &mut File) -> String {
    let mut bytes = Vec::new();
    file.rewind().unwrap();
    file.read_to_end(&mut bytes).unwrap();
    String::from_utf8_lossy(&bytes).into_owned()
}

impl Outcome {
    #[track_caller]
    pub fn ended(self, status: i32) -> Self {
        let Self { args, stderr, .. } = &self;
        assert_eq!(self.status, Some(status), "kband {args}: {stderr}");
        self
    }

    /// The output, after exit status 0.
    #[track_caller]
    pub fn done(self) -> String {
        self.ended(0).out
    }

    /// The output, after exit status 0 and a check that it contains these words.
    #[track_caller]
    pub fn prints(self, expected: &[&str]) -> String {
        let stdout = self.done();
        for part in expected {
            assert!(stdout.contains(part), "no '{part}' in {stdout}");
        }
        stdout
    }

    /// The printed JSON, after exit status 0.
    #[track_caller]
    pub fn json(self) -> Value {
        strip(serde_json::from_str(&self.done()).expect("kband prints JSON"))
    }

    /// Checks for one refusal that contains these words, and no output.
    #[track_caller]
    pub fn refused(&self, expected: &[&str]) {
        let outcome = format!("kband {}: {}{}", self.args, self.out, self.stderr);
        assert_eq!(self.status, Some(2), "{outcome}");
        assert_eq!(self.stderr.matches("error:").count(), 1, "{outcome}");
        for part in expected {
            assert!(self.stderr.contains(part), "no '{part}' in {outcome}");
        }
    }
}
