//! Compaction of lanes that take the same branch.

use super::{COLUMN, Lane, WIDEST};

/// Indices of lanes, with space to fill the last register.
#[derive(Clone, Debug)]
pub(crate) struct Queue {
    lanes: [u8; COLUMN + WIDEST],
    count: usize,
}

impl Queue {
    pub const EMPTY: Self = Self {
        lanes: [0; COLUMN + WIDEST],
        count: 0,
    };

    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds the lanes of a register whose bits are set.
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

    /// Removes the lanes that are not kept.
    #[cfg(any(test, feature = "analysis"))]
    pub fn retain(&mut self, keeps: impl Fn(usize) -> bool) {
        let mut kept = 0;
        for n in 0..self.count.min(COLUMN) {
            let lane = self.lanes[n];
            self.lanes[kept] = lane;
            kept += usize::from(keeps(lane.into()));
        }
        self.count = kept;
    }

    /// The lanes by registers of `width`, and how many of each register count; one that is not full
    /// repeats its last lane, to the same result.
    #[inline(always)]
    pub fn registers(&mut self, width: usize) -> impl Iterator<Item = ([u8; WIDEST], usize)> + '_ {
        let count = self.count.min(COLUMN);
        let last = count.checked_sub(1).map_or(0, |last| self.lanes[last]);
        self.lanes[count..count + WIDEST].fill(last);
        (0..count).step_by(width).map(move |at| {
            let mut lanes = [0; WIDEST];
            lanes.copy_from_slice(&self.lanes[at..at + WIDEST]);
            (lanes, width.min(count - at))
        })
    }
}

/// Positions of the set bits of the index, lowest first, a byte each.
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
