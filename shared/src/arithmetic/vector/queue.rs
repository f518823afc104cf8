//! Compaction of lanes that take the same branch.

use super::{COLUMN_LANES, MAX_LANES, Vector};

/// Indices of lanes, with space to fill the last register.
#[derive(Clone, Debug)]
pub(crate) struct Queue {
    lanes: [u8; COLUMN_LANES + MAX_LANES],
    count: usize,
}

impl Queue {
    pub const EMPTY: Self = Self {
        lanes: [0; COLUMN_LANES + MAX_LANES],
        count: 0,
    };

    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds the lanes of a register whose bits are set.
    #[inline(always)]
    pub fn push_chosen<V: Vector>(&mut self, lanes: [u8; MAX_LANES], bits: u32) {
        let places = SET_BIT_POSITIONS[bits as usize % SET_BIT_POSITIONS.len()];
        self.push(V::choose(lanes, places), bits);
    }

    /// Adds lanes from `at` on, one bit each.
    #[inline(always)]
    pub fn push_bits(&mut self, at: usize, bits: u32) {
        let places = SET_BIT_POSITIONS[bits as usize % SET_BIT_POSITIONS.len()];
        let lanes = places + at as u64 * (u64::MAX / 255);
        self.push(lanes.to_le_bytes(), bits);
    }

    #[inline(always)]
    fn push(&mut self, lanes: [u8; MAX_LANES], bits: u32) {
        if let Some(places) = self.lanes.get_mut(self.count..self.count + MAX_LANES) {
            places.copy_from_slice(&lanes);
            self.count += bits.count_ones() as usize;
        }
    }

    pub fn retain(&mut self, keeps: impl Fn(usize) -> bool) {
        let mut kept = 0;
        for n in 0..self.count.min(COLUMN_LANES) {
            let lane = self.lanes[n];
            self.lanes[kept] = lane;
            kept += usize::from(keeps(lane.into()));
        }
        self.count = kept;
    }

    /// The lanes by registers of `width`, and the number of valid lanes of each. A partly filled
    /// register repeats its last lane, with the same result.
    #[inline(always)]
    pub fn registers(
        &mut self,
        width: usize,
    ) -> impl Iterator<Item = ([u8; MAX_LANES], usize)> + '_ {
        let count = self.count.min(COLUMN_LANES);
        let last = count.checked_sub(1).map_or(0, |last| self.lanes[last]);
        self.lanes[count..count + MAX_LANES].fill(last);
        (0..count).step_by(width).map(move |at| {
            let mut lanes = [0; MAX_LANES];
            lanes.copy_from_slice(&self.lanes[at..at + MAX_LANES]);
            (lanes, width.min(count - at))
        })
    }
}

/// Positions of the set bits of the index, lowest first, a byte each.
const SET_BIT_POSITIONS: [u64; 256] = {
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
