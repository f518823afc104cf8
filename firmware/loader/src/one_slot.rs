//! Update of a chip with one slot: the loader writes the image over the old one.
//!
//! The desk first sends the image's hash with its signature. Only then the loader sets the slot's
//! first word, its mark, to zero and erases its page. The loader writes the mark last, once the
//! hash of the written image is the signed one. A program starts if it has a mark and its CRC-32 is
//! right.

use crate::layout::stm32g474::{BOARD, END, KEY, PAGE, RAM, SLOT};
use core::ops::Range;
use kband_control::wire::{
    MAX_UPDATE_BYTES, MAX_UPDATES_PER_START, UpdateAnswer, UpdateRefusal, UpdateRequest,
    check_chunk,
};
use salty::{PublicKey, Sha512, Signature};

/// Size of a word that is programmed at once, bytes.
const WORD: usize = 8;
/// Offset behind the word with the program's end: length of the shortest accepted image.
const MIN_LENGTH: u32 = END + WORD as u32;
/// Word after the key; it marks a completely written key.
const KEY_WRITTEN: [u8; WORD] = *b"key whol";

/// The chip's flash. Its functions return false or `None` on failure.
pub trait Memory {
    /// Copies the content from an address on; false if a word has wrong bits.
    fn read(&self, address: u32, bytes: &mut [u8]) -> bool;
    /// Programs a word that is erased, or sets a word to zero.
    fn program(&mut self, address: u32, word: &[u8; WORD]) -> bool;
    /// Erases the page at an address.
    fn erase(&mut self, address: u32) -> bool;
    /// CRC-32 of the words at these addresses.
    fn crc32(&self, range: Range<u32>) -> Option<u32>;
}

type Result<T = (), E = UpdateRefusal> = core::result::Result<T, E>;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    None,
    Open(DueImage),
    Done,
}

/// An image of this length and hash is due; `written` bytes are in the slot, without its mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct DueImage {
    length: u32,
    sum: [u8; 64],
    written: u32,
    mark: [u8; WORD],
}

/// The loader's side of an update.
pub struct OneSlot<M> {
    memory: M,
    key: Option<[u8; 32]>,
    progress: Progress,
    begun: u8,
}

impl<M: Memory> OneSlot<M> {
    /// The slot in this memory; `requested` is the key left by the program.
    pub fn new(memory: M, requested: Option<[u8; 32]>) -> Self {
        let mut slot = Self {
            memory,
            key: None,
            progress: Progress::None,
            begun: 0,
        };
        slot.key = requested.or_else(|| slot.stored_key());
        slot
    }

    /// Whether the slot has a complete program.
    pub fn has_program(&self) -> bool {
        let word = |address| {
            let mut word = [0; 4];
            let read = self.memory.read(address, &mut word);
            read.then_some(u32::from_le_bytes(word))
        };
        let is_whole = || {
            let [stack, entry] = [word(SLOT.start)?, word(SLOT.start + 4)?];
            let end = word(SLOT.start + END)?;
            let is_bounded = RAM.contains(&stack.wrapping_sub(1))
                && SLOT.contains(&entry)
                && (SLOT.start + MIN_LENGTH..SLOT.end).contains(&end)
                && end.is_multiple_of(4);
            let sum = is_bounded.then(|| self.memory.crc32(SLOT.start..end))??;
            Some(sum == word(end)?)
        };
        is_whole().unwrap_or(false)
    }

    /// Whether the update is finished.
    pub fn is_done(&self) -> bool {
        self.progress == Progress::Done
    }

