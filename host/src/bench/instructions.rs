//! Instructions per impact on the emulated microcontrollers, if image and emulator are installed.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};

/// Count of one kernel on one workload.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Count {
    /// Name of the kernel.
    pub kernel: String,
    /// Name of the workload.
    pub workload: String,
    /// `m4f` or `m0`.
    pub cpu: String,
    /// Instructions per impact.
    pub instructions: u64,
}

/// The emulated machines: QEMU's name, Rust target, name of the CPU.
pub(super) const MACHINES: [(&str, &str, &str); 2] = [
    ("olimex-stm32-h405", "thumbv7em-none-eabihf", "m4f"),
    ("microbit", "thumbv6m-none-eabi", "m0"),
];

/// Instructions for installing the emulator and building the images.
pub const NEXT: &str = "tests/setup.sh brings emulator and targets; then, in the project's folder, for each of \
    thumbv7em-none-eabihf and thumbv6m-none-eabi: cargo build --profile firmware --package kband-emulated \
    --bins --target TARGET --target-dir target/emulated";

/// The counts printed by the images, or the reason why there are none.
#[must_use]
pub fn counts() -> (Vec<Count>, Option<String>) {
    let mut counts = Vec::new();
    let mut missing = None;
    for (machine, target, _) in MACHINES {
        match image(target, "kernel_cost").and_then(|image| run(machine, &image)) {
            Ok(text) => counts.extend(text.lines().filter_map(parse)),
            Err(cause) => missing = Some(cause),
        }
    }
    (counts, missing)
}

/// Path of the image of the emulated tests.
///
/// It is in the folder of `CARGO_TARGET_DIR`, in the one this program was built in, or in `target`.
pub(super) fn image(target: &str, name: &str) -> Result<PathBuf, String> {
    let named = std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from);
    let own = std::env::current_exe()
        .ok()
        .and_then(|program| Some(program.parent()?.parent()?.to_path_buf()));
    let folders = [named, own, Some("target".into())];
    let below = |folder: PathBuf| {
        folder
            .join("emulated")
            .join(target)
            .join("firmware")
            .join(name)
    };
    let paths: Vec<PathBuf> = folders.into_iter().flatten().map(below).collect();
    let found = paths.iter().find(|path| path.is_file());
    found.cloned().ok_or_else(|| {
        format!(
            "no image {}",
            paths
                .first()
                .map_or(Path::new(""), PathBuf::as_path)
                .display()
        )
    })
}

/// The emulator with an image, limited to a minute.
pub(super) fn emulator(machine: &str, image: &Path) -> Command {
    let mut command = Command::new("timeout");
    command
        .args(["--kill-after=2", "60", "qemu-system-arm", "-M", machine])
        .args(["-display", "none", "-monitor", "none", "-serial", "null"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(image)
        .stdin(Stdio::null());
    command
}

/// Message for a failed emulator.
pub(super) fn failed(machine: &str, status: ExitStatus) -> String {
    format!("qemu-system-arm on {machine} ended with {status}; tests/setup.sh brings it")
}

/// Output of the image.
fn run(machine: &str, image: &Path) -> Result<String, String> {
    let output = emulator(machine, image)
        .args(["-icount", "shift=0"])
        .output()
        .map_err(|error| format!("no emulator: {error}"))?;
    if output.status.success() {
        Ok(String::from_utf8_lossy(&output.stderr).into_owned())
    } else {
        Err(failed(machine, output.status))
    }
}

/// `instructions KERNEL WORKLOAD CPU COUNT`.
fn parse(line: &str) -> Option<Count> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let ["instructions", kernel, workload, cpu, count] = words[..] else {
        return None;
    };
    // The images' mean over their orbits counts as the sweep.
    let workload = if workload == "orbits" {
        "sweep"
    } else {
        workload
    };
    Some(Count {
        kernel: kernel.into(),
        workload: workload.into(),
        cpu: cpu.into(),
        instructions: count.parse().ok()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_the_image_is_read() {
        let count = parse("instructions hybrid orbits m4f 412").unwrap();
        assert_eq!(
            (count.kernel.as_str(), count.workload.as_str()),
            ("hybrid", "sweep")
        );
        assert_eq!((count.cpu.as_str(), count.instructions), ("m4f", 412));
        assert_eq!(parse("instructions hybrid orbits m4f"), None);
        assert_eq!(parse("hash hybrid 0011"), None);
    }
}
