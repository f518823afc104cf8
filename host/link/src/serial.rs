//! Serial ports: search for them, and exclusive opening.

use std::fs::{DirEntry, File};
use std::path::{Path, PathBuf};

use kband_scene::refusal::Refusal;

/// Prefixes of names of serial ports: USB on Linux, USB on macOS.
const NAMES: [&str; 4] = ["ttyACM", "ttyUSB", "cu.usbmodem", "cu.usbserial"];

/// The only serial port of this computer.
pub fn only_port() -> Result<PathBuf, Refusal> {
    only(ports(Path::new("/dev")))
}

fn only(mut ports: Vec<PathBuf>) -> Result<PathBuf, Refusal> {
    if ports.len() > 1 {
        let cause = format!("there are several serial ports: {}", names(&ports));
        let next = format!("name the board's, such as --on {}", ports[0].display());
        return Err(Refusal::new(cause, next));
    }
    ports.pop().ok_or_else(|| {
        let cause = "no board: there is no serial port (/dev/ttyACM*, /dev/ttyUSB*)";
        let next = "plug in the board's link, name its port with --on /dev/PORT, or try --on qemu";
        Refusal::new(cause, next)
    })
}

fn ports(folder: &Path) -> Vec<PathBuf> {
    let is_port = |entry: &DirEntry| {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        NAMES.iter().any(|beginning| name.starts_with(beginning))
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let ports = entries.filter(is_port).map(|entry| entry.path());
    let mut ports: Vec<PathBuf> = ports.collect();
    ports.sort();
    ports
}

fn names(ports: &[PathBuf]) -> String {
    let names = ports.iter().map(|port| port.display().to_string());
    names.collect::<Vec<_>>().join(", ")
}

/// Opens a port exclusively, at 115200 baud, 8 bits, no parity.
#[cfg(unix)]
pub fn open(path: &Path) -> Result<File, Refusal> {
    use std::os::unix::fs::OpenOptionsExt;

    use rustix::fs::{OFlags, fcntl_setfl};
    use rustix::io::Errno;
    use rustix::termios::{ControlModes, OptionalActions, ioctl_tiocexcl, tcgetattr, tcsetattr};
    let name = &path.display();
    let busy = || {
        let next = "close the other kband or terminal program, and try again";
        Refusal::new(format!("{name}: another program uses the port"), next)
    };
    let unopened = |why: &str| {
        let accepted = "qemu, or a serial port such as /dev/ttyACM0";
        let next = format!("{why}: {}", present(&ports(Path::new("/dev"))));
        Refusal::value("--on", name, accepted, next)
    };
    // Does not wait for a carrier, and does not become the controlling terminal.
    let flags = OFlags::NONBLOCK | OFlags::NOCTTY;
    let port = File::options()
        .read(true)
        .write(true)
        .custom_flags(flags.bits() as i32)
        .open(path)
        .map_err(|error| match error.raw_os_error().map(Errno::from_raw_os_error) {
            Some(Errno::BUSY) => busy(),
            Some(Errno::ACCESS) => Refusal::new(
                format!("{name}: you have no permission to open this port"),
                "join the group that owns it (sudo usermod -aG dialout $USER), and log in again",
            ),
            _ => unopened(&error.to_string()),
        })?;
    let is_none = |_: Errno| unopened("this is no serial port");
    let mut modes = tcgetattr(&port).map_err(&is_none)?;
    // The lock excludes another kband, the exclusive mode all programs except those of root.
    port.try_lock().map_err(|_| busy())?;
    ioctl_tiocexcl(&port).map_err(&is_none)?;
    modes.make_raw();
    modes.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    modes.control_modes -= ControlModes::CSTOPB | ControlModes::CRTSCTS;
    modes
        .set_speed(115_200)
        .and_then(|()| tcsetattr(&port, OptionalActions::Flush, &modes))
        .and_then(|()| fcntl_setfl(&port, OFlags::empty()))
        .map_err(|error| {
            let cause = format!("{name}: the port does not take 115200 baud: {error}");
            Refusal::new(cause, "use another adapter")
        })?;
    Ok(port)
}

/// Refuses, because ports are not supported on this system.
#[cfg(not(unix))]
pub fn open(path: &Path) -> Result<File, Refusal> {
    let name = path.display();
    let cause = format!("{name}: this kband opens serial ports on Linux and macOS only");
    Err(Refusal::new(cause, "use kband there, or --on qemu"))
}

fn present(ports: &[PathBuf]) -> String {
    match ports {
        [] => "plug in the board, no serial port is there".into(),
        ports => format!("there is {}", names(ports)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_port_is_used_and_several_are_listed() {
        let folder = tempfile::tempdir().unwrap();
        for other in ["tty0", "null", "ttyS0"] {
            std::fs::write(folder.path().join(other), "").unwrap();
        }
        let message = || only(ports(folder.path())).unwrap_err().to_string();
        for expected in ["no serial port", "--on qemu"] {
            assert!(message().contains(expected), "{}", message());
        }
        let one = folder.path().join("ttyUSB3");
        std::fs::write(&one, "").unwrap();
        assert_eq!(only(ports(folder.path())).unwrap(), one);
        std::fs::write(folder.path().join("ttyACM0"), "").unwrap();
        for expected in ["ttyACM0", "ttyUSB3"] {
            assert!(message().contains(expected), "{}", message());
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_port_opens_once_and_other_files_are_refused() {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap();
        let path = Path::new(name.to_str().unwrap());
        let port = open(path).unwrap();
        let message = open(path).unwrap_err().to_string();
        assert!(message.contains("another program uses"), "{message}");
        drop(port);
        open(path).unwrap();
        for none in ["/dev/null", "/dev/nothing"] {
            let message = open(Path::new(none)).unwrap_err().to_string();
            for expected in [none, "/dev/ttyACM0"] {
                assert!(message.contains(expected), "{message}");
            }
        }
    }
}
