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
        let all = (1 << count) - 1;
        let tall = L::bits(launch.is_tall(track)) & all;
        for lane in chosen(lanes, tall) {
            self.tall.put(lane, true);
        }
        if tall == all {
            return;
        }
        let rests = L::bits(launch.chatters_out(track, restitution)) & all & !tall;
        for lane in chosen(lanes, rests) {
            resting.put(lane, true);
        }
        let left = all & !(tall | rests);
        let short = L::bits(launch.is_short(track)) & left;
        let home = L::bits(launch.is_home(track)) & left & !short;
        let [_, shorts, homes, lows] = &mut self.queues;
        shorts.push_chosen(lanes, short);
        homes.push_chosen(lanes, home);
        lows.push_chosen(lanes, left & !(short | home));
    }
}

/// The lanes of a register whose bits are set.
#[inline(always)]
fn chosen(lanes: [u8; WIDEST], bits: u32) -> impl Iterator<Item = usize> {
    let mut left = bits;
    core::iter::from_fn(move || {
        let n = (left != 0).then(|| left.trailing_zeros() as usize)?;
        left &= left - 1;
        Some(lanes[n % WIDEST].into())
    })
}