    /// Answers a request.
    pub fn answer(
        &mut self,
        request: &UpdateRequest<'_>,
        supply_is_good: bool,
    ) -> UpdateAnswer<'static> {
        let changed = match *request {
            UpdateRequest::State => {
                return UpdateAnswer::State {
                    board: BOARD,
                    size: SLOT.end - SLOT.start,
                    has_key: self.key.is_some(),
                    on_trial: false,
                };
            }
            // The signature protects this board, and the PIN does not.
            UpdateRequest::Unlock(_) => Ok(()),
            UpdateRequest::Signed { .. } | UpdateRequest::Bytes { .. } | UpdateRequest::End(_)
                if !supply_is_good =>
            {
                Err(UpdateRefusal::SupplyLow)
            }
            UpdateRequest::Signed {
                board,
                length,
                sum,
                signature,
            } => self.begin(board, length, sum, signature),
            UpdateRequest::Bytes { offset, bytes } => self.write(offset, bytes),
            UpdateRequest::End(_) => self.end(),
            UpdateRequest::Key(_) | UpdateRequest::Begin { .. } | UpdateRequest::Confirm => {
                return UpdateAnswer::Loader;
            }
        };
        changed.map_or_else(UpdateAnswer::Refused, |()| UpdateAnswer::Done)
    }

    fn begin(&mut self, board: &str, length: u32, sum: &[u8], signature: &[u8]) -> Result {
        if board != BOARD {
            return Err(UpdateRefusal::OtherBoard);
        }
        let (Ok(sum), Ok(signature)) = (sum.try_into(), signature.try_into()) else {
            return Err(UpdateRefusal::Length);
        };
        let fits = (MIN_LENGTH..=SLOT.end - SLOT.start).contains(&length);
        if !fits || !length.is_multiple_of(4) {
            return Err(UpdateRefusal::Length);
        }
        let key = self.key.ok_or(UpdateRefusal::NoKey)?;
        if !is_signed(&key, &sum, signature) {
            return Err(UpdateRefusal::Signature);
        }
        if self.begun == MAX_UPDATES_PER_START {
            return Err(UpdateRefusal::TooOften);
        }
        self.begun += 1;
        self.progress = Progress::None;
        // A page with an interrupted erasure may read as before; a mark of zero prevents a start.
        if !self.keep_key(&key)
            || !self.memory.program(SLOT.start, &[0; WORD])
            || !self.memory.erase(SLOT.start)
        {
            return Err(UpdateRefusal::Store);
        }
        self.progress = Progress::Open(DueImage {
            length,
            sum,
            written: 0,
            mark: [0; WORD],
        });
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result {
        let Progress::Open(due) = &mut self.progress else {
            return Err(UpdateRefusal::Order(0));
        };
        let Some(end) = check_chunk(offset, bytes, due.length, due.written)? else {
            return Ok(());
        };
        // Only the last word may be padded.
        if !offset.is_multiple_of(WORD as u32) {
            return Err(UpdateRefusal::Length);
        }
        for (at, part) in (offset..).step_by(WORD).zip(bytes.chunks(WORD)) {
            let mut word = [0xff; WORD];
            word[..part.len()].copy_from_slice(part);
            if at == 0 {
                due.mark = word;
                continue;
            }
            let address = SLOT.start + at;
            let erased = !at.is_multiple_of(PAGE) || self.memory.erase(address);
            if !erased || !program(&mut self.memory, address, &word) {
                self.progress = Progress::None;
                return Err(UpdateRefusal::Store);
            }
        }
        due.written = end;
        Ok(())
    }

    fn end(&mut self) -> Result {
        let due = match self.progress {
            Progress::Done => return Ok(()),
            Progress::None => return Err(UpdateRefusal::Order(0)),
            Progress::Open(due) => due,
        };
        if due.written != due.length {
            return Err(UpdateRefusal::Order(due.written));
        }
        self.progress = Progress::None;
        let mut written = Sha512::new();
        written.update(&due.mark);
        let mut bytes = [0; MAX_UPDATE_BYTES];
        for at in (WORD as u32..due.length).step_by(MAX_UPDATE_BYTES) {
            let bytes = &mut bytes[..MAX_UPDATE_BYTES.min((due.length - at) as usize)];
            if !self.memory.read(SLOT.start + at, bytes) {
                return Err(UpdateRefusal::Store);
            }
            written.update(bytes);
        }
        written.update(BOARD.as_bytes());
        if written.finalize() != due.sum {
            return Err(UpdateRefusal::Signature);
        }
        if !program(&mut self.memory, SLOT.start, &due.mark) {
            return Err(UpdateRefusal::Store);
        }
        self.progress = Progress::Done;
        Ok(())
    }

    fn stored_key(&self) -> Option<[u8; 32]> {
        let (mut key, mut whole) = ([0; 32], [0; WORD]);
        let read = self.memory.read(KEY, &mut key) && self.memory.read(KEY + 32, &mut whole);
        (read && whole == KEY_WRITTEN).then_some(key)
    }

    fn keep_key(&mut self, key: &[u8; 32]) -> bool {
        if self.stored_key() == Some(*key) {
            return true;
        }
        let (words, _) = key.as_chunks();
        let mut words = ((KEY..).step_by(WORD)).zip(words.iter().chain([&KEY_WRITTEN]));
        self.memory.erase(KEY)
            && words.all(|(address, word)| program(&mut self.memory, address, word))
    }
}

/// Programs a word and verifies it; an erased one needs no programming.
fn program(memory: &mut impl Memory, address: u32, word: &[u8; WORD]) -> bool {
    let mut stored = [0; WORD];
    (*word == [0xff; WORD] || memory.program(address, word))
        && memory.read(address, &mut stored)
        && stored == *word
}

/// Whether `signature` is the key owner's signature of `sum`.
#[inline(never)]
pub fn is_signed(key: &[u8; 32], sum: &[u8; 64], signature: &[u8; 64]) -> bool {
    let key = PublicKey::try_from(key);
    key.is_ok_and(|key| key.verify(sum, &Signature::from(signature)).is_ok())
}

#[cfg(test)]
mod tests;
