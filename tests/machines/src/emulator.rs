//! Runs an image on the emulated CPU with a wall-clock limit.

use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::root;

#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub enum Machine {
    /// Olimex STM32-H405: Cortex-M4F with 1 MiB of flash and 128 KiB of RAM.
    CortexM4F,
    /// BBC micro:bit: Cortex-M0 with 256 KiB of flash and 16 KiB of RAM, no FPU, no divider.
    CortexM0,
}

impl Machine {
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
    /// Clock of the desk: the fastest, with times that are not reproducible.
    Free,
    /// Executed instructions; waiting is skipped. Every run gives the same output.
    Steady,
    /// One nanosecond an instruction, so that SysTick counts instructions.
    Instructions,
}

/// Runs an image, which must pass within `limit` of wall-clock time, without input. It is stopped at
/// the limit even if its test has ended. Returns its semihosting output.
pub fn run(
    image: &Path,
    machine: Machine,
    clock: Clock,
    words: &[&str],
    limit: Duration,
) -> String {
    let clock = format!("{clock:?}").to_lowercase();
    let ran = Command::new(root().join("tests/emulator"))
        .args(["--machine", machine.name(), "--clock", &clock])
        .args(["--limit", &limit.as_secs_f64().to_string()])
        .args(words.iter().flat_map(|word| ["--word", word]))
        .arg(image)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .output()
        .expect("tests/emulator starts");
    let text = String::from_utf8_lossy(&ran.stderr).into_owned();
    // Ended by a signal: reported as the shell does.
    let ended = ran.status.signal().map(|signal| 128 + signal);
    match ran.status.code().or(ended) {
        Some(127) => panic!("no QEMU (qemu-system-arm) here; run tests/setup.sh"),
        // 124: the limit; 137: killed after it.
        Some(124 | 137) | None => panic!("the image was cut by its time limit:\n{text}"),
        Some(0) => text,
        Some(status) => panic!("the image failed with exit status {status}:\n{text}"),
    }
}
