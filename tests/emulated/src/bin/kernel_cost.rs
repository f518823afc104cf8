//! Instructions per impact of the kernels for microcontrollers, one line per kernel and workload:
//! `instructions KERNEL WORKLOAD m4f|m0 COUNT`. To be run with the emulator's clock on instructions.
//!
//! A kernel on the CPU that it is meant for is also tried on orbits all over the range of k and
//! restitution; the worst of those that never rest is printed with the launch that leads to it.
#![cfg_attr(target_os = "none", no_std, no_main)]

kband_emulated::image!(run);

#[cfg(not(target_os = "none"))]
fn run() {
    kband_emulated::say!("nothing counts instructions at the desk");
}

#[cfg(target_os = "none")]
fn run() {
    use kband::impact::{Hybrid, Integer, Single};

    let counter = kband_emulated::Counter::start();
    let hybrid = cost::measure::<Hybrid>(&counter);
    let single = cost::measure::<Single>(&counter);
    let integer = cost::measure::<Integer>(&counter);
    // The bounds are for the CPU that the kernel is meant for.
    if cfg!(target_abi = "eabihf") {
        let hybrid = hybrid.max(cost::sweep::<Hybrid>(&counter));
        let single = single.max(cost::sweep::<Single>(&counter));
        assert!(hybrid <= 480, "hybrid: {hybrid}");
        assert!(single <= 340, "f32: {single}");
    } else {
        let integer = integer.max(cost::sweep::<Integer>(&counter));
        assert!(integer <= 3500, "integer: {integer}");
    }
}

#[cfg(target_os = "none")]
mod cost {
    use core::hint::black_box;

    use kband_emulated::kernels::{CHATTER, Machine, ORBITS, begin, fall, fly, states};
    use kband_emulated::{Counter, say};

    const CPU: &str = if cfg!(target_abi = "eabihf") {
        "m4f"
    } else {
        "m0"
    };

    /// Counts every workload; returns the count of the worst orbit that stays locked or chaotic.
    pub fn measure<K: Machine>(counter: &Counter) -> u64 {
        let name = K::NAME;
        let (mut sum, mut worst) = (0, 0);
        for values in ORBITS {
            let cost = orbit::<K>(counter, values);
            let [k, restitution, ..] = values;
            say!("instructions {name} orbit-{k}-{restitution} {CPU} {cost}");
            sum += cost;
            worst = cost.max(worst);
        }
        let mean = sum / ORBITS.len() as u64;
        say!("instructions {name} orbits {CPU} {mean}");
        let cost = orbit::<K>(counter, CHATTER);
        say!("instructions {name} chatter {CPU} {cost}");
        for (workload, top) in [("high", 20.0), ("low", 3.0)] {
            let (kernels, states) = states::<K>(top);
            let cost = counter.count(|| {
                black_box(fall(&kernels, &states));
            }) / states.len() as u64;
            say!("instructions {name} {workload} {CPU} {cost}");
        }
        worst
    }

    /// The worst of many orbits that do not rest: from next to each lock of the first three orders and
    /// from one more state, for 49 values of k and 18 of restitution.
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
        say!("instructions {name} worst {CPU} {worst}");
        let [k, restitution, phase, velocity] = at;
        say!(
            "the worst of {orbits} orbits of {name}: k {k:.2}, R {restitution:.2} from {phase:.4}, {velocity:.4}"
        );
        worst
    }

    /// Phase and velocity next to a lock, where the flight takes `order` turns.
    fn lock(k: f64, restitution: f64, order: u32) -> Option<[f64; 2]> {
        let turns = core::f64::consts::TAU * f64::from(order);
        let velocity = k * turns * restitution / (1.0 + restitution);
        let cosine = 0.5 * k * turns * (1.0 - restitution) / (1.0 + restitution);
        (cosine < 1.0 && velocity < 29.0).then(|| [libm::acos(cosine) + 1e-3, velocity])
    }

    /// The cost of an impact of an orbit that has settled; `None` where it comes to rest.
    fn tireless<K: Machine>(counter: &Counter, values: [f64; 4]) -> Option<u64> {
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

    fn orbit<K: Machine>(counter: &Counter, values: [f64; 4]) -> u64 {
        let count = 500;
        let (kernel, start) = begin::<K>(values);
        // The first impacts bring the orbit to where it stays.
        let settled = fly(&kernel, start, 100);
        counter.count(|| {
            black_box(fly(&kernel, settled, count));
        }) / u64::from(count)
    }
}
