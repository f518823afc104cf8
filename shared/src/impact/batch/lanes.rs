//! Which lanes: as a set, and in a queue.

use crate::arithmetic::lane::{Lane, WIDEST};

/// Lanes of a block: what is known of them stays in the first level of the cache.
pub const LANES: usize = 256;

/// A yes or no for each lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Set([u64; LANES / 64]);

impl Set {
    pub const EMPTY: Self = Self([0; LANES / 64]);

    #[inline(always)]
    pub fn contains(&self, lane: usize) -> bool {
        self.0
            .get(lane / 64)
            .is_some_and(|word| word >> (lane % 64) & 1 == 1)
    }

    #[inline(always)]
    pub fn put(&mut self, lane: usize, is_in: bool) {
        if let Some(word) = self.0.get_mut(lane / 64) {
            *word = *word & !(1 << (lane % 64)) | u64::from(is_in) << (lane % 64);
        }
    }

    /// What is in this set and not in the other.
    pub fn without(&self, other: &Self) -> Self {
        let mut rest = *self;
        for (word, other) in rest.0.iter_mut().zip(&other.0) {
            *word &= !other;
        }
        rest
    }

    /// The `width` lanes from a multiple of it on, one bit each.
    #[inline(always)]
    pub fn bits(&self, at: usize, width: usize) -> u32 {
        (self.0[at / 64] >> (at % 64)) as u32 & ((1 << width) - 1)
    }

    pub fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        self.0.iter().enumerate().flat_map(|(n, &word)| {
            core::iter::successors(Some(word), |&rest| Some(rest & rest.wrapping_sub(1)))
                .take_while(|&rest| rest != 0)
                .map(move |rest| 64 * n + rest.trailing_zeros() as usize)
        })
    }
}

/// A yes or no for each lane, a byte each: those of lanes from all over the block are set without asking
/// which they are.
#[derive(Clone, Debug)]
pub(super) struct Flags([u8; LANES + WIDEST]);

impl Flags {
    pub const EMPTY: Self = Self([0; LANES + WIDEST]);

    /// Sets those of the first `width` of these lanes by their bits.
    #[inline(always)]
    pub fn put(&mut self, lanes: [u8; WIDEST], width: usize, bits: u32) {
        for (n, lane) in lanes.into_iter().enumerate().take(width) {
            self.0[usize::from(lane)] = (bits >> n & 1) as u8;
        }
    }

    /// Adds those from `at` on, one bit each.
    #[inline(always)]
    pub fn add(&mut self, at: usize, bits: u32) {
        for (n, flag) in self.0[at..at + WIDEST].iter_mut().enumerate() {
            *flag |= (bits >> n & 1) as u8;
        }
    }

    /// The `width` from `at` on, one bit each.
    #[inline(always)]
    pub fn bits(&self, at: usize, width: usize) -> u32 {
        let mut flags = [0; WIDEST];
        flags.copy_from_slice(&self.0[at..at + WIDEST]);
        // Byte n goes to bit n of the topmost byte.
        let bits = u64::from_le_bytes(flags).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        bits as u32 & ((1 << width) - 1)
    }
}

/// Lanes in a row, and room to fill the last register.
#[derive(Clone, Debug)]
pub(super) struct Queue {
    lanes: [u8; LANES + WIDEST],
    count: usize,
}

impl Queue {
    pub const EMPTY: Self = Self {
        lanes: [0; LANES + WIDEST],
        count: 0,
    };

    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds those lanes of a register whose bits are set.
    #[inline(always)]
    pub fn push_chosen<L: Lane>(&mut self, lanes: [u8; WIDEST], bits: u32) {
        let chosen = L::choose(lanes, PLACES[bits as usize % PLACES.len()]);
        if let Some(places) = self.lanes.get_mut(self.count..self.count + WIDEST) {
            places.copy_from_slice(&chosen);
            self.count += bits.count_ones() as usize;
        }
    }

    /// Adds lanes from `at` on, one bit each.
    #[inline(always)]
    pub fn push_bits(&mut self, at: usize, bits: u32) {
        let lanes = PLACES[bits as usize % PLACES.len()] + at as u64 * (u64::MAX / 255);
        if let Some(places) = self.lanes.get_mut(self.count..self.count + WIDEST) {
            places.copy_from_slice(&lanes.to_le_bytes());
            self.count += bits.count_ones() as usize;
        }
    }

    /// The lanes by registers of `width`, and how many of each register count; one that is not full
    /// repeats its last lane, to the same result.
    #[inline(always)]
    pub fn registers(&mut self, width: usize) -> impl Iterator<Item = ([u8; WIDEST], usize)> + '_ {
        let count = self.count.min(LANES);
        let last = count.checked_sub(1).map_or(0, |last| self.lanes[last]);
        self.lanes[count..count + WIDEST].fill(last);
        (0..count).step_by(width).map(move |at| {
            let mut lanes = [0; WIDEST];
            lanes.copy_from_slice(&self.lanes[at..at + WIDEST]);
            (lanes, width.min(count - at))
        })
    }
}

/// The places of the bits that are set in the index, lowest first, a byte each.
const PLACES: [u64; 256] = {
    let mut places = [0; 256];
    let mut bits = 0;
    while bits < 256 {
        let (mut place, mut count) = (0, 0);
        while place < 8 {
            if bits >> place & 1 == 1 {
                places[bits] |= (place as u64) << (8 * count);
                count += 1;
            }
            place += 1;
        }
        bits += 1;
    }
    places
};
