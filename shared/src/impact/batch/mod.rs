//! Many orbits at a time: blocks of SIMD lanes, each with its own k and restitution.
//!
//! Every lane gives the bits of [`Map`], whatever its neighbours and the CPU: the source is the
//! same over one or eight f64. Lanes fly in place while at least half of a register fly
//! [tall](super::double::tall). The others are gathered by kind of flight, so all lanes of a
//! register take the same path. A group of registers passes each stage together, which hides
//! latency.

mod columns;
mod gathered;
mod in_place;
mod lanes;
mod plan;
mod stages;

use crate::arithmetic::lane::Lane;
use crate::arithmetic::lane::queue::Queue;
use crate::arithmetic::lane::simd::Simd;
use crate::feeder::{OutOfRange, accept};
use crate::impact::double::Map;
use crate::impact::kernel::{Impact, PartState};
use columns::Columns;
use lanes::Set;
use plan::Plan;
use stages::Stages;

pub use lanes::LANES;

/// A block of orbits that advance together.
///
/// ```
/// use kband::impact::{Kernel, Map, batch::Block};
/// let map = Map::build(0.43, 0.2)?;
/// let start = Map::state(0.5, 0.45)?;
/// let mut block = Block::new();
/// block.put(7, &map, start)?;
/// block.advance(100);
/// let mut state = start;
/// for _ in 0..100 {
///     state = map.impact(state).next;
/// }
/// assert_eq!(block.state(7), Some(state));
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Debug)]
pub struct Block {
    simd: Simd,
    columns: Columns,
    /// Lanes that hold an orbit.
    filled: Set,
    /// Lanes that wait for the caller.
    resting: Set,
    /// Lanes whose last impact grazes.
    grazing: Set,
    /// The next lanes to fly, and those of the last impact.
    plans: [Plan; 2],
    /// Whether the second plan is the next one.
    second_is_next: bool,
    /// Lanes without a plan; only their state is set.
    unplanned: Set,
    /// Planned lanes whose orbit was removed.
    removed: Set,
    /// Lanes to plan.
    unsorted: Queue,
    stages: Stages,
}

impl Default for Block {
    fn default() -> Self {
        Self::new()
    }
}

impl Block {
    /// An empty block in the widest registers of this CPU.
    pub fn new() -> Self {
        Self::in_width(Simd::widest())
    }

    fn in_width(simd: Simd) -> Self {
        Self {
            simd,
            columns: Columns::ZERO,
            filled: Set::EMPTY,
            resting: Set::EMPTY,
            grazing: Set::EMPTY,
            plans: [Plan::EMPTY; 2],
            second_is_next: false,
            unplanned: Set::EMPTY,
            removed: Set::EMPTY,
            unsorted: Queue::EMPTY,
            stages: Stages::EMPTY,
        }
    }

    /// Puts an orbit into a lane and replaces any other there.
    ///
    /// # Errors
    /// `OutOfRange` for a lane that does not exist.
    pub fn put(&mut self, lane: usize, map: &Map, state: PartState) -> Result<(), OutOfRange> {
        accept("lane", lane as f64, lane < LANES, "0..255")?;
        self.remove_lane(lane);
        self.columns.put(lane, map.track(), map.restitution());
        self.start(lane, state);
        Ok(())
    }

    /// Empties a lane.
    pub fn clear(&mut self, lane: usize) {
        self.remove_lane(lane);
    }

    /// Removes a lane. A flying lane leaves its plan before the next impact.
    fn remove_lane(&mut self, lane: usize) {
        let planned = self.filled.contains(lane)
            && !self.resting.contains(lane)
            && !self.unplanned.contains(lane);
        if planned {
            self.removed.put(lane, true);
        }
        self.unplanned.put(lane, false);
        self.filled.put(lane, false);
        self.resting.put(lane, false);
    }

    fn start(&mut self, lane: usize, state: PartState) {
        self.columns.start(lane, state.phase, state.velocity);
        self.filled.put(lane, true);
        self.grazing.put(lane, false);
        self.unplanned.put(lane, true);
    }

    /// The state of a lane's orbit; `None` without an orbit.
    pub fn state(&self, lane: usize) -> Option<PartState> {
        self.filled.contains(lane).then(|| {
            let [phase, velocity] = self.columns.state(lane);
            PartState { phase, velocity }
        })
    }

    /// The last impact of a lane's orbit, with flight 0 before the first; `None` without an orbit.
    pub fn impact(&self, lane: usize) -> Option<Impact<PartState>> {
        self.state(lane).map(|next| Impact {
            flight: self.columns.flight(lane),
            next,
            grazes: self.grazing.contains(lane),
        })
    }

    /// Whether the orbit in a lane waits: its part rests, or has a closed chatter, see
    /// [`Contact::time_to_rest`](super::Contact::time_to_rest).
    ///
    /// It waits until it is cleared or replaced. [`Block::advance`] checks a lane at its begin and
    /// after each impact.
    pub fn rests(&self, lane: usize) -> bool {
        self.resting.contains(lane)
    }

