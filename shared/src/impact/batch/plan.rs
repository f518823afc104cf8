//! Plan of the next flights: lanes by kind of flight.

use super::lanes::{Flags, Set};
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
}

impl Kind {
    pub const ALL: [Self; 4] = [Self::Tall, Self::Short, Self::Once, Self::Low];
}

/// The lanes that fly next.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    /// Tall lanes from registers of several neighbouring lanes.
    tall: Set,
    /// Tall lanes from single lanes or from gathered registers.
    gathered: Flags,
    /// The other lanes by [`Kind`], and the gathered tall ones.
    pub queues: [Queue; 4],
}

impl Plan {
    pub const EMPTY: Self = Self {
        tall: Set::EMPTY,
        gathered: Flags::EMPTY,
        queues: [Queue::EMPTY; 4],
    };

    pub fn clear(&mut self) {
        self.tall = Set::EMPTY;
        self.gathered = Flags::EMPTY;
        for queue in &mut self.queues {
            queue.clear();
        }
    }

    /// Adds tall lanes by their bits, `width` lanes from `at` on; `at` is a multiple of `width`.
    #[inline(always)]
    pub fn add_tall(&mut self, at: usize, width: usize, bits: u32) {
        if width == 1 {
            self.gathered.put([at as u8; MAX_LANES], 1, bits);
        } else {
            self.tall.add(at, bits);
        }
    }

    /// The tall ones of the `width` lanes from `at` on, one bit each; `at` is a multiple of
    /// `width`.
    #[inline(always)]
    pub fn tall_bits(&self, at: usize, width: usize) -> u32 {
        let gathered = self.gathered.bits(at, width);
        if width == 1 {
            gathered
        } else {
            self.tall.bits(at, width) | gathered
        }
    }

    /// Removes lanes without an orbit.
    pub fn leave_out(&mut self, removed: &Set) {
        for lane in removed.iter() {
            self.tall.put(lane, false);
            self.gathered.clear(lane);
        }
        for queue in &mut self.queues {
            queue.retain(|lane| !removed.contains(lane));
        }
    }

    /// Plans the flights of the first `count` lanes of a register; resting lanes are added to
    /// `resting`.
    #[inline(always)]
    pub fn sort<L: Lane>(
        &mut self,
        resting: &mut Set,
        track: &Track<L>,
        restitution: L,
        launch: &Launch<L>,
        (lanes, count): ([u8; MAX_LANES], usize),
    ) {
        let all = (1 << count) - 1;
        let tall = L::bits(launch.is_tall(track));
        self.gathered.put(lanes, L::WIDTH, tall);
        let left = all & !tall;
        let mut rests = L::bits(launch.may_chatter_out(track)) & left;
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
        let [_, shorts, onces, lows] = &mut self.queues;
        shorts.push_chosen::<L>(lanes, short);
        onces.push_chosen::<L>(lanes, once);
        lows.push_chosen::<L>(lanes, left & !(short | once));
    }
}
