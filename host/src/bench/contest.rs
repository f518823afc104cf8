//! The kernels side by side: run time of each turn, errors once.

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::{Duration, Instant};

use kband::impact::batch::{Block, LANES, Simd};
use kband::impact::{Hybrid, Impact, Integer, Kernel, Map, PartState, Single};

use super::workload::{Launch, SETTLING, SWEEP_ORBITS, SWEEP_RESTITUTIONS, Workload, sweep_start};
use super::{Errors, Flight, bracket, textbook};

/// Relative flight difference (in rad, over 1 + flight) above which a flight is another root. The
/// coarsest arithmetic has errors of 3e-4.
const ANOTHER_ROOT: f64 = 1e-3;

/// A kernel or baseline, ready to run.
pub trait Contestant {
    /// Its name.
    fn name(&self) -> &'static str;
    /// Number of turns for all its impacts.
    fn turns(&self) -> usize;
    /// Makes the impacts of turn `n`, a few thousand of all; returns ns per impact.
    fn turn(&mut self, n: usize) -> f64;
    /// Errors of its impacts against f64.
    fn errors(&mut self) -> Errors;
}

/// All contestants of a workload; the slow baselines make fewer of its impacts.
#[must_use]
pub fn contestants(workload: Workload, launches: &[Launch]) -> Vec<Box<dyn Contestant>> {
    let few: Vec<Launch> = launches.iter().copied().step_by(8).collect();
    let mut contestants: Vec<Box<dyn Contestant>> = vec![
        Box::new(Baseline::new(
            "bracket",
            bracket::first_impact,
            few,
            LAUNCHES / 16,
        )),
        Box::new(Baseline::new(
            "textbook",
            textbook::first_impact,
            launches.to_vec(),
            LAUNCHES,
        )),
        Box::new(Kernels::<Map>::new(launches)),
    ];
    for (simd, name) in widths() {
        let Some(block) = Block::with(simd) else {
            continue;
        };
        contestants.push(if workload == Workload::Sweep {
            Box::new(Orbits::new(&block, name))
        } else {
            Box::new(Blocks::new(launches, &block, name))
        });
    }
    contestants.push(Box::new(Kernels::<Hybrid>::new(launches)));
    contestants.push(Box::new(Kernels::<Single>::new(launches)));
    contestants.push(Box::new(Kernels::<Integer>::new(launches)));
    contestants
}

/// The register widths of this CPU, the widest first, with the names of the batch kernel.
fn widths() -> impl Iterator<Item = (Simd, &'static str)> {
    let widest = Simd::widest();
    let narrower = (widest > Simd::None).then_some((Simd::None, "batch-single"));
    std::iter::once((widest, "batch")).chain(narrower)
}

/// Launches per turn. Enough to make the reload of the caches negligible. Few enough to end a turn
/// before a busy machine interrupts it.
pub const LAUNCHES: usize = 16 * LANES;

/// Ratio of the batch kernel's impacts per turn to the others'; the turns then take equally long.
const BATCHES: usize = 4;

/// The slice of `all` for turn `n`.
pub(super) fn slice<T>(all: &[T], n: usize, length: usize) -> &[T] {
    all.chunks(length)
        .nth(n % all.len().div_ceil(length).max(1))
        .unwrap_or(all)
}

/// Collects errors against the map in f64.
#[derive(Default)]
pub(super) struct Judge {
    errors: Vec<f64>,
    wrong_roots: u64,
}

impl Judge {
    fn judge(&mut self, k: f64, restitution: f64, state: PartState, flight: f64, phase: f64) {
        if let Ok(map) = Map::build(k, restitution) {
            self.compare(&map.impact(state), flight, phase);
        }
    }

    /// Compares flight and phase with an f64 impact, unless that grazes and rounding decides the
    /// first root.
    pub(super) fn compare(&mut self, truth: &Impact<PartState>, flight: f64, phase: f64) {
        if truth.grazes {
            return;
        }
        // NaN counts as another root.
        if (flight - truth.flight).abs() <= ANOTHER_ROOT * (1.0 + truth.flight) {
            let turned = (phase - truth.next.phase).abs();
            self.errors.push(turned.min((TAU - turned).abs()));
        } else {
            self.wrong_roots += 1;
        }
    }

