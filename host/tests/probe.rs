//! The verbs of the debug probe against an emulated chip behind an emulated probe.
#![cfg(feature = "flash")]

mod came;

use std::ops::Range;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use came::Came;
use kband_control::wire::{Request, Response};
use kband_host::chip::{Image, STM32F405RG};
use kband_machines::chip::Chip;
use kband_machines::emulator::Machine;
use kband_machines::images;
use kband_machines::probe::Probe;
use kband_machines::rig::Rig;
use kband_plant::Scene;
use tempfile::TempDir;

/// Wall-clock seconds for one command, a loaded machine allowed for.
const LIMIT: &str = "120";
/// What the settings hold before.
const SETTINGS: u8 = 0x5a;
/// What an older image left in the flash.
const OLDER: u8 = 0x00;

/// Runs `kband` in `folder`; killed at the limit.
fn kband(folder: impl AsRef<Path>, words: &[&str]) -> Came {
    came::run(folder, LIMIT, words)
}

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn feeder() -> PathBuf {
    images::build("kband-firmware", "feeder", Machine::CortexM4F)
}

/// Time in s after power-on within which a board whose sectors hold no records has erased the one
/// that its first fault goes to: 2 s at most.
const ERASED: f64 = 2.5;

/// Offsets of the settings and faults in the flash.
fn settings() -> Range<usize> {
    let [start, end] = [STM32F405RG.settings.start, STM32F405RG.settings.end]
        .map(|at| (at - STM32F405RG.flash.start) as usize);
    start..end
}

/// A board in operation: an older image drives the bridge, settings are kept.
fn board() -> Chip {
    let mut chip = Chip::default();
    chip.flash_mut()[..0x6_0000].fill(OLDER);
    chip.flash_mut()[settings()].fill(SETTINGS);
    assert!(chip.is_driven());
    chip
}

fn settings_are_kept(chip: &Chip) -> bool {
    chip.flash()[settings()]
        .iter()
        .all(|byte| *byte == SETTINGS)
}

fn holds(chip: &Chip, image: &Image) -> bool {
    image.pieces().iter().all(|piece| {
        let at = (piece.address - STM32F405RG.flash.start) as usize;
        chip.flash()[at..at + piece.bytes.len()] == piece.bytes
    })
}

#[test]
fn an_image_is_written_verified_and_started_with_the_drive_off() {
    let (folder, path) = (folder(), feeder());
    let image = Image::read(&path).unwrap();
    let probe = Probe::before(board());
    let name = probe.name();
    let words = ["flash", path.to_str().unwrap(), "--probe", &name];
    let out = kband(&folder, &words).done();
    assert!(out.contains("written, verified, started"), "{out}");
    let chip = probe.chip();
    assert!(holds(&chip, &image));
    assert!(settings_are_kept(&chip));
    assert!(chip.was_halted && !chip.driven_while_halted);
    let vector = &image.pieces()[0].bytes[4..8];
    let entry = u32::from_le_bytes([vector[0], vector[1], vector[2], vector[3]]);
    assert_eq!(chip.running(), Some(entry & !1));
}

#[test]
fn what_was_written_boots_and_answers_the_desk() {
    let (folder, path) = (folder(), feeder());
    let probe = Probe::before(board());
    let name = probe.name();
    let elf = path.to_str().unwrap();
    kband(&folder, &["flash", elf, "--probe", &name]).done();
    // Its flash under power, on a track: it answers over its link.
    let chip = probe.chip().clone();
    let mut rig = Rig::with(chip, &Scene::default());
    rig.chip.power_on();
    // What lay in the memory of the faults is no record: it is erased before the first one, and
    // meanwhile the board receives nothing.
    rig.run(ERASED);
    assert_eq!(rig.resets().len(), 1);
    rig.request(&Request::SelfTest, |response| {
        assert!(matches!(response, Response::SelfTest(test) if test.sensor));
    });
}

#[test]
fn option_bytes_are_never_set_on_a_protected_chip() {
    let (folder, path) = (folder(), feeder());
    let flash = |chip: Chip, more: &[&str]| {
        let probe = Probe::before(chip);
        let name = probe.name();
        let words = ["flash", path.to_str().unwrap(), "--probe", &name];
        let came = kband(&folder, &[&words[..], more].concat());
        (came, probe.chip().clone())
    };
    let set = |chip: &Chip| {
        let flash = &chip.board.flash;
        (flash.brown_out(), flash.hardware_watchdog())
    };
    let before = board().board.flash.options();
    let (came, chip) = flash(board(), &[]);
    came.done();
    assert_eq!(
        (set(&chip), chip.board.flash.options()),
        ((3, false), before)
    );
    let (came, chip) = flash(board(), &["--option-bytes"]);
    let said = came.done();
    assert!(
        said.contains("option bytes     brown-out reset at level 3"),
        "{said}"
    );
    assert_eq!(set(&chip), (0, true));
    let others = !(3 << 2 | 1 << 5);
    assert_eq!(chip.board.flash.options() & others, before & others);
    // The board reports them, and starts with the watchdog that runs already.
    let mut rig = Rig::with(chip.clone(), &Scene::default());
    rig.chip.power_on();
    // What lay in the memory of the faults is no record: it is erased before the first one, and
    // meanwhile the board receives nothing.
    rig.run(ERASED);
    assert_eq!(rig.resets().len(), 1);
    rig.request(&Request::SelfTest, |response| {
        let reports = |test: kband_control::wire::SelfTest| {
            test.set_up.brown_out == 2830 && test.set_up.watchdog
        };
        assert!(matches!(response, Response::SelfTest(test) if reports(test)));
    });
    // Once more changes nothing.
    let (came, again) = flash(chip, &["--option-bytes"]);
    came.done();
    assert_eq!(set(&again), (0, true));
    // Level 1 of the read protection: nothing is written at all.
    let mut protected = board();
    protected.board.flash.set_options(before & !0xff00 | 0x5500);
    let held = protected.flash().to_vec();
    let (came, chip) = flash(protected, &["--option-bytes"]);
    came.refused(&["read-protected", "nothing was written"]);
    assert!(chip.flash() == held);
    assert_eq!(set(&chip), (3, false));
}

