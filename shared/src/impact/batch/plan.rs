//! Which lanes fly next, by the kind of their flights.

use super::lanes::{Flags, Set};
use crate::arithmetic::lane::queue::Queue;
use crate::arithmetic::lane::{Lane, WIDEST};
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
    /// Those whose flights are tall, where they were told by registers of several neighbours.
    tall: Set,
    /// Those whose flights are tall, where they were told one by one or in registers that were gathered.
    gathered: Flags,
    /// The others by their [`Kind`], and those tall ones that are gathered.
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

    /// Adds tall ones of `width` lanes from a multiple of it on, one bit each.
    #[inline(always)]
    pub fn add_tall(&mut self, at: usize, width: usize, bits: u32) {
        if width == 1 {
            self.gathered.put([at as u8; WIDEST], 1, bits);
        } else {
            self.tall.add(at, bits);
        }
    }

    /// The tall ones of `width` lanes from a multiple of it on, one bit each.
    #[inline(always)]
    pub fn tall_bits(&self, at: usize, width: usize) -> u32 {
        let gathered = self.gathered.bits(at, width);
        if width == 1 {
            gathered
        } else {
            self.tall.bits(at, width) | gathered
        }
    }

    /// Leaves out lanes whose orbits are gone.
    pub fn leave_out(&mut self, gone: &Set) {
        for lane in gone.iter() {
            self.tall.put(lane, false);
            self.gathered.clear(lane);
        }
        for queue in &mut self.queues {
            queue.retain(|lane| !gone.contains(lane));
        }
    }

    /// Plans the flights of some lanes, the first `count` of a register; those that rest are added to
    /// `resting` instead.
    #[inline(always)]
    pub fn sort<L: Lane>(
        &mut self,
        resting: &mut Set,
        track: &Track<L>,
        restitution: L,
        launch: &Launch<L>,
        (lanes, count): ([u8; WIDEST], usize),
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
