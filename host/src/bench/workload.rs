//! Workloads: launches for measuring the kernels.

use std::f64::consts::TAU;

use kband::impact::{Kernel, Map, PartState};

use crate::random::SplitMix;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Launch {
    pub k: f64,
    pub restitution: f64,
    pub state: PartState,
}

type Workload = (&'static str, fn(usize) -> Vec<Launch>);

/// Every workload: its name, and a function of the approximate number of launches.
///
/// - high, low: velocities up to 20 and up to 3, k from 0.02 to 0.98.
/// - chatter: velocities from 1e-6 to 1, log-uniform: hops on the way to rest.
pub const WORKLOADS: [Workload; 3] = [
    ("high", |count| draw(count, |part| 20.0 * part)),
    ("low", |count| draw(count, |part| 3.0 * part)),
    ("chatter", |count| {
        draw(count, |part| 10_f64.powf(-6.0 * part))
    }),
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
