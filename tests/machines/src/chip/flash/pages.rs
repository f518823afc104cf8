//! Controller of the flash of the STM32G474: two banks of pages, words of 8 bytes with an
//! error-correcting code (RM0440, chapter 3; DS12288, flash memory characteristics).

use super::{DATA_CACHE, Flash, LOCKED, PROGRAM, TICKS};

/// Size of a page, bytes, with the flash in two banks.
pub const SIZE: usize = 2 * 1024;
const BANK: usize = 128;
/// Size of a word that is programmed at once, bytes.
const WORD: usize = 8;
/// Factory value of OPTR (3.7.8): brown-out reset off, watchdog started by software, two banks.
pub const OPTIONS: u32 = 0xffef_f8aa;
/// Bit of OPTR: software starts the independent watchdog.
pub const SOFTWARE_WATCHDOG: u32 = 1 << 16;
/// Bits of CR (3.7.6).
const ERASE_PAGE: u32 = 1 << 1;
pub(super) const OPTION_LOCK: u32 = 1 << 30;
/// Bits of SR (3.7.5): programmed twice, alignment, size, sequence; all errors.
const PROGRAMMED_TWICE: u32 = 1 << 3;
const ALIGNMENT: u32 = 1 << 5;
const WRONG_SIZE: u32 = 1 << 6;
const WRONG_SEQUENCE: u32 = 1 << 7;
pub(super) const ERRORS: u32 = 0xc3fa;
/// Bit of ECCR (3.7.7): two wrong bits were read.
pub(super) const DOUBLE_ERROR: u32 = 1 << 31;
/// Typical and longest duration of an erasure, ticks: 22 ms and 24.5 ms.
const ERASE_TIME: [u64; 2] = [22 * TICKS / 1000, 49 * TICKS / 2000];
/// Typical and longest duration of programming a word, ticks: 82 us and 84 us.
const WORD_TIME: [u64; 2] = [82 * TICKS / 1_000_000, 84 * TICKS / 1_000_000];

impl Flash {
    pub(super) fn erase_page(&mut self, now: u64) {
        // An erasure does not start with an error set.
        if self.control & ERASE_PAGE == 0 || self.status & ERRORS != 0 || now < self.busy {
            return self.status |= WRONG_SEQUENCE;
        }
        let number = (self.control >> 3 & 0x7f | self.control >> 4 & 0x80) as usize;
        let range = number * SIZE..(number + 1) * SIZE;
        self.torn.retain(|at| !range.contains(at));
        let usual = ERASE_TIME[usize::from(self.slow)];
        self.erase_sector(range, self.erases_in.unwrap_or(usual), now);
    }

    /// Writes half a word; the second half programs the word. After an erasure a word can be
    /// programmed once, and afterwards only to 0 (3.3.8).
    pub(super) fn program_word(&mut self, offset: usize, size: u32, value: u32, now: u64) {
        if self.control & (LOCKED | PROGRAM) != PROGRAM || self.status & ERRORS != 0 {
            return self.status |= WRONG_SEQUENCE;
        }
        if size != 4 {
            return self.status |= WRONG_SIZE;
        }
        let first = match self.half.take() {
            None if offset.is_multiple_of(WORD) => return self.half = Some((offset, value)),
            Some((at, first)) if at + 4 == offset => first,
            _ => return self.status |= ALIGNMENT,
        };
        let at = offset - 4;
        let word = u64::from(first) | u64::from(value) << 32;
        let before = self.bytes[at..at + WORD].to_vec();
        let erased = before == [0xff; WORD] && !self.torn.contains(&at);
        if word != 0 && !erased {
            return self.status |= PROGRAMMED_TWICE;
        }
        self.programmed_weak |= self.weak.iter().any(|range| range.contains(&at));
        self.programmed_cached |= self.access & DATA_CACHE != 0;
        self.under_way = Some((at, before));
        self.bytes[at..at + WORD].copy_from_slice(&word.to_le_bytes());
        self.torn.remove(&at);
        self.operations += 1;
        self.busy = now.max(self.busy) + WORD_TIME[usize::from(self.slow)];
    }

    /// Whether an offset is in the bank of the last operation.
    pub(super) fn shares_bank(&self, offset: usize) -> bool {
        let bank = |offset: usize| offset / SIZE / BANK;
        let worked = self.under_way.as_ref().map(|(at, _)| bank(*at));
        worked == Some(bank(offset))
    }

    /// Puts two wrong bits into each word of this range, as an interrupted operation does.
    pub fn tear(&mut self, at: usize, length: usize) {
        self.torn.extend((at..at + length).step_by(WORD));
    }

