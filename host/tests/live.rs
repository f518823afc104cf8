//! The dashboard in a terminal of 80 x 24.
#![cfg(all(unix, feature = "live"))]

use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use kband_control::Target;
use kband_control::wire::Request;
use kband_host::board::{Address, Emulated};
use kband_machines::emulator::Machine;
use kband_machines::images;
use kband_machines::terminal::Terminal;
use rustix::process::{Pid, Signal, kill_process, kill_process_group};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Termios, Winsize, tcgetattr, tcsetwinsize};

/// No wait of a test is longer.
const LIMIT: Duration = Duration::from_secs(60);

/// `kband live`, or another verb, in a pseudo-terminal; killed with its children when dropped.
struct Dashboard {
    child: Child,
    keys: File,
    terminal: File,
    before: Termios,
    output: Receiver<Vec<u8>>,
    screen: vt100::Parser,
}

impl Dashboard {
    fn start(arguments: &[&str]) -> Self {
        Self::of("live", arguments)
    }

    fn of(verb: &str, arguments: &[&str]) -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let size = Winsize {
            ws_row: 24,
            ws_col: 80,
            ws_xpixel: 0,
            ws_ypixel: 0,
        };
        tcsetwinsize(&master, size).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap();
        let terminal = File::options()
            .read(true)
            .write(true)
            .open(name.to_str().unwrap())
            .unwrap();
        let before = tcgetattr(&terminal).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_kband"))
            .arg(verb)
            .args(arguments)
            .env("TERM", "xterm-256color")
            .env("RUST_BACKTRACE", "0")
            .stdin(terminal.try_clone().unwrap())
            .stdout(terminal.try_clone().unwrap())
            .stderr(terminal.try_clone().unwrap())
            .process_group(0)
            .spawn()
            .unwrap();
        let keys = File::from(master);
        let mut reader = keys.try_clone().unwrap();
        let (sender, output) = channel();
        // Ends when the last end of the terminal is closed.
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = reader.read(&mut bytes) {
                if sender.send(bytes[..count].to_vec()).is_err() {
                    break;
                }
            }
        });
        Self {
            child,
            keys,
            terminal,
            before,
            output,
            screen: vt100::Parser::new(24, 80, 0),
        }
    }

    fn look(&mut self) {
        while let Ok(bytes) = self.output.recv_timeout(Duration::from_millis(20)) {
            self.screen.process(&bytes);
        }
    }

    fn wait_for(&mut self, words: &str) {
        let begun = Instant::now();
        while !self.screen.screen().contents().contains(words) {
            let waited = begun.elapsed() < LIMIT;
            assert!(waited, "no '{words}':\n{}", self.screen.screen().contents());
            self.look();
        }
    }

    fn press(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).unwrap();
    }

    fn end(&mut self) -> ExitStatus {
        let begun = Instant::now();
        loop {
            self.look();
            if let Some(status) = self.child.try_wait().unwrap() {
                self.look();
                // Its last words may still be on their way through the terminal.
                while !self.is_restored() && begun.elapsed() < LIMIT {
                    self.look();
                }
                return status;
            }
            assert!(begun.elapsed() < LIMIT, "it does not end");
        }
    }

    /// The keys that take the enable away, pause and quit, one after the other.
    fn is_stopped_paused_and_left(&mut self) {
        self.press("e");
        self.wait_for(" OFF ");
        self.press("p");
        self.wait_for("PAUSED");
        self.press("q");
        assert!(self.end().success());
        assert!(self.is_restored());
    }

    fn is_restored(&self) -> bool {
        let screen = self.screen.screen();
        let now = tcgetattr(&self.terminal).unwrap();
        !screen.alternate_screen()
            && !screen.hide_cursor()
            && now.local_modes == self.before.local_modes
            && now.input_modes == self.before.input_modes
            && now.output_modes == self.before.output_modes
    }
}

impl Drop for Dashboard {
    fn drop(&mut self) {
        if let Ok(None) = self.child.try_wait() {
            let group = Pid::from_child(&self.child);
            let _ = kill_process_group(group, Signal::KILL);
            let _ = self.child.wait();
        }
    }
}

