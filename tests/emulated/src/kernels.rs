//! Workloads for the kernels, equal on every machine.

use kband::arithmetic::Noise;
use kband::impact::{
    Integer, IntegerState, Kernel, Landing, Single, SingleState, Tone, WaveKernel,
};

/// A kernel with a step in machine units.
pub trait Machine: Kernel + Copy {
    /// Computes one flight and its impact.
    fn land(&self, state: Self::State) -> Landing<Self::State>;
    /// The bits of a state.
    fn bits(state: Self::State) -> [u32; 2];
}

impl Machine for Integer {
    #[inline(always)]
    fn land(&self, state: IntegerState) -> Landing<IntegerState> {
        Integer::land(self, state)
    }
    fn bits(state: IntegerState) -> [u32; 2] {
        [state.phase.bits(), state.velocity.bits()]
    }
}

impl Machine for Single {
    #[inline(always)]
    fn land(&self, state: SingleState) -> Landing<SingleState> {
        Single::land(self, state)
    }
    fn bits(state: SingleState) -> [u32; 2] {
        [state.phase.bits(), state.velocity.to_bits()]
    }
}

/// k, restitution, phase and velocity of eleven orbits that stay locked or chaotic.
pub const ORBITS: [[f64; 4]; 11] = [
    [0.43, 0.2, 0.45, 0.45],
    [0.232, 0.2, 0.25, 0.486],
    [0.157, 0.2, 0.15, 0.49],
    [0.38, 0.2, 0.65, 0.4],
    [0.355, 0.2, 0.7, 0.37],
    [0.34, 0.2, 0.77, 0.36],
    [0.7, 0.5, 0.7, 1.47],
    [0.586, 0.5, 0.8, 1.23],
    [1.2, 0.8, 1.138, 3.351],
    [0.2, 0.9, 2.0, 3.0],
    [0.05, 0.9, 2.0, 3.0],
];

/// A chattering orbit from lift-off to rest: k, restitution, phase and velocity.
pub const CHATTER: [f64; 4] = [0.9, 0.5, 1.119_769_515, 0.0];

/// Seven orbits in gear, and two out of gear: k, restitution, phase, velocity, amplitude and angle
/// (rad) of the second tone.
pub const WAVES: [[f64; 6]; 9] = [
    [0.35, 0.2, 0.5, 0.45, 0.15, 2.356],
    [0.3, 0.2, 0.4, 0.35, 0.10, 2.487],
    [0.42, 0.3, 0.5, 0.6, 0.10, 2.487],
    [0.402, 0.3, 0.5, 0.6, 0.19, 2.70],
    [0.5, 0.4, 0.5, 0.9, 0.15, 2.356],
    [0.46, 0.5, 0.5, 0.96, 0.15, 2.2],
    [0.573, 0.5, 0.5, 1.2, 0.23, 2.60],
    [0.2, 0.9, 2.0, 3.0, 0.15, 2.356],
    [0.05, 0.9, 2.0, 3.0, 0.15, 2.356],
];

/// A chattering orbit on two tones, with two humps in a turn.
pub const WAVE_CHATTER: [f64; 6] = [0.9, 0.5, 1.119_769_515, 0.5, 0.3, 1.0];

/// Kernel and initial state of an orbit on two tones. It panics if the kernel refuses them.
pub fn begin_on_tones<K: Machine + WaveKernel>(
    [k, restitution, phase, velocity, amplitude, angle]: [f64; 6],
) -> (K, K::State) {
    let tones = [Tone { amplitude, angle }, Tone::default()];
    (
        K::on_tones(tones, k, restitution).expect("parameters within range"),
        K::state(phase, velocity).expect("a state within range"),
    )
}

/// Kernel and initial state of an orbit. It panics if the kernel refuses them.
pub fn begin<K: Machine>([k, restitution, phase, velocity]: [f64; 4]) -> (K, K::State) {
    (
        K::build(k, restitution).expect("parameters within range"),
        K::state(phase, velocity).expect("a state within range"),
    )
}

