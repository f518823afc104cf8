//! Messages of an update of the firmware.
//!
//! Their frames have version 0, and their bytes never change: any desk can update any board.

use super::message::Pin;
use serde::{Deserialize, Serialize};

/// Largest number of bytes of an image in a request.
pub const MAX_UPDATE_BYTES: usize = 256;

/// Request of an update.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum UpdateRequest<'a> {
    /// Reads the board's state for updates.
    State,
    /// Gives the desk write access, as [`super::Request::Unlock`].
    Unlock(Pin),
    /// Sets the public key, 32 bytes. An error while running, or over another key without a PIN.
    Key(&'a [u8]),
    /// Begins an update. An error while the drive runs, for another board, or beyond the slot.
    Begin {
        /// Name of the board that the image is for.
        board: &'a str,
        /// Length of the image in bytes, a multiple of 4.
        length: u32,
    },
    /// The next bytes of the image, a multiple of 4.
    Bytes {
        /// Number of bytes before them.
        offset: u32,
        /// The bytes, [`MAX_UPDATE_BYTES`] at most.
        bytes: &'a [u8],
    },
    /// Ends the image with its signature, 64 bytes. A correct one starts the new image on trial.
    End(&'a [u8]),
    /// Confirms the image on trial. Without it the next start uses the previous image.
    Confirm,
    /// Begins an update in the loader of a board with one slot, which then erases its old image.
    Signed {
        /// Name of the board that the image is for.
        board: &'a str,
        /// Length of the image in bytes, a multiple of 4.
        length: u32,
        /// SHA-512 of the image and the name, 64 bytes.
        sum: &'a [u8],
        /// Signature of the sum, 64 bytes.
        signature: &'a [u8],
    },
}

/// Number of new image bytes in a request with `bytes` at `offset`. The image has `length` bytes,
/// of which `written` are stored. `None` for a repeated request, which was already carried out.
///
/// # Errors [`UpdateRefusal::Length`] for an invalid number of bytes, or beyond the image;
/// [`UpdateRefusal::Order`] if other bytes are due.
pub fn check_chunk(
    offset: u32,
    bytes: &[u8],
    length: u32,
    written: u32,
) -> Result<Option<u32>, UpdateRefusal> {
    let size = bytes.len() as u32;
    let end = offset.checked_add(size).filter(|end| *end <= length);
    let fits = size > 0 && size.is_multiple_of(4) && bytes.len() <= MAX_UPDATE_BYTES;
    match end.filter(|_| fits) {
        None => Err(UpdateRefusal::Length),
        Some(end) if end == written => Ok(None),
        Some(_) if offset != written => Err(UpdateRefusal::Order(written)),
        Some(end) => Ok(Some(end)),
    }
}

/// Answer to a request of an update.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum UpdateAnswer<'a> {
    /// The request was carried out.
    Done,
    /// The request was rejected without effect.
    Refused(UpdateRefusal),
    /// State of the board for updates.
    State {
        /// Name of the board.
        board: &'a str,
        /// Size of its slot in bytes; 0 for a board without one.
        size: u32,
        /// Whether it has a public key.
        has_key: bool,
        /// Whether its image is on trial.
        on_trial: bool,
    },
    /// The board restarts into its loader, which receives the image by [`UpdateRequest::Signed`].
    Loader,
}

/// Reason for a rejected request of an update.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum UpdateRefusal {
    /// The drive runs, or a simulation of it.
    Running,
    /// The link is read-only.
    ReadOnly,
    /// The PIN is wrong.
    WrongPin,
    /// Too many wrong PINs; the next attempt is possible after this number of seconds.
    Wait(u16),
    /// The fieldbus is in control.
    NotInControl,
    /// The board has no slot for an update.
    NoSlot,
    /// The board has no public key.
    NoKey,
    /// The board has another public key, and no PIN that protects it.
    HasKey,
    /// A key, an image or a signature of a wrong length.
    Length,
    /// The image is for another board.
    OtherBoard,
    /// Bytes out of order; the board has this number of them.
    Order(u32),
    /// The signature does not belong to image, board and key.
    Signature,
    /// The image on trial was not confirmed.
    OnTrial,
    /// The supply is low, or was within the last 100 ms.
    SupplyLow,
    /// The non-volatile memory failed, or has no saved settings.
    Store,
    /// Too many updates were begun since the board's start.
    TooOften,
}

/// Largest number of updates that a board begins after a start: each one wears its flash.
pub const MAX_UPDATES_PER_START: u8 = 16;
