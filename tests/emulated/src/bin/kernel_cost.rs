//! Instructions per impact of the board's kernel, one line per workload:
//! `instructions KERNEL WORKLOAD COUNT`. Run it with the emulator's clock on instructions.
//!
//! The kernel on one tone also runs orbits over the whole range of k and restitution. The most
//! expensive orbit that never rests is printed with its launch.
#![cfg_attr(target_os = "none", no_std, no_main)]

kband_emulated::image!(run);

#[cfg(not(target_os = "none"))]
fn run() {
    kband_emulated::say!("nothing counts instructions at the desk");
}

#[cfg(target_os = "none")]
fn run() {
    use cost::{measure, sweep};
    use kband_emulated::kernels::{
        CHATTER, ORBITS, WAVE_CHATTER, WAVES, begin, begin_on_tones, track, track_on_tones,
    };

    let counter = kband_emulated::Counter::start();
    let one = measure(&counter, "f32", (ORBITS, CHATTER), begin, track);
    // Bounds: the counted value, and 3 % for another compiler.
    let worst = one.worst.max(sweep(&counter));
    assert!(one.orbits <= 195, "{}", one.orbits);
    assert!(one.set_up <= 680, "{}", one.set_up);
    assert!(worst <= 311, "{worst}");
    let waves = (WAVES, WAVE_CHATTER);
    let two = measure(&counter, "f32-tones", waves, begin_on_tones, track_on_tones);
    // A second tone may double the cost.
    let costs = [two.orbits, two.high, two.low].into_iter();
    for (two, one) in costs.zip([one.orbits, one.high, one.low]) {
        assert!(100 * two <= 206 * one, "{two} for {one}");
    }
}

#[cfg(target_os = "none")]
mod cost {
    use core::hint::black_box;

    use kband::impact::{Single, SingleState};
    use kband_emulated::kernels::{TRACKS, begin, fall, fly, states};
    use kband_emulated::{Counter, say};

    /// A kernel and a state.
    type Start = (Single, SingleState);

    /// Instructions per impact.
    pub struct Cost {
        /// Of the most expensive orbit that stays locked or chaotic.
        pub worst: u64,
        pub orbits: u64,
        pub set_up: u64,
        pub high: u64,
        pub low: u64,
    }

    /// Counts each workload: the orbits, one that chatters, and the tracks.
    #[inline(never)]
    pub fn measure<const N: usize, const V: usize>(
        counter: &Counter,
        name: &str,
        (orbits, chatter): ([[f64; V]; N], [f64; V]),
        begin: fn([f64; V]) -> Start,
        track: impl Fn(f64) -> Single + Copy,
    ) -> Cost {
        let costs = orbits.map(|values| {
            let cost = orbit(counter, begin(values));
            say!(
                "instructions {name} orbit-{}-{} {cost}",
                values[0],
                values[1]
            );
            cost
        });
        let orbits = costs.iter().sum::<u64>() / N as u64;
        let chatter = orbit(counter, begin(chatter));
        let set_up = counter.count(|| {
            for k in TRACKS {
                black_box(track(black_box(k)));
            }
        }) / TRACKS.len() as u64;
        let kernels = TRACKS.map(track);
        // Mean cost of one impact from each state.
        let falls = |top| {
            let states = states::<Single>(top);
            counter.count(|| {
                black_box(fall(&kernels, &states));
            }) / states.len() as u64
        };
        let (high, low) = (falls(20.0), falls(3.0));
        say!("instructions {name} orbits {orbits}, chatter {chatter}, set-up {set_up}");
        say!("instructions {name} high {high}, low {low}");
        Cost {
            worst: costs.into_iter().max().unwrap_or(0),
            orbits,
            set_up,
            high,
            low,
        }
    }

    /// Largest cost over many orbits that do not rest, for 49 values of k and 18 of restitution.
    /// They start near each lock of the first three orders and at one more state.
    #[inline(never)]
    pub fn sweep(counter: &Counter) -> u64 {
        let (mut worst, mut at, mut orbits) = (0, [0.0; 4], 0);
        for i in 0..49 {
            for j in 0..18 {
                let (k, restitution) = (0.02 + 0.02 * f64::from(i), 0.1 + 0.05 * f64::from(j));
                let locks = (1..=3).filter_map(|order| lock(k, restitution, order));
                for [phase, velocity] in locks.chain([[2.0, 3.0]]) {
                    let values = [k, restitution, phase, velocity];
                    if let Some(cost) = tireless(counter, values) {
                        orbits += 1;
                        if cost > worst {
                            (worst, at) = (cost, values);
                        }
                    }
                }
            }
        }
        let [k, restitution, phase, velocity] = at;
        say!("instructions f32 worst {worst}");
        say!("of {orbits} orbits: k {k:.2}, R {restitution:.2} from {phase:.4}, {velocity:.4}");
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
    fn tireless(counter: &Counter, values: [f64; 4]) -> Option<u64> {
        /// Number of impacts over which the cost is averaged.
        const COUNT: u32 = 200;
        let (kernel, start) = begin::<Single>(values);
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

    fn orbit(counter: &Counter, (kernel, start): Start) -> u64 {
        let count = 500;
        // The first impacts are the transient.
        let settled = fly(&kernel, start, 100);
        counter.count(|| {
            black_box(fly(&kernel, settled, count));
        }) / u64::from(count)
    }
}
