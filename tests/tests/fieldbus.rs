//! The emulated board on the line of its fieldbus, with a master that others wrote.

use std::process::Command;
use std::time::Duration;

use kband_control::wire::{Request, Response};
use kband_host::board::{Address, Emulated};
use kband_tests::emulator::Machine;
use kband_tests::images;
use kband_tests::terminal::Terminal;

/// The master of PyPI.
#[test]
fn pymodbus_reads_and_runs_the_board() {
    let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("board.flash");
    let address = Address {
        flash_image: Some(flash.clone()),
        ..Address::of("qemu", Some(&image))
    };
    let mut link = address.open(Emulated::AtRest).unwrap();
    for request in [
        Request::set("bus_address", 17.0),
        // A busy desk delays requests.
        Request::set("bus_timeout", 60.0),
        Request::set("bus", 1.0),
        Request::Save,
    ] {
        link.ask(&request, |response| assert_eq!(response, Response::Done))
            .unwrap();
    }
    drop(link);
    let board = Terminal::on_bus(&image, &flash, Duration::from_secs(600));
    let python = images::target_folder().join("python/venv/bin/python3");
    let ran = Command::new(python)
        .arg(kband_tests::root().join("tests/clients/board.py"))
        .arg(board.port())
        .arg("17")
        .output()
        .expect("tests/setup.sh installs it");
    let said = String::from_utf8_lossy(&ran.stdout);
    let wrong = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{said} {wrong}");
    assert!(said.starts_with("pymodbus: held"), "{said}");
}
