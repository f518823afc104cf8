//! Instructions per impact of the kernels of the board, one line per kernel and workload:
//! `instructions KERNEL WORKLOAD COUNT`. Run it with the emulator's clock on instructions.
//!
//! A kernel on one tone also runs orbits over the whole range of k and restitution. The most
//! expensive orbit that never rests is printed with its launch.
#![cfg_attr(target_os = "none", no_std, no_main)]

kband_emulated::image!(run);

#[cfg(not(target_os = "none"))]
fn run() {
    kband_emulated::say!("nothing counts instructions at the desk");
}

#[cfg(target_os = "none")]
fn run() {
    use kband::impact::Single;

    let counter = kband_emulated::Counter::start();
    let single = cost::measure::<Single>(&counter);
    // Bounds: the counted value, and 3 % for another compiler.
    let worst = single.worst.max(cost::sweep::<Single>(&counter));
    single.is_held("f32", [195, 680]);
    assert!(worst <= 311, "f32: {worst}");
    let single_on_tones = cost::measure_on_tones::<Single>(&counter);
    single_on_tones.is_held_on_tones(&single);
}

#[cfg(target_os = "none")]
mod cost {
    use core::hint::black_box;

    use kband::impact::WaveKernel;
    use kband_emulated::kernels::{
        CHATTER, Machine, ORBITS, TRACKS, WAVE_CHATTER, WAVES, begin, begin_on_tones, fall, fly,
        states, track, track_on_tones,
    };
    use kband_emulated::{Counter, say};

    /// Instructions per impact.
    pub struct Cost {
        /// Of the most expensive orbit that stays locked or chaotic.
        pub worst: u64,
        orbits: u64,
        set_up: u64,
        high: u64,
        low: u64,
    }

    impl Cost {
        /// Checks the mean cost of an impact on the orbits, and that of a set-up.
        pub fn is_held(&self, name: &str, [orbits, set_up]: [u64; 2]) {
            assert!(self.orbits <= orbits, "{name}: {}", self.orbits);
            assert!(self.set_up <= set_up, "{name}: {}", self.set_up);
        }

        /// A second tone may double the cost, with the same 3 %.
        pub fn is_held_on_tones(&self, one: &Self) {
            for (two, one) in [
                (self.orbits, one.orbits),
                (self.high, one.high),
                (self.low, one.low),
            ] {
                assert!(100 * two <= 206 * one, "{two} for {one}");
            }
        }
    }

    /// Counts each workload.
    #[inline(never)]
    pub fn measure<K: Machine>(counter: &Counter) -> Cost {
        let (name, mut orbits, mut worst) = (K::NAME, 0, 0);
        for values in ORBITS {
            let [k, restitution, ..] = values;
            let cost = orbit(counter, begin::<K>(values));
            say!("instructions {name} orbit-{k}-{restitution} {cost}");
            orbits += cost;
            worst = cost.max(worst);
        }
        let orbits = orbits / ORBITS.len() as u64;
        say!("instructions {name} orbits {orbits}");
        let cost = orbit(counter, begin::<K>(CHATTER));
        say!("instructions {name} chatter {cost}");
        let set_up = counter.count(|| {
            for k in TRACKS {
                black_box(track::<K>(black_box(k)));
            }
        }) / TRACKS.len() as u64;
        say!("instructions {name} set-up {set_up}");
        Cost {
            worst,
            orbits,
            set_up,
            high: falls(counter, "high", 20.0, track::<K>),
            low: falls(counter, "low", 3.0, track::<K>),
        }
    }