    /// Advances every orbit that does not rest by this many impacts.
    pub fn advance(&mut self, impacts: u32) {
        if self.removed != Set::EMPTY {
            self.plans[usize::from(self.second_is_next)].leave_out(&self.removed);
            self.removed = Set::EMPTY;
        }
        match self.simd {
            #[cfg(target_arch = "x86_64")]
            Simd::Avx2 => x86::advance_avx2(self, impacts),
            _ => advance::<f64>(self, impacts),
        }
    }
}

/// Advances every orbit that does not rest by this many impacts.
#[inline(always)]
fn advance<L: Lane>(block: &mut Block, impacts: u32) {
    let Block {
        columns,
        resting,
        grazing,
        plans: [first, second],
        second_is_next,
        unplanned,
        unsorted,
        stages,
        ..
    } = block;
    let (mut next, mut now) = if *second_is_next {
        (second, first)
    } else {
        (first, second)
    };
    if *unplanned != Set::EMPTY {
        begin::<L>(columns, next, resting, unplanned, unsorted);
        *unplanned = Set::EMPTY;
    }
    for _ in 0..impacts {
        core::mem::swap(&mut now, &mut next);
        next.clear();
        *grazing = Set::EMPTY;
        in_place::advance::<L>(columns, stages, now, next, unsorted);
        gathered::advance::<L>(columns, stages, now, next, resting, grazing);
        sort::<L>(columns, next, resting, unsorted);
    }
    *second_is_next ^= impacts % 2 == 1;
}

/// Plans the first flights of lanes with only a state.
#[inline(always)]
fn begin<L: Lane>(
    columns: &mut Columns,
    next: &mut Plan,
    resting: &mut Set,
    unplanned: &Set,
    unsorted: &mut Queue,
) {
    for at in (0..LANES).step_by(L::WIDTH) {
        let bits = unplanned.bits(at, L::WIDTH);
        if bits != 0 {
            let launch = columns.begin_at::<L>(at, L::mask(bits));
            let tall = L::bits(launch.is_tall(&columns.track_at(at))) & bits;
            next.add_tall(at, L::WIDTH, tall);
            unsorted.push_bits(at, bits & !tall);
        }
    }
    sort::<L>(columns, next, resting, unsorted);
}

/// Plans the next flights of a queue's lanes, and empties it.
#[inline(always)]
fn sort<L: Lane>(columns: &Columns, next: &mut Plan, resting: &mut Set, unsorted: &mut Queue) {
    for register in unsorted.registers(L::WIDTH) {
        let (lanes, _) = register;
        let launch = columns.launch::<L>(lanes);
        let restitution = columns.restitution(lanes);
        next.sort(
            resting,
            &columns.track(lanes),
            restitution,
            &launch,
            register,
        );
    }
    unsorted.clear();
}

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod x86 {
    use super::{Block, advance};
    use crate::arithmetic::lane::avx2::Avx2;
    use crate::arithmetic::lane::twice::Twice;

    pub(super) fn advance_avx2(block: &mut Block, impacts: u32) {
        #[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
        fn inner(block: &mut Block, impacts: u32) {
            advance::<Twice<Avx2>>(block, impacts);
        }
        // SAFETY: a block of this width exists only where the CPU has AVX2 and counts bits.
        unsafe { inner(block, impacts) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::kernel::Kernel;

    /// Orbits over the whole range of k and restitution, from every kind of launch.
    fn starts() -> impl Iterator<Item = (Map, PartState)> {
        (0..LANES).map(|n| {
            let spread = |factor: f64| (n as f64 * factor).rem_euclid(1.0);
            let k = 0.02 + 1.4 * spread(0.618_034);
            let restitution = (1.2 * spread(0.414_214)).min(1.0);
            let velocity = libm::pow(10.0, 4.0 * spread(0.732_051) - 3.0);
            (
                Map::build(k, restitution).unwrap(),
                Map::state(7.0 * spread(0.236_068), velocity).unwrap(),
            )
        })
    }

    #[test]
    fn lanes_equal_the_map_bit_for_bit() {
        for simd in Simd::ALL {
            if simd > Simd::widest() {
                std::println!("this CPU has no {simd:?}");
                continue;
            }
            let mut block = Block::in_width(simd);
            let mut expected = std::vec::Vec::new();
            for (lane, (map, state)) in starts().enumerate() {
                block.put(lane, &map, state).unwrap();
                expected.push((map, state));
            }
            for step in 0..60 {
                let moving: std::vec::Vec<bool> = (0..LANES).map(|n| !block.rests(n)).collect();
                block.advance(1);
                for (lane, (map, state)) in expected.iter_mut().enumerate() {
                    if moving[lane] {
                        let impact = map.impact(*state);
                        assert_eq!(block.impact(lane), Some(impact), "{simd:?} {step} {map:?}");
                        *state = impact.next;
                    }
                }
            }
        }
    }
}
