//! Workloads: the launches on which the kernels are measured.

use std::f64::consts::TAU;

use kband::impact::batch::LANES;
use kband::impact::{
    Contact, Kernel, Map, Orbit, OrbitEvent, PartState, Tone, WaveKernel, WaveMap, WaveOrbit,
};

/// A launch: the map and the state it starts from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Launch {
    /// k of the track.
    pub k: f64,
    /// Restitution of the part.
    pub restitution: f64,
    /// Phase and velocity.
    pub state: PartState,
}

/// A set of launches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Workload {
    /// Velocities up to 20, k from 0.02 to 0.98.
    High,
    /// Velocities up to 3, k from 0.02 to 0.98.
    Low,
    /// Velocities from 1e-6 to 1, log-uniform: hops on the way to rest.
    Chatter,
    /// Orbits over a grid of k (0.02 to 0.98) and restitution (0.5 to 0.99), after their
    /// transients.
    Sweep,
}

/// Restitutions of the sweep.
pub const SWEEP_RESTITUTIONS: [f64; 8] = [0.5, 0.57, 0.64, 0.71, 0.78, 0.85, 0.92, 0.99];
/// Values of k of the sweep.
pub const SWEEP_K: usize = 64;
/// Orbits per restitution in the complete sweep: eight starts for each k.
pub const SWEEP_ORBITS: usize = 8 * SWEEP_K;
/// Impacts of an orbit of the sweep before its first launch.
pub const SETTLING: u32 = 300;

impl Workload {
    /// Every workload.
    pub const ALL: [Self; 4] = [Self::High, Self::Low, Self::Chatter, Self::Sweep];

    /// Name in tables and JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::High => "high",
            Self::Low => "low",
            Self::Chatter => "chatter",
            Self::Sweep => "sweep",
        }
    }

    /// At least `count` launches, the same in every run.
    #[must_use]
    pub fn launches(self, count: usize) -> Vec<Launch> {
        if self == Self::Sweep {
            return sweep(count);
        }
        let mut launches = Vec::with_capacity(count);
        let mut random = Random(1);
        while launches.len() < count {
            let restitution = 0.5 + 0.49 * random.part();
            let k = 0.02 + 0.96 * random.part();
            let phase = TAU * random.part();
            let part = random.part();
            let velocity = match self {
                Self::High => 20.0 * part,
                Self::Low => 3.0 * part,
                _ => 10_f64.powf(-6.0 * part),
            };
            let state = PartState { phase, velocity };
            // A chatter with a closed form has no hops.
            let flies = Contact::build(k, restitution)
                .is_ok_and(|contact| contact.time_to_rest(state).is_none());
            if flies {
                launches.push(Launch {
                    k,
                    restitution,
                    state,
                });
            }
        }
        launches
    }
}

/// Launches per track of several tones: as many as lanes in a block, so that both sort the same
/// number.
pub const TOGETHER: usize = LANES;

impl Workload {
    /// At least `count` launches on tracks of several tones, [`TOGETHER`] per track.
    ///
    /// They are those of one tone, with k and restitution of the first of each group; the sweep
    /// uses orbits on these tones.
    #[must_use]
    pub fn launches_on(self, tones: [Tone; 2], count: usize) -> Vec<Launch> {
        if self == Self::Sweep {
            return sweep_on(tones, count);
        }
        let mut launches = self.launches(count);
        for together in launches.chunks_mut(TOGETHER) {
            let Launch { k, restitution, .. } = together[0];
            for launch in together {
                (launch.k, launch.restitution) = (k, restitution);
            }
        }
        launches
    }
}

/// Random numbers (SplitMix64), the same in every run.
///
/// A CPU would learn an evenly spread sequence and predict the branches of the slowest kernel.
struct Random(u64);

impl Random {
    /// Uniform in 0..1.
    fn part(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// The start of an orbit of the sweep.
#[must_use]
pub fn sweep_start(n: usize) -> (f64, PartState) {
    let k = 0.02 + 0.96 * ((n % SWEEP_K) as f64 + 0.5) / SWEEP_K as f64;
    let state = PartState {
        phase: 1.0 + 0.7 * (n / SWEEP_K % 8) as f64,
        velocity: 2.0,
    };
    (k, state)
}

/// States along the orbits of the sweep.
fn sweep(count: usize) -> Vec<Launch> {
    let orbits = SWEEP_RESTITUTIONS.len() * SWEEP_K;
    let each = count.div_ceil(orbits);
    let mut launches = Vec::with_capacity(orbits * each);
    for restitution in SWEEP_RESTITUTIONS {
        for n in 0..SWEEP_K {
            let (k, start) = sweep_start(n);
            let Ok(map) = Map::build(k, restitution) else {
                continue;
            };
            let mut orbit = Orbit::new(&map, start);
            let mut impacts = 0;
            while impacts < SETTLING as usize + 3 * each + 6 {
                let state = orbit.state();
                match orbit.next() {
                    Some(OrbitEvent::Impact(_)) => {
                        impacts += 1;
                        // The flight after lift-off is precomputed and needs no search.
                        if impacts > SETTLING as usize && impacts % 3 == 0 && state.velocity > 0.0 {
                            launches.push(Launch {
                                k,
                                restitution,
                                state,
                            });
                        }
                    }
                    Some(_) => {}
                    None => break,
                }
            }
        }
    }
    launches
}

/// States along orbits on several tones, over the k and restitutions of [`sweep`], grouped by k.
fn sweep_on(tones: [Tone; 2], count: usize) -> Vec<Launch> {
    let each = count.div_ceil(SWEEP_K * TOGETHER) * TOGETHER / SWEEP_RESTITUTIONS.len();
    let mut launches = Vec::with_capacity(SWEEP_K * SWEEP_RESTITUTIONS.len() * each);
    for n in 0..SWEEP_K {
        let (k, start) = sweep_start(n);
        let first = launches.len();
        for restitution in SWEEP_RESTITUTIONS {
            let Ok(map) = WaveMap::on_tones(tones, k, restitution) else {
                continue;
            };
            let mut orbit = WaveOrbit::new(&map, start);
            let (mut impacts, mut taken) = (0, 0);
            // The state at which the flight begins, without those after lift-off.
            let mut state = None;
            while taken < each && impacts < SETTLING as usize + 9 * each {
                match orbit.next() {
                    Some(OrbitEvent::Impact(impact)) => {
                        impacts += 1;
                        if let Some(state) =
                            state.filter(|_| impacts % 3 == 0 && impacts > SETTLING as usize)
                        {
                            taken += 1;
                            launches.push(Launch {
                                k,
                                restitution: SWEEP_RESTITUTIONS[0],
                                state,
                            });
                        }
                        state = Some(impact.next);
                    }
                    Some(_) => state = None,
                    None => break,
                }
            }
        }
        // Orbits that rest for ever leave gaps, which copies of other launches fill.
        let flown = launches.len() - first;
        if flown == 0 {
            continue;
        }
        let missing = (TOGETHER - flown % TOGETHER) % TOGETHER;
        for m in 0..missing {
            launches.push(launches[first + m % flown]);
        }
    }
    launches
}
