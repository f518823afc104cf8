//! An image into the flash: drive off first, and no board that starts half an image.

use std::time::Duration;

use probe_rs::flashing::{DownloadOptions, FlashProgress, ProgressEvent, ProgressOperation};
use probe_rs::{MemoryInterface, Session};

use super::apart;
use super::image::{Image, Piece};
use super::model::Chip;
use super::reach::{Reached, causes};
use crate::desk::Desk;
use crate::refusal::Refusal;

/// Longest wait for the core to stop.
const HALT: Duration = Duration::from_millis(500);
/// Stack and entry of the image: erased, no core starts.
const FIRST: usize = 8;
/// What to do after it was cut.
const AGAIN: &str = "run kband flash again: until it ends well the board does not start, and its settings are untouched";

/// Writes an image through a probe, verifies it and starts it; `written` hears of bytes written.
///
/// The chip is identified first, then the drive is switched off, and only then is the core stopped. The
/// sector with the vector table is erased before all others and its first words are written after all else
/// was verified: cut at any moment, the board does not start, and its drive stays off.
pub fn write(
    image: Image,
    chip: &'static Chip,
    probe: Option<&str>,
    desk: &Desk,
    mut written: impl FnMut(u64),
) -> Result<(), Refusal> {
    let probe = probe.map(str::to_owned);
    let said = apart::start(move |sender| {
        // Nobody listens any more: then nobody misses it.
        let mut told = |bytes| _ = sender.send(Said::Written(bytes));
        let end = write_here(&image, chip, probe.as_deref(), &mut told);
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

/// What the writing says.
enum Said {
    Written(u64),
    Ended(Result<(), Refusal>),
}

fn write_here(
    image: &Image,
    chip: &'static Chip,
    probe: Option<&str>,
    written: &mut impl FnMut(u64),
) -> Result<(), Refusal> {
    let mut reached = Reached::by(probe, chip)?;
    reached.drive_off()?;
    let mut session = reached.control()?;
    stop(&mut session, chip)?;
    let (first, rest) = parts(image, chip);
    commit(&mut session, &rest, true, written)?;
    commit(&mut session, &first, false, written)?;
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

/// The image's first words, and all that is behind them.
fn parts(image: &Image, chip: &Chip) -> (Vec<Piece>, Vec<Piece>) {
    let mut pieces = image.pieces().to_vec();
    let head = pieces
        .iter_mut()
        .find(|piece| piece.address == chip.flash.start && piece.bytes.len() > FIRST);
    let first = head.map(|piece| {
        let rest = piece.bytes.split_off(FIRST);
        piece.address += FIRST as u32;
        Piece {
            address: chip.flash.start,
            bytes: std::mem::replace(&mut piece.bytes, rest),
        }
    });
    (first.into_iter().collect(), pieces)
}

/// Stops the core, and looks that the drive is off.
fn stop(session: &mut Session, chip: &Chip) -> Result<(), Refusal> {
    let (address, bit) = chip.drives;
    let off = session.core(0).and_then(|mut core| {
        core.halt(HALT)?;
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

/// Erases where it is asked to, writes and verifies.
fn commit(
    session: &mut Session,
    pieces: &[Piece],
    erase: bool,
    written: &mut impl FnMut(u64),
) -> Result<(), Refusal> {
    let failed = |error: &dyn std::error::Error| {
        Refusal::new(
            format!("the flash was not written: {}", causes(error)),
            AGAIN,
        )
    };
    let mut loader = session.target().flash_loader();
    for piece in pieces {
        loader
            .add_data(piece.address.into(), &piece.bytes)
            .map_err(|error| failed(&error))?;
    }
    let mut options = DownloadOptions::new();
    options.verify = true;
    options.skip_erase = !erase;
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
