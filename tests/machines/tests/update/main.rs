//! Updates of the firmware over the link, on the flashed image: of the STM32F405 with two slots,
//! and of the STM32G474 with one.

mod one_slot;
mod two_slots;

use kband_control::Target;
use kband_control::wire::{MAX_UPDATE_BYTES, SavedSettings, UpdateRefusal, UpdateRequest, crc32};
use kband_machines::chip::flash::START;
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Event;
use kband_machines::hazards::Hazard;
use kband_machines::images::{feeder_on, symbol};
use kband_machines::rig::{Act, Rig, ticks};
use salty::{Keypair, Sha512};
use std::sync::OnceLock;

fn keypair() -> Keypair {
    Keypair::from(&[7; 32])
}

fn program(rig: &Rig) -> Vec<u8> {
    let kind = rig.chip.board.kind;
    let end = (symbol(&feeder_on(kind), "_image_end") - START) as usize + 4;
    rig.chip.flash()[kind.facts().program..end].to_vec()
}

/// The program with another name: its version starts with 9.
fn other_program(rig: &Rig) -> Vec<u8> {
    let mut other = program(rig);
    let version = format!("{}+", env!("CARGO_PKG_VERSION"));
    let places: Vec<usize> = (0..other.len() - version.len())
        .filter(|at| other[*at..].starts_with(version.as_bytes()))
        .collect();
    assert!(!places.is_empty());
    for place in places {
        other[place] = b'9';
    }
    let check = other.len() - 4;
    let sum = crc32(&other[..check]).to_le_bytes();
    other[check..].copy_from_slice(&sum);
    other
}

fn sum(image: &[u8], board: &str) -> [u8; 64] {
    let mut sum = Sha512::new();
    sum.update(image);
    sum.update(board.as_bytes());
    sum.finalize()
}

fn signature(image: &[u8], board: &str) -> [u8; 64] {
    keypair().sign(&sum(image, board)).to_bytes()
}

fn begin(board: &str, length: usize) -> UpdateRequest<'_> {
    UpdateRequest::Begin {
        board,
        length: length as u32,
    }
}

fn send(rig: &mut Rig, image: &[u8]) -> Result<(), UpdateRefusal> {
    for (number, bytes) in image.chunks(MAX_UPDATE_BYTES).enumerate() {
        let offset = (number * MAX_UPDATE_BYTES) as u32;
        rig.update(&UpdateRequest::Bytes { offset, bytes })?;
    }
    Ok(())
}

/// A board with settings and the public key of [`keypair`].
fn rig_with_key(kind: Kind) -> Rig {
    static KEYED: [OnceLock<Rig>; 2] = [const { OnceLock::new() }; 2];
    let made = KEYED[kind as usize].get_or_init(|| {
        let hazard = Hazard::new("update", 50.0, Target::Amplitude(0.2));
        let mut rig = hazard.commissioned(kind);
        rig.chip.board.flash.erases_in = Some(ticks(0.02));
        let key = *keypair().public.as_bytes();
        assert_eq!(rig.update(&UpdateRequest::Key(&key)), Ok(()));
        rig
    });
    made.clone()
}

fn await_image(rig: &mut Rig) {
    let sent_count = rig.sent().len();
    rig.run_until(0.01, 60.0, |rig| rig.sent().len() > sent_count);
    rig.run_for(0.25);
}

/// Whether the other program runs, with the old settings and without a fault.
fn runs_other(rig: &mut Rig) -> bool {
    let name = rig.image().expect("an answer");
    assert_eq!(rig.stored(), SavedSettings::InUse);
    let kind = rig.chip.board.kind;
    let new = name.starts_with('9');
    let expected = if new { other_program } else { program }(&rig_with_key(kind));
    let whole = rig.chip.flash()[kind.facts().program..].starts_with(&expected);
    assert!(whole, "the slot has the whole image");
    new
}

fn power_cycle(rig: &mut Rig) {
    rig.power_cycle(0.01, 0.0);
    await_image(rig);
}

/// Presses the enable input; returns whether the bridge closes.
fn drives(rig: &mut Rig) -> bool {
    let from = rig.time();
    for (at, enable) in [(0.0, false), (0.6, true), (1.0, false)] {
        rig.at(from + at, Act::Enable(enable));
    }
    rig.run(from + 1.5);
    rig.find_time(from, &Event::Bridge(true)).is_some()
}
