//! The emulated board on the line of its fieldbus, with a master that others wrote.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use kband_control::wire::{Request, Response};
use kband_host::board::{Address, Emulated};
use kband_tests::emulator::Machine;
use kband_tests::images;

/// Unit of the board.
const UNIT: u8 = 17;
/// Longest life of the emulator, s.
const LIMIT_S: &str = "600";

/// The emulated board with its enable input on and a terminal as its bus.
struct Board {
    emulator: Child,
    terminal: PathBuf,
    /// Held open: QEMU looks for another reader only once a second.
    _line: File,
}

impl Drop for Board {
    /// `timeout` passes the signal on to the emulator, and ends with it.
    fn drop(&mut self) {
        let mut kill = Command::new("kill");
        let _ = kill.arg(self.emulator.id().to_string()).status();
        let _ = self.emulator.wait();
    }
}

impl Board {
    /// Starts the board with this flash.
    fn start(image: &Path, flash: &Path) -> Self {
        let name = flash.file_name().unwrap().to_str().unwrap();
        let words = format!("enable=on,target=native,arg=image,arg=run,arg={name}");
        let mut emulator = Command::new("timeout")
            .args(["--foreground", "--kill-after=5", LIMIT_S])
            .args(["qemu-system-arm", "-M", "olimex-stm32-h405"])
            .args(["-display", "none", "-monitor", "none"])
            .args(["-serial", "null", "-serial", "null", "-serial", "null"])
            .args(["-serial", "pty", "-semihosting-config", &words, "-kernel"])
            .arg(image)
            .current_dir(flash.parent().unwrap())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the emulator starts");
        let mut said = BufReader::new(emulator.stdout.take().unwrap());
        let terminal = loop {
            let mut line = String::new();
            let read = said.read_line(&mut line).unwrap();
            assert!(read > 0, "the emulator names its terminal");
            if let Some((_, rest)) = line.split_once("redirected to ") {
                break PathBuf::from(rest.split_whitespace().next().unwrap());
            }
        };
        let options = File::options().read(true).write(true).clone();
        let line = options.open(&terminal).unwrap();
        Self {
            emulator,
            terminal,
            _line: line,
        }
    }
}

/// A folder with a flash in which the bus commands the board.
fn commissioned(image: &Path) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let address = Address {
        flash_image: Some(folder.path().join("board.flash")),
        ..Address::of("qemu", Some(image))
    };
    let mut link = address.open(Emulated::AtRest).unwrap();
    for request in [
        Request::set("bus_address", UNIT.into()),
        // A busy desk delays requests.
        Request::set("bus_timeout", 60.0),
        Request::set("bus", 1.0),
        Request::Save,
    ] {
        link.ask(&request, |response| assert_eq!(response, Response::Done))
            .unwrap();
    }
    folder
}

/// The master of PyPI.
#[test]
fn pymodbus_reads_and_runs_the_board() {
    let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    let folder = commissioned(&image);
    let board = Board::start(&image, &folder.path().join("board.flash"));
    let root = kband_tests::root();
    let python = images::target_folder().join("python/venv/bin/python3");
    let ran = Command::new(python)
        .arg(root.join("tests/clients/board.py"))
        .arg(&board.terminal)
        .arg(UNIT.to_string())
        .output()
        .expect("tests/setup.sh installs it");
    let said = String::from_utf8_lossy(&ran.stdout);
    let wrong = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{said} {wrong}");
    println!("{said}");
    assert!(said.starts_with("pymodbus: held"), "{said}");
}
