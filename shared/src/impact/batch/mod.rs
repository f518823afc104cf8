//! Many orbits at a time: blocks of SIMD lanes, each with its own k and restitution.
//!
//! Every lane gives the bits of [`Map`], whatever its neighbours and the CPU: the source is the
//! same over one or eight f64. Lanes are gathered by kind of flight, so all lanes of a register
//! take the same path.

mod columns;
mod lanes;
mod plan;

use crate::arithmetic::vector::queue::Queue;
use crate::arithmetic::vector::simd::Simd;
use crate::arithmetic::vector::{MAX_LANES, Vector};
use crate::feeder::{OutOfRange, accept};
use crate::impact::double::first::first_impact;
use crate::impact::double::launch::Launch;
use crate::impact::double::step::Landing;
use crate::impact::double::{Map, low, short, tall};
use crate::impact::kernel::{Impact, PartState};
use columns::Columns;
use lanes::Set;
use plan::{Kind, Plan};

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
/// assert_eq!(block.impact(7).map(|impact| impact.next), Some(state));
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Debug)]
pub struct Block {
    simd: Simd,
    columns: Columns,
    filled: Set,
    /// Lanes that wait for the caller.
    resting: Set,
    grazing: Set,
    plan: Plan,
    /// Lanes without a plan; only their state is set.
    unplanned: Set,
    /// Planned lanes whose orbit was removed.
    removed: Set,
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
            plan: Plan::EMPTY,
            unplanned: Set::EMPTY,
            removed: Set::EMPTY,
        }
    }

    /// Puts an orbit into a lane and replaces any other there; an error if the lane does not exist.
    #[inline]
    pub fn put(&mut self, lane: usize, map: &Map, state: PartState) -> Result<(), OutOfRange> {
        accept("lane", lane as f64, lane < LANES, "0..255")?;
        self.clear(lane);
        self.columns.put(lane, map.track(), map.restitution());
        self.columns.start(lane, state.phase, state.velocity);
        self.filled.put(lane, true);
        self.grazing.put(lane, false);
        self.unplanned.put(lane, true);
        Ok(())
    }

    /// Empties a lane. A flying lane leaves its plan before the next impact.
    #[inline]
    pub fn clear(&mut self, lane: usize) {
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

    /// The last impact of a lane's orbit, with flight 0 before the first; `None` without an orbit.
    #[inline]
    pub fn impact(&self, lane: usize) -> Option<Impact> {
        self.filled.contains(lane).then(|| Impact {
            flight: self.columns.flight(lane),
            next: self.columns.state(lane),
            grazes: self.grazing.contains(lane),
        })
    }

    /// Whether the orbit in a lane waits until it is cleared or replaced: its part rests, or has a
    /// closed chatter, see [`Map::time_to_rest`]. [`Block::advance`] tests it before each impact.
    #[inline]
    pub fn rests(&self, lane: usize) -> bool {
        self.resting.contains(lane)
    }

    /// Advances every orbit that does not rest by this many impacts.
    pub fn advance(&mut self, impacts: u32) {
        if self.removed != Set::EMPTY {
            self.plan.leave_out(&self.removed);
            self.removed = Set::EMPTY;
        }
        match self.simd {
            #[cfg(target_arch = "x86_64")]
            Simd::Avx2 => x86::advance_avx2(self, impacts),
            _ => advance::<f64>(self, impacts),
        }
    }
}

#[inline(always)]
fn advance<V: Vector>(block: &mut Block, impacts: u32) {
    begin::<V>(block);
    let Block {
        columns,
        resting,
        grazing,
        plan: next,
        ..
    } = block;
    let mut now = Plan::EMPTY;
    for _ in 0..impacts {
        core::mem::swap(&mut now, next);
        *grazing = Set::EMPTY;
        for kind in Kind::ALL {
            let mut open = Queue::EMPTY;
            let queue = &mut now.0[kind as usize];
            for register in queue.registers(V::WIDTH) {
                fly::<V>(columns, next, resting, grazing, &mut open, kind, register);
            }
            queue.clear();
            if kind == Kind::Low {
                now.0[Kind::NearHump as usize] = open;
            }
        }
    }
}

