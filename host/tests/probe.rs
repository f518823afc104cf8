//! The verbs of the debug probe against an emulated chip behind an emulated probe.
#![cfg(feature = "flash")]

mod came;

use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
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
use object::{Object, ObjectSymbol};
use serde_json::Value;
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
fn what_was_written_boots_answers_the_desk_and_logs() {
    let (folder, path) = (folder(), feeder());
    let probe = Probe::before(board());
    let name = probe.name();
    let elf = path.to_str().unwrap();
    kband(&folder, &["flash", elf, "--probe", &name]).done();
    // Its log, read from the chip while it runs.
    let words = ["monitor", "--elf", elf, "--probe", &name, "--duration", "2"];
    let said = kband(&folder, &words).done();
    assert!(said.contains(", started by "), "{said}");
    assert!(!probe.chip().has_stopped(), "it faulted");
    // The same flash under power, on a track: it answers over its link.
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

/// What the feeder's image says in its log, as the board puts it into its ring.
struct Words {
    /// Numbers of the strings of the image.
    numbers: HashMap<String, u16>,
    /// Where it has its ring.
    ring: u32,
}

impl Words {
    fn of(image: &Path) -> Self {
        let bytes = std::fs::read(image).unwrap();
        let file = object::File::parse(&bytes[..]).unwrap();
        let (mut numbers, mut ring) = (HashMap::new(), None);
        for symbol in file.symbols() {
            let name = symbol.name().unwrap();
            if name == "_SEGGER_RTT" {
                ring = Some(symbol.address() as u32);
            } else if let Ok(word) = serde_json::from_str::<Value>(name) {
                let text = word["data"].as_str().unwrap().to_owned();
                numbers.insert(text, symbol.address() as u16);
            }
        }
        let ring = ring.unwrap();
        Self { numbers, ring }
    }

    /// "kband {}, started by {}" at a time in milliseconds.
    fn started(&self, time: u64, image: &str, cause: &str) -> Vec<u8> {
        let mut frame = self.numbers["kband {}, started by {}"]
            .to_le_bytes()
            .to_vec();
        frame.extend(time.to_le_bytes());
        for text in [image, cause] {
            frame.extend(self.numbers["{=str}"].to_le_bytes());
            frame.extend((text.len() as u32).to_le_bytes());
            frame.extend(text.as_bytes());
        }
        enclosed(&frame)
    }
}

/// A frame without a zero but for its end (<https://github.com/Dirbaio/rzcobs>).
fn enclosed(frame: &[u8]) -> Vec<u8> {
    let (mut bytes, mut run, mut zeros) = (Vec::new(), 0_u8, 0_u8);
    for &byte in frame {
        let full = if run < 7 {
            match byte {
                0 => zeros |= 1 << run,
                byte => bytes.push(byte),
            }
            run += 1;
            (run == 7 && zeros != 0).then_some(zeros)
        } else if byte == 0 {
            Some((run - 7) | 0x80)
        } else {
            bytes.push(byte);
            run += 1;
            (run == 134).then_some(0xff)
        };
        if let Some(mark) = full {
            bytes.push(mark);
            (run, zeros) = (0, 0);
        }
    }
    match run {
        0 => {}
        1..=6 => bytes.push((zeros | 0xff << run) & 0x7f),
        run => bytes.push((run - 7) | 0x80),
    }
    bytes.push(0);
    bytes
}

/// A board that runs the image, its ring empty, read and written up to `at`.
fn logging(image: &Image, words: &Words, buffer: u32, at: u32) -> Chip {
    let mut chip = board();
    for piece in image.pieces() {
        let place = (piece.address - STM32F405RG.flash.start) as usize;
        chip.flash_mut()[place..place + piece.bytes.len()].copy_from_slice(&piece.bytes);
    }
    chip.write(words.ring, 1, b"SEGGER RTT\0\0\0\0\0\0")
        .unwrap();
    let head = [1, 0, 0, buffer, RING, at, at, 0];
    let head: Vec<u8> = head.into_iter().flat_map(u32::to_le_bytes).collect();
    chip.write(words.ring + 16, 4, &head).unwrap();
    chip
}

/// Bytes of a ring of defmt-rtt.
const RING: u32 = 1024;

/// The board says more, as far as there is room; whether there was.
fn says(chip: &mut Chip, words: &Words, bytes: &[u8]) -> bool {
    let mut place = [0; 12];
    chip.read(words.ring + 28, &mut place).unwrap();
    let word = |at: usize| u32::from_le_bytes(place[at..at + 4].try_into().unwrap());
    let buffer = word(0);
    chip.read(words.ring + 36, &mut place).unwrap();
    let word = |at: usize| u32::from_le_bytes(place[at..at + 4].try_into().unwrap());
    let (mut write, read) = (word(0), word(4));
    if (read + RING - write - 1) % RING < bytes.len() as u32 {
        return false;
    }
    for byte in bytes {
        chip.write(buffer + write, 1, &[*byte]).unwrap();
        write = (write + 1) % RING;
    }
    chip.write(words.ring + 36, 4, &write.to_le_bytes())
        .unwrap();
    true
}

#[test]
fn the_log_of_a_board_is_read_while_it_runs() {
    let (folder, path) = (folder(), feeder());
    let (image, words) = (Image::read(&path).unwrap(), Words::of(&path));
    // Near the end of the ring, which the first line goes across.
    let probe = Probe::before(logging(&image, &words, 0x2000_c000, RING - 20));
    let line = |number: u64| words.started(number, "0.1.0+test", "power");
    assert!(says(&mut probe.chip(), &words, &line(0)));
    let elf = path.to_str().unwrap();
    let name = probe.name();
    let came = std::thread::scope(|scope| {
        let desk = scope.spawn(|| {
            let words = ["monitor", "--elf", elf, "--probe", &name, "--duration", "6"];
            kband(&folder, &[&words[..], &["--record-log", "kept"]].concat())
        });
        let end = Instant::now() + Duration::from_secs(4);
        let mut number = 1;
        while number < 200 && Instant::now() < end {
            number += u64::from(says(&mut probe.chip(), &words, &line(number)));
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(number > 30, "{number}: nobody empties the ring");
        (desk.join().unwrap(), number)
    });
    let (came, number) = came;
    assert_eq!(came.status, Some(0), "{}", came.said);
    let lines: Vec<&str> = came
        .out
        .lines()
        .filter(|line| line.contains("log "))
        .collect();
    assert_eq!(lines.len() as u64, number, "{}", came.out);
    for (number, line) in lines.iter().enumerate() {
        let time = format!("log 0.{number:03} info");
        let words = "kband 0.1.0+test, started by power";
        assert!(line.contains(&time) && line.contains(words), "{line}");
    }
    assert!(!came.said.contains("could not be read"), "{}", came.said);
    let chip = probe.chip();
    assert!(
        !chip.was_halted && chip.is_driven(),
        "the board was disturbed"
    );
}

#[test]
fn a_log_of_another_image_and_a_log_through_nothing_are_refused() {
    let (folder, path) = (folder(), feeder());
    let (image, words) = (Image::read(&path).unwrap(), Words::of(&path));
    let elf = path.to_str().unwrap();
    let monitor = |probe: &Probe, more: &[&str]| {
        let name = probe.name();
        let words = ["monitor", "--elf", elf, "--duration", "1", "--probe", &name];
        kband(&folder, &[&words[..], more].concat())
    };
    let mut chip = logging(&image, &words, 0x2000_c000, 0);
    chip.flash_mut()[40] ^= 1;
    monitor(&Probe::before(chip), &[]).refused(&["another image", "kband flash"]);
    let probe = Probe::before(logging(&image, &words, 0x2000_c000, 0));
    monitor(&probe, &["--rows", "4"]).refused(&["--rows", "--on"]);
    monitor(&probe, &["--on", "qemu"]).refused(&["emulated board", "--probe"]);
    // A ring that leads out of the memory is none; the board is left alone.
    let probe = Probe::before(logging(&image, &words, 0x2001_ff00, 0));
    let came = monitor(&probe, &[]);
    assert_eq!(came.status, Some(0), "{}", came.said);
    assert!(!came.out.contains("log "), "{}", came.out);
    // The supply fails.
    let mut chip = logging(&image, &words, 0x2000_c000, 0);
    chip.fails_after = Some(0);
    monitor(&Probe::before(chip), &[]).refused(&["does not", "next: "]);
}
