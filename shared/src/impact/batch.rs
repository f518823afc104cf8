//! Many orbits at a time: blocks of lanes, each with its own k and restitution.
//!
//! Every lane gives the bits that [`Map`] gives, whatever its neighbours do and whatever the CPU offers:
//! the kernels are the same source over one, four or eight f64. Before each impact the lanes are sorted
//! by the kind of their flight, so that all lanes of a register take the same path; a group of registers
//! goes through each stage of the kernel together, which hides the latency of one behind the others.

use super::flight::{Landing, Launch, Track, finish, low, search, short, tall};
use super::{Impact, Map, State};
use crate::arithmetic::lane::{Lane, WIDEST};
use crate::feeder::{OutOfRange, accept};

pub use crate::arithmetic::lane::simd::Simd;

/// Lanes of a block.
pub const LANES: usize = 512;

/// Registers that go through a stage together.
const GROUP: usize = 8;

/// Kinds of flight that lanes are sorted by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Tall,
    Short,
    Home,
    Low,
}

impl Kind {
    const ALL: [Self; 4] = [Self::Tall, Self::Short, Self::Home, Self::Low];
}

/// One orbit: a cache line.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Orbit {
    /// Phase, velocity, and the sine and cosine of the phase.
    launch: [f64; 4],
    /// k, 1/k, the edge and the restitution.
    track: [f64; 4],
}

impl Orbit {
    fn launch(&self) -> Launch<f64> {
        launch(self.launch)
    }
}

#[inline(always)]
fn launch<L: Lane>([phase, velocity, sine, cosine]: [L; 4]) -> Launch<L> {
    Launch {
        phase,
        velocity,
        sine,
        cosine,
    }
}

/// Lanes of one kind, and room to fill the last register.
#[derive(Clone, Debug)]
struct Queue {
    lanes: [u16; LANES + WIDEST],
    count: usize,
}

impl Queue {
    const EMPTY: Self = Self {
        lanes: [0; LANES + WIDEST],
        count: 0,
    };

    #[inline(always)]
    fn push(&mut self, lane: u16) {
        if let Some(place) = self.lanes.get_mut(self.count) {
            *place = lane;
            self.count += 1;
        }
    }

    #[inline(always)]
    fn extend(&mut self, lanes: &[u16]) {
        if let Some(places) = self.lanes.get_mut(self.count..self.count + lanes.len()) {
            places.copy_from_slice(lanes);
            self.count += lanes.len();
        }
    }
}

/// A yes or no for each lane.
#[derive(Clone, Copy, Debug)]
struct Set([u64; LANES / 64]);

impl Set {
    const EMPTY: Self = Self([0; LANES / 64]);

    fn contains(&self, lane: usize) -> bool {
        self.0
            .get(lane / 64)
            .is_some_and(|word| word >> (lane % 64) & 1 == 1)
    }

    fn put(&mut self, lane: usize, is_in: bool) {
        if let Some(word) = self.0.get_mut(lane / 64) {
            *word = *word & !(1 << (lane % 64)) | u64::from(is_in) << (lane % 64);
        }
    }

    fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        self.0.iter().enumerate().flat_map(|(n, &word)| {
            core::iter::successors(Some(word), |&rest| Some(rest & rest.wrapping_sub(1)))
                .take_while(|&rest| rest != 0)
                .map(move |rest| 64 * n + rest.trailing_zeros() as usize)
        })
    }
}

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
    orbits: [Orbit; LANES],
    flight: [f64; LANES],
    /// Lanes that hold an orbit.
    filled: Set,
    /// Lanes that wait for their caller.
    resting: Set,
    /// Lanes whose last impact grazes.
    grazing: Set,
    /// The lanes that fly next, by kind; only where `sorted`.
    queues: [Queue; 4],
    sorted: bool,
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
    #[must_use]
    pub fn with(simd: Simd) -> Option<Self> {
        (simd <= Simd::widest()).then(|| Self::in_width(simd))
    }

    fn in_width(simd: Simd) -> Self {
        Self {
            simd,
            orbits: [Orbit {
                launch: [0.0; 4],
                track: [0.0; 4],
            }; LANES],
            flight: [0.0; LANES],
            filled: Set::EMPTY,
            resting: Set::EMPTY,
            grazing: Set::EMPTY,
            queues: [Queue::EMPTY; 4],
            sorted: false,
        }
    }

    /// The width of the registers it is computed in.
    #[must_use]
    pub fn simd(&self) -> Simd {
        self.simd
    }

    /// Puts an orbit into a lane, in place of what was there.
    ///
    /// # Errors
    /// Where there is no such lane.
    pub fn put(&mut self, lane: usize, map: &Map, state: State) -> Result<(), OutOfRange> {
        accept("lane", lane as f64, lane < LANES, "0..511")?;
        let track = map.track();
        self.orbits[lane].track = [track.k, track.per_k, track.edge, map.restitution()];
        self.sorted &= self.resting.contains(lane);
        self.filled.put(lane, true);
        self.start(lane, state);
        Ok(())
    }

    /// Restarts the orbit of a lane from another state, on the same track; cheapest where it rests.
    ///
    /// # Errors
    /// Where there is no orbit in such a lane.
    pub fn restart(&mut self, lane: usize, state: State) -> Result<(), OutOfRange> {
        let filled = self.filled.contains(lane);
        accept("lane", lane as f64, filled, "a lane with an orbit in it")?;
        self.sorted &= self.resting.contains(lane);
        self.start(lane, state);
        Ok(())
    }

    fn start(&mut self, lane: usize, state: State) {
        let launch = Launch::new(state.phase, state.velocity);
        let orbit = &mut self.orbits[lane];
        orbit.launch = [launch.phase, launch.velocity, launch.sine, launch.cosine];
        self.flight[lane] = 0.0;
        self.grazing.put(lane, false);
        self.resting.put(lane, false);
        if self.sorted {
            self.sort(lane);
        }
    }

    /// Puts a lane into the queue of its kind.
    fn sort(&mut self, lane: usize) {
        let orbit = &self.orbits[lane];
        let (track, launch) = (track(orbit.track), orbit.launch());
        if f64::any(launch.chatters_out(&track, orbit.track[3])) {
            self.resting.put(lane, true);
            return;
        }
        let kind = if f64::any(launch.is_tall(&track)) {
            Kind::Tall
        } else if f64::any(launch.is_short(&track)) {
            Kind::Short
        } else if f64::any(launch.is_home(&track)) {
            Kind::Home
        } else {
            Kind::Low
        };
        self.queues[kind as usize].push(lane as u16);
    }

    /// Empties a lane.
    pub fn clear(&mut self, lane: usize) {
        self.sorted &= self.resting.contains(lane) || !self.filled.contains(lane);
        self.filled.put(lane, false);
        self.resting.put(lane, false);
    }

    /// The state of the orbit in a lane; `None` where there is none.
    #[must_use]
    pub fn state(&self, lane: usize) -> Option<State> {
        self.filled.contains(lane).then(|| {
            let [phase, velocity, ..] = self.orbits[lane].launch;
            State { phase, velocity }
        })
    }

    /// The last impact of the orbit in a lane (flight 0 where it had none); `None` where there is no
    /// orbit.
    #[must_use]
    pub fn impact(&self, lane: usize) -> Option<Impact<State>> {
        self.state(lane).map(|next| Impact {
            flight: self.flight[lane],
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
        if !self.sorted {
            self.queues = [Queue::EMPTY; 4];
            let waiting = self.resting;
            for lane in 0..LANES {
                if self.filled.contains(lane) && !waiting.contains(lane) {
                    self.sort(lane);
                }
            }
            self.sorted = true;
        }
        match self.simd {
            #[cfg(target_arch = "x86_64")]
            Simd::Avx512 => x86::advance_avx512(self, impacts),
            #[cfg(target_arch = "x86_64")]
            Simd::Avx2 => x86::advance_avx2(self, impacts),
            _ => advance::<f64>(self, impacts),
        }
    }
}

/// The track of the columns of orbits.
#[inline(always)]
fn track<L: Lane>([k, per_k, edge, _]: [L; 4]) -> Track<L> {
    Track {
        k,
        per_k,
        edge,
        edge_cosine: Track::edge_cosine(k),
    }
}

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod x86 {
    use super::{Block, advance};
    use crate::arithmetic::lane::avx2::Avx2;
    use crate::arithmetic::lane::avx512::Avx512;

    pub(super) fn advance_avx2(block: &mut Block, impacts: u32) {
        #[target_feature(enable = "avx2")]
        fn inner(block: &mut Block, impacts: u32) {
            advance::<Avx2>(block, impacts);
        }
        // SAFETY: a block of this width exists only where the CPU has AVX2.
        unsafe { inner(block, impacts) }
    }

    pub(super) fn advance_avx512(block: &mut Block, impacts: u32) {
        #[target_feature(enable = "avx512f,avx512dq,avx2")]
        fn inner(block: &mut Block, impacts: u32) {
            advance::<Avx512>(block, impacts);
        }
        // SAFETY: a block of this width exists only where the CPU has AVX-512 F and DQ.
        unsafe { inner(block, impacts) }
    }
}

/// What the stages of a kernel hand on, for each register of a group.
#[derive(Clone, Copy)]
struct Stage<L: Lane> {
    launch: Launch<L>,
    track: Track<L>,
    restitution: L,
    crossing: tall::Crossing<L>,
    stretch: low::Stretch<L>,
    close: L,
    landing: Landing<L>,
    certain: L::Mask,
}

#[inline(always)]
fn advance<L: Lane>(block: &mut Block, impacts: u32) {
    let zero = L::splat(0.0);
    let mut stages = [Stage {
        launch: launch([zero; 4]),
        track: track([zero; 4]),
        restitution: zero,
        crossing: tall::Crossing::none(),
        stretch: low::Stretch::none(),
        close: zero,
        landing: Landing {
            flight: zero,
            phase: zero,
            arrival: zero,
        },
        certain: zero.below(zero),
    }; GROUP];
    let mut queues = [Queue::EMPTY; 4];
    for _ in 0..impacts {
        core::mem::swap(&mut queues, &mut block.queues);
        for queue in &mut block.queues {
            queue.count = 0;
        }
        block.grazing = Set::EMPTY;
        for kind in Kind::ALL {
            let queue = &mut queues[kind as usize];
            let count = queue.count.min(LANES);
            if count == 0 {
                continue;
            }
            // A register that is not full repeats its last lane, to the same result.
            let last = queue.lanes[count - 1];
            queue.lanes[count..count + WIDEST].fill(last);
            let mut at = 0;
            while at < count {
                let some = (count - at).min(GROUP * L::WIDTH);
                let registers = some.div_ceil(L::WIDTH);
                let lanes = &queue.lanes[at..(at + registers * L::WIDTH).min(LANES + WIDEST)];
                group(block, kind, lanes, some, &mut stages[..registers]);
                at += some;
            }
        }
    }
}

/// One impact of the lanes of a group, all of one kind; the first `count` of them count.
#[inline(always)]
fn group<L: Lane>(
    block: &mut Block,
    kind: Kind,
    lanes: &[u16],
    count: usize,
    stages: &mut [Stage<L>],
) {
    for (stage, lanes) in stages.iter_mut().zip(lanes.chunks_exact(L::WIDTH)) {
        let mut launches = [&block.orbits[0].launch; WIDEST];
        let mut tracks = [&block.orbits[0].track; WIDEST];
        for (n, &lane) in lanes.iter().enumerate() {
            let orbit = &block.orbits[usize::from(lane) % LANES];
            launches[n] = &orbit.launch;
            tracks[n] = &orbit.track;
        }
        stage.launch = launch(L::gather(launches));
        let columns = L::gather(tracks);
        stage.track = track(columns);
        stage.restitution = columns[3];
        match kind {
            Kind::Tall => stage.crossing = tall::crossing(&stage.track, &stage.launch),
            Kind::Short => stage.close = short::guess(&stage.track, &stage.launch),
            Kind::Home => stage.stretch = low::home(&stage.track, &stage.launch),
            Kind::Low => stage.stretch = low::stretch(&stage.track, &stage.launch),
        }
    }
    match kind {
        Kind::Tall => {
            for stage in &mut *stages {
                stage.close = tall::approach(&stage.track, &stage.launch, &stage.crossing);
            }
            for stage in &mut *stages {
                stage.landing = finish(&stage.track, &stage.launch, stage.close).0;
            }
        }
        Kind::Short => {
            for stage in &mut *stages {
                (stage.landing, stage.certain) =
                    short::landing(&stage.track, &stage.launch, stage.close);
            }
        }
        Kind::Home | Kind::Low => {
            for stage in &mut *stages {
                stage.close = low::approach(&stage.track, &stage.launch, &stage.stretch);
            }
            for stage in &mut *stages {
                (stage.landing, stage.certain) =
                    low::landing(&stage.track, &stage.launch, &stage.stretch, stage.close);
            }
        }
    }
    let mut left = count;
    for (stage, lanes) in stages.iter_mut().zip(lanes.chunks_exact(L::WIDTH)) {
        if kind != Kind::Tall && L::any(!stage.certain) {
            search_for(block, stage, lanes);
        }
        let next = Launch::new(
            stage.landing.phase,
            stage.restitution * stage.landing.arrival,
        );
        let tall = L::bits(next.is_tall(&stage.track));
        let rows = L::rows([next.phase, next.velocity, next.sine, next.cosine]);
        let flight = stage.landing.flight.to_array();
        for (n, &lane) in lanes.iter().enumerate() {
            let lane = usize::from(lane) % LANES;
            block.orbits[lane].launch = rows[n];
            block.flight[lane] = flight[n];
        }
        let lanes = &lanes[..left.min(L::WIDTH)];
        left -= lanes.len();
        if tall.count_ones() as usize == L::WIDTH {
            block.queues[Kind::Tall as usize].extend(lanes);
        } else {
            let short = L::bits(next.is_short(&stage.track));
            let home = L::bits(next.is_home(&stage.track));
            let resting = L::bits(next.chatters_out(&stage.track, stage.restitution));
            for (n, &lane) in lanes.iter().enumerate() {
                if resting >> n & 1 == 1 {
                    block.resting.put(usize::from(lane), true);
                } else {
                    // Tall 0, short 1, home 2, low 3.
                    let bit = |mask: u32| (mask >> n & 1) as usize;
                    let kind = (1 - bit(tall)) * (1 + (1 - bit(short)) * (2 - bit(home)));
                    block.queues[kind.min(3)].push(lane);
                }
            }
        }
    }
}

/// The landings of the lanes of which the closed forms are not certain.
#[inline(always)]
fn search_for<L: Lane>(block: &mut Block, stage: &mut Stage<L>, lanes: &[u16]) {
    let certain = L::bits(stage.certain);
    let mut flight = stage.landing.flight.to_array();
    let mut phase = stage.landing.phase.to_array();
    let mut arrival = stage.landing.arrival.to_array();
    for (n, &lane) in lanes.iter().enumerate() {
        if certain >> n & 1 == 0 {
            let lane = usize::from(lane) % LANES;
            let orbit = &block.orbits[lane];
            let (landing, grazes) =
                search::landing(&track(orbit.track), &orbit.launch(), search::Envelope::Skip);
            flight[n] = landing.flight;
            phase[n] = landing.phase;
            arrival[n] = landing.arrival;
            block.grazing.put(lane, grazes);
        }
    }
    stage.landing = Landing {
        flight: L::from_array(flight),
        phase: L::from_array(phase),
        arrival: L::from_array(arrival),
    };
}

#[cfg(test)]
mod tests {
    use super::super::Kernel;
    use super::*;

    /// Orbits over the whole range of k and restitution, from every kind of launch.
    fn starts() -> impl Iterator<Item = (Map, State)> {
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
