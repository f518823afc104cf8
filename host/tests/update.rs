//! From a new board to an update over the link that runs its recipe again: `kband` on a
//! pseudo-terminal, and the flashed image on its simulated chip.
#![cfg(unix)]

mod came;

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

/// Wall-clock seconds for one command: the chip is slower than the board.
const LIMIT: &str = "600";
/// Time of the board between two looks at the line, and longest time without a byte of the desk, s.
const STEP: f64 = 0.005;
const IDLE: f64 = 2.0;

/// Runs `kband` on a board's line, and the board as long as the desk says something.
fn kband(rig: &mut Rig, folder: &Path, words: &str) -> String {
    let (mut far, mut near, name) = came::port();
    let mut from_desk = far.try_clone().unwrap();
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
            let mut idle_from = rig.time();
            while !done.load(Ordering::Relaxed) {
                let wait = if rig.time() < idle_from {
                    Duration::ZERO
                } else {
                    Duration::from_millis(50)
                };
                match bytes.recv_timeout(wait) {
                    Ok(bytes) => {
                        rig.act(&Act::Link(bytes));
                        idle_from = rig.time() + IDLE;
                    }
                    Err(RecvTimeoutError::Timeout) if rig.time() < idle_from => {}
                    Err(RecvTimeoutError::Timeout) => continue,
                    Err(RecvTimeoutError::Disconnected) => break,
                }
                rig.run(rig.time() + STEP);
                let all = rig.sent();
                if far.write_all(&all[sent..]).is_err() {
                    break;
                }
                sent = all.len();
            }
        });
        let words: Vec<&str> = words.split(' ').chain(["--on", &name]).collect();
        let came = came::run(folder, LIMIT, &words);
        done.store(true, Ordering::Relaxed);
        // A byte ends the wait for the desk.
        near.write_all(&[0]).unwrap();
        came.done()
    })
}

/// Switches the supply off and on, and lets the board start.
fn cut_power(rig: &mut Rig) {
    rig.act(&Act::Volts(0.0));
    rig.run(rig.time() + 0.01);
    rig.act(&Act::Volts(3.3));
    rig.run(rig.time() + 1.0);
}

#[test]
fn a_new_board_is_updated_and_runs_its_recipe_again() {
    updated_it_runs_its_recipe(Kind::Stm32f405);
}

#[test]
fn a_new_board_with_one_slot_is_updated_and_runs_its_recipe_again() {
    updated_it_runs_its_recipe(Kind::Stm32g474);
}

fn updated_it_runs_its_recipe(kind: Kind) {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let hazard = Hazard::of("update", 50.0, Target::Amplitude(0.2));
    let mut rig = hazard.commissioned(kind);
    rig.chip.board.flash.erases_in = Some(ticks(0.02));
    came::kband(folder, "update --new-key plant.key").done();
    kband(&mut rig, folder, "update --set-key plant.key.pub");
    kband(&mut rig, folder, "target mm 0.1");
    kband(&mut rig, folder, "recipe save 1 caps");
    cut_power(&mut rig);
    kband(&mut rig, folder, "recipe use 1");
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
    let said = kband(&mut rig, folder, "update new --key plant.key");

    assert!(said.contains(" runs 9"), "{said}");
    assert!(
        said.contains("settings, target and recipes are as before"),
        "{said}"
    );
    assert!(rig.image().unwrap().starts_with('9'));
    let recipe = rig.request(&Request::Status, |response| match response {
        Response::Status(status) => status.recipe,
        other => panic!("{other:?}"),
    });
    assert_eq!(recipe, 1);
    rig.act(&Act::Enable(true));
    rig.run(rig.time() + 2.0);
    let driven = rig.amplitude();
    assert!((driven - 0.1).abs() < 0.01, "{driven}");
    rig.act(&Act::Enable(false));
    cut_power(&mut rig);
    assert!(rig.image().unwrap().starts_with('9'));
}