    pub(super) fn verdict(self) -> Errors {
        Errors::of(self.errors, self.wrong_roots)
    }
}

struct Baseline {
    name: &'static str,
    first_impact: fn(f64, f64, f64) -> Flight,
    launches: Vec<Launch>,
    /// Launches per turn.
    turn: usize,
}

impl Baseline {
    fn new(
        name: &'static str,
        first_impact: fn(f64, f64, f64) -> Flight,
        launches: Vec<Launch>,
        turn: usize,
    ) -> Self {
        Self {
            name,
            first_impact,
            launches,
            turn,
        }
    }
}

impl Contestant for Baseline {
    fn name(&self) -> &'static str {
        self.name
    }

    fn turns(&self) -> usize {
        self.launches.len().div_ceil(self.turn)
    }

    fn turn(&mut self, n: usize) -> f64 {
        let launches = slice(&self.launches, n, self.turn);
        let begun = Instant::now();
        for launch in launches {
            let PartState { phase, velocity } = launch.state;
            // By reference, to avoid a copy of the result.
            black_box(&(self.first_impact)(launch.k, phase, velocity));
        }
        per_impact(begun.elapsed(), launches.len())
    }

    fn errors(&mut self) -> Errors {
        let mut judge = Judge::default();
        for launch in &self.launches {
            let PartState { phase, velocity } = launch.state;
            let flight = (self.first_impact)(launch.k, phase, velocity);
            judge.judge(
                launch.k,
                launch.restitution,
                launch.state,
                flight.duration,
                flight.phase,
            );
        }
        judge.verdict()
    }
}

/// One kernel, one impact at a time.
struct Kernels<K: Kernel> {
    ready: Vec<(K, K::State, Launch)>,
}

impl<K: Kernel> Kernels<K> {
    fn new(launches: &[Launch]) -> Self {
        // Leaves out launches that the arithmetic cannot represent.
        let ready = |launch: &Launch| {
            let kernel = K::build(launch.k, launch.restitution).ok()?;
            let state = K::state(launch.state.phase, launch.state.velocity).ok()?;
            Some((kernel, state, *launch))
        };
        Self {
            ready: launches.iter().filter_map(ready).collect(),
        }
    }
}

impl<K: Kernel> Contestant for Kernels<K> {
    fn name(&self) -> &'static str {
        K::NAME
    }

    fn turns(&self) -> usize {
        self.ready.len().div_ceil(LAUNCHES)
    }

    fn turn(&mut self, n: usize) -> f64 {
        let ready = slice(&self.ready, n, LAUNCHES);
        let begun = Instant::now();
        for (kernel, state, _) in ready {
            black_box(&kernel.impact(*state));
        }
        per_impact(begun.elapsed(), ready.len())
    }

    fn errors(&mut self) -> Errors {
        let mut judge = Judge::default();
        for (kernel, state, launch) in &self.ready {
            let impact = kernel.impact(*state);
            judge.judge(
                launch.k,
                launch.restitution,
                K::observe(*state),
                impact.flight,
                K::observe(impact.next).phase,
            );
        }
        judge.verdict()
    }
}

/// The batch kernel, one impact of each launch.
struct Blocks {
    name: &'static str,
    /// The blocks of a turn.
    blocks: Vec<Block>,
    launches: Vec<(Map, Launch)>,
}

impl Blocks {
    fn new(launches: &[Launch], block: &Block, name: &'static str) -> Self {
        let ready =
            |launch: &Launch| Some((Map::build(launch.k, launch.restitution).ok()?, *launch));
        Self {
            name,
            blocks: vec![block.clone(); LAUNCHES / LANES],
            launches: launches.iter().filter_map(ready).collect(),
        }
    }

    /// Fills the block with launches.
    fn fill(block: &mut Block, launches: &[(Map, Launch)]) {
        for lane in 0..LANES {
            block.clear(lane);
        }
        for (lane, (map, launch)) in launches.iter().enumerate() {
            // A chunk has at most as many launches as lanes.
            let _ = block.put(lane, map, launch.state);
        }
        // Sorts the lanes.
        block.advance(0);
    }
}

