//! Processor in the loop: the controller on the emulated CPU behind a serial port, the plant at the
//! desk.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use kband_control::{Event, Fault, Target};
use kband_host::board::{Address, Emulated};
use kband_host::desk::Desk;
use kband_host::simulate::{DEFAULT, Fidelity, SceneFile, Watch, run_on, watched};
use kband_plant::{Change, Disturbance};
use kband_tests::emulator::Machine;
use kband_tests::images;
use kband_tests::terminal::Terminal;

fn image() -> std::path::PathBuf {
    images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F)
}

#[test]
fn a_capture_over_a_serial_port_has_the_bits_of_the_desk() {
    let board = Terminal::start(&image(), "link", Duration::from_secs(150));
    let mut file = SceneFile::parse(DEFAULT).unwrap();
    // Parts of constant restitution, which a kick locks.
    file.scene.target = Target::Locked { order: 1 };
    file.scene.scatter.clear();
    // Soft start, plan, kick, judging, lock; then the supply sags.
    file.duration = 2.9;
    let sag = Disturbance {
        at: 2.515,
        change: Change::BrownOut(true),
    };
    file.scene.disturbances = std::iter::once(sag).collect();
    let desk = Desk::new(Some(1)).unwrap();
    let line = Address::of(&board.port().display().to_string(), None)
        .open(Emulated::AtRest)
        .unwrap();
    let emulated = run_on(line, &file, Watch::KEPT, &desk).unwrap();
    let simulated = watched(&file, Fidelity::Waveform, Watch::KEPT, &desk).unwrap();
    assert_eq!(emulated.moments().len(), 145);
    for (a, b) in emulated.moments().iter().zip(simulated.moments()) {
        assert_eq!(a, b);
    }
    let mut events = emulated.events();
    assert!(events.any(|happened| happened.event == Event::Locked));
    assert_eq!(emulated.last().fault, Some(Fault::WatchdogReset));
}

/// Environment variable with the image for the helper process below.
const HELD: &str = "KBAND_TESTS_HELD_IMAGE";

#[test]
#[ignore = "the process that a_killed_desk_takes_its_emulator_along kills"]
fn hold_an_emulator() {
    if let Some(image) = std::env::var_os(HELD) {
        let _line = Address::of("qemu", Some(Path::new(&image)))
            .open(Emulated::AtRest)
            .unwrap();
        std::thread::sleep(Duration::from_secs(100));
    }
}

#[test]
fn a_killed_desk_takes_its_emulator_along() {
    let folder = tempfile::tempdir().unwrap();
    let held = folder.path().join("held");
    std::fs::copy(image(), &held).unwrap();
    let name = held.display().to_string();
    let running = || {
        let processes = std::fs::read_dir("/proc").unwrap().flatten();
        let lines = processes.flat_map(|process| std::fs::read(process.path().join("cmdline")));
        let mut lines = lines.map(|line| String::from_utf8_lossy(&line).into_owned());
        lines.any(|line| line.starts_with("qemu") && line.contains(&name))
    };
    let wait_for = |wanted: bool| {
        let end = Instant::now() + Duration::from_secs(40);
        while running() != wanted && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(20));
        }
        running() == wanted
    };
    // The process ends by itself after its sleep.
    let mut desk = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "hold_an_emulator", "--ignored"])
        .env(HELD, &held)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let began = wait_for(true);
    // Killed without a request to end: it cannot clean up.
    let killed = desk.kill().and_then(|()| desk.wait());
    let ended = wait_for(false);
    assert!(began, "no emulator was started");
    assert!(killed.is_ok(), "{killed:?}");
    assert!(ended, "the emulator outlives the desk");
}
