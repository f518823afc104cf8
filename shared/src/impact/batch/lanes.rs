//! Sets of lanes.

use crate::arithmetic::vector::COLUMN_LANES;

/// Number of lanes of a block: its columns fit into the first-level cache.
pub const LANES: usize = COLUMN_LANES;

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

    /// The `width` lanes from `at` on, one bit each; `at` is a multiple of `width`.
    #[inline(always)]
    pub fn bits(&self, at: usize, width: usize) -> u32 {
        (self.0[at / 64] >> (at % 64)) as u32 & ((1 << width) - 1)
    }
}
