//! The emulated CPU in place of a board.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use kband_scene::refusal::Refusal;

/// Path of the emulated image in a clone of the project.
const IMAGE: &str = "target/thumbv7em-none-eabihf/firmware/virtual_feeder";

/// Drive of an emulated board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Emulated {
    /// Off: settings may be changed and saved.
    AtRest,
    /// Runs the default scene at the board's own speed.
    Running,
}

/// How to build the image of this version.
pub(crate) const BUILD: &str = "in kband's own folder: cargo build -p kband-firmware --profile firmware \
    --target thumbv7em-none-eabihf --bin virtual_feeder";

const MIN_QEMU: [u32; 2] = [9, 2];

/// Refuses a QEMU version that is too old, from the output of `--version`.
fn check_version(printed: &str) -> Result<(), Refusal> {
    let version = printed.split_whitespace().nth(3).unwrap_or_default();
    let mut numbers = version.split('.').map_while(|number| number.parse().ok());
    let numbers = [numbers.next(), numbers.next()].map(|number| number.unwrap_or(0));
    if numbers >= MIN_QEMU {
        return Ok(());
    }
    let [major, minor] = MIN_QEMU;
    let key = "the version of qemu-system-arm";
    let accepted = format!("{major}.{minor} or newer");
    let next = "run tests/setup.sh in kband's own folder, which installs it, or use a board";
    Err(Refusal::value(key, version, accepted, next))
}

/// Starts the emulator with its serial port on pipes and its settings in the file `flash`.
pub fn start(
    image: Option<&Path>,
    emulated: Emulated,
    flash: Option<&Path>,
) -> Result<Child, Refusal> {
    let image = image.map_or_else(|| PathBuf::from(IMAGE), Path::to_path_buf);
    if !image.is_file() {
        let path = image.display();
        let cause = format!("{path}: there is no image for the emulated CPU");
        let next = format!("{BUILD}, or name it with --image");
        return Err(Refusal::new(cause, next));
    }
    let resolve = |path: &Path| {
        path.canonicalize()
            .map_err(|error| Refusal::file(path, &error, "give the path of a readable file"))
    };
    let image = resolve(&image)?;
    let mut option = String::from(match emulated {
        Emulated::AtRest => "enable=on,target=native,arg=image,arg=link",
        Emulated::Running => "enable=on,target=native,arg=image,arg=run",
    });
    // A QEMU that does not start is refused below.
    if let Ok(printed) = Command::new("qemu-system-arm").arg("--version").output() {
        check_version(&String::from_utf8_lossy(&printed.stdout))?;
    }
    let mut command = Command::new("qemu-system-arm");
    tether(&mut command);
    if let Some(flash) = flash {
        let flash = resolve(flash)?;
        let (folder, name) = (flash.parent(), flash.file_name());
        if let (Some(folder), Some(name)) = (folder, name) {
            // The board accepts only a short command line, so it receives the name alone.
            command.current_dir(folder);
            option += &format!(",arg={}", name.to_string_lossy().replace(',', ",,"));
        }
    }
    command
        .args(["-M", "olimex-stm32-h405", "-display", "none"])
        .args(["-monitor", "none", "-serial", "null", "-serial", "stdio"])
        .arg("-semihosting-config")
        .arg(option)
        .arg("-kernel")
        .arg(&image)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|error| {
            let cause = format!("qemu-system-arm does not start: {error}");
            Refusal::new(cause, "run tests/setup.sh, which installs it")
        })
}

/// Makes the system kill the process of `command` when the thread that starts it ends.
#[cfg(target_os = "linux")]
fn tether(command: &mut Command) {
    use rustix::process::{Signal, set_parent_process_death_signal};
    use std::os::unix::process::CommandExt;
    let tie = || set_parent_process_death_signal(Some(Signal::KILL)).map_err(Into::into);
    // SAFETY: between fork and exec the closure makes one system call, without lock or memory.
    unsafe { command.pre_exec(tie) };
}

/// On other systems the process ends only when its line closes.
#[cfg(not(target_os = "linux"))]
fn tether(_command: &mut Command) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn qemu_older_than_9_2_is_refused_with_a_next_step() {
        let printed =
            |version| format!("QEMU emulator version {version} (Debian 1:1)\nCopyright\n");
        for good in ["9.2.0", "9.10.1", "10.0.2"] {
            assert_eq!(check_version(&printed(good)), Ok(()));
        }
        for old in ["7.2.9", "9.1.3"] {
            let refused = check_version(&printed(old)).unwrap_err().to_string();
            assert!(refused.contains(old) && refused.contains("9.2 or newer"));
            assert!(refused.contains("tests/setup.sh"), "{refused}");
        }
    }
}
