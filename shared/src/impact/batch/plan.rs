//! Plan of the next flights: lanes by kind of flight.

use super::lanes::Set;
use crate::arithmetic::vector::queue::Queue;
use crate::arithmetic::vector::{MAX_LANES, Vector};
use crate::impact::double::launch::{Launch, Track};

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
    pub const ALL: [Self; 5] = {
        use Kind::*;
        [Tall, Short, Once, Low, NearHump]
    };
}

#[derive(Clone, Debug)]
pub(super) struct Plan(pub [Queue; Kind::ALL.len()]);

impl Plan {
    pub const EMPTY: Self = Self([Queue::EMPTY; Kind::ALL.len()]);

    pub fn leave_out(&mut self, removed: &Set) {
        for queue in &mut self.0 {
            queue.retain(|lane| !removed.contains(lane));
        }
    }

    /// Plans the flights of the lanes of a register whose bits are in `all`; resting lanes are
    /// added to `resting`.
    #[inline(always)]
    pub fn sort<V: Vector>(
        &mut self,
        resting: &mut Set,
        track: &Track<V>,
        restitution: V,
        launch: &Launch<V>,
        lanes: [u8; MAX_LANES],
        all: u32,
    ) {
        let tall = V::bits(launch.is_tall(track)) & all;
        let remaining = all & !tall;
        let mut rests = V::bits(track.may_chatter_out(launch.velocity)) & remaining;
        if rests != 0 {
            rests &= V::bits(launch.chatters_out(track, restitution));
            for (n, lane) in lanes.into_iter().enumerate() {
                if rests >> n & 1 == 1 {
                    resting.put(lane.into(), true);
                }
            }
        }
        let remaining = remaining & !rests;
        let short = V::bits(launch.is_short(track)) & remaining;
        let one_root = V::bits(launch.has_one_root(track)) & remaining & !short;
        let [talls, shorts, onces, lows, _] = &mut self.0;
        talls.push_chosen::<V>(lanes, tall);
        shorts.push_chosen::<V>(lanes, short);
        onces.push_chosen::<V>(lanes, one_root);
        lows.push_chosen::<V>(lanes, remaining & !(short | one_root));
    }
}
