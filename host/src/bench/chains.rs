//! Latency of an impact: one orbit, each impact from the end of the one before.
//!
//! Independent launches overlap in a CPU; those of an orbit wait for each other. The CPU also
//! predicts the textbook's branches there. Following one part costs this latency.

use std::hint::black_box;
use std::time::Instant;

use kband::feeder::OutOfRange;
use kband::impact::{Hybrid, Integer, Kernel, Map, PartState, Single};

use super::{median, textbook};
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;

/// An orbit to follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chain {
    /// Name of its regime.
    pub name: &'static str,
    /// k of the track.
    pub k: f64,
    /// Restitution of the part.
    pub restitution: f64,
}

/// The orbits: a lock, chaos in gear, and a lively part that flies over many cycles.
pub const CHAINS: [Chain; 3] = [
    Chain {
        name: "lock",
        k: 0.43,
        restitution: 0.2,
    },
    Chain {
        name: "chaos",
        k: 0.34,
        restitution: 0.2,
    },
    Chain {
        name: "wide chaos",
        k: 0.2,
        restitution: 0.95,
    },
];

/// Start of turn `n`: the starts are close together, no turn repeats another, and no timed orbit
/// rests.
fn start(n: u32) -> PartState {
    PartState {
        phase: 0.7,
        velocity: 0.36 + 1e-4 * f64::from(n),
    }
}

/// Impacts before the timing, and impacts per turn.
const SETTLING: u32 = 1000;
const IMPACTS: u32 = 4096;

/// A kernel on a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timed {
    /// Name of the kernel.
    pub kernel: &'static str,
    /// The orbit.
    pub chain: Chain,
    /// Nanoseconds for an impact, median of the turns.
    pub nanoseconds: f64,
}

/// Flies turn `n` of a chain; returns ns per impact.
type Turn = Box<dyn Fn(u32) -> f64>;

/// Times every kernel on every chain in turns.
pub fn timed(rounds: usize, desk: &Desk) -> Result<Vec<Timed>, Refusal> {
    let progress = Progress::new("bench", CHAINS.len() as u64);
    let mut lines = Vec::new();
    for chain in CHAINS {
        let kernels = kernels(chain)?;
        let mut times = vec![Vec::new(); kernels.len()];
        for n in 0..rounds as u32 {
            for ((_, turn), times) in kernels.iter().zip(&mut times) {
                desk.go_on()?;
                times.push(turn(n));
            }
        }
        let kernels = kernels.into_iter().zip(times);
        lines.extend(kernels.map(|((kernel, _), times)| Timed {
            kernel,
            chain,
            nanoseconds: median(times),
        }));
        progress.advance(1);
    }
    progress.finish();
    Ok(lines)
}

/// Every kernel, for one chain.
fn kernels(chain: Chain) -> Result<Vec<(&'static str, Turn)>, Refusal> {
    let Chain { k, restitution, .. } = chain;
    let by_textbook = move |state: PartState| {
        let flight = textbook::first_impact(k, state.phase, state.velocity);
        PartState {
            phase: flight.phase,
            velocity: restitution * flight.arrival,
        }
    };
    Ok(vec![
        ("textbook", turn(Ok, by_textbook)),
        kernel::<Map>(chain)?,
        kernel::<Hybrid>(chain)?,
        kernel::<Single>(chain)?,
        kernel::<Integer>(chain)?,
    ])
}

fn kernel<K: Kernel + 'static>(chain: Chain) -> Result<(&'static str, Turn), Refusal> {
    let kernel = K::build(chain.k, chain.restitution)?;
    let state = |start: PartState| K::state(start.phase, start.velocity);
    let next = move |state| kernel.impact(state).next;
    Ok((K::NAME, turn(state, next)))
}

/// The turns of a map from one state to the next.
fn turn<S: Copy + 'static>(
    state: impl Fn(PartState) -> Result<S, OutOfRange> + 'static,
    next: impl Fn(S) -> S + 'static,
) -> Turn {
    Box::new(move |n| {
        // Every start is a state of every kernel.
        let Ok(mut state) = state(start(n)) else {
            return f64::NAN;
        };
        // Long enough to reload the caches after the other turns.
        for _ in 0..SETTLING {
            state = next(state);
        }
        let begun = Instant::now();
        for _ in 0..IMPACTS {
            state = next(state);
        }
        black_box(state);
        begun.elapsed().as_nanos() as f64 / f64::from(IMPACTS)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An orbit at rest would count flights of zero length.
    #[test]
    fn no_chain_rests() {
        for chain in CHAINS {
            let map = Map::build(chain.k, chain.restitution).unwrap();
            for n in 0..100 {
                let mut state = start(n);
                for _ in 0..SETTLING + IMPACTS {
                    let impact = map.impact(state);
                    assert!(impact.flight > 0.0, "{chain:?} {n}: {state:?}");
                    state = impact.next;
                }
            }
        }
    }
}