    /// Counts each workload on two tones.
    #[inline(never)]
    pub fn measure_on_tones<K: Machine + WaveKernel>(counter: &Counter) -> Cost {
        let (name, mut orbits, mut worst) = ("f32-tones", 0, 0);
        for values in WAVES {
            let [k, restitution, ..] = values;
            let cost = orbit(counter, begin_on_tones::<K>(values));
            say!("instructions {name} orbit-{k}-{restitution} {cost}");
            orbits += cost;
            worst = cost.max(worst);
        }
        let orbits = orbits / WAVES.len() as u64;
        say!("instructions {name} orbits {orbits}");
        let cost = orbit(counter, begin_on_tones::<K>(WAVE_CHATTER));
        say!("instructions {name} chatter {cost}");
        let set_up = counter.count(|| {
            black_box(begin_on_tones::<K>(black_box(WAVE_CHATTER)));
        });
        say!("instructions {name} set-up {set_up}");
        Cost {
            worst,
            orbits,
            set_up,
            high: falls(counter, "tones, high", 20.0, track_on_tones::<K>),
            low: falls(counter, "tones, low", 3.0, track_on_tones::<K>),
        }
    }

    /// Mean cost of one impact from each state.
    #[inline(never)]
    fn falls<K: Machine>(counter: &Counter, workload: &str, top: f64, track: fn(f64) -> K) -> u64 {
        let kernels = TRACKS.map(track);
        let states = states::<K>(top);
        let cost = counter.count(|| {
            black_box(fall(&kernels, &states));
        }) / states.len() as u64;
        say!("instructions {} {workload} {cost}", K::NAME);
        cost
    }

    /// Largest cost over many orbits that do not rest, for 49 values of k and 18 of restitution.
    /// They start near each lock of the first three orders and at one more state.
    #[inline(never)]
    pub fn sweep<K: Machine>(counter: &Counter) -> u64 {
        let (mut worst, mut at, mut orbits) = (0, [0.0; 4], 0);
        for i in 0..49 {
            for j in 0..18 {
                let (k, restitution) = (0.02 + 0.02 * f64::from(i), 0.1 + 0.05 * f64::from(j));
                let locks = (1..=3).filter_map(|order| lock(k, restitution, order));
                for [phase, velocity] in locks.chain([[2.0, 3.0]]) {
                    let values = [k, restitution, phase, velocity];
                    if let Some(cost) = tireless::<K>(counter, values) {
                        orbits += 1;
                        if cost > worst {
                            (worst, at) = (cost, values);
                        }
                    }
                }
            }
        }
        let name = K::NAME;
        say!("instructions {name} worst {worst}");
        let [k, restitution, phase, velocity] = at;
        say!(
            "the worst of {orbits} orbits of {name}: k {k:.2}, R {restitution:.2} from {phase:.4}, {velocity:.4}"
        );
        worst
    }

    /// Phase and velocity near a lock whose flight takes `order` turns.
    fn lock(k: f64, restitution: f64, order: u32) -> Option<[f64; 2]> {
        let turns = core::f64::consts::TAU * f64::from(order);
        let velocity = k * turns * restitution / (1.0 + restitution);
        let cosine = 0.5 * k * turns * (1.0 - restitution) / (1.0 + restitution);
        (cosine < 1.0 && velocity < 29.0).then(|| [libm::acos(cosine) + 1e-3, velocity])
    }

    /// Cost of an impact on a settled orbit; `None` where it comes to rest.
    fn tireless<K: Machine>(counter: &Counter, values: [f64; 4]) -> Option<u64> {
        /// Number of impacts over which the cost is averaged.
        const COUNT: u32 = 200;
        let (kernel, start) = begin::<K>(values);
        let settled = fly(&kernel, start, COUNT);
        let mut state = settled;
        for _ in 0..COUNT {
            let landing = kernel.land(state);
            if landing.steps == 0 {
                return None;
            }
            state = landing.next;
        }
        let cost = counter.count(|| {
            black_box(fly(&kernel, settled, COUNT));
        });
        Some(cost / u64::from(COUNT))
    }

    fn orbit<K: Machine>(counter: &Counter, (kernel, start): (K, K::State)) -> u64 {
        let count = 500;
        // The first impacts are the transient.
        let settled = fly(&kernel, start, 100);
        counter.count(|| {
            black_box(fly(&kernel, settled, count));
        }) / u64::from(count)
    }
}
