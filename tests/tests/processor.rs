//! Processor in the loop: the controller on the emulated CPU behind a serial port, the plant at the
//! desk.

use std::time::Duration;

use kband_control::{Event, Fault, Target};
use kband_host::board::{Address, Emulated};
use kband_host::desk::Desk;
use kband_host::simulate::{DEFAULT, Fidelity, SceneFile, Watch, run_on, run_watched};
use kband_plant::{Change, Disturbance};
use kband_tests::emulator::Machine;
use kband_tests::images;
use kband_tests::terminal::Terminal;

#[test]
fn a_capture_over_a_serial_port_has_the_bits_of_the_desk() {
    let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    let board = Terminal::start(&image, "link", Duration::from_secs(150));
    let mut file = SceneFile::parse(DEFAULT).unwrap();
    // Parts with constant restitution, which a kick brings into lock.
    file.scene.target = Target::Locked { order: 1 };
    file.scene.scatter.clear();
    // Soft start, plan, kick, evaluation, lock; then the supply sags.
    file.duration = 2.9;
    let sag = Disturbance {
        at: 2.515,
        change: Change::BrownOut(true),
    };
    file.scene.disturbances = std::iter::once(sag).collect();
    let desk = Desk::new(Some(1));
    let address = Address::new(&board.port().display().to_string(), None);
    let line = address.open(Emulated::AtRest).unwrap();
    let emulated = run_on(line, &file, Watch::ALL_CYCLES, &desk).unwrap();
    let simulated = run_watched(&file, Fidelity::Waveform, Watch::ALL_CYCLES, &desk).unwrap();
    assert_eq!(emulated.moments().len(), 145);
    for (a, b) in emulated.moments().iter().zip(simulated.moments()) {
        assert_eq!(a, b);
    }
    let mut events = emulated.events();
    assert!(events.any(|happened| happened.event == Event::Locked));
    assert_eq!(emulated.last().fault, Some(Fault::WatchdogReset));
}
