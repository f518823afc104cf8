//! Writes an image into the flash: drive off first, and an incomplete image never starts.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use probe_rs::flashing::{DownloadOptions, FlashProgress, ProgressEvent, ProgressOperation};
use probe_rs::{Core, MemoryInterface, Session};

use super::image::{Image, Piece};
use super::model::{Chip, Controller, OptionBytes};
use super::reach::{ConnectedChip, causes};
use crate::desk::{Desk, Progress};
use crate::refusal::{Refusal, Result};

/// Longest wait for a probe; erasing a sector takes up to 4 s (RM0090, datasheet table 40).
const SILENCE_TIMEOUT: Duration = Duration::from_secs(20);
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(50);
const THREAD_NAME: &str = "probe";
const HALT_TIMEOUT: Duration = Duration::from_millis(500);
/// Bytes of stack pointer and entry of the image; while they are erased, the core does not start.
const STACK_AND_ENTRY_BYTES: usize = 8;
/// Largest number of status reads of the flash controller: for a word, and for option bytes.
const MAX_STATUS_POLLS: usize = 1_000;
const MAX_OPTION_POLLS: usize = 100_000;
const RETRY_STEP: &str =
    "run kband flash again: until it succeeds the board does not start; its settings are kept";

/// Writes an image through a probe, verifies it and starts it.
///
/// First the chip is identified, the drive switched off and the core stopped. The sector of the
/// vector table is erased first, and its first words are written last. So an interrupted board does
/// not start, and its drive stays off. A protected chip is refused before anything is written.
pub fn write(
    image: Image,
    probe: Option<&str>,
    options: Option<OptionBytes>,
    desk: &Desk,
) -> Result<()> {
    let progress = Progress::new("writing", image.size().into());
    let probe = probe.map(str::to_owned);
    let (sender, written) = channel();
    let others = std::panic::take_hook();
    // A panic of the thread is reported below.
    std::panic::set_hook(Box::new(move |panic| {
        if std::thread::current().name() != Some(THREAD_NAME) {
            others(panic);
        }
    }));
    // In its own thread, because the probe may not answer, and its driver may panic.
    let work = std::thread::Builder::new().name(THREAD_NAME.into());
    let work = work.spawn(move || {
        // A closed channel has no reader.
        let mut report = |bytes| _ = sender.send(bytes);
        write_image(&image, probe.as_deref(), options, &mut report)
    });
    let work = work.map_err(|error| {
        let cause = format!("a thread could not be started: {error}");
        Refusal::new(cause, "close other programs and try again")
    })?;
    let (mut started, mut last) = (false, Instant::now());
    let cut = loop {
        if desk.check_stop().is_err() {
            let cause = "interrupted while the probe was at work";
            break Refusal::cut(cause, "start it again");
        }
        match written.recv_timeout(STOP_POLL_INTERVAL) {
            Ok(bytes) => {
                (started, last) = (true, Instant::now());
                progress.advance(bytes);
            }
            Err(RecvTimeoutError::Disconnected) => match work.join() {
                Ok(end) => return end,
                Err(_) => {
                    let cause = "the connection to the probe was lost";
                    break Refusal::new(cause, "plug the probe in and try again");
                }
            },
            Err(RecvTimeoutError::Timeout) if last.elapsed() > SILENCE_TIMEOUT => {
                let waited = SILENCE_TIMEOUT.as_secs();
                let cause = format!("the probe has not answered for {waited} s");
                break Refusal::new(cause, "unplug the probe, plug it in and try again");
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
    };
    Err(if started { cut.then(RETRY_STEP) } else { cut })
}

fn write_image(
    image: &Image,
    probe: Option<&str>,
    options: Option<OptionBytes>,
    written: &mut impl FnMut(u64),
) -> Result<()> {
    let chip = image.chip;
    let mut reached = ConnectedChip::connect(probe, chip)?;
    reached.drive_off()?;
    let mut session = reached.control()?;
    halt_core(&mut session, chip)?;
    if let Some(options) = options {
        check_unprotected(&mut session, options)?;
    }
    let (first, rest) = split_image(image);
    commit(&mut session, &rest, written)?;
    write_first_words(&mut session, chip, first)?;
    written(STACK_AND_ENTRY_BYTES as u64);
    if let Some(options) = options {
        set(&mut session, chip, options)?;
    }
    let started = session.core(0).and_then(|mut core| core.reset());
    started.map_err(|error| {
        let why = causes(&error);
        let cause = format!("written and verified, but the chip does not start: {why}");
        Refusal::new(cause, "switch the board off and on")
    })
}

fn split_image(image: &Image) -> ([u32; 2], Vec<Piece>) {
    let start = image.chip.flash.start;
    let mut first = [0; 2];
    let mut pieces = image.pieces.clone();
    // The image's checks guarantee the vector table at its beginning.
    for piece in &mut pieces {
        if piece.address == start && piece.bytes.len() > STACK_AND_ENTRY_BYTES {
            let rest = piece.bytes.split_off(STACK_AND_ENTRY_BYTES);
            for (word, bytes) in first.iter_mut().zip(piece.bytes.chunks_exact(4)) {
                *word = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            }
            *piece = Piece {
                address: start + STACK_AND_ENTRY_BYTES as u32,
                bytes: rest,
            };
        }
    }
    (first, pieces)
}

/// Stops the core, and checks that the drive is off.
fn halt_core(session: &mut Session, chip: &Chip) -> Result<()> {
    let (address, bit) = chip.drives;
    let off = session.core(0).and_then(|mut core| {
        core.halt(HALT_TIMEOUT)?;
        let drives = core.read_word_32(address.into())?;
        core.write_word_32(address.into(), drives & !bit)?;
        Ok(core.read_word_32(address.into())? & bit == 0)
    });
    let cause = match off {
        Ok(true) => return Ok(()),
        Ok(false) => "the drive does not switch off".into(),
        Err(error) => format!("the core does not stop: {}", causes(&error)),
    };
    let next = "nothing was written: switch the board off, and look at its bridge";
    Err(Refusal::new(cause, next))
}

fn refuse_unwritten(why: &str) -> Refusal {
    Refusal::new(format!("the flash was not written: {why}"), RETRY_STEP)
}

/// Writes the first words, stack before entry, by register: a loader writes whole pages.
fn write_first_words(session: &mut Session, chip: &Chip, words: [u32; 2]) -> Result<()> {
    let its = chip.controller;
    let written = session.core(0).and_then(|mut core| {
        if core.read_word_32(its.control.into())? & Controller::LOCK != 0 {
            for key in Controller::KEYS {
                core.write_word_32(its.keys.into(), key)?;
            }
        }
        core.write_word_32(its.status.into(), its.errors)?;
        core.write_word_32(its.control.into(), its.program)?;
        let mut errors = 0;
        let places = || (chip.flash.start..).step_by(4).map(u64::from);
        for (place, word) in places().zip(words) {
            core.write_word_32(place, word)?;
            errors |= wait_until_idle(&mut core, its, MAX_STATUS_POLLS)? & its.errors;
        }
        core.write_word_32(its.control.into(), Controller::LOCK)?;
        let mut stored = [0; 2];
        core.read_32(chip.flash.start.into(), &mut stored)?;
        Ok((errors, stored == words))
    });
    match written {
        Ok((0, true)) => Ok(()),
        Ok((errors, _)) => {
            let state = format!("errors {errors:#x} of the flash's controller");
            let why = format!("its first words read back wrong ({state})");
            Err(refuse_unwritten(&why))
        }
        Err(error) => Err(refuse_unwritten(&causes(&error))),
    }
}

/// The status once the controller is idle. It programs a word in 100 us, less than one read of the
/// status (datasheets: STM32F405, table 39; STM32G474, table 51).
fn wait_until_idle(
    core: &mut Core<'_>,
    controller: Controller,
    max_polls: usize,
) -> Result<u32, probe_rs::Error> {
    for _ in 0..max_polls {
        let status = core.read_word_32(controller.status.into())?;
        if status & Controller::BUSY == 0 {
            return Ok(status);
        }
    }
    Err(probe_rs::Error::Timeout)
}

/// Refuses a protected chip: a change of its option bytes could erase it, or lock it permanently.
fn check_unprotected(session: &mut Session, options: OptionBytes) -> Result<()> {
    let (mask, none) = options.protection;
    let core = session.core(0);
    let options_word = core.and_then(|mut core| core.read_word_32(options.register.into()));
    let (cause, next) = match options_word {
        Ok(value) if value & mask == none => return Ok(()),
        Ok(value) => (
            format!("the chip is read-protected (option bytes {value:#010x}): nothing was written"),
            "kband changes no protection: flash without --option-bytes, or lift it with the vendor's tool, which erases the chip",
        ),
        Err(error) => (
            format!("the option bytes cannot be read: {}", causes(&error)),
            "flash without --option-bytes",
        ),
    };
    Err(Refusal::new(cause, next))
}

/// Sets the option bytes, keeps the others, and reads all of them back.
fn set(session: &mut Session, chip: &Chip, options: OptionBytes) -> Result<()> {
    let register = u64::from(options.register);
    let held = session.core(0).and_then(|mut core| {
        let before = core.read_word_32(register)? & !(OptionBytes::LOCK | OptionBytes::START);
        let requested = before & !options.clears;
        if requested == before {
            return Ok(true);
        }
        for key in OptionBytes::KEYS {
            core.write_word_32(options.keys.into(), key)?;
        }
        core.write_word_32(register, requested)?;
        core.write_word_32(register, requested | OptionBytes::START)?;
        wait_until_idle(&mut core, chip.controller, MAX_OPTION_POLLS)?;
        let after = core.read_word_32(register)?;
        core.write_word_32(register, requested | OptionBytes::LOCK)?;
        Ok(after & !(OptionBytes::LOCK | OptionBytes::START) == requested)
    });
    let wrong = match held {
        Ok(true) => return Ok(()),
        Ok(false) => "read back wrong".into(),
        Err(error) => format!("are not: {}", causes(&error)),
    };
    let cause = format!("the image is written, but the option bytes {wrong}");
    let next = "run kband flash --option-bytes again; kband identify lists them";
    Err(Refusal::new(cause, next))
}

fn commit(session: &mut Session, pieces: &[Piece], written: &mut impl FnMut(u64)) -> Result<()> {
    let failed = |error: &dyn std::error::Error| refuse_unwritten(&causes(error));
    let mut loader = session.target().flash_loader();
    for piece in pieces {
        let added = loader.add_data(piece.address.into(), &piece.bytes);
        added.map_err(|error| failed(&error))?;
    }
    let mut options = DownloadOptions::new();
    options.verify = true;
    options.progress = FlashProgress::new(|event| {
        if let ProgressEvent::Progress {
            operation, size, ..
        } = event
        {
            let program = matches!(operation, ProgressOperation::Program);
            written(if program { size } else { 0 });
        }
    });
    let committed = loader.commit(session, options);
    committed.map_err(|error| failed(&error))
}
