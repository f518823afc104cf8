//! Verbs for the debug probe, run against an emulated chip and an emulated probe.
#![cfg(feature = "flash")]

mod outcome;

use std::ops::Range;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use kband_control::wire::{Request, Response};
use kband_host::chip::{Image, STM32F405RG};
use kband_machines::chip::Chip;
use kband_machines::emulator::Machine;
use kband_machines::images;
use kband_machines::probe::Probe;
use kband_machines::rig::Rig;
use kband_plant::Scene;
use outcome::Outcome;

const TIMEOUT: &str = "120";
/// Content of the settings' sectors before the test.
const SETTINGS: u8 = 0x5a;
/// Content of the rest of the flash, from an older image.
const OLD_IMAGE_BYTE: u8 = 0x00;
/// Time in s after power-on by which a board without records has erased a sector.
const ERASE_TIME: f64 = 2.5;

/// Runs `kband flash` with the feeder's image on the probe of this name.
fn kband_flash(probe: &str, more: &[&str]) -> Outcome {
    let image = feeder();
    let args = ["flash", image.to_str().unwrap(), "--probe", probe];
    let folder = tempfile::tempdir().unwrap();
    outcome::run(folder, TIMEOUT, &[&args[..], more].concat())
}

fn flash(chip: Chip, more: &[&str]) -> (Outcome, Probe) {
    let probe = Probe::before(chip);
    (kband_flash(&probe.name(), more), probe)
}

fn feeder() -> PathBuf {
    images::build("kband-firmware", "feeder", Machine::CortexM4F)
}

/// The flash of a chip in a machine, after power-on. The older content of the fault sector is no
/// record, so the sector is erased first; meanwhile the board receives nothing.
fn started(chip: Chip) -> Rig {
    let mut rig = Rig::with(chip, &Scene::default());
    rig.chip.power_on();
    rig.run(ERASE_TIME);
    assert_eq!(rig.resets().len(), 1);
    rig
}

fn settings() -> Range<usize> {
    let [start, end] = [STM32F405RG.settings.start, STM32F405RG.settings.end]
        .map(|at| (at - STM32F405RG.flash.start) as usize);
    start..end
}

/// A board in operation: an older image drives the bridge, and settings are saved.
fn board() -> Chip {
    let mut chip = Chip::default();
    chip.flash_mut()[..0x6_0000].fill(OLD_IMAGE_BYTE);
    chip.flash_mut()[settings()].fill(SETTINGS);
    assert!(chip.is_driven());
    chip
}

fn settings_are_kept(chip: &Chip) -> bool {
    let mut bytes = chip.flash()[settings()].iter();
    bytes.all(|byte| *byte == SETTINGS)
}

fn contains(chip: &Chip, image: &Image) -> bool {
    image.pieces.iter().all(|piece| {
        let at = (piece.address - STM32F405RG.flash.start) as usize;
        chip.flash()[at..at + piece.bytes.len()] == piece.bytes
    })
}

#[test]
fn a_written_image_boots_with_the_drive_off_and_answers_the_desk() {
    let image = Image::read(&feeder()).unwrap();
    let (outcome, probe) = flash(board(), &[]);
    outcome.prints(&["written, verified, started"]);
    let chip = probe.chip().clone();
    assert!(contains(&chip, &image));
    assert!(settings_are_kept(&chip));
    assert!(chip.was_halted && !chip.driven_while_halted);
    let entry = image.pieces[0].bytes[4..].first_chunk();
    let entry = u32::from_le_bytes(*entry.unwrap());
    assert_eq!(chip.running(), Some(entry & !1));
    started(chip).request(&Request::SelfTest, |response| {
        assert!(matches!(response, Response::SelfTest(test) if test.sensor));
    });
}