    /// Reports a read of a word with two wrong bits; returns whether the word is one.
    #[inline]
    pub fn reads_torn(&mut self, offset: usize) -> bool {
        let torn = !self.torn.is_empty() && self.torn.contains(&(offset & !(WORD - 1)));
        if torn {
            self.code |= DOUBLE_ERROR;
        }
        torn
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BUSY, KEYS, START_ERASING};
    use super::*;
    use crate::chip::kind::Kind;

    const PLACE: usize = 0x7_f000;

    fn open() -> Flash {
        let mut flash = Flash::new(Kind::Stm32g474);
        for key in KEYS {
            flash.set_register(0x08, key, 0);
        }
        assert_eq!(flash.register(0x14, 0), OPTION_LOCK);
        flash
    }

    fn program(flash: &mut Flash, at: usize, word: u64, now: u64) {
        flash.set_register(0x14, PROGRAM, now);
        flash.program(at, 4, word as u32, now);
        flash.program(at + 4, 4, (word >> 32) as u32, now);
    }

    #[test]
    fn a_word_is_programmed_once_and_then_to_zero() {
        let mut flash = open();
        program(&mut flash, PLACE, 0x0123_4567_89ab_cdef, 0);
        assert_eq!(flash.register(0x10, WORD_TIME[0] - 1), BUSY);
        assert_eq!(flash.register(0x10, WORD_TIME[0]), 0);
        let word = u64::from_le_bytes(flash.bytes[PLACE..][..8].try_into().unwrap());
        assert_eq!(word, 0x0123_4567_89ab_cdef);
        program(&mut flash, PLACE, 1, TICKS);
        assert_eq!(flash.register(0x10, TICKS), PROGRAMMED_TWICE);
        program(&mut flash, PLACE + 8, 1, TICKS);
        let both = PROGRAMMED_TWICE | WRONG_SEQUENCE;
        assert_eq!(flash.register(0x10, TICKS), both, "an error blocks it");
        flash.set_register(0x10, ERRORS, TICKS);
        program(&mut flash, PLACE, 0, TICKS);
        assert_eq!(flash.bytes[PLACE..][..8], [0; 8]);
        assert_eq!(flash.operations, 2);
        assert!(std::mem::take(&mut flash.programmed_cached));
        flash.set_register(0x00, 0, TICKS);
        program(&mut flash, PLACE + 16, 1, 2 * TICKS);
        assert!(!flash.programmed_cached);
    }

    #[test]
    fn half_a_word_and_a_wrong_size_are_errors() {
        for (at, size, error) in [(4, 4, ALIGNMENT), (0, 1, WRONG_SIZE)] {
            let mut flash = open();
            flash.set_register(0x14, PROGRAM, 0);
            flash.program(PLACE + at, size, 0, 0);
            assert_eq!((flash.register(0x10, 0), flash.operations), (error, 0));
        }
        let mut locked = Flash::new(Kind::Stm32g474);
        program(&mut locked, PLACE, 0, 0);
        assert_eq!(locked.register(0x10, 0), WRONG_SEQUENCE);
    }

    #[test]
    fn an_erasure_takes_a_page_of_its_bank_and_blocks_that_bank() {
        for (bank, number) in [(0, 127), (1, 127)] {
            let mut flash = open();
            flash.bytes.fill(0);
            let page = ERASE_PAGE | 127 << 3 | (bank as u32) << 11;
            flash.set_register(0x14, page | START_ERASING, 0);
            let at = (128 * bank + number) * SIZE;
            assert_eq!(flash.bytes[at..at + SIZE], [0xff; SIZE]);
            assert_eq!(flash.bytes.iter().filter(|b| **b == 0xff).count(), SIZE);
            assert_eq!(flash.busy, ERASE_TIME[0]);
            assert_eq!(flash.is_busy(0, 1), bank == 0);
            assert_eq!(flash.is_busy(PLACE, 1), bank == 1);
            assert!(!flash.is_busy(at, ERASE_TIME[0]));
        }
    }

    #[test]
    fn a_word_cut_short_reads_with_two_wrong_bits_until_erased() {
        let mut flash = open();
        program(&mut flash, PLACE, 7, 0);
        program(&mut flash, PLACE + 8, 7, WORD_TIME[0]);
        flash.supply_goes(WORD_TIME[0] + 1);
        assert!(!flash.reads_torn(PLACE));
        assert_eq!(flash.register(0x18, 0), 0);
        assert!(flash.reads_torn(PLACE + 12));
        assert_eq!(flash.register(0x18, 0), DOUBLE_ERROR);
        flash.set_register(0x18, DOUBLE_ERROR, 0);
        assert_eq!(flash.register(0x18, 0), 0);
        let page = ERASE_PAGE | 126 << 3 | 1 << 11;
        flash.set_register(0x14, page | START_ERASING, TICKS);
        assert!(!flash.reads_torn(PLACE + 8));
    }
}
