//! An image into the flash: drive off first, and no board that starts half an image.

use std::time::Duration;

use probe_rs::flashing::{DownloadOptions, FlashProgress, ProgressEvent, ProgressOperation};
use probe_rs::{Core, MemoryInterface, Session};

use super::apart;
use super::image::{Image, Piece};
use super::model::{Chip, Controller, OptionBytes};
use super::reach::{Reached, causes};
use crate::desk::Desk;
use crate::refusal::Refusal;

/// Longest wait for the core to stop.
const HALT_TIMEOUT: Duration = Duration::from_millis(500);
/// Bytes of stack and entry of the image; while they are erased, no core starts.
const STACK_AND_ENTRY_BYTES: usize = 8;
/// Reads of the flash controller's status until it counts as stuck: for a word, and for the option
/// bytes, whose sector is erased.
const MAX_STATUS_POLLS: usize = 1_000;
const LONG_LOOKS: usize = 100_000;
/// The next step after an interrupted run.
const AGAIN: &str =
    "run kband flash again: until it succeeds the board does not start; its settings are kept";

/// Writes an image through a probe, verifies it and starts it; `written` receives numbers of
/// written bytes.
///
/// The order is: identify the chip, switch the drive off, stop the core. The sector of the vector
/// table is erased first, and its first words are written last, after all else is verified. So an
/// interrupted board does not start, and its drive stays off. Requested option bytes are set at the
/// end. A protected chip is refused before anything is written.
pub fn write(
    image: Image,
    probe: Option<&str>,
    options: Option<OptionBytes>,
    desk: &Desk,
    mut written: impl FnMut(u64),
) -> Result<(), Refusal> {
    let probe = probe.map(str::to_owned);
    let said = apart::start(move |sender| {
        // A closed channel has no reader.
        let mut report = |bytes| _ = sender.send(Said::Written(bytes));
        let end = write_here(&image, probe.as_deref(), options, &mut report);
        _ = sender.send(Said::Ended(end));
    })?;
    let mut begun = false;
    loop {
        let next = apart::next(&said, desk);
        match next.map_err(|cut| if begun { cut.then(AGAIN) } else { cut })? {
            Said::Written(bytes) => {
                begun = true;
                written(bytes);
            }
            Said::Ended(end) => return end,
        }
    }
}

enum Said {
    Written(u64),
    Ended(Result<(), Refusal>),
}

fn write_here(
    image: &Image,
    probe: Option<&str>,
    options: Option<OptionBytes>,
    written: &mut impl FnMut(u64),
) -> Result<(), Refusal> {
    let chip = image.chip();
    let mut reached = Reached::by(probe, chip)?;
    reached.drive_off()?;
    let mut session = reached.control()?;
    stop(&mut session, chip)?;
    if let Some(options) = options {
        unprotected(&mut session, options)?;
    }
    let (first, rest) = parts(image);
    commit(&mut session, &rest, written)?;
    begin(&mut session, chip, first)?;
    written(STACK_AND_ENTRY_BYTES as u64);
    if let Some(options) = options {
        set(&mut session, chip, options)?;
    }
    let started = session.core(0).and_then(|mut core| core.reset());
    started.map_err(|error| {
        Refusal::new(
            format!(
                "written and verified, but the chip does not start: {}",
                causes(&error)
            ),
            "switch the board off and on",
        )
    })
}

