//! Which lanes fly next, by the kind of their flights.

use super::lanes::{Queue, Set};
use crate::arithmetic::lane::{Lane, WIDEST};
use crate::impact::flight::{Launch, Track};

/// Kinds of flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Tall,
    Short,
    Home,
    Low,
}

impl Kind {
    pub const ALL: [Self; 4] = [Self::Tall, Self::Short, Self::Home, Self::Low];
}

/// The lanes that fly next.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    /// Those whose flights are tall.
    pub tall: Set,
    /// The others by their [`Kind`], and those tall ones that are gathered.
    pub queues: [Queue; 4],
}

impl Plan {
    pub const EMPTY: Self = Self {
        tall: Set::EMPTY,
        queues: [Queue::EMPTY; 4],
    };

    pub fn clear(&mut self) {
        self.tall = Set::EMPTY;
        for queue in &mut self.queues {
            queue.clear();
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
        let tall = L::bits(launch.is_tall(track));
        let mut short = 0;
        let mut home = 0;
        let mut rests = 0;
        if tall != L::bits(L::mask(u32::MAX)) {
            short = L::bits(launch.is_short(track)) & !tall;
            home = L::bits(launch.is_home(track)) & !(tall | short);
            rests = L::bits(launch.chatters_out(track, restitution)) & !tall;
        }
        let low = !(tall | short | home | rests);
        let (short, home) = (short & !rests, home & !rests);
        for (n, lane) in lanes.into_iter().enumerate().take(count) {
            let is = |mask: u32| mask >> n & 1 == 1;
            self.tall.add(lane.into(), tall >> n & 1);
            resting.add(lane.into(), rests >> n & 1);
            let [_, shorts, homes, lows] = &mut self.queues;
            shorts.push(lane, is(short));
            homes.push(lane, is(home));
            lows.push(lane, is(low));
        }
    }
}
