//! What an impact costs in a chain: one orbit, each impact from where the one before ended.
//!
//! Launches that know nothing of each other overlap in a CPU; those of an orbit wait for each other, and the textbook's
//! branches are predicted there. Who follows one part waits for a chain.

use std::hint::black_box;
use std::time::Instant;

use kband::impact::{Exact, Hybrid, Integer, Kernel, Map, PartState, Single};

use super::{median, textbook};
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;

/// An orbit that is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chain {
    /// What it does.
    pub name: &'static str,
    /// k of the track.
    pub k: f64,
    /// Restitution of the part.
    pub restitution: f64,
}

/// The orbits: a lock, chaos in gear, and a part that loses little and flies over many cycles.
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
        restitution: 0.9,
    },
];

/// Where each begins.
const START: PartState = PartState {
    phase: 0.7,
    velocity: 0.36,
};
/// Impacts before an orbit is timed, and of a turn.
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

/// An orbit under way: makes so many impacts.
type Orbit = Box<dyn FnMut(u32)>;

/// Times every kernel on every chain in turns.
pub fn timed(rounds: usize, desk: &Desk) -> Result<Vec<Timed>, Refusal> {
    let progress = Progress::new("bench", CHAINS.len() as u64);
    let mut lines = Vec::new();
    for chain in CHAINS {
        let mut orbits = orbits(chain)?;
        let mut times = vec![Vec::new(); orbits.len()];
        for _ in 0..rounds {
            for ((_, orbit), times) in orbits.iter_mut().zip(&mut times) {
                desk.go_on()?;
                // Another turn first, for what the others' turns have taken from the caches.
                orbit(IMPACTS);
                let begun = Instant::now();
                orbit(IMPACTS);
                times.push(begun.elapsed().as_nanos() as f64 / f64::from(IMPACTS));
            }
        }
        let kernels = orbits.into_iter().zip(times);
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

/// Every kernel on a chain, settled.
fn orbits(chain: Chain) -> Result<Vec<(&'static str, Orbit)>, Refusal> {
    let mut orbits = vec![
        ("textbook", by_textbook(chain)),
        kernel::<Exact>(chain)?,
        kernel::<Map>(chain)?,
        kernel::<Hybrid>(chain)?,
        kernel::<Single>(chain)?,
        kernel::<Integer>(chain)?,
    ];
    for (_, orbit) in &mut orbits {
        orbit(SETTLING);
    }
    Ok(orbits)
}

fn kernel<K: Kernel + 'static>(chain: Chain) -> Result<(&'static str, Orbit), Refusal> {
    let kernel = K::build(chain.k, chain.restitution)?;
    let mut state = K::state(START.phase, START.velocity)?;
    Ok((
        K::NAME,
        Box::new(move |impacts| {
            for _ in 0..impacts {
                state = kernel.impact(state).next;
            }
            state = black_box(state);
        }),
    ))
}

fn by_textbook(Chain { k, restitution, .. }: Chain) -> Orbit {
    let mut state = START;
    Box::new(move |impacts| {
        for _ in 0..impacts {
            let flight = textbook::first_impact(k, state.phase, state.velocity);
            state = PartState {
                phase: flight.phase,
                velocity: restitution * flight.arrival,
            };
        }
        state = black_box(state);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An orbit that rests would be timed as flights of nothing.
    #[test]
    fn no_chain_rests() {
        for chain in CHAINS {
            let map = Map::build(chain.k, chain.restitution).unwrap();
            let mut state = START;
            for n in 0..SETTLING + 22 * 2 * IMPACTS {
                let impact = map.impact(state);
                assert!(impact.flight > 1e-3, "{chain:?} {n}: {state:?}");
                state = impact.next;
            }
        }
    }
}
