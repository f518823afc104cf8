//! Many orbits at a time: blocks of lanes, each with its own k and restitution.
//!
//! Every lane gives the bits that [`Map`] gives, whatever its neighbours do and whatever the CPU offers:
//! the kernels are the same source over one or eight f64. Lanes stand where they are as long as half
//! of a register fly [tall](super::double::tall); the others are gathered by the kind of their flight,
//! so that all lanes of a register take the same path. A group of registers goes through each stage of a
//! kernel together, which hides the latency of one behind the others.

mod columns;
mod gathered;
mod in_place;
mod lanes;
mod plan;
mod stages;

use crate::arithmetic::lane::Lane;
use crate::arithmetic::lane::queue::Queue;
use crate::feeder::{OutOfRange, accept};
use crate::impact::double::Map;
use crate::impact::kernel::{Impact, PartState};
use columns::Columns;
use lanes::Set;
use plan::Plan;
use stages::Stages;

#[cfg(not(feature = "unstable"))]
use crate::arithmetic::lane::simd::Simd;
#[cfg(feature = "unstable")]
pub use crate::arithmetic::lane::simd::Simd;
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
    /// Lanes that wait for their caller.
    resting: Set,
    /// Lanes whose last impact grazes.
    grazing: Set,
    /// The lanes that fly next, and those of the last impact.
    plans: [Plan; 2],
    /// Whether those that fly next come second.
    turned: bool,
    /// Lanes that are in no plan yet, and of which no more than the state is known.
    fresh: Set,
    /// Lanes that are planned though their orbit is gone.
    gone: Set,
    /// Lanes that are to be planned.
    unsorted: Queue,
    stages: Stages,
}

impl Default for Block {
    fn default() -> Self {
        Self::new()
    }
}

impl Block {
    /// An empty block, computed in the widest registers of this CPU.
    #[must_use]
    pub fn new() -> Self {
        Self::in_width(Simd::widest())
    }

    /// An empty block in registers of a given width; `None` where this CPU has none so wide.
    #[cfg(any(test, feature = "unstable"))]
    #[must_use]
    pub fn with(simd: Simd) -> Option<Self> {
        (simd <= Simd::widest()).then(|| Self::in_width(simd))
    }

    fn in_width(simd: Simd) -> Self {
        Self {
            simd,
            columns: Columns::ZERO,
            filled: Set::EMPTY,
            resting: Set::EMPTY,
            grazing: Set::EMPTY,
            plans: [Plan::EMPTY; 2],
            turned: false,
            fresh: Set::EMPTY,
            gone: Set::EMPTY,
            unsorted: Queue::EMPTY,
            stages: Stages::EMPTY,
        }
    }

    /// The width of the registers it is computed in.
    #[cfg(any(test, feature = "unstable"))]
    #[must_use]
    pub fn simd(&self) -> Simd {
        self.simd
    }

    /// Puts an orbit into a lane, in place of what was there.
    ///
    /// # Errors
    /// Where there is no such lane.
    pub fn put(&mut self, lane: usize, map: &Map, state: PartState) -> Result<(), OutOfRange> {
        accept("lane", lane as f64, lane < LANES, "0..255")?;
        self.withdraw(lane);
        self.columns.put(lane, map.track(), map.restitution());
        self.start(lane, state);
        Ok(())
    }

    /// Restarts the orbit of a lane from another state, on the same track; cheapest where it rests.
    ///
    /// # Errors
    /// Where there is no orbit in such a lane.
    pub fn restart(&mut self, lane: usize, state: PartState) -> Result<(), OutOfRange> {
        let filled = self.filled.contains(lane);
        accept("lane", lane as f64, filled, "a lane with an orbit in it")?;
        self.withdraw(lane);
        self.start(lane, state);
        Ok(())
    }

    /// Empties a lane.
    pub fn clear(&mut self, lane: usize) {
        self.withdraw(lane);
    }

    /// Takes a lane out. One that flies stands in a plan, which it leaves before the next impact.
    fn withdraw(&mut self, lane: usize) {
        let planned = self.filled.contains(lane)
            && !self.resting.contains(lane)
            && !self.fresh.contains(lane);
        if planned {
            self.gone.put(lane, true);
        }
        self.fresh.put(lane, false);
        self.filled.put(lane, false);
        self.resting.put(lane, false);
    }