/// Plans the first flights of lanes with only a state.
#[inline(always)]
fn begin<V: Vector>(block: &mut Block) {
    let mut queue = Queue::EMPTY;
    for at in (0..LANES).step_by(MAX_LANES) {
        queue.push_bits(at, block.unplanned.bits(at, MAX_LANES));
    }
    for (lanes, count) in queue.registers(V::WIDTH) {
        let [phase, velocity] = block.columns.states(lanes);
        let launch = Launch::<V>::new(phase, velocity);
        let all = (1 << count) - 1;
        block.columns.land(lanes, all, V::splat(0.0), &launch);
        let (track, restitution) = (block.columns.track(lanes), block.columns.restitution(lanes));
        block
            .plan
            .sort(&mut block.resting, &track, restitution, &launch, lanes, all);
    }
    block.unplanned = Set::EMPTY;
}

/// One impact of the lanes of a register, of which `count` are valid, and their next plan. Lanes of
/// a low flight whose interval is not certain are added to `open` instead.
#[inline(always)]
fn fly<V: Vector>(
    columns: &mut Columns,
    next: &mut Plan,
    resting: &mut Set,
    grazing: &mut Set,
    open: &mut Queue,
    kind: Kind,
    (lanes, count): ([u8; MAX_LANES], usize),
) {
    let (track, launch) = (columns.track::<V>(lanes), columns.launch::<V>(lanes));
    let restitution = columns.restitution::<V>(lanes);
    let all = (1 << count) - 1;
    let (mut landing, certain, uncertain) = match kind {
        Kind::Tall => (tall::landing(&track, &launch), all, 0),
        Kind::Short => {
            let (landing, certain) = short::landing(&track, &launch, short::guess(&track, &launch));
            (landing, V::bits(certain), 0)
        }
        Kind::Once | Kind::Low => {
            let interval = if kind == Kind::Once {
                low::find_single_interval(&track, &launch)
            } else {
                low::find_interval(&track, &launch)
            };
            let estimate = low::approach(&track, &launch, &interval);
            let (landing, certain) = low::landing(&track, &launch, &interval, &estimate);
            let certain_interval = V::bits(interval.certain);
            (landing, V::bits(certain), all & !certain_interval)
        }
        Kind::NearHump => {
            let (landing, certain) = low::land_near_hump(&track, &launch);
            (landing, V::bits(certain), 0)
        }
    };
    let landed = all & !uncertain;
    if landed & !certain != 0 {
        landing = decide(columns, grazing, &landing, landed & !certain, lanes);
    }
    let after = Launch::new(landing.phase, restitution * landing.arrival);
    if uncertain == 0 {
        // The lanes behind the last valid one repeat it.
        columns.land(lanes, u32::MAX, landing.flight, &after);
    } else {
        open.push_chosen::<V>(lanes, uncertain);
        columns.land(lanes, landed, landing.flight, &after);
    }
    next.sort(resting, &track, restitution, &after, lanes, landed);
}

/// The landings of a register, with those of the lanes in `bits` found one by one.
#[inline(always)]
fn decide<V: Vector>(
    columns: &Columns,
    grazing: &mut Set,
    landing: &Landing<V>,
    bits: u32,
    lanes: [u8; MAX_LANES],
) -> Landing<V> {
    let mut landings = [landing.flight, landing.phase, landing.arrival].map(V::to_array);
    for (m, lane) in lanes.into_iter().enumerate().take(V::WIDTH) {
        let all = [lane; MAX_LANES];
        if bits >> m & 1 == 1
            && let Some((exact, grazes)) = first_impact(&columns.track(all), &columns.launch(all))
        {
            let exact = [exact.flight, exact.phase, exact.arrival];
            for (values, value) in landings.iter_mut().zip(exact) {
                // A register that is not full repeats its last lane.
                for (place, other) in values.iter_mut().zip(lanes) {
                    *place = if other == lane { value } else { *place };
                }
            }
            grazing.put(lane.into(), grazes);
        }
    }
    let [flight, phase, arrival] = landings.map(V::from_array);
    Landing {
        flight,
        phase,
        arrival,
    }
}

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod x86 {
    use super::{Block, advance};
    use crate::arithmetic::vector::avx2::Avx2;

    pub(super) fn advance_avx2(block: &mut Block, impacts: u32) {
        #[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
        fn inner(block: &mut Block, impacts: u32) {
            advance::<Avx2>(block, impacts);
        }
        // SAFETY: a block of this width exists only if the CPU has AVX2 and counts bits.
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
