//! The state of an update and two slots of a flash for the program. Loader and program change the
//! state with `embassy-boot`. A single slot is in [`one_slot`].
//!
//! `embassy-boot` erases its state at each step. An interrupted erasure could leave its mark of a
//! swap, which differs by one bit from that of an ordinary start. Here an erasure is one word: it
//! ends a page of 64 bytes. From then on the next page, blank until now, holds the state.
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
const WORD: u32 = 4;
/// Offset in a page of the word that ends it.
const END: u32 = PAGE - WORD;
/// Largest number of pages that an update ends: mark, reversal, and confirmation.
const PAGES_OF_AN_UPDATE: u32 = 3;

/// The state of an update in `pages` pages of `flash` from `start` on, which were erased together.
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

    /// Whether enough pages remain for an update.
    pub fn have_room(&mut self) -> bool {
        let page = self.current();
        page.is_ok_and(|page| page + PAGES_OF_AN_UPDATE < self.pages)
    }

    /// Marks the slot of an update: the next start swaps the slots. Returns whether it is marked.
    pub fn mark(&mut self) -> bool {
        let mut word = [0; WORD as usize];
        let mut state = BlockingFirmwareState::new(self, &mut word);
        state.mark_updated().is_ok()
    }

    /// Confirms the running image: the next start does not revert it. Returns whether it did.
    pub fn confirm(&mut self) -> bool {
        let mut word = [0; WORD as usize];
        let mut state = BlockingFirmwareState::new(self, &mut word);
        state.mark_booted().is_ok()
    }

    /// Whether the next start swaps the slots or reverts an update; the running image is on trial.
    pub fn is_swap_due(&mut self) -> bool {
        let mut magic = [0; WORD as usize];
        let read = self.read(0, &mut magic).is_ok();
        read && embassy_boot::State::from(magic) == embassy_boot::State::Swap
    }

    fn read_at(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let read = self.flash.read(self.start + offset, bytes);
        read.map_err(|error| error.kind())
    }

    /// Number of the page with the state: the first one that has not ended.
    fn current(&mut self) -> Result<u32, NorFlashErrorKind> {
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
}

impl<F: NorFlash> ErrorType for StatePages<F> {
    type Error = NorFlashErrorKind;
}

impl<F: NorFlash> ReadNorFlash for StatePages<F> {
    const READ_SIZE: usize = 1;

    /// After the last page the state reads as blank: an ordinary start.
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
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

    fn erase(&mut self, _from: u32, _to: u32) -> Result<(), NorFlashErrorKind> {
        self.write(END, &[0; WORD as usize])
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let page = self.current()?;
        if page == self.pages {
            // All pages were used.
            return Err(NorFlashErrorKind::Other);
        }
        let written = self.flash.write(self.start + page * PAGE + offset, bytes);
        written.map_err(|error| error.kind())
    }
}

#[cfg(test)]
mod tests;
