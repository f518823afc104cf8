//! Queue of faults that are not in the flash yet, in RAM that a reset leaves unchanged.
//!
//! After power-on the RAM content is arbitrary: a record counts only with a valid checksum.

use kband_control::wire::crc32;

/// Size of a record, bytes.
pub const RECORD_SIZE: usize = 24;
const MAX_RECORDS: usize = 4;
/// Constant added to the checksum, so that zeroed RAM holds no record.
const MARK: u32 = 0x6b62_5746;

#[derive(Clone, Copy, Debug)]
#[repr(C)]
struct Entry {
    content: [u8; RECORD_SIZE],
    check: u32,
}

impl Entry {
    const EMPTY: Self = Self {
        content: [0; RECORD_SIZE],
        check: 0,
    };

    fn check(content: &[u8; RECORD_SIZE]) -> u32 {
        crc32(content).wrapping_add(MARK)
    }

    fn is_valid(&self) -> bool {
        self.check == Self::check(&self.content)
    }
}

/// The queued records, the oldest first.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Waiting([Entry; MAX_RECORDS]);

impl Waiting {
    /// No records.
    pub const EMPTY: Self = Self([Entry::EMPTY; MAX_RECORDS]);

    /// Adds a record. A full queue drops it, because the first faults are nearest to the cause.
    pub fn push(&mut self, content: [u8; RECORD_SIZE]) {
        let valid = self.0.iter().rposition(Entry::is_valid);
        if let Some(entry) = self.0.get_mut(valid.map_or(0, |last| last + 1)) {
            let check = Entry::check(&content);
            *entry = Entry { content, check };
        }
    }

    /// The oldest record.
    pub fn first(&self) -> Option<[u8; RECORD_SIZE]> {
        let first = self.0.iter().find(|entry| entry.is_valid());
        first.map(|entry| entry.content)
    }

    /// Removes the oldest record.
    pub fn drop_first(&mut self) {
        if let Some(first) = self.0.iter_mut().find(|entry| entry.is_valid()) {
            *first = Entry::EMPTY;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn records_come_back_in_their_order_and_the_first_four_stay() {
        let mut waiting = Waiting::EMPTY;
        assert_eq!(waiting.first(), None);
        for n in 1..=6 {
            waiting.push([n; RECORD_SIZE]);
        }
        let mut order = Vec::new();
        while let Some(record) = waiting.first() {
            order.push(record[0]);
            waiting.drop_first();
        }
        assert_eq!(order, [1, 2, 3, 4]);
        waiting.push([7; RECORD_SIZE]);
        assert_eq!(waiting.first(), Some([7; RECORD_SIZE]));
    }

    #[test]
    fn noise_and_every_flipped_bit_are_no_record() {
        let mut valid = Waiting::EMPTY;
        valid.push([9; RECORD_SIZE]);
        for bit in 0..8 * (RECORD_SIZE + 4) {
            let mut flipped = valid;
            let entry = &mut flipped.0[0];
            match entry.content.get_mut(bit / 8) {
                Some(byte) => *byte ^= 1 << (bit % 8),
                None => entry.check ^= 1 << (bit - 8 * RECORD_SIZE),
            }
            assert_eq!(flipped.first(), None, "bit {bit}");
        }
        for byte in [0, 0xff, 0xa5] {
            let check = u32::from_le_bytes([byte; 4]);
            let content = [byte; RECORD_SIZE];
            let entry = Waiting([Entry { content, check }; MAX_RECORDS]).first();
            assert_eq!(entry, None);
        }
    }
}
