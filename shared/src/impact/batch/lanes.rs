//! Sets of lanes.

use crate::arithmetic::lane::{COLUMN_LANES, MAX_LANES};

/// Number of lanes of a block: its columns fit into the first-level cache.
pub const LANES: usize = COLUMN_LANES;

/// A set of lanes, one bit each.
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

    /// Adds the lanes from `at` on whose bits are set; `at` is a multiple of the register width.
    #[inline(always)]
    pub fn add(&mut self, at: usize, bits: u32) {
        self.0[at / 64] |= u64::from(bits) << (at % 64);
    }

    /// The `width` lanes from `at` on, one bit each; `at` is a multiple of `width`.
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

/// A set of lanes, one byte each: lanes from all over the block are set without a branch.
#[derive(Clone, Debug)]
pub(super) struct Flags([u8; LANES + MAX_LANES]);

impl Flags {
    pub const EMPTY: Self = Self([0; LANES + MAX_LANES]);

    /// Sets the first `width` of these lanes by their bits.
    #[inline(always)]
    pub fn put(&mut self, lanes: [u8; MAX_LANES], width: usize, bits: u32) {
        for (n, lane) in lanes.into_iter().enumerate().take(width) {
            self.0[usize::from(lane)] = (bits >> n & 1) as u8;
        }
    }

    pub fn clear(&mut self, lane: usize) {
        if let Some(flag) = self.0.get_mut(lane) {
            *flag = 0;
        }
    }

    /// The `width` lanes from `at` on, one bit each.
    #[inline(always)]
    pub fn bits(&self, at: usize, width: usize) -> u32 {
        if width == 1 {
            return self.0[at].into();
        }
        let mut flags = [0; MAX_LANES];
        flags.copy_from_slice(&self.0[at..at + MAX_LANES]);
        // Moves byte n to bit n of the topmost byte.
        let bits = u64::from_le_bytes(flags).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        bits as u32 & ((1 << width) - 1)
    }
}
