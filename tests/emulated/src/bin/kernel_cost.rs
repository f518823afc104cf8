//! Instructions per impact of the kernels for microcontrollers, one line per kernel and workload:
//! `instructions KERNEL WORKLOAD m4f|m0 COUNT`. To be run with the emulator's clock on instructions.
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
        assert!(hybrid <= 480, "hybrid: {hybrid}");
        assert!(single <= 340, "f32: {single}");
    } else {
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