#[test]
fn option_bytes_are_never_set_on_a_protected_chip() {
    let set = |chip: &Chip| {
        let flash = &chip.board.flash;
        (flash.brown_out(), flash.hardware_watchdog())
    };
    let before = board().board.flash.options;
    let (outcome, probe) = flash(board(), &[]);
    outcome.done();
    assert_eq!(set(&probe.chip()), (3, false));
    assert_eq!(probe.chip().board.flash.options, before);
    let (outcome, probe) = flash(board(), &["--option-bytes"]);
    outcome.prints(&["option bytes     brown-out reset at level 3"]);
    let chip = probe.chip().clone();
    assert_eq!(set(&chip), (0, true));
    let others = !(3 << 2 | 1 << 5);
    assert_eq!(chip.board.flash.options & others, before & others);
    // The board reports the option bytes, and starts with the watchdog already running.
    started(chip.clone()).request(&Request::SelfTest, |response| {
        let reports = |test: kband_control::wire::SelfTest| {
            test.set_up.brown_out == 2830 && test.set_up.watchdog
        };
        assert!(matches!(response, Response::SelfTest(test) if reports(test)));
    });
    // A repetition changes nothing.
    let (outcome, probe) = flash(chip, &["--option-bytes"]);
    outcome.done();
    assert_eq!(set(&probe.chip()), (0, true));
    // Read protection of level 1: nothing is written.
    let mut protected = board();
    protected.board.flash.set_options(before & !0xff00 | 0x5500);
    let held = protected.flash().to_vec();
    let (outcome, probe) = flash(protected, &["--option-bytes"]);
    outcome.refused(&["read-protected", "nothing was written"]);
    assert!(probe.chip().flash() == held);
    assert_eq!(set(&probe.chip()), (3, false));
}

#[test]
fn a_half_written_board_does_not_start() {
    let image = Image::read(&feeder()).unwrap();
    let (outcome, probe) = flash(board(), &[]);
    outcome.done();
    let whole = probe.chip().operations();
    let near_end = [300, 3, 2, 1].map(|left| whole - left);
    // During erasure, first page, middle, after the verification, and in the last words.
    for cut in [1, 2, 3, 5, 8, 120, whole / 2].into_iter().chain(near_end) {
        let mut chip = board();
        chip.board.cut_at = Some(cut);
        let (outcome, probe) = flash(chip, &[]);
        outcome.refused(&["next: ", "kband flash again", "does not start"]);
        let mut chip = probe.chip();
        assert!(!chip.driven_while_halted, "cut after {cut}");
        chip.power_on();
        if chip.running().is_some() {
            assert!(contains(&chip, &image), "cut after {cut} of {whole}");
        }
        assert!(settings_are_kept(&chip), "cut after {cut}");
    }
    let mut chip = board();
    chip.board.cut_at = Some(whole / 3);
    let (outcome, probe) = flash(chip, &[]);
    outcome.refused(&["kband flash again"]);
    probe.chip().power_on();
    assert_eq!(probe.chip().running(), None);
    kband_flash(&probe.name(), &[]).done();
    assert!(contains(&probe.chip(), &image));
}

#[test]
fn another_chip_is_neither_stopped_nor_written() {
    for (identity, expected) in [
        ((0x1007_6431, 1024), ["0x431", "0x413"]),
        ((0x1007_6413, 512), ["512 KiB", "1024 KiB"]),
    ] {
        let mut chip = board();
        chip.board.identity = identity;
        let before = chip.flash().to_vec();
        let (outcome, probe) = flash(chip, &[]);
        outcome.refused(&[&expected[..], &["nothing was changed", "right board"]].concat());
        let chip = probe.chip();
        assert!(!chip.was_halted && chip.is_driven());
        assert!(chip.flash() == before);
    }
}

#[test]
fn a_flash_that_does_not_take_the_image_is_found_out() {
    for (address, bits) in [(0x0800_0004, 0x4000_0200), (0x0802_2000, u32::MAX)] {
        let mut chip = board();
        chip.board.flash.worn = Some((address, bits));
        let (outcome, probe) = flash(chip, &[]);
        outcome.refused(&["the flash was not written", "does not start"]);
        assert!(!probe.chip().driven_while_halted);
    }
}

#[test]
fn a_lost_or_silent_probe_gives_one_message() {
    // A port without a listener.
    let nobody = {
        let port = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap();
        format!("1d50:6018:{}", port.local_addr().unwrap())
    };
    kband_flash(&nobody, &[]).refused(&["does not open", "next:"]);
    kband_flash("1d50", &[]).refused(&["--probe", "VID:PID"]);
    kband_flash("1d50:6018:none", &[]).refused(&["no debug probe", "udev"]);
    // A listener that accepts and never answers.
    let mute = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let name = format!("1d50:6018:{}", mute.local_addr().unwrap());
    let start = Instant::now();
    kband_flash(&name, &[]).refused(&["has not answered", "next:"]);
    assert!(start.elapsed() < Duration::from_secs(60));
}