    fn start(&mut self, lane: usize, state: PartState) {
        self.columns.start(lane, state.phase, state.velocity);
        self.filled.put(lane, true);
        self.grazing.put(lane, false);
        self.fresh.put(lane, true);
    }

    /// The state of the orbit in a lane; `None` where there is none.
    #[must_use]
    pub fn state(&self, lane: usize) -> Option<PartState> {
        self.filled.contains(lane).then(|| {
            let [phase, velocity] = self.columns.state(lane);
            PartState { phase, velocity }
        })
    }

    /// The last impact of the orbit in a lane (flight 0 where it had none); `None` where there is no
    /// orbit.
    #[must_use]
    pub fn impact(&self, lane: usize) -> Option<Impact<PartState>> {
        self.state(lane).map(|next| Impact {
            flight: self.columns.flight(lane),
            next,
            grazes: self.grazing.contains(lane),
        })
    }

    /// The lanes whose part is at rest, or chatters so closely to rest that
    /// [`Contact::time_to_rest`](super::Contact::time_to_rest) sums the rest of it. They wait until they
    /// are restarted, cleared or put anew. A lane is looked at when [`Block::advance`] begins and after
    /// each of its impacts.
    pub fn resting(&self) -> impl Iterator<Item = usize> + '_ {
        self.resting.iter()
    }

    /// Whether the orbit in a lane waits, as [`Block::resting`] says.
    #[must_use]
    pub fn rests(&self, lane: usize) -> bool {
        self.resting.contains(lane)
    }

    /// Takes every orbit that does not rest this many impacts further.
    pub fn advance(&mut self, impacts: u32) {
        if self.gone != Set::EMPTY {
            self.plans[usize::from(self.turned)].leave_out(&self.gone);
            self.gone = Set::EMPTY;
        }
        match self.simd {
            #[cfg(target_arch = "x86_64")]
            Simd::Avx2 => x86::advance_avx2(self, impacts),
            _ => advance::<f64>(self, impacts),
        }
    }
}

/// Takes every orbit that does not rest this many impacts further.
#[inline(always)]
fn advance<L: Lane>(block: &mut Block, impacts: u32) {
    let Block {
        columns,
        resting,
        grazing,
        plans: [first, second],
        turned,
        fresh,
        unsorted,
        stages,
        ..
    } = block;
    let (mut next, mut now) = if *turned {
        (second, first)
    } else {
        (first, second)
    };
    if *fresh != Set::EMPTY {
        begin::<L>(columns, next, resting, fresh, unsorted);
        *fresh = Set::EMPTY;
    }
    for _ in 0..impacts {
        core::mem::swap(&mut now, &mut next);
        next.clear();
        *grazing = Set::EMPTY;
        in_place::advance::<L>(columns, stages, now, next, unsorted);
        gathered::advance::<L>(columns, stages, now, next, resting, grazing);
        sort::<L>(columns, next, resting, unsorted);
    }
    *turned ^= impacts % 2 == 1;
}

/// Plans the first flights of lanes of which no more than the state is known.
#[inline(always)]
fn begin<L: Lane>(
    columns: &mut Columns,
    next: &mut Plan,
    resting: &mut Set,
    fresh: &Set,
    unsorted: &mut Queue,
) {
    for at in (0..LANES).step_by(L::WIDTH) {
        let bits = fresh.bits(at, L::WIDTH);
        if bits != 0 {
            let launch = columns.begin_at::<L>(at, L::mask(bits));
            let tall = L::bits(launch.is_tall(&columns.track_at(at))) & bits;
            next.add_tall(at, L::WIDTH, tall);
            unsorted.push_bits(at, bits & !tall);
        }
    }
    sort::<L>(columns, next, resting, unsorted);
}

/// Plans the next flights of the lanes of a queue, and empties it.
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
    fn every_lane_is_the_map_bit_for_bit_in_every_width() {
        for simd in Simd::ALL {
            let Some(mut block) = Block::with(simd) else {
                std::println!("this CPU has no {simd:?}");
                continue;
            };
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
