//! Soak test: launches of every kind through every arithmetic, each impact judged.

use std::panic::{AssertUnwindSafe, catch_unwind};

use kband::arithmetic::Phase;
use kband::impact::batch::{Block, LANES};
use kband_host::desk::Desk;

use crate::bench::{Bench, Judged};
use crate::states::{self, Kind, Launch, Random};
use crate::verdict::Verdict;

/// Number of launches per track: preparing a track in every arithmetic takes as long as one
/// verdict.
const LAUNCHES_PER_TRACK: usize = 8;
const _: () = assert!(LANES.is_multiple_of(LAUNCHES_PER_TRACK));

/// Results of a soak for one kind of launch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// Number of launches.
    pub launches: u64,
    /// Impacts, in any arithmetic, that differ from the oracle's and are flagged as grazing.
    pub flagged: u64,
    /// Touches that are undecided within the oracle's rounding.
    pub undecided: u64,
}

impl Tally {
    fn plus(self, other: &Self) -> Self {
        Self {
            launches: self.launches + other.launches,
            flagged: self.flagged + other.flagged,
            undecided: self.undecided + other.undecided,
        }
    }
}

/// The launch rounded to the resolution of all arithmetics: 2^-32 turns, and 2^-26 or f32. One
/// proof then applies to all of them. A launch that would round to rest is unchanged.
fn held_by_all(launch: &Launch) -> Launch {
    let velocity = (launch.velocity * 67_108_864.0).round() / 67_108_864.0;
    if velocity == 0.0 {
        return *launch;
    }
    Launch {
        phase: Phase::from_radians(launch.phase).radians(),
        velocity: f64::from(velocity as f32),
        ..*launch
    }
}

/// Launches of block `number` of a kind, from tracks of one tone or of several, determined by the
/// seed.
fn launches(kind: Kind, on_tones: bool, seed: u64, number: u64) -> Vec<Launch> {
    let mut seeds = Random::new(seed ^ ((kind as u64) << 56) ^ (number << 8));
    let mut random = Random::new(seeds.bits());
    let mut launches = Vec::with_capacity(LANES);
    while launches.len() < LANES {
        let restitution = states::restitution(&mut random);
        let tones = on_tones.then(|| states::tones(&mut random));
        let tones = tones.unwrap_or_default();
        let track = kind.track(&mut random, tones);
        for n in 0..LAUNCHES_PER_TRACK {
            let launch = kind.launch(&mut random, track, restitution);
            let held = held_by_all(&launch);
            launches.push(if n % 2 == 0 { launch } else { held });
        }
    }
    launches
}

/// Judges one launch; a panic of a kernel is an error.
fn judged(bench: &Bench, launch: &Launch) -> Result<Judged, String> {
    catch_unwind(AssertUnwindSafe(|| bench.judge(launch)))
        .unwrap_or_else(|_| Err("a kernel panicked".into()))
        .map_err(|cause| format!("{launch:?}\n    {cause}"))
}

/// Tries one block of launches in every arithmetic.
fn block(launches: &[Launch], report: &impl Fn(&str)) -> Tally {
    let mut tally = Tally::default();
    let tracks = launches.iter().step_by(LAUNCHES_PER_TRACK);
    let bench = |first: &Launch| Bench::build(&first.track, first.restitution);
    let benches: Vec<Bench> = tracks.map(bench).collect();
    let mut lanes = Block::new();
    for (lane, launch) in launches.iter().enumerate() {
        if let Some(map) = &benches[lane / LAUNCHES_PER_TRACK].map {
            // Every launch has a lane.
            let _ = lanes.put(lane, map, launch.state());
        }
    }
    lanes.advance(1);
    for (lane, launch) in launches.iter().enumerate() {
        tally.launches += 1;
        let judged = judged(&benches[lane / LAUNCHES_PER_TRACK], launch).and_then(|judged| {
            let alone = judged.impact;
            match lanes.impact(lane) {
                Some(lane) if lane != alone && lane.flight > 0.0 => Err(format!(
                    "{launch:?}\n    batch gave {lane:?}, f64 {alone:?}"
                )),
                _ => Ok(judged),
            }
        });
        match judged {
            Ok(judged) => {
                tally.flagged += judged.flagged;
                tally.undecided += u64::from(judged.verdict == Verdict::Undecided);
            }
            Err(cause) => report(&cause),
        }
    }
    tally
}

/// Tries `count` launches of every kind, from tracks of one tone or of several, on every core.
/// Reports wrong impacts at once. The seed alone determines the launches. It panics if the program
/// is asked to stop.
pub fn soak(
    count: u64,
    on_tones: bool,
    seed: u64,
    report: impl Fn(&str) + Sync + Send,
) -> Vec<(Kind, Tally)> {
    let blocks = count.div_ceil(LANES as u64).max(1) as usize;
    let desk = Desk::new(None);
    let one = |kind| {
        let try_block = |number| {
            let launches = launches(kind, on_tones, seed, number as u64);
            block(&launches, &|cause| report(&format!("{kind:?}: {cause}")))
        };
        let tallies = desk.map("launches", blocks, try_block).expect("all blocks");
        (kind, tallies.iter().fold(Tally::default(), Tally::plus))
    };
    Kind::ALL.map(one).into()
}

/// The impacts of every arithmetic for one launch, and the verdict.
pub fn replay(launch: &Launch) -> Result<String, String> {
    let truth = launch.track.first_impact(launch.phase, launch.velocity);
    let text = format!("{launch:?}\noracle {truth:?}\n");
    judged(&Bench::build(&launch.track, launch.restitution), launch)
        .map(|judged| format!("{text}{:?}", judged.verdict))
        .map_err(|cause| format!("{text}{cause}"))
}
