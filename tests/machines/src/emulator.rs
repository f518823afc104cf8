//! Runs an image on the emulated CPU with a wall-clock limit.

use std::io::{Read, Seek};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::root;

/// The emulated machine.
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub enum Machine {
    /// Olimex STM32-H405: Cortex-M4F with 1 MiB of flash and 128 KiB of RAM.
    CortexM4F,
    /// BBC micro:bit: Cortex-M0 with 256 KiB of flash and 16 KiB of RAM, no FPU, no divider.
    CortexM0,
}

impl Machine {
    /// Rust target of the machine.
    pub fn target(self) -> &'static str {
        match self {
            Self::CortexM4F => "thumbv7em-none-eabihf",
            Self::CortexM0 => "thumbv6m-none-eabi",
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::CortexM4F => "olimex-stm32-h405",
            Self::CortexM0 => "microbit",
        }
    }
}

/// Reference of the emulated clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clock {
    /// The desk's clock: fastest, with times that are not reproducible.
    Free,
    /// Executed instructions; waiting is skipped. Every run gives the same output.
    Steady,
    /// One nanosecond an instruction, so that SysTick counts instructions.
    Instructions,
}

/// Options of a run.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// The machine.
    pub machine: Machine,
    /// Its clock.
    pub clock: Clock,
    /// Argument of the image on its semihosting command line.
    pub word: Option<&'static str>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            machine: Machine::CortexM4F,
            clock: Clock::Steady,
            word: None,
        }
    }
}

/// Result of a run.
#[derive(Clone, Debug)]
pub struct Output {
    /// Exit status of the image, 0 if it passed; `None` where the limit ended it.
    pub status: Option<i32>,
    /// Its semihosting output.
    pub text: String,
}

impl Output {
    /// The text of an image that passed.
    ///
    /// # Panics
    /// The image failed or reached the limit.
    pub fn passed(self) -> String {
        match self.status {
            Some(0) => self.text,
            Some(status) => panic!("the image failed with exit status {status}:\n{}", self.text),
            None => panic!("the image was cut by its time limit:\n{}", self.text),
        }
    }
}

/// The command that runs an image for at most `limit`; standard input is empty unless `input`.
///
/// It ends at the limit even where the test that started it is gone.
fn command(image: &Path, options: Options, limit: Duration) -> Command {
    let mut command = Command::new(root().join("tests/emulator"));
    command.args(["--machine", options.machine.name()]);
    command.args(["--limit", &limit.as_secs_f64().to_string()]);
    command.args([
        "--clock",
        match options.clock {
            Clock::Free => "free",
            Clock::Steady => "steady",
            Clock::Instructions => "instructions",
        },
    ]);
    if let Some(word) = options.word {
        command.args(["--word", word]);
    }
    command.arg(image).stdin(Stdio::null());
    command
}

/// Runs an image for at most `limit` of wall-clock time.
///
/// # Panics
/// There is no emulator; one line names the command that installs it.
pub fn run(image: &Path, options: Options, limit: Duration) -> Output {
    // A file instead of a pipe: a process that outlives the emulator cannot block the end.
    let mut file = tempfile::tempfile().expect("a temporary file can be made");
    let mut child = command(image, options, limit)
        .stdout(Stdio::null())
        .stderr(file.try_clone().expect("a file handle is copied"))
        .spawn()
        .expect("tests/emulator starts");
    // The emulator's own limit comes first; this one covers a broken `timeout` command.
    let last = Instant::now() + limit + Duration::from_secs(15);
    let status = loop {
        if let Some(status) = child.try_wait().expect("the emulator can be waited for") {
            // Ended by a signal: reported as the shell does.
            break status.code().or(status.signal().map(|signal| 128 + signal));
        }
        if Instant::now() > last {
            let _ = child.kill();
            let _ = child.wait();
            break None;
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    let mut bytes = Vec::new();
    file.rewind()
        .and_then(|()| file.read_to_end(&mut bytes))
        .expect("the output is read");
    let text = String::from_utf8_lossy(&bytes).into_owned();
    match status {
        Some(127) => panic!("no QEMU (qemu-system-arm) here; run tests/setup.sh"),
        // 124: the limit; 137: killed after it.
        Some(124 | 137) | None => Output { status: None, text },
        status => Output { status, text },
    }
}
