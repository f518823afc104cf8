//! An image on the emulated CPU with its serial port on a pseudo-terminal, in place of a board.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

use crate::root;

/// The emulated board; dropping it terminates the emulator.
pub struct Terminal {
    emulator: Child,
    port: PathBuf,
    /// Kept open for what the emulator may print.
    _output: BufReader<ChildStdout>,
}

impl Terminal {
    /// Starts the image with the argument `word`, for at most `limit`.
    pub fn start(image: &Path, word: &str, limit: Duration) -> Self {
        Self::spawn(image, &["--serial", "pty", "--word", word], limit, &root())
    }

    /// Starts the emulated board with its drive enabled, the fieldbus on a terminal and this file
    /// as its flash.
    pub fn on_bus(image: &Path, flash: &Path, limit: Duration) -> Self {
        let folder = flash.parent().expect("the flash lies in a folder");
        let name = flash.file_name().and_then(|name| name.to_str());
        let name = name.expect("a name in UTF-8");
        let options = ["--bus", "pty", "--word", "run", "--flash", name];
        Self::spawn(image, &options, limit, folder)
    }

    fn spawn(image: &Path, options: &[&str], limit: Duration, folder: &Path) -> Self {
        let mut emulator = Command::new(root().join("tests/emulator"))
            .args(["--limit", &limit.as_secs_f64().to_string()])
            .args(["--clock", "free"])
            .args(options)
            .arg(image)
            .current_dir(folder)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("tests/emulator starts");
        let mut output = BufReader::new(emulator.stdout.take().expect("its output is a pipe"));
        let mut line = String::new();
        let _ = output.read_line(&mut line);
        let mut words = line.split_whitespace();
        let port = words.find(|word| word.starts_with("/dev/"));
        let port = port.expect("a terminal; is there a QEMU? run tests/setup.sh");
        Self {
            emulator,
            port: port.into(),
            _output: output,
        }
    }

    /// Path of the serial port for a desk.
    pub fn port(&self) -> &Path {
        &self.port
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        // On SIGTERM `timeout` also terminates the emulator; on SIGKILL it could not.
        let _ = Command::new("kill")
            .args(["-TERM", &self.emulator.id().to_string()])
            .stderr(Stdio::null())
            .status();
        let _ = self.emulator.wait();
    }
}
