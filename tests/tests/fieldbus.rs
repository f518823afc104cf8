//! The emulated board on its fieldbus, with a master in this file and masters of others. They go
//! from power-on to gear, change the target, cause a fault and acknowledge it, and save.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::process::Command;
use std::sync::mpsc;
use std::time::{Duration, Instant};

use kband_bus::registers;
use kband_bus::rtu;
use kband_control::wire::{Request, Response};
use kband_control::{Fault, Settings, State, Target};
use kband_host::board::{Address, Emulated};
use kband_tests::bus::{self, UNIT, float};
use kband_tests::emulator::Machine;
use kband_tests::images;
use kband_tests::terminal::Terminal;

/// Time limit of the emulator and of a wait for a state.
const TIMEOUT: Duration = Duration::from_secs(600);
const STATE_TIMEOUT: Duration = Duration::from_secs(120);
/// Number of attempts. On a busy machine a frame may be interrupted, and is then no request.
const ATTEMPTS: u32 = 10;

// Registers.
const CONTROL: u16 = 0;
const KIND: u16 = 1;
const STATUS: u16 = 4;
const STATE: u16 = 5;
const FAULT: u16 = 6;
const SAVE: u16 = 9;
/// Bit of the status word: the target is met.
const TARGET_HELD: u16 = 1 << 8;

/// The emulated board with its enable input on and a terminal as its bus.
struct Board {
    terminal: Terminal,
    /// SavedSettings open, because QEMU checks for a new reader only once a second.
    line: File,
}

impl Board {
    fn start(image: &Path, flash: &Path) -> Self {
        let terminal = Terminal::on_bus(image, flash, TIMEOUT);
        let line = File::options().read(true).write(true).open(terminal.port());
        let line = line.unwrap();
        Self { terminal, line }
    }

    /// Waits for the first answer, by a master that then leaves the line.
    fn wait_until_started(&self) {
        let starts = |_: &u32| {
            let mut first = mbpoll_command(self, "-r 80 -c 1", &[]);
            !first.output().is_ok_and(|ran| ran.status.success())
        };
        assert!((0..ATTEMPTS).take_while(starts).count() < ATTEMPTS as usize);
    }

    /// A master with exclusive use of the line.
    fn master(&self) -> Master {
        let mut line = self.line.try_clone().unwrap();
        let (sender, bytes) = mpsc::channel();
        std::thread::spawn(move || {
            let mut byte = [0];
            // The thread ends with the emulator.
            while line.read_exact(&mut byte).is_ok() && sender.send(byte[0]).is_ok() {}
        });
        Master {
            line: self.line.try_clone().unwrap(),
            bytes,
        }
    }
}

struct Master {
    line: File,
    bytes: mpsc::Receiver<u8>,
}

impl Master {
    /// Function and data of the answer to a request.
    fn request(&mut self, pdu: &[u8]) -> Vec<u8> {
        let frame = bus::frame(UNIT, pdu);
        for _ in 0..ATTEMPTS {
            self.line.write_all(&frame).unwrap();
            let mut answer = Vec::new();
            while let Ok(byte) = self.bytes.recv_timeout(Duration::from_secs(5)) {
                answer.push(byte);
                if let Some(adu) = rtu::check(&answer) {
                    assert_eq!(adu[0], UNIT);
                    return adu[1..].to_vec();
                }
            }
        }
        panic!("no answer to {pdu:?}");
    }

    fn word(&mut self, address: u16) -> u16 {
        match self.request(&bus::read(address, 1))[..] {
            [3, 2, high, low] => u16::from_be_bytes([high, low]),
            ref other => panic!("{address}: {other:?}"),
        }
    }

    fn write(&mut self, address: u16, registers: &[u16]) {
        let pdu = bus::write(address, registers);
        assert_eq!(self.request(&pdu), pdu[..5], "{address}");
    }

    fn set(&mut self, key: &str, value: f32) {
        let index = Settings::KEYS.iter().position(|entry| entry.name == key);
        let address = registers::FIRST_SETTING + 2 * index.unwrap() as u16;
        self.write(address, &float(value));
    }

    /// Waits until a register, under a mask, has this value.
    #[track_caller]
    fn wait(&mut self, address: u16, mask: u16, value: u16) {
        self.wait_until(|master| master.word(address) & mask == value);
    }

    #[track_caller]
    fn wait_until(&mut self, is_met: impl Fn(&mut Self) -> bool) {
        let end = Instant::now() + STATE_TIMEOUT;
        while !is_met(self) {
            let registers =
                [(0, 10), (16, 16)].map(|(at, count)| self.request(&bus::read(at, count)));
            assert!(Instant::now() < end, "{registers:?}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn wait_for(&mut self, state: State) {
        self.wait(STATE, u16::MAX, state.number().into());
    }
}

/// A folder with a flash in which the bus has this authority, a board with this flash, and its
/// address.
fn commissioned(bus: f32) -> (tempfile::TempDir, Board, Address) {
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
        Request::set("bus", bus),
        Request::Save,
    ] {
        link.request(&request, |response| assert_eq!(response, Response::Done))
            .unwrap();
    }
    drop(link);
    (folder, Board::start(&image, &flash), address)
}

#[test]
fn a_master_runs_the_board_from_power_on_to_gear_and_saves() {
    let (_folder, emulated, address) = commissioned(2.0);
    let mut board = emulated.master();
    board.write(CONTROL, &[0, 1]);
    board.write(CONTROL, &[1]);
    board.wait(STATUS, TARGET_HELD, TARGET_HELD);
    assert_eq!(board.word(STATE), u16::from(State::Holding.number()));
    // A new target while the drive runs.
    let [high, low] = float(0.8);
    board.write(KIND, &[32, high, low]);
    // k, in thousandths.
    let is_held = |master: &mut Master| master.word(STATUS) & TARGET_HELD != 0;
    board.wait_until(|master| is_held(master) && master.word(16).abs_diff(800) < 20);
    board.write(CONTROL, &[0]);
    board.wait_for(State::Off);
    // A sensitivity other than the sensor's.
    board.set("sensitivity", 0.5);
    board.write(CONTROL, &[1]);
    board.wait_for(State::Fault);
    let fault = Fault::SensorImplausible.number();
    assert_eq!(board.word(FAULT), u16::from(fault));
    board.write(CONTROL, &[0]);
    board.write(CONTROL, &[0x80]);
    board.wait_for(State::Off);
    board.set("sensitivity", Settings::default().sensitivity);
    board.write(SAVE, &[1]);
    board.wait(SAVE, u16::MAX, 2);
    drop((board, emulated));
    let mut link = address.open(Emulated::AtRest).unwrap();
    link.request(&Request::Held, |response| {
        assert_eq!(response, Response::Held(Target::K(0.8)));
    })
    .unwrap();
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
    let (_folder, board, _) = commissioned(1.0);
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
    let (_folder, board, _) = commissioned(1.0);
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
    let (folder, board, _) = commissioned(1.0);
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
