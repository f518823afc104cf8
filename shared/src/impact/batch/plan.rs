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
    /// Those whose flights are tall.
    pub tall: Flags,
    /// The others by their [`Kind`], and those tall ones that are gathered.
    pub queues: [Queue; 4],
}

impl Plan {
    pub const EMPTY: Self = Self {
        tall: Flags::EMPTY,
        queues: [Queue::EMPTY; 4],
    };

    pub fn clear(&mut self) {
        self.tall = Flags::EMPTY;
        for queue in &mut self.queues {
            queue.clear();
        }
    }

    /// Leaves out lanes whose orbits are gone.
    pub fn leave_out(&mut self, gone: &Set) {
        for lane in gone.iter() {
            self.tall.clear(lane);
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
        self.tall.put(lanes, L::WIDTH, tall);
        let left = all & !tall;
        let rests = L::bits(launch.chatters_out(track, restitution)) & left;
        if rests != 0 {
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
