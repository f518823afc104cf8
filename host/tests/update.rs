//! From a new board to an update over a link that loses bytes, after which the board runs its
//! recipe again. It runs `kband` on a pseudo-terminal and the flashed image on its emulated chip.
#![cfg(unix)]

mod outcome;

use std::io::{Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use kband_control::Target;
use kband_control::wire::{Request, Response};
use kband_machines::chip::kind::Kind;
use kband_machines::hazards::Hazard;
use kband_machines::images;
use kband_machines::rig::{Act, Rig, ticks};
use outcome::Outcome;

/// Time limit of one command, s of wall-clock time; the emulated chip is slower than the board.
const TIMEOUT: &str = "600";
/// Of so many pieces of bytes from the desk, and from the board, one is lost.
const LOST_FROM_DESK: usize = 41;
const LOST_FROM_BOARD: usize = 97;
/// Simulated time between two reads of the line, and longest one without a byte, s.
const STEP: f64 = 0.005;
const IDLE: f64 = 2.0;

/// Runs `kband` on a board's line that loses bytes, and the board while the desk sends.
fn kband(rig: &mut Rig, folder: &Path, args: &str) -> Outcome {
    let (mut master, mut slave, name) = outcome::port();
    let mut from_desk = master.try_clone().unwrap();
    let (send, bytes) = channel();
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let send = send;
            let mut buffer = [0; 1024];
            while let Ok(count @ 1..) = from_desk.read(&mut buffer) {
                if done.load(Ordering::Relaxed) || send.send(buffer[..count].to_vec()).is_err() {
                    break;
                }
            }
        });
        scope.spawn(|| {
            let bytes = bytes;
            let mut sent = rig.sent().len();
            let (mut requests, mut answers) = (0, 0);
            let mut idle_from = rig.time();
            while !done.load(Ordering::Relaxed) {
                let idles = u64::from(rig.time() >= idle_from);
                match bytes.recv_timeout(Duration::from_millis(50 * idles)) {
                    Ok(bytes) => {
                        requests += 1;
                        if requests % LOST_FROM_DESK != 0 {
                            rig.act(&Act::Link(bytes));
                        }
                        idle_from = rig.time() + IDLE;
                    }
                    Err(RecvTimeoutError::Timeout) if rig.time() < idle_from => {}
                    Err(RecvTimeoutError::Timeout) => continue,
                    Err(RecvTimeoutError::Disconnected) => break,
                }
                rig.run_for(STEP);
                let all = rig.sent();
                if all.len() > sent {
                    answers += 1;
                    let is_lost = answers % LOST_FROM_BOARD == 0;
                    if !is_lost && master.write_all(&all[sent..]).is_err() {
                        break;
                    }
                    sent = all.len();
                }
            }
        });
        let args: Vec<&str> = args.split(' ').chain(["--on", &name]).collect();
        let outcome = outcome::run(folder, TIMEOUT, &args);
        done.store(true, Ordering::Relaxed);
        // One byte ends the reader's wait.
        slave.write_all(&[0]).unwrap();
        outcome
    })
}

#[test]
fn an_updated_board_with_two_slots_runs_its_recipe() {
    updated_it_runs_its_recipe(Kind::Stm32f405);
}

#[test]
fn an_updated_board_with_one_slot_runs_its_recipe() {
    updated_it_runs_its_recipe(Kind::Stm32g474);
}

fn updated_it_runs_its_recipe(kind: Kind) {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let hazard = Hazard::new("update", 50.0, Target::Amplitude(0.2));
    let mut rig = hazard.commissioned(kind);
    rig.chip.board.flash.erases_in = Some(ticks(0.02));
    outcome::kband(folder, "update --new-key plant.key").done();
    for args in [
        "update --set-key plant.key.pub",
        "lock 4711",
        "unlock 4711",
        "target mm 0.1",
        "recipe save 1 caps",
    ] {
        kband(&mut rig, folder, args).done();
    }
    // The new image is the same program with another version.
    let mut image = std::fs::read(images::feeder_on(kind)).unwrap();
    let version = format!("{}+", env!("CARGO_PKG_VERSION"));
    let places: Vec<usize> = (0..image.len() - version.len())
        .filter(|at| image[*at..].starts_with(version.as_bytes()))
        .collect();
    assert!(!places.is_empty());
    for place in places {
        image[place] = b'9';
    }
    std::fs::write(folder.join("new"), image).unwrap();
    let update = "update new --key plant.key";
    kband(&mut rig, folder, update).refused(&["not saved", "kband settings save"]);
    // The board starts within a second.
    rig.power_cycle(0.01, 1.0);
    kband(&mut rig, folder, update).refused(&["read-only", "--pin PIN"]);
    for args in ["unlock 4711", "recipe use 1"] {
        kband(&mut rig, folder, args).done();
    }
    let updated = kband(&mut rig, folder, &format!("{update} --pin 4711"));
    updated.prints(&[" runs 9", "settings, target and recipes are as before"]);
    assert!(rig.image().unwrap().starts_with('9'));
    let recipe = rig.request(&Request::Status, |response| match response {
        Response::Status(status) => status.recipe,
        other => panic!("{other:?}"),
    });
    assert_eq!(recipe, 1);
    // A press counts only after the input was low for 100 ms; the board may just have started.
    rig.run_for(1.0).send(&Request::Alive);
    rig.act(&Act::Enable(true));
    // Half of the link's time limit passes before and after a request.
    rig.run_for(1.0).send(&Request::Alive);
    rig.run_for(1.0);
    let (driven, status) = (rig.amplitude(), rig.status());
    assert!((driven - 0.1).abs() < 0.01, "{driven} {status:?}");
    rig.act(&Act::Enable(false));
    rig.power_cycle(0.01, 1.0);
    assert!(rig.image().unwrap().starts_with('9'));
}
