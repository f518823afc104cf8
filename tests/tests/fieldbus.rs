//! The emulated board on its fieldbus, with masters of others. They run it to a target, change the
//! target and stop it. The flashed image is tested in `tests/machines/tests/bus.rs`.

use std::fs::File;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use kband_control::wire::{Request, Response};
use kband_host::board::{Address, Emulated};
use kband_tests::bus::{UNIT, float};
use kband_tests::emulator::Machine;
use kband_tests::images;
use kband_tests::terminal::Terminal;

/// Time limit of the emulator and of a wait for a state.
const TIMEOUT: Duration = Duration::from_secs(600);
const STATE_TIMEOUT: Duration = Duration::from_secs(120);
/// Number of attempts. On a busy machine a frame may be interrupted, and is then no request.
const ATTEMPTS: u32 = 10;
/// Bit of the status word: the target is met.
const TARGET_HELD: u16 = 1 << 8;

/// The emulated board with its enable input on and a terminal as its bus.
struct Board {
    terminal: Terminal,
    /// Kept open, because QEMU checks for a new reader only once a second.
    _line: File,
}

impl Board {
    fn start(image: &Path, flash: &Path) -> Self {
        let terminal = Terminal::on_bus(image, flash, TIMEOUT);
        let line = File::options().read(true).write(true).open(terminal.port());
        Self {
            terminal,
            _line: line.unwrap(),
        }
    }

    /// Waits for the first answer, by a master that then leaves the line.
    fn wait_until_started(&self) {
        let starts = |_: &u32| {
            let mut first = mbpoll_command(self, "-r 80 -c 1", &[]);
            !first.output().is_ok_and(|ran| ran.status.success())
        };
        assert!((0..ATTEMPTS).take_while(starts).count() < ATTEMPTS as usize);
    }
}

/// A folder with a flash in which the bus has authority, and a board with this flash.
fn commissioned() -> (tempfile::TempDir, Board) {
    let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("board.flash");
    let address = Address {
        flash_image: Some(flash.clone()),
        ..Address::new("qemu", Some(&image))
    };
    let mut link = address.open(Emulated::AtRest).unwrap();
    for request in [
        Request::set("bus_address", UNIT.into()),
        // A busy desk delays its requests.
        Request::set("bus_timeout", 60.0),
        Request::set("bus", 1.0),
        Request::Save,
    ] {
        link.request(&request, |response| assert_eq!(response, Response::Done))
            .unwrap();
    }
    drop(link);
    (folder, Board::start(&image, &flash))
}

/// Runs a program that must succeed; returns its output.
fn run(command: &mut Command) -> String {
    let ran = command.output().expect("tests/setup.sh installs it");
    let output = String::from_utf8_lossy(&ran.stdout).into_owned();
    let wrong = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{command:?}: {output} {wrong}");
    output
}

/// `mbpoll` with these arguments; a pseudo-terminal has no parity.
fn mbpoll_command(board: &Board, arguments: &str, values: &[&str]) -> Command {
    let mut command = Command::new("mbpoll");
    let fixed = "-m rtu -a 17 -b 19200 -P none -0 -1 -q -o 5";
    command.args(fixed.split(' ')).args(arguments.split(' '));
    command.arg(board.terminal.port()).args(values);
    command
}

/// Output of `mbpoll` for these arguments; it fails if the board refuses.
fn mbpoll(board: &Board, arguments: &str, values: &[&str]) -> String {
    let mut command = mbpoll_command(board, arguments, values);
    for _ in 0..ATTEMPTS {
        let ran = command.output().expect("tests/setup.sh installs it");
        if ran.status.success() {
            return String::from_utf8_lossy(&ran.stdout).into_owned();
        }
        let wrong = String::from_utf8_lossy(&ran.stderr);
        assert!(wrong.contains("timed out"), "{command:?}: {wrong}");
    }
    panic!("no answer to {command:?}");
}

/// The master of Debian, which uses libmodbus.
#[test]
fn mbpoll_reads_and_runs_the_board() {
    let (_folder, board) = commissioned();
    board.wait_until_started();
    let version = mbpoll(&board, "-r 80 -c 1", &[]);
    assert!(version.contains("[80]: \t1"), "{version}");
    let frequency = mbpoll(&board, "-t 4:float -B -r 100 -c 1", &[]);
    assert!(frequency.contains("[100]: \t50"), "{frequency}");
    mbpoll(&board, "-r 0", &["0"]);
    let [high, low] = float(0.8).map(|word| word.to_string());
    mbpoll(&board, "-r 1", &["32", &high, &low]);
    mbpoll(&board, "-r 0", &["1"]);
    let wait = |mask: u16, value: u16| {
        let end = Instant::now() + STATE_TIMEOUT;
        loop {
            let output = mbpoll(&board, "-r 4 -c 1", &[]);
            let word = output.split("[4]: \t").nth(1).expect("the status word");
            let word: u16 = word.split_whitespace().next().unwrap().parse().unwrap();
            if word & mask == value {
                return;
            }
            assert!(Instant::now() < end, "status word {word:#x}");
        }
    };
    wait(TARGET_HELD, TARGET_HELD);
    mbpoll(&board, "-r 0", &["0"]);
    // The drive is off.
    wait(1 << 1, 0);
}

/// The master of PyPI.
#[test]
fn pymodbus_reads_and_runs_the_board() {
    let (_folder, board) = commissioned();
    let client = kband_tests::root().join("tests/clients/board.py");
    let mut python = Command::new(images::target_folder().join("python/venv/bin/python3"));
    python.arg(client).arg(board.terminal.port());
    let output = run(python.arg(UNIT.to_string()));
    println!("{output}");
    assert!(output.starts_with("pymodbus: held"), "{output}");
}

/// The C library of many masters.
#[test]
fn libmodbus_reads_and_runs_the_board() {
    let (folder, board) = commissioned();
    let client = folder.path().join("client");
    let source = kband_tests::root().join("tests/clients/board.c");
    let mut gcc = Command::new("gcc");
    gcc.args(["-Wall", "-Wextra", "-Werror", "-o"]).arg(&client);
    run(gcc.arg(&source).arg("-lmodbus"));
    board.wait_until_started();
    let mut client = Command::new(client);
    let output = run(client.arg(board.terminal.port()).arg(UNIT.to_string()));
    println!("{output}");
    assert!(output.starts_with("libmodbus: held"), "{output}");
}
