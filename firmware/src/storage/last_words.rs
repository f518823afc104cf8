//! Last message of the firmware, kept across a reset: up to 244 bytes of UTF-8 text.
//!
//! The record lies in RAM that the start-up code does not clear. After power-on its content is
//! arbitrary: a record counts only with its mark and a valid checksum.

use core::fmt;
use kband_control::wire::crc32;

/// Longest stored text, bytes; a longer one is cut.
const CAPACITY: usize = 244;
/// Mark of a valid record.
const MARK: u32 = 0x6b62_4c57;

/// The record in reserved RAM.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct LastWords {
    mark: u32,
    length: u32,
    check: u32,
    text: [u8; CAPACITY],
}

impl LastWords {
    /// No record.
    pub const EMPTY: Self = Self {
        mark: 0,
        length: 0,
        check: 0,
        text: [0; CAPACITY],
    };

    /// Replaces the record by `words`, cut at the capacity.
    pub fn keep(&mut self, words: fmt::Arguments<'_>) {
        *self = Self::EMPTY;
        // The writer never fails: text beyond the capacity is dropped.
        let _ = fmt::Write::write_fmt(self, words);
        self.check = crc32(&self.text);
        self.mark = MARK;
    }

    /// The stored text, if its record is valid.
    pub fn read(&self) -> Option<&str> {
        let length = usize::try_from(self.length).ok()?;
        if self.mark != MARK || self.check != crc32(&self.text) {
            return None;
        }
        core::str::from_utf8(self.text.get(..length)?).ok()
    }
}

impl fmt::Write for LastWords {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for character in text.chars() {
            let start = self.length as usize;
            let Some(room) = self.text.get_mut(start..start + character.len_utf8()) else {
                break;
            };
            character.encode_utf8(room);
            self.length += room.len() as u32;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    #[test]
    fn kept_words_are_read_and_noise_and_cleared_ones_are_not() {
        let mut words = LastWords::EMPTY;
        assert_eq!(words.read(), None);
        words.keep(format_args!("{} at {}", "index out of range", "lib.rs:7"));
        assert_eq!(words.read(), Some("index out of range at lib.rs:7"));
        assert_eq!(with(words, |it| it.text[3] ^= 1).read(), None);
        assert_eq!(with(words, |it| it.length = u32::MAX).read(), None);
        assert_eq!(with(words, |it| it.mark = 0).read(), None);
    }

    #[test]
    fn long_words_are_cut_between_characters() {
        let mut words = LastWords::EMPTY;
        words.keep(format_args!("a{}", "é".repeat(300)));
        let text = words.read().unwrap();
        assert_eq!(text.len(), 243);
        assert!(text.ends_with('é'));
    }
}
