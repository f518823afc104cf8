//! An image on the emulated CPU with its serial port on a pseudo-terminal, as a board's at a desk.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::root;

/// Longest wait for the emulator to name its terminal.
const PATIENCE: Duration = Duration::from_secs(30);

/// The emulated board; dropping it ends the emulator.
pub struct Terminal {
    emulator: Child,
    port: PathBuf,
}

impl Terminal {
    /// Starts the image with the argument `word`, for at most `limit`.
    ///
    /// # Panics
    /// It does not start.
    pub fn start(image: &Path, word: &str, limit: Duration) -> Self {
        Self::spawn(image, &["--serial", "pty", "--word", word], limit, &root())
    }

    /// Starts the emulated board with its drive enabled, the fieldbus on a terminal and this file as
    /// its flash.
    ///
    /// # Panics
    /// It does not start.
    pub fn on_bus(image: &Path, flash: &Path, limit: Duration) -> Self {
        let folder = flash.parent().expect("the flash lies in a folder");
        let name = flash.file_name().and_then(|name| name.to_str());
        let name = name.expect("a name in UTF-8");
        let options = ["--bus", "pty", "--word", "run", "--flash", name];
        Self::spawn(image, &options, limit, folder)
    }

    fn spawn(image: &Path, options: &[&str], limit: Duration, place: &Path) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let said = folder.path().join("said");
        let emulator = Command::new(root().join("tests/emulator"))
            .args(["--limit", &limit.as_secs_f64().to_string()])
            .args(["--clock", "free"])
            .args(options)
            .arg(image)
            .current_dir(place)
            .stdin(Stdio::null())
            .stdout(File::create(&said).expect("a file can be made"))
            .stderr(Stdio::null())
            .spawn()
            .expect("tests/emulator starts");
        let mut terminal = Self {
            emulator,
            port: PathBuf::new(),
        };
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            let mut text = String::new();
            // A file that cannot be read yet counts as empty.
            let _ = File::open(&said).and_then(|mut file| file.read_to_string(&mut text));
            let mut words = text.split_whitespace();
            if let Some(port) = words.find(|word| word.starts_with("/dev/")) {
                terminal.port = port.into();
                return terminal;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        panic!("the emulator names no terminal; is there a QEMU? run tests/setup.sh");
    }

    /// The serial port for a desk.
    pub fn port(&self) -> &Path {
        &self.port
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        // On SIGTERM `timeout` ends the emulator too; on SIGKILL it could not.
        let _ = Command::new("kill")
            .args(["-TERM", &self.emulator.id().to_string()])
            .stderr(Stdio::null())
            .status();
        let _ = self.emulator.wait();
    }
}