#[test]
fn a_half_written_board_does_not_start() {
    let (folder, path) = (folder(), feeder());
    let image = Image::read(&path).unwrap();
    let flash = |probe: &Probe| {
        kband(
            &folder,
            &["flash", path.to_str().unwrap(), "--probe", &probe.name()],
        )
    };
    let whole = {
        let probe = Probe::before(board());
        assert_eq!(flash(&probe).status, Some(0));
        probe.chip().operations()
    };
    // Within the erasing, the first page, the middle, the verified rest, the very last words.
    for cut in [
        1,
        2,
        3,
        5,
        8,
        120,
        whole / 2,
        whole - 300,
        whole - 3,
        whole - 2,
        whole - 1,
    ] {
        let mut chip = board();
        chip.fails_after = Some(cut);
        let probe = Probe::before(chip);
        flash(&probe).refused(&["next: ", "kband flash again", "does not start"]);
        let mut chip = probe.chip();
        assert!(!chip.driven_while_halted, "cut after {cut}");
        chip.power_on();
        if chip.running().is_some() {
            assert!(holds(&chip, &image), "cut after {cut} of {whole}");
        }
        assert!(settings_are_kept(&chip), "cut after {cut}");
    }
    // The same board again.
    let mut chip = board();
    chip.fails_after = Some(whole / 3);
    let probe = Probe::before(chip);
    flash(&probe).refused(&["kband flash again"]);
    probe.chip().power_on();
    assert_eq!(probe.chip().running(), None);
    assert_eq!(flash(&probe).status, Some(0));
    assert!(holds(&probe.chip(), &image));
}

#[test]
fn another_chip_is_neither_stopped_nor_written() {
    let (folder, path) = (folder(), feeder());
    for (identity, words) in [
        ((0x1007_6431, 1024), ["0x431", "0x413"]),
        ((0x1007_6413, 512), ["512 KiB", "1024 KiB"]),
    ] {
        let mut chip = board();
        chip.board.identity = identity;
        let before = chip.flash().to_vec();
        let probe = Probe::before(chip);
        let came = kband(
            &folder,
            &["flash", path.to_str().unwrap(), "--probe", &probe.name()],
        );
        came.refused(&words);
        came.refused(&["nothing was touched", "right board"]);
        let chip = probe.chip();
        assert!(!chip.was_halted && chip.is_driven());
        assert!(chip.flash() == before);
    }
}

#[test]
fn a_flash_that_does_not_take_the_image_is_found_out() {
    let (folder, path) = (folder(), feeder());
    for (address, bits) in [(0x0800_0004, 0x4000_0200), (0x0802_2000, u32::MAX)] {
        let mut chip = board();
        chip.wear(address, bits);
        let probe = Probe::before(chip);
        let came = kband(
            &folder,
            &["flash", path.to_str().unwrap(), "--probe", &probe.name()],
        );
        came.refused(&["the flash was not written", "does not start"]);
        assert!(!probe.chip().driven_while_halted);
    }
}

#[test]
fn a_lost_or_silent_probe_gives_one_message() {
    let (folder, path) = (folder(), feeder());
    let image = path.to_str().unwrap();
    // A port that nobody listens on.
    let nobody = {
        let port = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap();
        format!("1d50:6018:{}", port.local_addr().unwrap())
    };
    kband(&folder, &["flash", image, "--probe", &nobody]).refused(&["does not open", "next:"]);
    kband(&folder, &["flash", image, "--probe", "1d50"]).refused(&["--probe", "VID:PID"]);
    kband(&folder, &["flash", image, "--probe", "1d50:6018:none"])
        .refused(&["no debug probe", "udev"]);
    // One that takes the call and never answers.
    let mute = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let name = format!("1d50:6018:{}", mute.local_addr().unwrap());
    let begun = Instant::now();
    kband(&folder, &["flash", image, "--probe", &name]).refused(&["has not answered", "next:"]);
    assert!(begun.elapsed() < Duration::from_secs(60));
}