fn parts(image: &Image) -> ([u32; 2], Vec<Piece>) {
    let start = image.chip().flash.start;
    let mut first = [0; 2];
    let mut pieces = image.pieces().to_vec();
    // The checks of an image require the vector table at its begin.
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
fn stop(session: &mut Session, chip: &Chip) -> Result<(), Refusal> {
    let (address, bit) = chip.drives;
    let off = session.core(0).and_then(|mut core| {
        core.halt(HALT_TIMEOUT)?;
        let drives = core.read_word_32(address.into())?;
        core.write_word_32(address.into(), drives & !bit)?;
        Ok(core.read_word_32(address.into())? & bit == 0)
    });
    let switch = "nothing was written: switch the board off, and look at its bridge";
    match off {
        Ok(true) => Ok(()),
        Ok(false) => Err(Refusal::new("the drive does not switch off", switch)),
        Err(error) => Err(Refusal::new(
            format!("the core does not stop: {}", causes(&error)),
            switch,
        )),
    }
}

fn unwritten(why: &str) -> Refusal {
    Refusal::new(format!("the flash was not written: {why}"), AGAIN)
}

/// Writes the first words, stack before entry, by the flash controller's registers. A loader writes
/// whole pages, and some flashes accept no second write of a word, not even an erased value.
fn begin(session: &mut Session, chip: &Chip, words: [u32; 2]) -> Result<(), Refusal> {
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
            errors |= idle(&mut core, its, MAX_STATUS_POLLS)? & its.errors;
        }
        core.write_word_32(its.control.into(), Controller::LOCK)?;
        let mut held = [0; 2];
        core.read_32(chip.flash.start.into(), &mut held)?;
        Ok((errors, held == words))
    });
    match written {
        Ok((0, true)) => Ok(()),
        Ok((errors, _)) => Err(unwritten(&format!(
            "its first words read back wrong (errors {errors:#x} of the flash's controller)"
        ))),
        Err(error) => Err(unwritten(&causes(&error))),
    }
}

/// The status of the idle controller. It programs a word in 100 us, less than one read of the
/// status (datasheets: STM32F405, table 39; STM32G474, table 51).
fn idle(core: &mut Core<'_>, controller: Controller, looks: usize) -> Result<u32, probe_rs::Error> {
    for _ in 0..looks {
        let status = core.read_word_32(controller.status.into())?;
        if status & Controller::BUSY == 0 {
            return Ok(status);
        }
    }
    Err(probe_rs::Error::Timeout)
}

/// Refused for a protected chip: a change of its option bytes could erase it, or lock it for ever.
fn unprotected(session: &mut Session, options: OptionBytes) -> Result<(), Refusal> {
    let (mask, none) = options.protection;
    let shown = session
        .core(0)
        .and_then(|mut core| core.read_word_32(options.register.into()));
    match shown {
        Ok(value) if value & mask == none => Ok(()),
        Ok(value) => Err(Refusal::new(
            format!("the chip is read-protected (option bytes {value:#010x}): nothing was written"),
            "kband changes no protection: flash without --option-bytes, or lift it with the vendor's tool, which erases the chip",
        )),
        Err(error) => Err(Refusal::new(
            format!("the option bytes cannot be read: {}", causes(&error)),
            "flash without --option-bytes",
        )),
    }
}

/// Sets the option bytes, keeps all others, and reads them back.
fn set(session: &mut Session, chip: &Chip, options: OptionBytes) -> Result<(), Refusal> {
    let register = u64::from(options.register);
    let held = session.core(0).and_then(|mut core| {
        let before = core.read_word_32(register)? & !(OptionBytes::LOCK | OptionBytes::START);
        let wanted = before & !options.clears;
        if wanted == before {
            return Ok(true);
        }
        for key in OptionBytes::KEYS {
            core.write_word_32(options.keys.into(), key)?;
        }
        core.write_word_32(register, wanted)?;
        core.write_word_32(register, wanted | OptionBytes::START)?;
        idle(&mut core, chip.controller, LONG_LOOKS)?;
        let after = core.read_word_32(register)?;
        core.write_word_32(register, wanted | OptionBytes::LOCK)?;
        Ok(after & !(OptionBytes::LOCK | OptionBytes::START) == wanted)
    });
    let next = "run kband flash --option-bytes again; kband identify lists them";
    match held {
        Ok(true) => Ok(()),
        Ok(false) => Err(Refusal::new(
            "the image is written, but the option bytes read back wrong",
            next,
        )),
        Err(error) => Err(Refusal::new(
            format!(
                "the image is written, but the option bytes are not: {}",
                causes(&error)
            ),
            next,
        )),
    }
}

/// Erases, writes and verifies.
fn commit(
    session: &mut Session,
    pieces: &[Piece],
    written: &mut impl FnMut(u64),
) -> Result<(), Refusal> {
    let failed = |error: &dyn std::error::Error| unwritten(&causes(error));
    let mut loader = session.target().flash_loader();
    for piece in pieces {
        loader
            .add_data(piece.address.into(), &piece.bytes)
            .map_err(|error| failed(&error))?;
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
    loader
        .commit(session, options)
        .map_err(|error| failed(&error))
}
