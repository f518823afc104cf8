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
const KINDS: usize = 3;
const TALL: u8 = 0;
const SHORT: u8 = 1;
const LOW: u8 = 2;
/// The lane waits for its caller.
const RESTING: u8 = 3;
/// No orbit was put into the lane.
const EMPTY: u8 = 4;

/// One orbit: a cache line.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Orbit {
    /// Phase, velocity, and the sine and cosine of the phase.
    launch: [f64; 4],
    /// k, 1/k, the edge and its cosine.
    track: [f64; 4],
}

impl Orbit {
    fn launch(&self) -> Launch<f64> {
        launch(self.launch)
    }

    fn track(&self) -> Track<f64> {
        track(self.track)
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

#[inline(always)]
fn track<L: Lane>([k, per_k, edge, edge_cosine]: [L; 4]) -> Track<L> {
    Track {
        k,
        per_k,
        edge,
        edge_cosine,
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
    restitution: [f64; LANES],
    flight: [f64; LANES],
    kind: [u8; LANES],
    /// Lanes whose last impact grazes, one bit each.
    grazes: [u64; LANES / 64],
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
            restitution: [0.0; LANES],
            flight: [0.0; LANES],
            kind: [EMPTY; LANES],
            grazes: [0; LANES / 64],
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
        self.orbits[lane].track = [track.k, track.per_k, track.edge, track.edge_cosine];
        self.restitution[lane] = map.restitution();
        self.start(lane, state);
        Ok(())
    }

    /// Restarts the orbit of a lane from another state, on the same track.
    ///
    /// # Errors
    /// Where there is no orbit in such a lane.
    pub fn restart(&mut self, lane: usize, state: State) -> Result<(), OutOfRange> {
        let filled = lane < LANES && self.kind[lane] != EMPTY;
        accept("lane", lane as f64, filled, "a lane with an orbit in it")?;
        self.start(lane, state);
        Ok(())
    }

    fn start(&mut self, lane: usize, state: State) {
        let launch = Launch::new(state.phase, state.velocity);
        let orbit = &mut self.orbits[lane];
        orbit.launch = [launch.phase, launch.velocity, launch.sine, launch.cosine];
        self.kind[lane] = kind(&orbit.track(), &launch, self.restitution[lane]);
        self.flight[lane] = 0.0;
        self.grazes[lane / 64] &= !(1 << (lane % 64));
    }

    /// Empties a lane.
    pub fn clear(&mut self, lane: usize) {
        if let Some(kind) = self.kind.get_mut(lane) {
            *kind = EMPTY;
        }
    }

    /// The state of the orbit in a lane; `None` where there is none.
    #[must_use]
    pub fn state(&self, lane: usize) -> Option<State> {
        let filled = *self.kind.get(lane)? != EMPTY;
        let [phase, velocity, ..] = self.orbits[lane].launch;
        filled.then_some(State { phase, velocity })
    }

    /// The last impact of the orbit in a lane (flight 0 where it had none); `None` where there is no
    /// orbit.
    #[must_use]
    pub fn impact(&self, lane: usize) -> Option<Impact<State>> {
        self.state(lane).map(|next| Impact {
            flight: self.flight[lane],
            next,
            grazes: self.grazes[lane / 64] >> (lane % 64) & 1 == 1,
        })
    }

    /// The lanes whose part is at rest, or chatters so closely to rest that
    /// [`Contact::time_to_rest`](super::Contact::time_to_rest) sums the rest of it. They wait until they
    /// are restarted, cleared or put anew.
    pub fn resting(&self) -> impl Iterator<Item = usize> + '_ {
        (0..LANES).filter(|&lane| self.kind[lane] == RESTING)
    }

    /// Whether the orbit in a lane waits, as [`Block::resting`] says.
    #[must_use]
    pub fn rests(&self, lane: usize) -> bool {
        self.kind.get(lane) == Some(&RESTING)
    }

    /// Takes every orbit that does not rest this many impacts further.
    pub fn advance(&mut self, impacts: u32) {
        match self.simd {
            #[cfg(target_arch = "x86_64")]
            Simd::Avx512 => x86::advance_avx512(self, impacts),
            #[cfg(target_arch = "x86_64")]
            Simd::Avx2 => x86::advance_avx2(self, impacts),
            _ => advance::<f64>(self, impacts),
        }
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

/// The kind of one launch.
fn kind(track: &Track<f64>, launch: &Launch<f64>, restitution: f64) -> u8 {
    kinds(track, launch, restitution)[0]
}

/// The kind of each lane's launch.
#[inline(always)]
fn kinds<L: Lane>(track: &Track<L>, launch: &Launch<L>, restitution: L) -> [u8; WIDEST] {
    let tall = L::bits(launch.is_tall(track));
    let short = L::bits(launch.is_short(track));
    let mut kinds = [0; WIDEST];
    if tall.count_ones() as usize == L::WIDTH {
        return kinds;
    }
    let resting = L::bits(launch.chatters_out(track, restitution));
    for (lane, kind) in kinds.iter_mut().enumerate().take(L::WIDTH) {
        let bit = |mask: u32| (mask >> lane & 1) as u8;
        *kind = if bit(resting) == 1 {
            RESTING
        } else {
            (1 - bit(tall)) * (LOW - bit(short))
        };
    }
    kinds
}

/// Lanes of one kind, in groups of registers.
struct Queue {
    lanes: [u16; LANES + WIDEST],
    count: usize,
}

/// What the stages of a kernel hand on, for each register of a group.
#[derive(Clone, Copy)]
struct Stage<L: Lane> {
    launch: Launch<L>,
    track: Track<L>,
    crossing: tall::Crossing<L>,
    stretch: low::Stretch<L>,
    close: L,
    landing: Landing<L>,
    certain: L::Mask,
}

#[inline(always)]
fn advance<L: Lane>(block: &mut Block, impacts: u32) {
    let zero = L::splat(0.0);
    let launch = launch([zero; 4]);
    let track = track([zero; 4]);
    let mut stages = [Stage {
        launch,
        track,
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
    let mut queues = [const {
        Queue {
            lanes: [0; LANES + WIDEST],
            count: 0,
        }
    }; KINDS + 2];
    for _ in 0..impacts {
        for queue in &mut queues {
            queue.count = 0;
        }
        for (lane, &kind) in block.kind.iter().enumerate() {
            let queue = &mut queues[usize::from(kind).min(KINDS + 1)];
            queue.lanes[queue.count % LANES] = lane as u16;
            queue.count += 1;
        }
        block.grazes = [0; LANES / 64];
        for (kind, queue) in queues[..KINDS].iter_mut().enumerate() {
            let count = queue.count.min(LANES);
            if count == 0 {
                continue;
            }
            // A register that is not full repeats its last lane, to the same result.
            let last = queue.lanes[count - 1];
            queue.lanes[count..count + WIDEST].fill(last);
            let mut at = 0;
            while at < count {
                let registers = (count - at).div_ceil(L::WIDTH).min(GROUP);
                let lanes = &queue.lanes[at..(at + registers * L::WIDTH).min(LANES + WIDEST)];
                group(block, kind as u8, lanes, &mut stages[..registers]);
                at += registers * L::WIDTH;
            }
        }
    }
}

/// One impact of the lanes of a group, all of one kind.
#[inline(always)]
fn group<L: Lane>(block: &mut Block, kind: u8, lanes: &[u16], stages: &mut [Stage<L>]) {
    for (stage, lanes) in stages.iter_mut().zip(lanes.chunks_exact(L::WIDTH)) {
        let orbit = |n: usize| &block.orbits[usize::from(lanes[n.min(L::WIDTH - 1)]) % LANES];
        let numbers = [0, 1, 2, 3, 4, 5, 6, 7];
        stage.launch = launch(L::gather(numbers.map(|n| &orbit(n).launch)));
        stage.track = track(L::gather(numbers.map(|n| &orbit(n).track)));
        match kind {
            TALL => stage.crossing = tall::crossing(&stage.track, &stage.launch),
            SHORT => stage.close = short::guess(&stage.track, &stage.launch),
            _ => stage.stretch = low::stretch(&stage.track, &stage.launch),
        }
    }
    match kind {
        TALL => {
            for stage in &mut *stages {
                stage.close = tall::approach(&stage.track, &stage.launch, &stage.crossing);
            }
            for stage in &mut *stages {
                stage.landing = finish(&stage.track, &stage.launch, stage.close).0;
            }
        }
        SHORT => {
            for stage in &mut *stages {
                (stage.landing, stage.certain) =
                    short::landing(&stage.track, &stage.launch, stage.close);
            }
        }
        _ => {
            for stage in &mut *stages {
                stage.close = low::approach(&stage.track, &stage.launch, &stage.stretch);
            }
            for stage in &mut *stages {
                (stage.landing, stage.certain) =
                    low::landing(&stage.track, &stage.launch, &stage.stretch, stage.close);
            }
        }
    }
    for (stage, lanes) in stages.iter_mut().zip(lanes.chunks_exact(L::WIDTH)) {
        if kind != TALL && L::any(!stage.certain) {
            let certain = L::bits(stage.certain);
            let mut flight = stage.landing.flight.to_array();
            let mut phase = stage.landing.phase.to_array();
            let mut arrival = stage.landing.arrival.to_array();
            for (n, &lane) in lanes.iter().enumerate() {
                if certain >> n & 1 == 0 {
                    let lane = usize::from(lane) % LANES;
                    let orbit = &block.orbits[lane];
                    let (landing, grazes) = search::landing(&orbit.track(), &orbit.launch());
                    flight[n] = landing.flight;
                    phase[n] = landing.phase;
                    arrival[n] = landing.arrival;
                    block.grazes[lane / 64] |= u64::from(grazes) << (lane % 64);
                }
            }
            stage.landing = Landing {
                flight: L::from_array(flight),
                phase: L::from_array(phase),
                arrival: L::from_array(arrival),
            };
        }
        let mut restitution = [0.0; WIDEST];
        for (value, &lane) in restitution.iter_mut().zip(lanes) {
            *value = block.restitution[usize::from(lane) % LANES];
        }
        let restitution = L::from_array(restitution);
        let next = Launch::new(stage.landing.phase, restitution * stage.landing.arrival);
        let kinds = kinds(&stage.track, &next, restitution);
        let rows = L::rows([next.phase, next.velocity, next.sine, next.cosine]);
        let flight = stage.landing.flight.to_array();
        for (n, &lane) in lanes.iter().enumerate() {
            let lane = usize::from(lane) % LANES;
            block.orbits[lane].launch = rows[n];
            block.flight[lane] = flight[n];
            block.kind[lane] = kinds[n];
        }
    }
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