/// State after `count` impacts; after each rest the orbit restarts.
#[inline(never)]
pub fn fly<K: Machine>(kernel: &K, start: K::State, count: u32) -> K::State {
    (0..count).fold(start, |state, _| next(kernel, start, state))
}

#[inline(always)]
fn next<K: Machine>(kernel: &K, start: K::State, state: K::State) -> K::State {
    let landing = kernel.land(state);
    if landing.steps == 0 {
        start
    } else {
        landing.next
    }
}

/// Hash (FNV-1a) of the bits of every state of an orbit.
#[inline(never)]
fn hash<K: Machine>(kernel: &K, start: K::State, count: u32, mut hash: u32) -> u32 {
    let mut state = start;
    for _ in 0..count {
        state = next(kernel, start, state);
        for word in K::bits(state) {
            for byte in word.to_le_bytes() {
                hash = (hash ^ u32::from(byte)).wrapping_mul(16_777_619);
            }
        }
    }
    hash
}

/// Name of each kernel and hash of its orbits: eleven that do not rest and one that chatters, 10
/// 000 impacts each.
pub fn hashes() -> impl Iterator<Item = (&'static str, u32)> {
    [
        (Single::NAME, hash_orbits::<Single> as fn(u32) -> u32),
        (Integer::NAME, |count| hash_orbits::<Integer>(count / 10)),
        ("f32-tones", |count| hash_waves::<Single>(count / 4)),
    ]
    .into_iter()
    .map(|(name, hash)| (name, hash(10_000)))
}

fn hash_orbits<K: Machine>(count: u32) -> u32 {
    let orbits = ORBITS.iter().chain([&CHATTER]);
    orbits.fold(2_166_136_261, |sum, &orbit| {
        let (kernel, start) = begin::<K>(orbit);
        hash(&kernel, start, count, sum)
    })
}

/// Hash of the orbits on two tones, each also with a third tone.
fn hash_waves<K: Machine + WaveKernel>(count: u32) -> u32 {
    let orbits = WAVES.iter().chain([&WAVE_CHATTER]);
    orbits.fold(2_166_136_261, |sum, &orbit| {
        let (kernel, start) = begin_on_tones::<K>(orbit);
        let sum = hash(&kernel, start, count, sum);
        let [k, restitution, .., amplitude, angle] = orbit;
        let third = Tone::new(0.07, 5.74);
        let three = K::on_tones([Tone { amplitude, angle }, third], k, restitution);
        let three = three.expect("parameters within range");
        hash(&three, start, count / 2, sum)
    })
}

/// k of eight tracks.
pub const TRACKS: [f64; 8] = [0.06, 0.12, 0.2, 0.3, 0.42, 0.55, 0.7, 0.85];

/// Map of a track with restitution 0.8. It panics if the kernel refuses it.
pub fn track<K: Kernel>(k: f64) -> K {
    K::build(k, 0.8).expect("parameters within range")
}

/// The same map on two tones.
pub fn track_on_tones<K: WaveKernel>(k: f64) -> K {
    let second = Tone::new(0.15, 2.356);
    K::on_tones([second, Tone::default()], k, 0.8).expect("parameters within range")
}

/// 256 states on [`TRACKS`], with velocities up to `top`. It panics if the kernel refuses them.
pub fn states<K: Machine>(top: f64) -> [(K::State, u8); 256] {
    let mut noise = Noise::new(1);
    core::array::from_fn(|i| {
        let phase = f64::from(noise.uniform()) * core::f64::consts::TAU;
        let velocity = f64::from(noise.uniform()) * top;
        let state = K::state(phase, velocity).expect("a state within range");
        (state, (i & 7) as u8)
    })
}

/// Computes one impact from each state, and combines their bits, so the compiler can skip none.
#[inline(never)]
pub fn fall<K: Machine>(kernels: &[K; 8], states: &[(K::State, u8)]) -> u32 {
    let mut sum = 0_u32;
    for &(state, index) in states {
        let landing = kernels[usize::from(index & 7)].land(state);
        let [phase, velocity] = K::bits(landing.next);
        sum = sum.wrapping_add(phase ^ velocity);
    }
    sum
}
