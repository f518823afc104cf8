//! Two slots of a flash for the program: the state of an update, on which a loader and the program
//! work with `embassy-boot`. One slot is in [`one_slot`].
//!
//! `embassy-boot` erases its state at each step. A cut erasure could leave its mark of a swap, one
//! bit from that of an ordinary start. Here an erasure is one word: it ends a page of 64 bytes, and
//! the next page, blank until now, has the state from then on.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod layout;
pub mod note;
#[cfg(feature = "one_slot")]
pub mod one_slot;

use embassy_boot::BlockingFirmwareState;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// Size of a page, bytes: 14 words of `embassy-boot` for slots of three sectors, and the last one.
pub const PAGE: u32 = 64;
/// Size of a word, bytes.
const WORD: u32 = 4;
/// Offset in a page of the word that ends it.
const END: u32 = PAGE - WORD;
/// Number of pages that an update ends at most: it is marked, taken back, and marked as confirmed.
const PAGES_OF_AN_UPDATE: u32 = 3;

/// Error of the state's flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StateError {
    /// Reading or programming the flash failed.
    Flash(NorFlashErrorKind),
    /// All pages were used.
    Full,
}

impl NorFlashError for StateError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Flash(kind) => *kind,
            Self::Full => NorFlashErrorKind::Other,
        }
    }
}

/// The state of an update in `pages` pages of `flash` from `start` on. They were erased together.
pub struct StatePages<F> {
    flash: F,
    start: u32,
    pages: u32,
}

impl<F: NorFlash> StatePages<F> {
    /// The pages in these bytes of the flash.
    pub fn new(flash: F, range: core::ops::Range<u32>) -> Self {
        const { assert!(F::WRITE_SIZE as u32 == WORD && F::READ_SIZE == 1) };
        Self {
            flash,
            start: range.start,
            pages: range.len() as u32 / PAGE,
        }
    }

    /// Whether the pages last for an update.
    pub fn have_room(&mut self) -> Result<bool, StateError> {
        Ok(self.current()? + PAGES_OF_AN_UPDATE < self.pages)
    }

    /// Marks the slot of an update: the next start swaps the slots. Returns whether it is marked.
    pub fn mark(&mut self) -> bool {
        let mut word = [0; WORD as usize];
        let mut state = BlockingFirmwareState::new(self, &mut word);
        state.mark_updated().is_ok()
    }

    /// Confirms the running image: the next start takes no update back. Returns whether it did.
    pub fn confirm(&mut self) -> bool {
        let mut word = [0; WORD as usize];
        let mut state = BlockingFirmwareState::new(self, &mut word);
        state.mark_booted().is_ok()
    }

    /// Whether the next start swaps the slots or takes an update back. The running image is on trial
    /// then.
    pub fn is_swap_due(&mut self) -> bool {
        let mut magic = [0; WORD as usize];
        let read = self.read(0, &mut magic).is_ok();
        read && embassy_boot::State::from(magic) == embassy_boot::State::Swap
    }

    fn read_at(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), StateError> {
        let read = self.flash.read(self.start + offset, bytes);
        read.map_err(|error| StateError::Flash(error.kind()))
    }

    /// Number of the page with the state: the first one that was not ended.
    fn current(&mut self) -> Result<u32, StateError> {
        let (mut ended, mut open) = (0, self.pages);
        while ended < open {
            let middle = (ended + open) / 2;
            let mut word = [0; WORD as usize];
            self.read_at(middle * PAGE + END, &mut word)?;
            if word == [0xff; WORD as usize] {
                open = middle;
            } else {
                ended = middle + 1;
            }
        }
        Ok(open)
    }

    fn write_at(&mut self, offset: u32, bytes: &[u8]) -> Result<(), StateError> {
        let page = self.current()?;
        if page == self.pages {
            return Err(StateError::Full);
        }
        let written = self.flash.write(self.start + page * PAGE + offset, bytes);
        written.map_err(|error| StateError::Flash(error.kind()))
    }
}

impl<F: NorFlash> ErrorType for StatePages<F> {
    type Error = StateError;
}

impl<F: NorFlash> ReadNorFlash for StatePages<F> {
    const READ_SIZE: usize = 1;

    /// Behind the last page the state is blank: an ordinary start.
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), StateError> {
        let page = self.current()?;
        if page == self.pages {
            bytes.fill(0xff);
            return Ok(());
        }
        self.read_at(page * PAGE + offset, bytes)
    }

    fn capacity(&self) -> usize {
        END as usize
    }
}

impl<F: NorFlash> NorFlash for StatePages<F> {
    const WRITE_SIZE: usize = WORD as usize;
    const ERASE_SIZE: usize = END as usize;

    fn erase(&mut self, _from: u32, _to: u32) -> Result<(), StateError> {
        self.write_at(END, &[0; WORD as usize])
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), StateError> {
        self.write_at(offset, bytes)
    }
}

#[cfg(test)]
mod tests;