#[test]
fn live_keys_work_and_the_terminal_is_restored() {
    let mut dashboard = Dashboard::start(&["--speed", "10"]);
    dashboard.wait_for(" HOLDING ");
    for words in [
        "k against the band",
        "in gear 9",
        "gear band",
        "impact phase",
        "no fault",
    ] {
        dashboard.wait_for(words);
    }
    assert!(dashboard.screen.screen().alternate_screen() && !dashboard.is_restored());
    // From the setpoint of the gear: the search finds no chaos for this lot.
    dashboard.press("+");
    dashboard.wait_for("target k = 0.");
    dashboard.press("x");
    dashboard.wait_for("target chaos");
    dashboard.is_stopped_paused_and_left();
}

#[test]
fn help_lies_over_the_picture_until_it_is_closed() {
    let mut dashboard = Dashboard::start(&["--speed", "10"]);
    dashboard.wait_for(" HOLDING ");
    dashboard.press("?");
    for words in ["? or Esc closes it", "F  fault", "m  limiting"] {
        dashboard.wait_for(words);
    }
    dashboard.press("?");
    // What it covered is there again, and Esc is once more the end.
    let begun = Instant::now();
    while dashboard.screen.screen().contents().contains("closes it") {
        assert!(begun.elapsed() < LIMIT);
        dashboard.look();
    }
    dashboard.press("\x1b");
    assert!(dashboard.end().success() && dashboard.is_restored());
}

#[test]
fn a_long_command_is_seen_to_work_before_its_first_step_is_done() {
    // One step of some minutes.
    let mut command = Dashboard::of("exponent", &["--k", "0.34", "--impacts", "1000000000"]);
    command.wait_for("exponent [");
    command.wait_for("0 %");
    command.wait_for("2s so far");
    assert!(command.child.try_wait().unwrap().is_none());
}

#[test]
fn the_emulated_board_is_looked_at_and_obeys_the_keys() {
    let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    let mut dashboard = Dashboard::start(&["--on", "qemu", "--image", image.to_str().unwrap()]);
    // The soft start, over the link and from the event log.
    for words in ["qemu", "target gear of order 1", "started", "no fault"] {
        dashboard.wait_for(words);
    }
    dashboard.press("x");
    dashboard.wait_for("target chaos");
    dashboard.wait_for("target set");
    dashboard.is_stopped_paused_and_left();
}

#[test]
fn a_board_on_a_serial_port_shows_the_target_that_it_holds() {
    let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    let board = Terminal::start(&image, "run", Duration::from_secs(120));
    let port = board.port().display().to_string();
    // Another desk was there before.
    let mut line = Address::of(&port, None).open(Emulated::Running).unwrap();
    line.tell(&Request::Target(Target::K(0.5))).unwrap();
    // What reads the port notices with the next byte that nobody wants it any more.
    line.tell(&Request::Telemetry(1)).unwrap();
    drop(line);
    let begun = Instant::now();
    let free = || {
        let port = File::options().read(true).write(true).open(&port);
        port.is_ok_and(|port| port.try_lock().is_ok())
    };
    while !free() {
        assert!(begun.elapsed() < LIMIT, "the port stays held");
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut dashboard = Dashboard::start(&["--on", &port]);
    for words in [&port, "target k = 0.5", "no fault"] {
        dashboard.wait_for(words);
    }
    dashboard.press("2");
    dashboard.wait_for("target lock of order 2");
    dashboard.is_stopped_paused_and_left();
}

#[test]
fn it_ends_by_itself_and_by_a_signal() {
    let mut dashboard = Dashboard::start(&["--for", "0.3"]);
    assert!(dashboard.end().success());
    assert!(dashboard.is_restored());

    let mut dashboard = Dashboard::start(&[]);
    dashboard.wait_for("STARTING");
    kill_process(Pid::from_child(&dashboard.child), Signal::TERM).unwrap();
    assert!(dashboard.end().success());
    assert!(dashboard.is_restored());
}