impl Contestant for Blocks {
    fn name(&self) -> &'static str {
        self.name
    }

    fn turns(&self) -> usize {
        self.launches.len().div_ceil(BATCHES * LAUNCHES)
    }

    fn turn(&mut self, n: usize) -> f64 {
        let launches = slice(&self.launches, n, BATCHES * LAUNCHES);
        let mut spent = Duration::ZERO;
        for launches in launches.chunks(LAUNCHES) {
            let filled = &mut self.blocks[..launches.len().div_ceil(LANES)];
            for (block, launches) in filled.iter_mut().zip(launches.chunks(LANES)) {
                Self::fill(block, launches);
            }
            let begun = Instant::now();
            for block in filled {
                block.advance(1);
            }
            spent += begun.elapsed();
        }
        per_impact(spent, launches.len())
    }

    fn errors(&mut self) -> Errors {
        let mut judge = Judge::default();
        let block = &mut self.blocks[0];
        for launches in self.launches.chunks(LANES) {
            Self::fill(block, launches);
            block.advance(1);
            for (lane, (_, launch)) in launches.iter().enumerate() {
                if let Some(impact) = block.impact(lane) {
                    judge.judge(
                        launch.k,
                        launch.restitution,
                        launch.state,
                        impact.flight,
                        impact.next.phase,
                    );
                }
            }
        }
        judge.verdict()
    }
}

/// The batch kernel on whole orbits: blocks of one restitution.
///
/// Resting parts restart with the impact after their lift-off.
struct Orbits {
    name: &'static str,
    blocks: Vec<(Box<Block>, Lanes)>,
}

/// The map of each lane, and its state after the flight from lift-off.
type Lanes = Vec<(Map, PartState)>;

impl Orbits {
    fn new(empty: &Block, name: &'static str) -> Self {
        let block = |restitution: f64, first: usize| {
            let mut block = Box::new(empty.clone());
            let lane = |n: usize| {
                let (k, start) = sweep_start(first + n);
                let map = Map::build(k, restitution).ok()?;
                let thrown = PartState {
                    phase: k.asin(),
                    velocity: 0.0,
                };
                block.put(n, &map, start).ok()?;
                Some((map, map.impact(thrown).next))
            };
            let lanes: Lanes = (0..LANES).filter_map(lane).collect();
            (block, lanes)
        };
        let mut blocks = Vec::new();
        for restitution in SWEEP_RESTITUTIONS {
            for first in (0..SWEEP_ORBITS).step_by(LANES) {
                blocks.push(block(restitution, first));
            }
        }
        for (block, lanes) in &mut blocks {
            Self::advance(block, lanes, SETTLING);
        }
        Self { name, blocks }
    }

    /// Advances the orbits of a block by this many impacts.
    fn advance(block: &mut Block, lanes: &Lanes, impacts: u32) {
        let mut resting = [0; LANES];
        for _ in 0..impacts {
            block.advance(1);
            let mut count = 0;
            for lane in block.resting() {
                resting[count] = lane;
                count += 1;
            }
            for &lane in &resting[..count] {
                // The lane holds an orbit, because it rests.
                let _ = block.restart(lane, lanes[lane].1);
            }
        }
    }
}

impl Contestant for Orbits {
    fn name(&self) -> &'static str {
        self.name
    }

    fn turns(&self) -> usize {
        self.blocks.len()
    }

    fn turn(&mut self, n: usize) -> f64 {
        const IMPACTS: u32 = (BATCHES * LAUNCHES / LANES) as u32;
        let turns = self.blocks.len();
        let (block, lanes) = &mut self.blocks[n % turns];
        let begun = Instant::now();
        Self::advance(block, lanes, IMPACTS);
        per_impact(begun.elapsed(), LANES * IMPACTS as usize)
    }

    fn errors(&mut self) -> Errors {
        let mut judge = Judge::default();
        for (block, lanes) in &mut self.blocks {
            let before: Vec<Option<PartState>> = (0..LANES).map(|lane| block.state(lane)).collect();
            block.advance(1);
            for (lane, state) in before.into_iter().enumerate() {
                if let (Some(state), Some(impact)) = (state, block.impact(lane)) {
                    let map = &lanes[lane].0;
                    judge.judge(
                        map.k(),
                        map.restitution(),
                        state,
                        impact.flight,
                        impact.next.phase,
                    );
                }
            }
        }
        judge.verdict()
    }
}

pub(super) fn per_impact(spent: Duration, impacts: usize) -> f64 {
    spent.as_nanos() as f64 / impacts.max(1) as f64
}
