//! Plan of the next flights: lanes by kind of flight.

use super::lanes::Set;
use crate::arithmetic::lane::queue::Queue;
use crate::arithmetic::lane::{Lane, MAX_LANES};
use crate::impact::double::launch::{Launch, Track};

/// Kinds of flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Tall,
    Short,
    Once,
    Low,
    /// Low flights that barely clear a hump; no flight is planned so.
    NearHump,
}

impl Kind {
    pub const ALL: [Self; 5] = [
        Self::Tall,
        Self::Short,
        Self::Once,
        Self::Low,
        Self::NearHump,
    ];
}

/// The lanes that fly next, by [`Kind`].
#[derive(Clone, Debug)]
pub(super) struct Plan(pub [Queue; Kind::ALL.len()]);

impl Plan {
    pub const EMPTY: Self = Self([Queue::EMPTY; Kind::ALL.len()]);

    /// Removes lanes without an orbit.
    pub fn leave_out(&mut self, removed: &Set) {
        for queue in &mut self.0 {
            queue.retain(|lane| !removed.contains(lane));
        }
    }

    /// Plans the flights of the lanes of a register whose bits are in `all`; resting lanes are
    /// added to `resting`.
    #[inline(always)]
    pub fn sort<L: Lane>(
        &mut self,
        resting: &mut Set,
        track: &Track<L>,
        restitution: L,
        launch: &Launch<L>,
        lanes: [u8; MAX_LANES],
        all: u32,
    ) {
        let tall = L::bits(launch.is_tall(track)) & all;
        let left = all & !tall;
        let mut rests = L::bits(track.may_chatter_out(launch.velocity)) & left;
        if rests != 0 {
            rests &= L::bits(launch.chatters_out(track, restitution));
            for (n, lane) in lanes.into_iter().enumerate() {
                if rests >> n & 1 == 1 {
                    resting.put(lane.into(), true);
                }
            }
        }
        let left = left & !rests;
        let short = L::bits(launch.is_short(track)) & left;
        let once = L::bits(launch.meets_once(track)) & left & !short;
        let [talls, shorts, onces, lows, _] = &mut self.0;
        talls.push_chosen::<L>(lanes, tall);
        shorts.push_chosen::<L>(lanes, short);
        onces.push_chosen::<L>(lanes, once);
        lows.push_chosen::<L>(lanes, left & !(short | once));
    }
}
