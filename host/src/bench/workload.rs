//! Workloads: launches for measuring the kernels.

use std::f64::consts::TAU;

use kband::impact::{Kernel, Map, Orbit, OrbitEvent, PartState};

use crate::random::SplitMix;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Launch {
    pub k: f64,
    pub restitution: f64,
    pub state: PartState,
}

/// A workload: its name, and a function of the approximate number of launches.
pub type Workload = (&'static str, fn(usize) -> Vec<Launch>);

/// Every workload.
///
/// - high, low: velocities up to 20 and up to 3, k from 0.02 to 0.98.
/// - chatter: velocities from 1e-6 to 1, log-uniform: hops on the way to rest.
/// - sweep: settled orbits over a grid of k (0.02 to 0.98) and restitution (0.5 to 0.99).
pub const WORKLOADS: [Workload; 4] = [
    ("high", |count| draw(count, |part| 20.0 * part)),
    ("low", |count| draw(count, |part| 3.0 * part)),
    ("chatter", |count| {
        draw(count, |part| 10_f64.powf(-6.0 * part))
    }),
    ("sweep", sweep),
];

fn draw(count: usize, velocity: fn(f64) -> f64) -> Vec<Launch> {
    // Random order: a CPU would learn to predict the branches of an evenly spaced sequence.
    let mut random = SplitMix(1);
    let launch = || {
        let restitution = 0.5 + 0.49 * random.uniform();
        let k = 0.02 + 0.96 * random.uniform();
        let phase = TAU * random.uniform();
        let velocity = velocity(random.uniform());
        Some(Launch {
            k,
            restitution,
            state: PartState { phase, velocity },
        })
    };
    // A chatter with a closed form has no hops.
    let hops = |launch: &Launch| {
        let map = Map::build(launch.k, launch.restitution);
        map.is_ok_and(|map| map.time_to_rest(launch.state).is_none())
    };
    let launches = std::iter::from_fn(launch).filter(hops);
    launches.take(count).collect()
}

/// Every third launch of settled orbits, without the precomputed flight after lift-off.
fn sweep(count: usize) -> Vec<Launch> {
    const RESTITUTIONS: [f64; 8] = [0.5, 0.57, 0.64, 0.71, 0.78, 0.85, 0.92, 0.99];
    const TRACKS: usize = 64;
    const SETTLING: usize = 300;
    let each = count.div_ceil(RESTITUTIONS.len() * TRACKS);
    let mut launches = Vec::new();
    for restitution in RESTITUTIONS {
        for n in 0..TRACKS {
            let k = 0.02 + 0.96 * (n as f64 + 0.5) / TRACKS as f64;
            let Ok(map) = Map::build(k, restitution) else {
                continue;
            };
            let start = PartState::new(1.0, 2.0);
            let mut orbit = Orbit::new(&map, start);
            let hop = || {
                let state = orbit.state();
                let hops = matches!(orbit.next()?, OrbitEvent::Impact(_)) && state.velocity > 0.0;
                Some(hops.then_some(Launch {
                    k,
                    restitution,
                    state,
                }))
            };
            let hops = std::iter::from_fn(hop).skip(SETTLING).take(9 * each);
            launches.extend(hops.flatten().step_by(3).take(each));
        }
    }
    launches
}
